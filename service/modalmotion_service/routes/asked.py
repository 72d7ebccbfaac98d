"""What a call contains, whose store it concerns, its answer, and how both are described."""

import asyncio
import contextlib
import json
from collections.abc import Awaitable, Callable, Coroutine, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import Annotated, Any, Final, TypeVar

from fastapi import Depends, Header, Query
from fastapi import Request as HttpRequest
from pydantic import BaseModel
from starlette.background import BackgroundTask
from starlette.requests import ClientDisconnect
from starlette.responses import FileResponse, Response

from modalmotion.errors import StoreError
from modalmotion.mesh import facts_as_json
from modalmotion.store import ResultStore, index
from modalmotion_service.access.keys import key_required
from modalmotion_service.access.scopes import principal_of
from modalmotion_service.document import is_file
from modalmotion_service.errors import ConflictError, IdempotencyMismatchError
from modalmotion_service.http import gate
from modalmotion_service.http import negotiation as media
from modalmotion_service.schemas import from_core, general
from modalmotion_service.schemas.queries import CasesRequest, LabelledSequence
from modalmotion_service.workspace import jobs, spool
from modalmotion_service.workspace.operation import Case, Operation, Outcome, Request, State
from modalmotion_service.workspace.training import find_cases

_LOOK_SECONDS: Final = 0.2
_KEPT_HEADERS: Final = ("content-type", "location", "etag", "preference-applied")


Made = TypeVar("Made")


@dataclass(frozen=True)
class Asked:
    """A call, with the open state of its owner.

    Parameters
    ----------
    state : State
    http : fastapi.Request
    wait : float or None, s
        For which the client would wait; 0 for a job at once.
    """

    state: State
    http: HttpRequest
    wait: float | None

    @property
    def store(self) -> ResultStore:
        """The owner's store."""
        return self.state.store

    def media_type(self, *offered: str) -> str:
        """Choose the media type of the answer."""
        return media.best_type(self.http.headers.get("accept", "*/*"), offered)

    def note(self, *ids: str | None) -> None:
        """Name in the audit log what the call is about, where its path does not."""
        gate.note_ids(self.http, [one for one in ids if one is not None])

    def tagged(self, *parts: str) -> str:
        """Make the tag of an answer."""
        return media.tag_of(self.http.scope["route"].path, *parts)

    def knows(self, tag: str) -> Response | None:
        """Give the answer 304 where the client has what the tag represents."""
        is_known = media.is_known(self.http, tag)
        return Response(status_code=304, headers={"ETag": tag}) if is_known else None

    def json(self, answer: BaseModel, headers: Mapping[str, str] | None = None) -> Response:
        """Answer with a model as JSON, and its tag."""
        body = answer.model_dump_json()
        tag = media.tag_of(body)
        known = self.knows(tag) if self.http.method in ("GET", "HEAD") else None
        return known or Response(body, 200, {"ETag": tag, **(headers or {})}, media.JSON)

    async def do(
        self,
        what: Operation,
        request: Request,
        *,
        file: spool.SpoolFile | None = None,
        tag: Sequence[str] | None = None,
        key: str | None = None,
    ) -> Response:
        """Answer with what an operation makes, or 202 with a job that makes it.

        Parameters
        ----------
        what : Operation
        request : Request
        file : SpoolFile, optional
        tag : sequence of str, optional
            What the answer is made from beside the query: 304 where the client has it already.
        key : str, optional
            Idempotency key of the request.
        """
        if key is not None:
            make = partial(self.do, what, request, file=file, tag=tag)
            return await self.once(key, what, request, file, make)
        kind = request.media_type or what.media_types[0]
        if not request.media_type and len(what.media_types) > 1:
            kind = self.media_type(*what.media_types)
        request, headers = replace(request, media_type=kind), {}
        if tag is not None:
            headers["ETag"] = self.tagged(*tag, request.query.model_dump_json(), kind)
            if (known := self.knows(headers["ETag"])) is not None:
                return known
        self.note(getattr(request.query, "template", None))
        work = self.state.runner.perform(self.wait, what, request, file)
        done = await self.unless_left(work)
        if not isinstance(done, Outcome):
            answer = job_answer(done)
            headers = {"Location": answer.links["self"], "Retry-After": "1"}
            headers["Preference-Applied"] = "respond-async"
            return Response(answer.model_dump_json(), 202, headers, media.JSON)
        gate.note_facts(self.http, done.filled)
        headers = {**done.headers, **headers}
        if len(what.media_types) > 1:
            headers["Vary"] = "Accept"
        if isinstance(done.content, Path):
            return temporary_file(done.content, done.media_type, headers)
        return Response(done.content, done.status, headers, done.media_type)

    async def unless_left(self, work: Coroutine[Any, Any, Made]) -> Made:
        """Wait for work, and end it when the client leaves.

        What has become a job goes on.

        Raises
        ------
        ClientDisconnect
            If the client has left.
        """
        done = asyncio.ensure_future(work)
        try:
            while not (await asyncio.wait([done], timeout=_LOOK_SECONDS))[0]:
                if await self.http.is_disconnected():
                    done.cancel()
                    await asyncio.wait([done])
                    raise ClientDisconnect
            return done.result()
        finally:
            done.cancel()

    async def once(
        self,
        key: str | None,
        what: Operation,
        request: Request,
        file: spool.SpoolFile | None,
        make: Callable[[], Awaitable[Response]],
    ) -> Response:
        """Make an answer, or repeat the one made for the same idempotency key.

        Raises
        ------
        IdempotencyMismatchError
            If the key came before with another request.
        ConflictError
            If the first request is still under way.
        """
        if key is None:
            return await make()
        keys = self.state.idempotency
        facts = facts_as_json(request.facts if file is None else file.facts)
        said = request.query.model_dump_json() + json.dumps(facts)
        mark = media.tag_of(what.name, "" if file is None else file.sha256, said)
        known = await asyncio.to_thread(keys.claim, key, mark)
        if known is None:
            try:
                answer = await make()
            except BaseException:
                # What went wrong first is what the client is told.
                with contextlib.suppress(StoreError):
                    await asyncio.to_thread(keys.release, key)
                raise
            response = {
                "body": bytes(answer.body).decode(),
                "headers": {n: v for n, v in answer.headers.items() if n in _KEPT_HEADERS},
            }
            await asyncio.to_thread(keys.complete, key, answer.status_code, response)
            return answer
        if known.fingerprint != mark:
            raise IdempotencyMismatchError(
                "This Idempotency-Key came before with another request.",
                remedy="Use a new key for every new request.",
            )
        if known.status is None:
            raise ConflictError(
                "The first request with this Idempotency-Key is still under way.",
                remedy="Wait a second and send it again.",
            )
        return Response(
            known.response["body"],
            status_code=known.status,
            headers={**known.response["headers"], "Idempotency-Replayed": "true"},
        )

    async def about(
        self,
        wanted: CasesRequest,
        query: type[from_core.JsonBody],
        look: Callable[[ResultStore, Sequence[LabelledSequence], int], list[Case]] = find_cases,
        **more: Any,
    ) -> Request:
        """Make the request about the sequences that a body names, as they are known now."""
        most = self.state.settings.max_query_ids
        cases = await asyncio.to_thread(look, self.store, wanted.cases, most)
        ids = tuple(case.id for case in cases)
        self.note(*ids)
        stated = wanted.model_dump(include=set(query.model_fields), exclude_unset=True)
        return Request(query=query.model_validate(stated), ids=ids, cases=tuple(cases), **more)


