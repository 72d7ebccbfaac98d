"""Work of one owner: tasks, files that they write, and signatures that many wait for."""

import asyncio
import json
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final, ParamSpec, TypeVar

from pydantic_core import from_json

from modalmotion.errors import (
    LostFileError,
    ModeCountError,
    NotFoundError,
    ParameterError,
    TopologyError,
    UnlikeCasesError,
)
from modalmotion.mesh import Facts, facts_as_json
from modalmotion.modes.topologies import MESH, SPHERE
from modalmotion.progress import Progress, Reporter, silent
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import parameters_from_json
from modalmotion.store import ResultStore, SequenceRecord
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.observation import stage
from modalmotion_service.work.engine import Engine
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.tasks import signatures
from modalmotion_service.work.tasks.files import Fitted, ProgressFile
from modalmotion_service.workspace.spool import Quota, Spool, SpoolFile, remove_with_beside

T = TypeVar("T")
A = TypeVar("A")


P = ParamSpec("P")


_POLL_SECONDS: Final = 0.25

USUAL: Final = SignatureParameters()
"""Parameters of the signature that a sequence has unasked."""


@dataclass(eq=False)
class Analysis:
    """Has workers do tasks of one owner, each within its tariff, and stores what they write.

    Parameters
    ----------
    store : ResultStore
    engine : Engine
        Where parsing and fitting happen.
    spool : Spool
        Where workers leave their output.
    tariff : Tariff
        Of the owner whose store it is.
    quota : Quota
        Of the same.
    """

    store: ResultStore
    engine: Engine
    spool: Spool
    tariff: Tariff
    quota: Quota

    async def work(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Have a worker do a task."""
        terms = self.tariff.terms(task, args)
        with stage("worker"):
            # Cancelling the wait cancels the future, and with it ends the worker's process.
            return await asyncio.wrap_future(self.engine.run(terms, task, *args, **kwargs))

    async def stored(self, put: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Have the store do something."""
        with stage("store"):
            return await asyncio.to_thread(put, *args, **kwargs)

    async def followed(self, report: Reporter, task: Callable[..., T], *args: Any) -> T:
        """Have a worker do a task whose last argument is a `ProgressFile`; report what it tells."""
        progress = self.spool.new_path()
        work, file = asyncio.ensure_future(self.work(task, *args, progress)), ProgressFile(progress)
        try:
            while not work.done():
                await asyncio.wait([work], timeout=_POLL_SECONDS)
                if (told := file.read()) is not None:
                    report(told)
            return await work
        finally:
            work.cancel()
            # Whoever would write it again has ended then.
            await asyncio.wait([work])
            SpoolFile(progress).remove()

    async def written(self, task: Callable[..., object], *args: Any) -> Path:
        """Have a worker write a file, which a task names last; gives it."""
        with self.output() as output:
            await self.work(task, *args, output)
        return output

    async def each(
        self,
        items: Sequence[A],
        work: Callable[[A], Awaitable[T]],
        report: Reporter,
        what: str,
    ) -> list[T]:
        """Do something for each of many, as many at a time as there are workers.

        Parameters
        ----------
        items : sequence
        work : async function
            The first that fails ends the others.
        report : callable
            Called with the stage "signature 3 of 9" where `what` is a signature.
        what : str
        """
        done: dict[int, T] = {}
        waiting = iter(enumerate(items))

        async def take() -> None:
            for number, item in waiting:
                done[number] = await work(item)
                report(Progress(len(done), len(items), f"{what} {len(done)} of {len(items)}"))

        try:
            async with asyncio.TaskGroup() as takers:
                for _ in range(self.engine.n_workers):
                    takers.create_task(take())
        except BaseExceptionGroup as failed:
            raise failed.exceptions[0] from None
        if len(done) < len(items):
            # Given up by the engine, as at the end of the service.
            raise asyncio.CancelledError
        return [done[number] for number in range(len(items))]

    @contextmanager
    def image(self) -> Iterator[Path]:
        """Name a file for a worker to write and the store to take; it is removed in the end.

        Raises
        ------
        StoreError
            If the owner may store no more.
        """
        self.quota.require()
        with self.output() as path:
            try:
                yield path
            finally:
                path.unlink(missing_ok=True)

    @contextmanager
    def output(self) -> Iterator[Path]:
        """Name a file for a worker to write; it is removed if the work fails."""
        path = self.spool.new_path()
        try:
            yield path
        except BaseException:
            # Also removes a dead worker's leftovers.
            remove_with_beside(path)
            raise

    def template_path(self, parameters: SignatureParameters) -> Path | None:
        """File of the template that parameters name; None where they name none.

        Raises
        ------
        NotFoundError
            If there is no template of that id.
        """
        if parameters.template is None:
            return None
        return self.store.template_path(parameters.template)

    def resolved(
        self, sequence_id: str, parameters: SignatureParameters
    ) -> tuple[SignatureParameters, Facts]:
        """Complete parameters by the facts that a fit reads; gives the sequence's facts too.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        record = self.store.sequence_record(sequence_id)
        parameters = parameters.with_facts(record.facts, record.topology, record.grid)
        return parameters, record.facts

    async def signature(
        self, sequence_id: str, parameters: SignatureParameters, report: Reporter = silent
    ) -> Path:
        """Give the file of a signature, made if it is missing or damaged.

        The landmarks are those that the facts of the sequence state now.
        """
        parameters, _ = self.resolved(sequence_id, parameters)

        path = await asyncio.to_thread(self.store.sound_signature_path, sequence_id, parameters.key)
        if path is None:
            with self.image() as image:
                await self._sign(sequence_id, parameters, image, report)
                path = await self.stored(
                    self.store.put_signature_image, image, sequence_id, parameters.key
                )
        return path

    @asynccontextmanager
    async def fitted(
        self,
        sequence_id: str,
        key: str | None,
        report: Reporter = silent,
        usual: SignatureParameters = USUAL,
    ) -> AsyncIterator[Fitted]:
        """Give a stored signature; without a key the usual one, for a while if it is not stored.

        Raises
        ------
        NotFoundError
            If there is no such sequence, or no such signature of it.
        LostFileError
            If its file is gone or damaged.
        """
        sequence = await asyncio.to_thread(self.store.sequence_path, sequence_id)
        if key is None:
            parameters, _ = self.resolved(sequence_id, usual)
        else:
            parameters = await self.parameters_of(sequence_id, key)
        path = await asyncio.to_thread(self.store.sound_signature_path, sequence_id, parameters.key)
        kept, template = path, self.template_path(parameters)
        record, track = self.store.sequence_record(sequence_id), self.track_path(sequence_id)
        with self.output() as passing:
            if path is None:
                if key is not None:
                    raise _lost(sequence_id)
                await self._sign(sequence_id, parameters, path := passing, report)
            try:
                yield Fitted(path, sequence, template, track, record)
            finally:
                if kept is None:
                    remove_with_beside(passing)

    async def parameters_of(self, sequence_id: str, key: str) -> SignatureParameters:
        """Give the parameters of a stored signature."""
        text = await self.rendered(sequence_id, key)
        return parameters_from_json(from_json(text)["parameters"])

    async def rendered(self, sequence_id: str, key: str) -> bytes:
        """Give a stored signature as the service's JSON, but for the facts of its sequence."""
        text = await asyncio.to_thread(self.store.rendered_signature, sequence_id, key)
        if text is not None:
            return text
        path = await asyncio.to_thread(self.store.sound_signature_path, sequence_id, key)
        if path is None:
            raise _lost(sequence_id)
        file = path.relative_to(self.store.root).as_posix()
        text = await self.work(signatures.render, path, f"{sequence_id}-{key}", file)
        await asyncio.to_thread(self.store.keep_rendered, sequence_id, key, text)
        return text

    async def of_one_kind(
        self, sequence_ids: list[str], parameters: SignatureParameters, paths: list[Path]
    ) -> list[Path]:
        """Take spring modes of all closed surfaces of a mesh of which some have them by shape."""
        if parameters.fixes_kind:
            return paths
        kinds = await self.work(signatures.kinds_of, paths)
        meshes = {mesh for _, mesh in kinds if mesh}
        springs, chosen = replace(parameters, topology=MESH), []
        for sequence_id, path, (surface, _) in zip(sequence_ids, paths, kinds, strict=True):
            chosen.append(path)
            is_stated = self.store.sequence_record(sequence_id).topology is not None
            if meshes and surface == SPHERE.name and not is_stated:
                other = await self.signature(sequence_id, springs)
                ((_, mesh),) = await self.work(signatures.kinds_of, [other])
                chosen[-1] = other if mesh in meshes else path
        return chosen

    def completed(
        self, sequence_id: str, subject: str | None, label: str | None, facts: Facts, offered: Facts
    ) -> tuple[SequenceRecord, tuple[str, ...]]:
        """Fill in what is not known of a stored sequence; gives the names of that too.

        Raises
        ------
        ConflictError
            If something is known to be otherwise.
        """
        try:
            return self.store.complete_sequence(
                sequence_id, subject=subject, label=label, facts=facts, offered=offered
            )
        except ParameterError as error:
            if "differ" not in error.details:
                raise
            raise ConflictError(
                error.message,
                remedy=f"Change it with PATCH /v1/sequences/{sequence_id}, or leave it out.",
                details={**error.details, "sequence_id": sequence_id},
            ) from error

    def track_path(self, sequence_id: str) -> Path | None:
        """File of the track that made a sequence; None of one that was sent."""
        try:
            return self.store.track_path(sequence_id)
        except NotFoundError:
            return None

    async def _sign(
        self, sequence_id: str, parameters: SignatureParameters, image: Path, report: Reporter
    ) -> None:
        sequence = await asyncio.to_thread(self.store.sequence_path, sequence_id)
        template = self.template_path(parameters)
        track = await asyncio.to_thread(self.track_path, sequence_id)
        await self.followed(report, signatures.sign, sequence, parameters, template, track, image)


def with_facts(text: bytes, facts: Facts) -> bytes:
    """Add facts to a signature that was rendered without."""
    return text[:-1] + b',"facts":' + json.dumps(facts_as_json(facts)).encode() + b"}"


def _lost(sequence_id: str) -> LostFileError:
    return LostFileError(
        f"The file of this signature of sequence {sequence_id[:12]} is lost or damaged.",
        remedy="POST its parameters again, or restore a backup.",
    )


async def in_one_basis(
    make: Callable[[SignatureParameters], Awaitable[T]], parameters: SignatureParameters
) -> T:
    """Make something of several signatures, all with spring modes where their own do not compare.

    As the library does it where the sequences are at hand.
    """
    try:
        return await make(parameters)
    except UnlikeCasesError as unlike:
        if parameters.topology is not None:
            raise
        try:
            return await make(replace(parameters, topology=MESH))
        except (UnlikeCasesError, TopologyError, ModeCountError):
            raise unlike from None
