"""What handlers ask for, as annotated types."""

from __future__ import annotations

from typing import Annotated, cast

from fastapi import Depends, Request
from starlette.datastructures import UploadFile

from modalmotion.errors import MalformedFileError
from modalmotion.store import ResultStore
from modalmotion_service.analysis import Analysis
from modalmotion_service.settings import Settings


def get_settings(request: Request) -> Settings:
    """Give the settings the app was made with."""
    return cast("Settings", request.app.state.settings)


def get_store(request: Request) -> ResultStore:
    """Give the open result store."""
    return cast("ResultStore", request.app.state.store)


def get_analysis(request: Request) -> Analysis:
    """Give what turns sequences into results."""
    return cast("Analysis", request.app.state.analysis)


async def read_upload(request: Request) -> bytes:
    """Read an upload: the raw body, or the part named "file" of a form.

    Raises
    ------
    MalformedFileError
        If a form holds no such part.
    """
    if not request.headers.get("content-type", "").startswith("multipart/form-data"):
        # Joined once: request.body() would keep a second copy for the life of the request.
        return b"".join([chunk async for chunk in request.stream()])
    async with request.form(max_files=1, max_fields=20) as form:
        part = form.get("file")
        if not isinstance(part, UploadFile):
            raise MalformedFileError(
                "The form has no file part named 'file'.",
                remedy="Send one part named 'file', or the bytes as the raw body.",
            )
        return await part.read()


SettingsDependency = Annotated[Settings, Depends(get_settings)]
StoreDependency = Annotated[ResultStore, Depends(get_store)]
AnalysisDependency = Annotated[Analysis, Depends(get_analysis)]
Upload = Annotated[bytes, Depends(read_upload)]