async def get_state(request: HttpRequest) -> State:
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


async def _asked(request: HttpRequest) -> Asked:
    return Asked(await get_state(request), request, None)


async def _waiting(
    request: HttpRequest,
    wait: Annotated[
        float | None,
        Query(
            ge=0,
            le=1e6,
            description="Seconds after which it becomes a job; 0 for a job at once. The header "
            "Prefer does the same: wait=20, respond-async.",
        ),
    ] = None,
    prefer: Annotated[str, Header(max_length=200, include_in_schema=False)] = "",
) -> Asked:
    stated = media.preferred_wait(prefer)
    # Of both the sooner: a job at once is one, whatever else is said.
    wait = stated if wait is None or stated == 0 else wait
    return Asked(await get_state(request), request, wait)


AskedNow = Annotated[Asked, Depends(_asked)]
"""Of calls that are answered at once."""
AskedAny = Annotated[Asked, Depends(_waiting)]
"""Of calls that may become a job."""

IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=128,
        description="A request sent again with the same key is answered as the first time.",
    ),
]


def temporary_file(path: Path, media_type: str, headers: Mapping[str, str]) -> FileResponse:
    """Answer with a file that was made for it alone, and remove it after the answer."""
    removal = BackgroundTask(path.unlink, missing_ok=True)
    return FileResponse(path, 200, headers, media_type, background=removal)


def job_answer(job: jobs.Job, text: str | None = None) -> general.JobAnswer:
    """Write a job out, with what it is doing now in words."""
    here = f"/v1/jobs/{job.id}"
    # Noted a little before the job has succeeded.
    result = (job.state == general.JobState.SUCCEEDED and job.result) or {}
    return from_core.read_from(
        general.JobAnswer,
        job,
        text=text or None,
        result=f"{here}/result" if "file" in result else result.get("link"),
        links={"self": here},
    )


def page_of(names: list[str], limit: int, cursor: str | None) -> tuple[list[str], str | None]:
    """Give a page of sorted names, and the cursor for the next."""
    after = "" if cursor is None else index.from_cursor(cursor)[1]
    rest = [name for name in names if name > after]
    page = rest[:limit]
    return page, index.to_cursor("name", page[-1]) if len(rest) > limit else None


ACCEPTED: Final[dict[int | str, dict[str, Any]]] = {
    202: {"model": general.JobAnswer, "description": "Continued as a job; fetch the result later."}
}

EXAMPLES: Final[dict[str, Any]] = json.loads(
    files("modalmotion_service.routes").joinpath("examples.json").read_text()
)
"""Of each body, by the name of its model; and of what is in a path."""

_BINARY: Final = {"schema": {"type": "string", "format": "binary"}}
_TEXT: Final = {"schema": {"type": "string"}}
_OBJECT: Final = {"schema": {"type": "object"}}


def answers(
    *media_types: str,
    of: Any = None,
    status: int = 200,
    is_new: bool = False,
    waits: bool = True,
) -> dict[str, Any]:
    """Describe the answers of a call, for the router.

    Parameters
    ----------
    *media_types : str
        That it is given as.
    of : type, optional
        Model of JSON.
    status : int
        Of an answer at once.
    is_new : bool
        Whether 201 says that something was made, and 200 that it was known.
    waits : bool
        Whether it may become a job.
    """
    content = {
        kind: _OBJECT if kind == media.FHIR else _BINARY if is_file(kind) else _TEXT
        for kind in media_types
        if kind != media.JSON
    }
    first: dict[str, Any] = {"description": "The requested content."}
    if content:
        first["content"] = content
    responses: dict[int | str, dict[str, Any]] = {201 if is_new else status: first}
    if is_new:
        responses[200] = {"model": of, **first, "description": "Known already."}
    made: dict[str, Any] = {
        "status_code": 201 if is_new else status,
        "response_model": of,
        "responses": {**responses, **(ACCEPTED if waits else {})},
    }
    if of is None:
        made |= {"response_class": Response, "response_model": None}
    return made
