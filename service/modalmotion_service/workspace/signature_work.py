"""Signatures of stored sequences: read from the store, or made by a worker and stored."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from pathlib import Path

from modalmotion.errors import NotFoundError
from modalmotion.facts import Facts
from modalmotion.modes.topology import SPHERE
from modalmotion.signature.comparison import Comparison
from modalmotion.signature.making import SignatureParameters
from modalmotion.stopwatch import StageReport
from modalmotion.store import SequenceRecord
from modalmotion_service.http.negotiation import CSV, HDF5
from modalmotion_service.http.timing import add_milliseconds, stage
from modalmotion_service.work.tasks import signatures
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.owner_work import OwnerWork
from modalmotion_service.workspace.shared_work import unheard


class SignatureWork(OwnerWork):
    """Makes each signature once, however many requests want it at the same time."""

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
            template = self.template_path(parameters)
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
        template = self.template_path(parameters)
        return await self.work(signatures.sign_upload, upload, parameters, template, media_type)

    async def distance(
        self, sequence_id: str, other_id: str, parameters: SignatureParameters, closed: bool
    ) -> Comparison:
        """Compare the signatures of two sequences, made with the same parameters."""
        own = await self.signature(sequence_id, parameters)
        other = await self.signature(other_id, parameters)
        ids = [sequence_id, other_id]
        own, other = await self._of_one_kind(ids, parameters, [own, other])
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
        paths = await self._of_one_kind(sequence_ids, parameters, paths)
        with self.output() as output:
            if media_type == CSV:
                kept = await asyncio.to_thread(self._kept_vertices, records)
                template = self.template_path(parameters)
                await self.work(signatures.tabulate, paths, records, kept, template, output)
            else:
                task = signatures.pack_hdf5 if media_type == HDF5 else signatures.pack_npz
                await self.work(task, paths, records, output)
        return output

    async def _of_one_kind(
        self, sequence_ids: list[str], parameters: SignatureParameters, paths: list[Path]
    ) -> list[Path]:
        """Take spring modes of all closed surfaces of a mesh of which some have them by shape."""
        if parameters.fixes_kind:
            return paths
        kinds = await self.work(signatures.kinds_of, paths)
        meshes = {mesh for _, mesh in kinds if mesh}
        springs, chosen = replace(parameters, closed_form=False), []
        for sequence_id, path, (surface, _) in zip(sequence_ids, paths, kinds, strict=True):
            chosen.append(path)
            is_stated = self._store.sequence_record(sequence_id).topology is not None
            if meshes and surface == SPHERE.name and not is_stated:
                other = await self.signature(sequence_id, springs)
                ((_, mesh),) = await self.work(signatures.kinds_of, [other])
                chosen[-1] = other if mesh in meshes else path
        return chosen

    async def _with_sequence(
        self, sequence_id: str, parameters: SignatureParameters
    ) -> tuple[Path, Path]:
        signature = await self.signature(sequence_id, parameters)
        return await asyncio.to_thread(self._store.sequence_path, sequence_id), signature

    def _track_path(self, sequence_id: str) -> Path | None:
        """File of the track that made a sequence; None of one that was sent."""
        try:
            return self._store.track_path(sequence_id)
        except NotFoundError:
            return None

    def _kept_vertices(self, records: list[SequenceRecord]) -> list[Path | None]:
        """Files of the vertices of sequences, where they are kept."""
        return [self._store.sequence_path(r.id) if r.has_upload else None for r in records]
