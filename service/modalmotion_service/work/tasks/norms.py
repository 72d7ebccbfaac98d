"""Norms made of kept controls, and kept sequences compared with them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from modalmotion.classification.cases import case_name
from modalmotion.mesh import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.norm import (
    Norm,
    cohort_deviation,
    norm_from_hdf5,
    norm_to_hdf5,
    train_norm,
)
from modalmotion.norm.norm import Control, Reading
from modalmotion.signature.making import ModalSignature
from modalmotion.store import sequence_from_hdf5, signature_from_hdf5
from modalmotion_service.schemas.models import CohortDeviationAnswer, DeviationAnswer
from modalmotion_service.work.task_progress import ProgressFile
from modalmotion_service.work.tasks.files import write_whole


@dataclass(frozen=True)
class KeptRecording:
    """A kept sequence with its signature.

    Parameters
    ----------
    sequence_id : str
    signature : Path
    vertices : Path or None
        None where they are not kept: then no volume is read.
    facts : Facts
        Of the sequence; kept files have none.
    subject : str or None
    """

    sequence_id: str
    signature: Path
    vertices: Path | None
    facts: Facts
    subject: str | None

    def read_signature(self) -> ModalSignature:
        """Read the signature, with the facts."""
        return replace(signature_from_hdf5(self.signature), facts=self.facts)

    def read_sequence(self) -> MeshSequence | None:
        """Read the vertices, with the facts."""
        if self.vertices is None:
            return None
        return sequence_from_hdf5(self.vertices).with_facts(self.facts)


def make_norm(
    recordings: Sequence[KeptRecording],
    name: str,
    modes: int,
    topology: str | None,
    image: Path,
    progress: Path,
) -> None:
    """Make a norm of kept controls and write its HDF5 image; see `train_norm`."""
    report = ProgressFile(progress).write

    def tell(done: int, total: int) -> None:
        report(done / total, f"control {done} of {total}")

    controls = [
        Control(
            one.read_signature(),
            one.subject,
            case_name(one.sequence_id),
            # Read one after another, when its turn comes.
            sequence=one.read_sequence,
        )
        for one in recordings
    ]
    norm = train_norm(controls, name, modes=modes, topology=topology, progress=tell)
    write_whole(image, norm_to_hdf5(norm))


def ask_norm(
    recording: KeptRecording, norm: Path, level: float, stated: str | None
) -> tuple[bytes, str | None]:
    """Compare a kept sequence with a norm; gives the answer as JSON.

    Parameters
    ----------
    recording : KeptRecording
    norm : Path
    level : float
    stated : str or None
        Topology that the sequence states.

    Returns
    -------
    bytes, str or None
        Without an answer the topology in which the norm would rather have the signature.
    """
    controls = norm_from_hdf5(norm)
    own, imposed = _read(recording, controls, stated)
    if own is None:
        return b"", imposed
    answer = DeviationAnswer(**controls.deviation(own, level=level).as_json())
    return answer.model_dump_json().encode(), None


def ask_norm_together(
    recordings: Sequence[KeptRecording], norm: Path, level: float, stated: Sequence[str | None]
) -> tuple[bytes, dict[int, str]]:
    """Compare kept sequences with a norm, each and together; gives the answer as JSON.

    Returns
    -------
    bytes, dict of int to str
        Without an answer the topologies in which the norm would rather have some, by number.
    """
    controls = norm_from_hdf5(norm)
    readings, imposed = [], {}
    for number, (one, topology) in enumerate(zip(recordings, stated, strict=True)):
        own, wanted = _read(one, controls, topology)
        if own is not None:
            readings.append(own)
        elif wanted is not None:
            imposed[number] = wanted
    if imposed:
        return b"", imposed
    together = cohort_deviation(controls, readings, level=level)
    return CohortDeviationAnswer(**together.as_json()).model_dump_json().encode(), {}


def _read(
    recording: KeptRecording, controls: Norm, stated: str | None
) -> tuple[Reading | None, str | None]:
    """Read a recording as the controls are; or give the topology in which they rather have it."""
    signature = recording.read_signature()
    imposed = controls.readable.imposed_on(signature.surface, stated)
    if imposed is not None and imposed.topology is not None:
        return None, str(imposed.topology)
    own = controls.read(
        signature,
        subject=recording.subject,
        name=case_name(recording.sequence_id),
        sequence=recording.read_sequence(),
    )
    return own, None
