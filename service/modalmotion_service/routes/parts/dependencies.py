"""Dependencies of handlers, as annotated types."""

from __future__ import annotations

from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import replace
from typing import Annotated, Final

from fastapi import Depends, Header, Request
from fastapi.exceptions import RequestValidationError
from starlette.datastructures import FormData, UploadFile

from modalmotion.errors import MalformedFileError
from modalmotion.facts import facts_from_texts, is_fact
from modalmotion.store import ResultStore
from modalmotion_service.access.keys import key_required
from modalmotion_service.access.principal import principal_of
from modalmotion_service.http.forms import received_form
from modalmotion_service.http.many_files import ManyFiles
from modalmotion_service.http.preferences import Preference, parse_preference
from modalmotion_service.http.timing import stage
from modalmotion_service.routes.parts.form_fields import fields_of, spool_file_of
from modalmotion_service.routes.parts.openapi_parts import PREFER
from modalmotion_service.workspace.spool import SpoolFile
from modalmotion_service.workspace.state import State

LONGEST_PREFER: Final = 200
"""Characters of a header Prefer."""

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
    prefer: Annotated[str, Header(max_length=LONGEST_PREFER, description=PREFER)] = "",
) -> Preference:
    """Give how long the client wants to wait."""
    return parse_preference(prefer)


def preference_of(request: Request) -> Preference:
    """Give how long the client wants to wait, where no dependency says it.

    Raises
    ------
    RequestValidationError
        If the header is too long.
    """
    prefer = request.headers.get("prefer", "")
    if len(prefer) > LONGEST_PREFER:
        message = f"String should have at most {LONGEST_PREFER} characters"
        raise RequestValidationError(
            [
                {
                    "type": "string_too_long",
                    "loc": ("header", "prefer"),
                    "msg": message,
                    "ctx": {"max_length": LONGEST_PREFER},
                }
            ]
        )
    return parse_preference(prefer)


def receiving(
    *names: str, takes_facts: bool = True, takes_many: bool = False
) -> Callable[[Request, State], Awaitable[SpoolFile]]:
    """Make the dependency that receives an upload into the spool.

    It is the raw body, or a form's part named "file".

    Parameters
    ----------
    *names : str
        Fields that may stand in the form too.
    takes_facts : bool
        Whether facts may.
    takes_many : bool
        Whether it may be parts named "files", each a sequence, and a part named "manifest" that
        describes them.
    """

    async def receive_upload(request: Request, state: StateDependency) -> SpoolFile:
        file = await _receive(request, state, names, takes_facts=takes_facts, takes_many=takes_many)
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
    request: Request,
    state: State,
    names: tuple[str, ...],
    *,
    takes_facts: bool,
    takes_many: bool,
) -> SpoolFile:
    # Only requests with an idempotency key are compared by their hash.
    hashed = "idempotency-key" in request.headers
    with stage("receive"):
        kind = request.headers.get("content-type", "").lower()
        if not kind.startswith("multipart/form-data"):
            return await state.spool.receive(request.stream(), hashed=hashed)
        # Before the form is received, not after.
        state.spool.require_reserve()
        many = None
        if takes_many:
            many = ManyFiles(state.spool.new_path(), state.settings.max_batch_files)
        try:
            async with received_form(request, state.spool.folder, many) as form:
                if many is not None and many.parts:
                    return await spool_file_of(form, many)
                part = _file_of(form)
                texts = fields_of(form, names, takes_facts=takes_facts)
                facts = facts_from_texts({name: texts[name] for name in texts if is_fact(name)})
                stated = {name: texts[name] for name in names if name in texts}
                file = await state.spool.receive(_pieces(part), hashed=hashed)
                return replace(file, facts=facts, names=stated)
        except BaseException:
            if many is not None:
                many.discard()
            raise


def _file_of(form: FormData) -> UploadFile:
    part = form.get("file")
    if not isinstance(part, UploadFile):
        raise MalformedFileError(
            "The form has no file part named 'file'.",
            remedy="Send one part named 'file', or the bytes as the raw body.",
        )
    return part


async def _pieces(part: UploadFile) -> AsyncIterator[bytes]:
    while piece := await part.read(_PIECE):
        yield piece


StoreDependency = Annotated[ResultStore, Depends(get_store)]
PreferenceDependency = Annotated[Preference, Depends(get_preference)]
FileDependency = Annotated[SpoolFile, Depends(receiving())]
FilesDependency = Annotated[SpoolFile, Depends(receiving(takes_many=True))]
BareFileDependency = Annotated[SpoolFile, Depends(receiving(takes_facts=False))]
RawFileDependency = Annotated[SpoolFile, Depends(receive_raw)]
NamedFileDependency = Annotated[SpoolFile, Depends(receiving("subject", "label"))]
