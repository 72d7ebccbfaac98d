"""Signatures of one owner: read from the store, or made by a worker and stored or not."""

from __future__ import annotations

import asyncio
import json
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from pydantic_core import from_json

from modalmotion.errors import LostFileError, NotFoundError, ParameterError
from modalmotion.mesh import Facts, facts_as_json
from modalmotion.modes.topology import MESH, SPHERE
from modalmotion.progress import StageReport
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import parameters_from_json
from modalmotion.store import SequenceRecord
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.observation import stage
from modalmotion_service.work.tasks import signatures
from modalmotion_service.work.tasks.files import Fitted
from modalmotion_service.workspace.owner_work import OwnerWork, unheard
from modalmotion_service.workspace.spool import remove_with_beside

USUAL: Final = SignatureParameters()
"""Parameters of the signature that a sequence has unasked."""


class Analysis(OwnerWork):
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
            with self.image() as image:
                await self._sign(sequence_id, parameters, image, tell)
                with stage("store"):
                    return await asyncio.to_thread(
                        self._store.put_signature_image, image, sequence_id, parameters.key
                    )

        path = await asyncio.to_thread(
            self._store.sound_signature_path, sequence_id, parameters.key
        )
        if path is not None:
            return path
        return await self.shared_work.join((sequence_id, parameters.key), make, report)

    @asynccontextmanager
    async def fitted(
        self,
        sequence_id: str,
        key: str | None,
        report: StageReport = unheard,
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
        sequence = await asyncio.to_thread(self._store.sequence_path, sequence_id)
        if key is None:
            parameters, _ = self.resolved(sequence_id, usual)
        else:
            parameters = await self.parameters_of(sequence_id, key)
        path = await asyncio.to_thread(
            self._store.sound_signature_path, sequence_id, parameters.key
        )
        kept, template = path, self.template_path(parameters)
        record, track = self._store.sequence_record(sequence_id), self.track_path(sequence_id)
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
        text = await asyncio.to_thread(self._store.rendered_signature, sequence_id, key)
        if text is not None:
            return text
        path = await asyncio.to_thread(self._store.sound_signature_path, sequence_id, key)
        if path is None:
            raise _lost(sequence_id)
        file = path.relative_to(self._store.root).as_posix()
        with stage("render"):
            text = await self.work(signatures.render, path, f"{sequence_id}-{key}", file)
        await asyncio.to_thread(self._store.keep_rendered, sequence_id, key, text)
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
            is_stated = self._store.sequence_record(sequence_id).topology is not None
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

    def track_path(self, sequence_id: str) -> Path | None:
        """File of the track that made a sequence; None of one that was sent."""
        try:
            return self._store.track_path(sequence_id)
        except NotFoundError:
            return None

    async def _sign(
        self, sequence_id: str, parameters: SignatureParameters, image: Path, report: StageReport
    ) -> None:
        sequence = await asyncio.to_thread(self._store.sequence_path, sequence_id)
        template = self.template_path(parameters)
        track = await asyncio.to_thread(self.track_path, sequence_id)
        await self.staged(report, signatures.sign, sequence, parameters, template, track, image)


def with_facts(text: bytes, facts: Facts) -> bytes:
    """Add facts to a signature that was rendered without."""
    return text[:-1] + b',"facts":' + json.dumps(facts_as_json(facts)).encode() + b"}"


def _lost(sequence_id: str) -> LostFileError:
    return LostFileError(
        f"The file of this signature of sequence {sequence_id[:12]} is lost or damaged.",
        remedy="POST its parameters again, or restore a backup.",
    )
