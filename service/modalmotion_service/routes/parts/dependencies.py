"""Dependencies of handlers, as annotated types."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from typing import Annotated

from fastapi import Depends, Header, Request
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import FormData, UploadFile

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.facts import column_of, facts_from_texts, is_fact
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


def receiving(
    *names: str, takes_facts: bool = True
) -> Callable[[Request, State], Awaitable[SpoolFile]]:
    """Make the dependency that receives an upload into the spool.

    It is the raw body, or a form's part named "file".

    Parameters
    ----------
    *names : str
        Fields that may stand in the form too.
    takes_facts : bool
        Whether facts may.
    """

    async def receive_upload(request: Request, state: StateDependency) -> SpoolFile:
        file = await _receive(request, state, names, takes_facts=takes_facts)
        # Handlers remove their upload; one that is never called because its query is not valid
        # cannot.
        request.state.remove_upload = file.remove
        return file

    return receive_upload


async def receive_raw(request: Request, state: StateDependency) -> SpoolFile:
    """Receive the raw body of a request into the spool."""
    with stage("receive"):
        file = await state.spool.receive(request.stream(), hashed=False)
    request.state.remove_upload = file.remove
    return file


async def _receive(
    request: Request, state: State, names: tuple[str, ...], *, takes_facts: bool
) -> SpoolFile:
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
            texts = _fields_of(form, names, takes_facts=takes_facts)
            facts = facts_from_texts({name: texts[name] for name in texts if is_fact(name)})
            stated = {name: texts[name] for name in names if name in texts}
            file = await state.spool.receive(_pieces(part), hashed=hashed)
            return replace(file, facts=facts, names=stated)


def _fields_of(form: FormData, names: tuple[str, ...], *, takes_facts: bool) -> dict[str, str]:
    """Read the fields of a form beside its file: facts by the names that columns of tables have.

    Raises
    ------
    RequestValidationError
        If one is not known here: it would be dropped.
    ParameterError
        If one is stated twice.
    """
    texts: dict[str, str] = {}
    for heading, value in form.multi_items():
        name = column_of(heading)
        if heading == "file" and not isinstance(value, str) and name not in texts:
            continue
        if not isinstance(value, str) or not ((takes_facts and is_fact(name)) or name in names):
            may_be = ", ".join(["file", *names])
            and_facts = " and facts" if takes_facts else ""
            raise RequestValidationError(
                [
                    {
                        "loc": ("form", heading[:80]),
                        "msg": f"A form has {may_be}{and_facts}; all else stands in the query, as "
                        f"?{heading[:80]}=...",
                    }
                ]
            )
        if name in texts:
            raise ParameterError(
                f"The form has two fields '{name[:80]}'.", remedy="Send one of them."
            )
        texts[name] = value
    return texts


async def _pieces(part: UploadFile) -> AsyncIterator[bytes]:
    while piece := await part.read(_PIECE):
        yield piece


StoreDependency = Annotated[ResultStore, Depends(get_store)]
PreferenceDependency = Annotated[Preference, Depends(get_preference)]
FileDependency = Annotated[SpoolFile, Depends(receiving())]
BareFileDependency = Annotated[SpoolFile, Depends(receiving(takes_facts=False))]
RawFileDependency = Annotated[SpoolFile, Depends(receive_raw)]
NamedFileDependency = Annotated[SpoolFile, Depends(receiving("subject", "label"))]
