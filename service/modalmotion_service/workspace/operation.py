"""The one registry of operations: each is done while its client waits, or as a job.

An operation is an async function of the owner's state, a request and who hears of its progress.
A request is all that the work depends on; what becomes a job is written out as JSON and taken up
again after a restart. Work that a client has waited for goes on for the job.
"""

import asyncio
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Final

from pydantic import BaseModel, PlainSerializer, PlainValidator, TypeAdapter

from modalmotion.errors import LostFileError
from modalmotion.mesh.facts import NO_FACTS
from modalmotion.progress import Progress, Reporter
from modalmotion.store import ResultStore
from modalmotion_service.http.negotiation import JSON
from modalmotion_service.schemas.from_core import JsonBody
from modalmotion_service.settings import Settings
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.upload import FactsAsJson, Part
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import Ending, JobRunner
from modalmotion_service.workspace.jobs import IdempotencyKeys, Job, Jobs
from modalmotion_service.workspace.spool import Spool, SpoolFile, require_room


@dataclass(frozen=True)
class Case:
    """A stored sequence as a request names it.

    Parameters
    ----------
    id : str
    label : str
        Empty where there is none.
    subject : str or None
    covariates : mapping of str to (float or str)
    """

    id: str
    label: str
    subject: str | None
    covariates: Annotated[
        Mapping[str, float | str], PlainValidator(dict), PlainSerializer(dict)
    ] = field(default_factory=dict)


@dataclass(frozen=True)
class Request:
    """All that an operation depends on.

    Parameters
    ----------
    query : BaseModel
        As its client stated it: of the model of the operation.
    media_type : str
        Of the answer; by default what its client accepts.
    sequence_id : str
    key : str or None
        Of a signature's parameters.
    ids : tuple of str
        Of other things that the work reads: a job about one of them ends with it.
    file : str
        Name of the upload in the spool.
    facts : Facts
        Stated beside the upload.
    parts : tuple of Part
        Of an upload of many.
    cases : tuple of Case
        Stored sequences with label, subject and covariates as they were known.
    reference : str
        Model or norm, or a template's id.
    name : str
        Of the work itself.
    """

    query: Any = field(default_factory=JsonBody)
    media_type: str = ""
    sequence_id: str = ""
    key: str | None = None
    ids: tuple[str, ...] = ()
    file: str = ""
    facts: FactsAsJson = NO_FACTS
    parts: tuple[Part, ...] = ()
    cases: tuple[Case, ...] = ()
    reference: str = ""
    name: str = ""

    def as_json(self) -> dict[str, Any]:
        """Write it as a job remembers it."""
        values = _REQUEST.dump_python(self, mode="json", exclude={"query"}, exclude_defaults=True)
        return {**values, "query": self.query.model_dump(mode="json", exclude_unset=True)}

    @staticmethod
    def from_json(values: Mapping[str, Any], query: type[BaseModel]) -> "Request":
        """Read what `as_json` gave."""
        stated = {"media_type": JSON, **values, "query": query(**values.get("query", {}))}
        return _REQUEST.validate_python(stated)


_REQUEST: Final = TypeAdapter(Request)


@dataclass(frozen=True)
class Outcome:
    """What an operation has made: the body of its answer, and where it is kept if it is.

    Parameters
    ----------
    content : bytes or Path
        A file is in the spool, and whoever has the outcome removes it.
    media_type : str
    status : int
    headers : dict
    link : str or None
        Of what is stored; a job without one keeps the content as a file.
    filled : tuple of str
        Facts of a stored sequence that are known by it.
    """

    content: bytes | Path
    media_type: str = JSON
    status: int = 200
    headers: Mapping[str, str] = field(default_factory=dict)
    link: str | None = None
    filled: tuple[str, ...] = ()


def made(
    answer: BaseModel,
    link: str,
    is_new: bool,
    *,
    filled: tuple[str, ...] = (),
    headers: Mapping[str, str] | None = None,
) -> Outcome:
    """Answer with what is stored now: 201 where it is new, 200 where it was known."""
    body = answer.model_dump_json().encode()
    headers = {"Location": link, **(headers or {})}
    return Outcome(body, JSON, 201 if is_new else 200, headers, link, filled)


def as_json(answer: BaseModel) -> Outcome:
    """Answer with a model as JSON."""
    return Outcome(answer.model_dump_json().encode())


@dataclass(frozen=True)
class State:
    """Everything open for one owner while the service runs.

    Parameters
    ----------
    settings : Settings
    store : ResultStore
    spool : Spool
    analysis : Analysis
    training_engine : Engine
        Where models are trained, apart from the short work of other requests.
    jobs : Jobs
    idempotency : IdempotencyKeys
    runner : Performance
    """

    settings: Settings
    store: ResultStore
    spool: Spool
    analysis: Analysis
    training_engine: Engine
    jobs: Jobs
    idempotency: IdempotencyKeys
    runner: "Performance"


Work = Callable[[State, Request, Reporter], Awaitable[Outcome]]
OnStored = Callable[[State, Request, str], Awaitable[None]]


@dataclass(frozen=True)
class Operation:
    """One entry of the registry.

    Parameters
    ----------
    name : str
        Also the kind of its jobs.
    work : async function
    query : type of BaseModel
        What its client states.
    media_types : tuple of str
        That it answers with; the first by default.
    is_job : bool
        Whether no client waits for it.
    is_apart : bool
        Whether its jobs run in places of their own: hours of it keep nothing else waiting.
    on_stored : async function, optional
        Called with the link of what was stored, once that is noted: ends what the work began with.
    """

    name: str
    work: Work
    query: type[BaseModel]
    media_types: tuple[str, ...]
    is_job: bool = False
    is_apart: bool = False
    on_stored: OnStored | None = None


