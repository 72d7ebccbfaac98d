"""Dependencies of handlers, as annotated types."""

from __future__ import annotations

from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Annotated

from fastapi import Depends, Header, Request
from starlette.datastructures import FormData, UploadFile

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.facts import Facts, column_of, facts_from_texts, is_fact
from modalmotion.store import ResultStore
from modalmotion_service.access.keys import key_required
from modalmotion_service.access.principal import principal_of
from modalmotion_service.http.forms import received_form
from modalmotion_service.http.preferences import Preference, parse_preference
from modalmotion_service.http.timing import stage
from modalmotion_service.routes.parts.openapi_parts import PREFER
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State

# Bytes at a time when a form's part is copied.
_PIECE = 1 << 20


# Coroutines, though some wait for nothing: FastAPI runs plain functions in threads, and each of
# the two switches costs more than the function.


async def get_state(request: Request) -> State:
    """Give the open state of the key's owner; nobody else's.

    Raises
    ------
    AuthenticationError
        If nobody was recognised: an open route has no data to give.
    """
    principal = principal_of(request.scope)
    if principal is None:
        raise key_required()
    state: State = await request.app.state.owners.state(principal.owner)
    return state


StateDependency = Annotated[State, Depends(get_state)]


async def get_store(state: StateDependency) -> ResultStore:
    """Give the open result store."""
    return state.store


async def get_preference(
    prefer: Annotated[str, Header(max_length=200, description=PREFER)] = "",
) -> Preference:
    """Give how long the client wants to wait."""
    return parse_preference(prefer)


async def receive_upload(request: Request, state: StateDependency) -> SpoolFile:
    """Receive an upload into the spool: the raw body, or a form's part named "file".

    Raises
    ------
    MalformedFileError
        If a form holds no such part.
    """
    file = await _receive(request, state)
    # Handlers remove their upload; one that is never called because its query is not valid
    # cannot.
    request.state.remove_upload = file.remove
    return file


async def _receive(request: Request, state: State) -> SpoolFile:
    # Only requests with an idempotency key are compared by their hash.
    hashed = "idempotency-key" in request.headers
    with stage("receive"):
        kind = request.headers.get("content-type", "").lower()
        if not kind.startswith("multipart/form-data"):
            return await state.spool.receive(request.stream(), hashed=hashed)
        # Before the form is received, not after.
        state.spool.require_reserve()
        async with received_form(request, state.spool.folder) as form:
            part = form.get("file")
            if not isinstance(part, UploadFile):
                raise MalformedFileError(
                    "The form has no file part named 'file'.",
                    remedy="Send one part named 'file', or the bytes as the raw body.",
                )
            facts = _facts_in(form)
            file = await state.spool.receive(_pieces(part), hashed=hashed)
            return replace(file, facts=facts)


def _facts_in(form: FormData) -> Facts:
    """Read the facts that fields of a form state, by the names that columns of tables have.

    Raises
    ------
    ParameterError
        If one cannot be read, or is stated twice.
    """
    texts: dict[str, str] = {}
    for heading, value in form.multi_items():
        name = column_of(heading)
        if isinstance(value, str) and is_fact(name):
            if name in texts:
                raise ParameterError(
                    f"The form has two fields '{name[:80]}'.", remedy="Send one of them."
                )
            texts[name] = value
    return facts_from_texts(texts)


async def _pieces(part: UploadFile) -> AsyncIterator[bytes]:
    while piece := await part.read(_PIECE):
        yield piece


StoreDependency = Annotated[ResultStore, Depends(get_store)]
PreferenceDependency = Annotated[Preference, Depends(get_preference)]
FileDependency = Annotated[SpoolFile, Depends(receive_upload)]
