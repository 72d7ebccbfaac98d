"""A worker's part of a cohort: some files at a time."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from modalmotion.errors import ModalMotionError
from modalmotion.facts import Facts
from modalmotion.formats import ReadOptions
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import MESH, SPHERE
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.store import (
    SequenceRecord,
    record_of,
    record_to_json,
    signature_image,
    template_from_hdf5,
    upload_image,
)
from modalmotion.store.disk.group_commit import GroupCommit
from modalmotion.tracking.parameters import sequence_of
from modalmotion_service.cohort.remote import Source
from modalmotion_service.cohort.transfer import fetched
from modalmotion_service.work.parsing import parser_for


@dataclass(frozen=True)
class Item:
    """A file, its names and facts, and where its results go.

    Parameters
    ----------
    path : Path or RemoteFile
    subject, label : str or None
    facts : Facts
    created : str
        Time of arrival for the record. The worker does not set it: a second one at the same work
        must write the same.
    made : Path
        Name that the files of its results begin with.
    keeps_vertices : bool
    """

    path: Source
    subject: str | None
    label: str | None
    facts: Facts
    created: str
    made: Path
    keeps_vertices: bool

    @property
    def record_file(self) -> Path:
        """Where the record of the sequence goes."""
        return self.made.with_suffix(".record")

    @property
    def signature(self) -> Path:
        """Where the signature goes."""
        return self.made.with_suffix(".signature")

    @property
    def vertices(self) -> Path | None:
        """Where the vertices go, if they are stored."""
        return self.made.with_suffix(".vertices") if self.keeps_vertices else None

    def remove_files(self) -> None:
        """Remove results that the store has not taken."""
        for path in (self.record_file, self.signature, self.vertices):
            if path is not None:
                path.unlink(missing_ok=True)


@dataclass(frozen=True)
class Signed:
    """A file that was understood.

    Parameters
    ----------
    record : SequenceRecord
    key : str
        Of the signature's parameters, with what the fit read of the facts.
    rms_error, weighted_rms_error : float
    kind : str
        Topology of a closed surface that its shape alone gave it, and its mesh; else empty.
    """

    record: SequenceRecord
    key: str
    rms_error: float
    weighted_rms_error: float
    kind: str = ""


@dataclass(frozen=True)
class Refused:
    """A file that was not understood.

    Parameters
    ----------
    code, reason : str
    """

    code: str
    reason: str


def sign_batch(
    items: tuple[Item, ...],
    options: ReadOptions,
    parameters: SignatureParameters,
    template: Path | None,
    most_bytes: int,
) -> list[Signed | Refused]:
    """Write record and signature of each file, durably; the store only has to move them.

    A fault in one file does not affect the others.
    """
    shared = None if template is None else template_from_hdf5(template)
    parser = parser_for(options.limits)
    outcomes: list[Signed | Refused] = []
    with GroupCommit() as files:
        for item in items:
            try:
                stated = replace(options, facts=item.facts.over(options.facts))
                with fetched(item.path, item.made.parent, most_bytes) as path:
                    sequence = sequence_of(path, stated, parser=parser)
                signature = modal_signature(sequence, parameters, template=shared)
            except ModalMotionError as error:
                outcomes.append(Refused(error.code, str(error)))
                continue
            record = record_of(
                sequence,
                created=item.created,
                has_upload=item.keeps_vertices,
                subject=item.subject,
                label=item.label,
            )
            files.write(item.record_file, record_to_json(record))
            if item.vertices is not None:
                files.write(item.vertices, upload_image(sequence))
            files.write(item.signature, signature_image(signature))
            errors = signature.rms_error, signature.weighted_rms_error
            kind = _kind_by_shape(sequence, signature)
            outcomes.append(Signed(record, signature.parameters.key, *errors, kind))
    return outcomes


def _kind_by_shape(sequence: MeshSequence, signature: ModalSignature) -> str:
    if sequence.topology is not None or signature.parameters.fixes_kind:
        return ""
    if signature.surface not in (SPHERE.name, MESH):
        return ""
    digest = hashlib.sha256(str(sequence.n_vertices).encode())
    digest.update(np.ascontiguousarray(sequence.faces, dtype="<i8").data)
    return f"{signature.surface} {digest.hexdigest()[:16]}"
