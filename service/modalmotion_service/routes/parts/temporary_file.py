"""Answers with a file that was made for them alone."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from starlette.background import BackgroundTask
from starlette.responses import FileResponse


def temporary_file(path: Path, media_type: str, **options: Any) -> FileResponse:
    """Answer with a file and remove it, whatever becomes of the answer.

    Parameters
    ----------
    path : Path
    media_type : str
    **options
        As of `FileResponse`.
    """
    removal = BackgroundTask(path.unlink, missing_ok=True)
    return FileResponse(path, media_type=media_type, background=removal, **options)
