"""Results of sequences: read from the store, or computed by a worker and stored."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ParamSpec, TypeVar

from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.exports.surfaces import SurfaceFormat
from modalmotion.facts import Facts
from modalmotion.formats import ReadLimits
from modalmotion.signature.comparison import Comparison
from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import StageReport
from modalmotion.store import ResultStore, SequenceRecord
from modalmotion.template.body_frame import Components
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.negotiation import CSV, HDF5
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.schemas import (
    EncodedAnswer,
    EncodingTarget,
    ModesQuery,
    ReadingAnswer,
    TemplateAnswer,
)
from modalmotion_service.work.executor import Engine
from modalmotion_service.work.owner import work_of
from modalmotion_service.work.tariff import Tariff
from modalmotion_service.work.task_progress import followed
from modalmotion_service.work.tasks import (
    codec,
    derived,
    reports,
    sequences,
    signatures,
    templates,
    views,
)
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.shared_work import SharedWork, unheard
from modalmotion_service.workspace.spool import Spool, remove_with_beside

P = ParamSpec("P")
T = TypeVar("T")


@dataclass(frozen=True)
class KeptUpload:
    """An upload whose sequence is stored.

    Parameters
    ----------
    record : SequenceRecord
    reading : ReadingAnswer
        How the upload was read.
    is_new : bool
    filled : tuple of str
        Facts of a known sequence that were not known before.
    """

    record: SequenceRecord
    reading: ReadingAnswer
    is_new: bool
    filled: tuple[str, ...] = ()


class Analysis:
    """Computes each result once, however many requests want it at the same time.

    Parameters
    ----------
    store : ResultStore
    engine : Engine
        Where parsing and fitting happen.
    spool : Spool
        Where workers leave their output.
    tariff : Tariff
        Of the owner whose store it is.
    """

    def __init__(self, store: ResultStore, engine: Engine, spool: Spool, tariff: Tariff) -> None:
        self._store = store
        self.engine = engine
        self._spool = spool
        self._tariff = tariff
        self._shared_work = SharedWork()

    async def keep(
        self,
        upload: Upload,
        *,
        subject: str | None,
        label: str | None,
        report: StageReport = unheard,
    ) -> KeptUpload:
        """Read an upload and store its sequence.

        Of a known sequence, what is stated with it and not known yet is filled in.

        Raises
        ------
        ConflictError
            If something is stated beside the file that is known to be otherwise.
        """

        async def make(tell: StageReport) -> KeptUpload:
            with self.image() as image, stage("worker"):
                work = self.followed(tell, sequences.ingest, upload, image)
                sent, reading, milliseconds = await work
                add_milliseconds(milliseconds)
                with stage("store"):
                    record, is_new = await asyncio.to_thread(
                        self._store.put_sequence_image, image, sent, subject=subject, label=label
                    )
            filled: tuple[str, ...] = ()
            if not is_new:
                record, filled = await asyncio.to_thread(
                    self.completed, record.id, subject, label, upload.options.facts, sent.facts
                )
                if filled:
                    reading.notes.append(
                        f"The sequence was known; {', '.join(filled)} is known now too."
                    )
            others = [n for n in sent.facts.stated if n in record.facts.changed(sent.facts)]
            if others:
                reading.notes.append(
                    f"The sequence was known, and keeps its facts; {', '.join(others)} would now "
                    "be different. PATCH changes them."
                )
            return KeptUpload(record, reading, is_new, filled)

        return await self._shared_work.join(upload.path, make, report)

    def completed(
        self,
        sequence_id: str,
        subject: str | None,
        label: str | None,
        facts: Facts,
        offered: Facts,
    ) -> tuple[SequenceRecord, tuple[str, ...]]:
        """Fill in what is not known of a stored sequence; gives the names of that too.

        Raises
        ------
        ConflictError
            If something is known to be otherwise.
        """
        try:
            return self._store.complete_sequence(
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

    def resolved(
        self, sequence_id: str, parameters: SignatureParameters
    ) -> tuple[SignatureParameters, Facts]:
        """Complete parameters by the facts that a fit reads; gives the sequence's facts too.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        """
        record = self._store.sequence_record(sequence_id)
        parameters = parameters.with_facts(record.facts, record.topology, record.grid)
        return parameters, record.facts

    async def signature(
        self, sequence_id: str, parameters: SignatureParameters, report: StageReport = unheard
    ) -> Path:
        """Give the file of a signature, made if it is missing or damaged.

        The landmarks are those that the facts of the sequence state now.
        """
        parameters, _ = self.resolved(sequence_id, parameters)

        async def make(tell: StageReport) -> Path:
            sequence = await asyncio.to_thread(self._store.sequence_path, sequence_id)
            template = self._template_path(parameters)
            track = await asyncio.to_thread(self._track_path, sequence_id)
            with self.image() as image, stage("worker"):
                add_milliseconds(
                    await self.followed(
                        *(tell, signatures.sign, sequence, parameters, template, track, image)
                    )
                )
                with stage("store"):
                    return await asyncio.to_thread(
                        self._store.put_signature_image, image, sequence_id, parameters.key
                    )

        path = await asyncio.to_thread(
            self._store.sound_signature_path, sequence_id, parameters.key
        )
        if path is not None:
            return path
        return await self._shared_work.join((sequence_id, parameters.key), make, report)

    async def signature_of_upload(
        self, upload: Upload, parameters: SignatureParameters, media_type: str
    ) -> bytes:
        """Fit an upload and give its signature as the media type; nothing is stored."""
        with stage("worker"):
            body, milliseconds = await self.fit_upload(upload, parameters, media_type)
        add_milliseconds(milliseconds)
        return body

    async def fit_upload(
        self, upload: Upload, parameters: SignatureParameters, media_type: str
    ) -> tuple[bytes, dict[str, float]]:
        """Fit an upload as `signature_of_upload`; gives milliseconds by stage besides."""
        template = self._template_path(parameters)
        return await self.work(signatures.sign_upload, upload, parameters, template, media_type)

    def require_template(self, parameters: SignatureParameters) -> None:
        """Check that the template that parameters name is there.

        Raises
        ------
        NotFoundError
            If there is none of that id.
        """
        self._template_path(parameters)

    async def distance(
        self, sequence_id: str, other_id: str, parameters: SignatureParameters, closed: bool
    ) -> Comparison:
        """Compare the signatures of two sequences, made with the same parameters."""
        own = await self.signature(sequence_id, parameters)
        other = await self.signature(other_id, parameters)
        return await self.work(signatures.compare_signatures, own, other, closed)

    async def signature_json(self, sequence_id: str, parameters: SignatureParameters) -> bytes:
        """Give a signature as the service's JSON."""
        path = await self.signature(sequence_id, parameters)
        with stage("render"):
            facts = self._store.sequence_record(sequence_id).facts
            file = self.within_store(path)
            return await self.work(signatures.signature_as_json, path, file, facts)

    async def signature_as(
        self, sequence_id: str, parameters: SignatureParameters, media_type: str
    ) -> bytes:
        """Give a signature as a media type that says nothing of its sequence's facts."""
        path = await self.signature(sequence_id, parameters)
        return await self.work(signatures.signature_as, path, media_type)

    async def signature_hdf5(self, sequence_id: str, parameters: SignatureParameters) -> bytes:
        """Give a signature with the facts of its sequence as HDF5."""
        path = await self.signature(sequence_id, parameters)
        facts = self._store.sequence_record(sequence_id).facts
        return await self.work(signatures.signature_with_facts, path, facts)

    async def draw_signature(self, sequence_id: str, parameters: SignatureParameters) -> bytes:
        """Draw a signature beside its sequence, as PNG."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        with stage("draw"):
            return await self.work(signatures.draw_signature, sequence, signature)

    async def template(
        self, upload: Upload, parameters: SignatureParameters, report: StageReport = unheard
    ) -> tuple[TemplateAnswer, bool]:
        """Make and store the template of an upload; tell whether it is new."""

        async def make(tell: StageReport) -> tuple[TemplateAnswer, bool]:
            with self.image() as image, stage("worker"):
                work = self.followed(tell, templates.make_template, upload, parameters, image)
                answer, milliseconds = await work
                add_milliseconds(milliseconds)
                with stage("store"):
                    is_new = await asyncio.to_thread(
                        self._store.put_template_image, image, answer.id
                    )
            return answer, is_new

        return await self._shared_work.join(("template", upload.path), make, report)

    async def describe_template(self, template_id: str) -> TemplateAnswer:
        """Describe a stored template."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        return await self.work(templates.describe_template, path)

    async def draw_template(self, template_id: str) -> bytes:
        """Draw the natural coordinates of a stored template, as PNG."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        return await self.work(templates.draw_template, path)

    async def template_modes(self, template_id: str, query: ModesQuery, media_type: str) -> bytes:
        """Give the vibration modes of a stored template as the media type."""
        path = await asyncio.to_thread(self._store.template_path, template_id)
        with stage("modes"):
            return await self.work(templates.modes_of_template, path, query, media_type)

    async def readouts(
        self, sequence_id: str, parameters: SignatureParameters, media_type: str
    ) -> bytes:
        """Read volume and ejection fraction from a signature, as JSON, PNG or a table."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self._template_path(parameters)
        facts = self._store.sequence_record(sequence_id).facts
        with stage("readouts"):
            return await self.work(
                derived.read_out, sequence, signature, template, media_type, facts
            )

    async def reconstruction(
        self,
        sequence_id: str,
        parameters: SignatureParameters,
        surface_format: SurfaceFormat,
        times: list[float] | None,
        max_targets: int | None,
    ) -> Path:
        """Superpose a signature's surfaces into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        with self._output() as output, stage("superpose"):
            await self.work(
                derived.superpose,
                sequence,
                signature,
                self._template_path(parameters),
                surface_format,
                times,
                max_targets,
                output,
            )
        return output

    async def report(
        self,
        sequence_id: str,
        parameters: SignatureParameters,
        classification: Path | None,
        media_type: str,
    ) -> bytes:
        """Report on a sequence, as FHIR, PDF or a table."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self._template_path(parameters)
        record = self._store.sequence_record(sequence_id)
        with stage("report"):
            return await self.work(
                reports.make_report,
                sequence,
                signature,
                template,
                media_type,
                record.facts,
                classification,
                record.created,
            )

    async def dicom(
        self,
        sequence_id: str,
        parameters: SignatureParameters,
        classification: Path | None,
        instance: Path,
        limits: ReadLimits,
    ) -> Path:
        """Write DICOM objects of an instance's study into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self._template_path(parameters)
        record = self._store.sequence_record(sequence_id)
        with self._output() as output, stage("report"):
            await self.work(
                reports.make_dicom,
                *(sequence, signature, template, instance, limits),
                *(record.facts, classification, record.created, output),
            )
        return output

    async def view(
        self, sequence_id: str, parameters: SignatureParameters, *, as_page: bool
    ) -> Path:
        """Write what a page shows of a sequence into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self._template_path(parameters)
        facts = self._store.sequence_record(sequence_id).facts
        with self._output() as output, stage("view"):
            is_tracked = self._store.is_tracked(sequence_id)
            how = (as_page, self._store.track_path(sequence_id) if is_tracked else None)
            await self.work(views.make_view, sequence, signature, template, facts, *how, output)
        return output

    async def view_frames(
        self, sequence_id: str, parameters: SignatureParameters, first: int, stop: int | None
    ) -> Path:
        """Write frames as they were sent into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self._template_path(parameters)
        with self._output() as output, stage("view"):
            await self.work(views.make_frames, sequence, signature, template, first, stop, output)
        return output

    async def tradeoff(
        self,
        sequence_id: str,
        parameters: SignatureParameters,
        front_modes: int,
        components: Components | None,
        media_type: str,
        report: StageReport = unheard,
    ) -> Path:
        """Measure a trade into a file, which the caller removes."""
        sequence = await asyncio.to_thread(self._store.sequence_path, sequence_id)
        with self._output() as output, stage("worker"):
            spent = await self.followed(
                report,
                derived.measure_trade,
                sequence,
                parameters,
                front_modes,
                components,
                self._template_path(parameters),
                media_type,
                output,
                self._store.sequence_record(sequence_id).facts,
            )
            add_milliseconds(spent)
        return output

    async def encoded(
        self,
        source: Upload | str,
        target: EncodingTarget,
        report: StageReport = unheard,
    ) -> tuple[Path, EncodedAnswer]:
        """Encode an upload, or a stored sequence by its id, to a file that the caller removes."""
        with self._output() as output, stage("encode"):
            if isinstance(source, str):
                path = await asyncio.to_thread(self._store.sequence_path, source)
                work = self.followed(report, codec.encode_kept, path, target, output)
            else:
                work = self.followed(report, codec.encode_upload, source, target, output)
            return output, await work

    async def decoded(
        self,
        stream: Path,
        limits: ReadLimits,
        frames: range | None,
        vertices: range | None,
        media_type: str,
    ) -> Path:
        """Decode a stream to a file that the caller removes."""
        with self._output() as output, stage("decode"):
            what = stream, limits, frames, vertices
            await self.work(codec.decode_upload, *what, media_type, output)
        return output

    async def _with_sequence(
        self, sequence_id: str, parameters: SignatureParameters
    ) -> tuple[Path, Path]:
        signature = await self.signature(sequence_id, parameters)
        return await asyncio.to_thread(self._store.sequence_path, sequence_id), signature

    def _template_path(self, parameters: SignatureParameters) -> Path | None:
        if parameters.template is None:
            return None
        return self._store.template_path(parameters.template)

    def _track_path(self, sequence_id: str) -> Path | None:
        """File of the track that made a sequence; None of one that was sent."""
        try:
            return self._store.track_path(sequence_id)
        except NotFoundError:
            return None

    async def pack(
        self,
        sequence_ids: list[str],
        parameters: SignatureParameters,
        media_type: str,
        report: StageReport = unheard,
    ) -> Path:
        """Pack many signatures into one file, or a table, which the caller removes."""
        paths = []
        whole = len(sequence_ids) + 1
        for done, sequence_id in enumerate(sequence_ids):

            def tell(share: float, text: str, done: int = done) -> None:
                report((done + share) / whole, f"signature {done + 1} of {whole - 1}: {text}")

            paths.append(await self.signature(sequence_id, parameters, tell))
            report((done + 1) / whole, f"signature {done + 1} of {whole - 1}")
        records = [self._store.sequence_record(sequence_id) for sequence_id in sequence_ids]
        with self._output() as output:
            if media_type == CSV:
                kept = await asyncio.to_thread(self._kept_vertices, records)
                template = self._template_path(parameters)
                await self.work(signatures.tabulate, paths, records, kept, template, output)
            else:
                task = signatures.pack_hdf5 if media_type == HDF5 else signatures.pack_npz
                await self.work(task, paths, records, output)
        return output

    def _kept_vertices(self, records: list[SequenceRecord]) -> list[Path | None]:
        """Files of the vertices of sequences, where they are kept."""
        return [self._store.sequence_path(r.id) if r.has_upload else None for r in records]

    def within_store(self, path: Path) -> str:
        """Path of a result within the data folder."""
        return path.relative_to(self._store.root).as_posix()

    async def work(self, task: Callable[P, T], *args: P.args, **kwargs: P.kwargs) -> T:
        """Have a worker do a task."""
        terms = self._tariff.terms(task, args)
        # Cancelling the wait cancels the future, and with it ends the worker's process.
        with work_of(str(self._store.root)):
            future = self.engine.submit_for(terms, task, *args, **kwargs)
        return await asyncio.wrap_future(future)

    async def followed(self, report: StageReport, task: Callable[..., T], *args: Any) -> T:
        """Have a worker do a task whose last argument is a `ProgressFile`; report what it tells."""
        progress = self._spool.new_path()
        try:
            return await followed(self.work(task, *args, progress), progress, report)
        finally:
            remove_with_beside(progress)

    @contextmanager
    def image(self) -> Iterator[Path]:
        """Name a file for a worker to write, which is removed in the end."""
        with self._output() as path:
            try:
                yield path
            finally:
                path.unlink(missing_ok=True)

    @contextmanager
    def _output(self) -> Iterator[Path]:
        """Name a file for a worker to write; it is removed if the work fails."""
        path = self._spool.new_path()
        try:
            yield path
        except BaseException:
            # Also removes a dead worker's leftovers.
            remove_with_beside(path)
            raise
