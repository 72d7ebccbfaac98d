"""Results that derive from signatures, and streams: computed by a worker, to files or bytes."""

from __future__ import annotations

import asyncio
from pathlib import Path

from modalmotion.exports.surfaces import SurfaceFormat
from modalmotion.formats import ReadLimits
from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import StageReport
from modalmotion.template.body_frame import Components
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.schemas import EncodedAnswer, EncodingTarget
from modalmotion_service.work.tasks import codec, derived, reports, views
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.shared_work import unheard
from modalmotion_service.workspace.signature_work import SignatureWork
from modalmotion_service.workspace.template_work import TemplateWork
from modalmotion_service.workspace.upload_work import UploadWork


class Analysis(UploadWork, TemplateWork, SignatureWork):
    """Computes each result once, however many requests want it at the same time."""

    async def readouts(
        self, sequence_id: str, parameters: SignatureParameters, media_type: str
    ) -> bytes:
        """Read volume and ejection fraction from a signature, as JSON, PNG or a table."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self.template_path(parameters)
        facts = self._store.sequence_record(sequence_id).facts
        track = await asyncio.to_thread(self._track_path, sequence_id)
        with stage("readouts"):
            return await self.work(
                derived.read_out, sequence, signature, template, media_type, facts, track
            )

    async def reconstruction(
        self,
        sequence_id: str,
        parameters: SignatureParameters,
        surface_format: SurfaceFormat,
        times: list[float] | None,
        phases: list[float] | int | None,
        max_targets: int | None,
    ) -> Path:
        """Superpose a signature's surfaces into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        with self.output() as output, stage("superpose"):
            await self.work(
                derived.superpose,
                sequence,
                signature,
                self.template_path(parameters),
                surface_format,
                times,
                phases,
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
        template = self.template_path(parameters)
        record = self._store.sequence_record(sequence_id)
        track = await asyncio.to_thread(self._track_path, sequence_id)
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
                track,
                record.name or record.subject or "",
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
        template = self.template_path(parameters)
        record = self._store.sequence_record(sequence_id)
        track = await asyncio.to_thread(self._track_path, sequence_id)
        with self.output() as output, stage("report"):
            await self.work(
                reports.make_dicom,
                *(sequence, signature, template, instance, limits),
                *(record.facts, classification, record.created, track, output),
            )
        return output

    async def view(
        self, sequence_id: str, parameters: SignatureParameters, *, as_page: bool
    ) -> Path:
        """Write what a page shows of a sequence into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self.template_path(parameters)
        record = self._store.sequence_record(sequence_id)
        title = record.name or record.subject or ""
        with self.output() as output, stage("view"):
            how = as_page, await asyncio.to_thread(self._track_path, sequence_id)
            await self.work(
                views.make_view, sequence, signature, template, record.facts, *how, title, output
            )
        return output

    async def view_frames(
        self, sequence_id: str, parameters: SignatureParameters, first: int, stop: int | None
    ) -> Path:
        """Write frames as they were sent into a file, which the caller removes."""
        sequence, signature = await self._with_sequence(sequence_id, parameters)
        template = self.template_path(parameters)
        with self.output() as output, stage("view"):
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
        with self.output() as output, stage("worker"):
            spent = await self.followed(
                report,
                derived.measure_trade,
                sequence,
                parameters,
                front_modes,
                components,
                self.template_path(parameters),
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
        with self.output() as output, stage("encode"):
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
        with self.output() as output, stage("decode"):
            what = stream, limits, frames, vertices
            await self.work(codec.decode_upload, *what, media_type, output)
        return output