def operation(
    *media_types: str,
    query: type[BaseModel] = JsonBody,
    **how: Any,
) -> Callable[[Work], Operation]:
    """Make an operation of a function, under its name."""

    def made(work: Work) -> Operation:
        name = getattr(work, "__name__", "").replace("_", "-")
        return Operation(name, work, query, media_types or (JSON,), **how)

    return made


class Performance(JobRunner):
    """Operations of one owner under way: for a client who waits, then as a job, if any.

    Parameters
    ----------
    operations : mapping of str to Operation
    settings : Settings
    jobs : Jobs
    n_workers : int
    n_apart : int
        Jobs at once of a kind that runs in places of its own.
    """

    state: State
    """Of the owner; set once it is there."""

    def __init__(
        self,
        operations: Mapping[str, Operation],
        settings: Settings,
        jobs: Jobs,
        n_workers: int,
        n_apart: int,
    ) -> None:
        apart = {name: n_apart for name, what in operations.items() if what.is_apart}
        retry_seconds = 3600.0 * settings.retry_hours
        super().__init__(jobs, 2 * n_workers, settings.max_unfinished_jobs, apart, retry_seconds)
        self._operations = operations
        self._left: dict[str, asyncio.Task[Outcome]] = {}
        self._listeners: dict[str, Reporter] = {}

    async def perform(
        self,
        wait: float | None,
        what: Operation,
        request: Request,
        file: SpoolFile | None = None,
    ) -> Outcome | Job:
        """Wait for work as long as client and settings allow, then leave it to a job.

        Where nothing is kept there are no jobs, and it is waited for to its end.

        Parameters
        ----------
        wait : float or None, s
            For which the client would; 0 for a job at once.
        what : Operation
        request : Request
        file : SpoolFile, optional
            The upload, which is the job's from then on where there is one.
        """
        state = self.state
        request = replace(request, name=state.spool.new_path().name)
        if file is not None:
            request = replace(request, file=file.path.name, facts=file.facts, parts=file.parts)
        work = what.work(state, request, partial(self._tell, request.name))
        if state.settings.stateless:
            # Another replica would not know the job; the work has limits of its own.
            return await work
        task = None if wait == 0 or what.is_job else asyncio.ensure_future(work)
        most = state.settings.wait_seconds
        try:
            if task is None:
                work.close()  # type: ignore[attr-defined]
            else:
                await asyncio.wait([task], timeout=most if wait is None else min(wait, most))
                if task.done():
                    outcome = task.result()
                    if what.on_stored is not None and outcome.link is not None:
                        await what.on_stored(state, request, outcome.link)
                    return outcome
                self._left[request.name] = task
            # The file of its result is kept for hours, whoever asked.
            state.analysis.quota.require()
            if file is not None:
                # Acknowledged before it is read, it must outlive a crash.
                await asyncio.to_thread(file.make_durable)
            job = await self.start(what.name, request.as_json(), instead_of=task)
        except BaseException:
            self._left.pop(request.name, None)
            if task is not None:
                task.cancel()
            raise
        if file is not None:
            file.is_left = True
        return job

    async def do(self, job: Job, report: Reporter) -> dict[str, Any]:
        """Do an operation as a job, or wait for the work that was left to it; gives its result."""
        what, state = self._operations[job.kind], self.state
        request = Request.from_json(job.request, what.query)
        if request.file:
            require_spooled(state.spool, request.file)
        self._listeners[request.name] = report
        task = self._left.pop(request.name, None)
        if task is None:
            task = asyncio.ensure_future(what.work(state, request, report))
        try:
            outcome = await task
        finally:
            task.cancel()
            self._listeners.pop(request.name, None)
        result: dict[str, Any] = {} if outcome.link is None else {"link": outcome.link}
        if outcome.link is None or isinstance(outcome.content, Path):
            path = outcome.content
            if isinstance(path, bytes):
                data, path = path, state.spool.new_path()
                await asyncio.to_thread(path.write_bytes, data)
            headers = dict(outcome.headers)
            result |= {"file": path.name, "media_type": outcome.media_type, "headers": headers}
        return result

    def ending(self, job: Job) -> Ending | None:
        """Give what the operation of a job ends with, if anything."""
        what = self._operations[job.kind]
        if (on_stored := what.on_stored) is None:
            return None
        request = Request.from_json(job.request, what.query)
        return lambda result: on_stored(self.state, request, result["link"])

    def clean_up(self, request: Any) -> None:
        """Remove the upload of a job."""
        if "file" in request:
            self.state.spool.remove(request["file"])

    def require_store(self) -> None:
        """Raise StoreError while the spool has no room."""
        require_room(self.state.spool.folder)

    def _tell(self, name: str, progress: Progress) -> None:
        if (listener := self._listeners.get(name)) is not None:
            listener(progress)


def require_spooled(spool: Spool, name: str) -> Path:
    """Find the file that came with a job.

    Raises
    ------
    LostFileError
        If it is gone.
    """
    path = spool.at(name)
    if not path.is_file():
        raise LostFileError(
            "The file that came with this job is lost: it was stored until the job's end.",
            remedy="Send the request again; and look after the disk of the data folder.",
        )
    return path
