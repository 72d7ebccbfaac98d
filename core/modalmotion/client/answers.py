"""Answers of the service as values."""

from __future__ import annotations

import io
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from modalmotion.client.connection import Answer
from modalmotion.client.errors import BrokenAnswerError, understood
from modalmotion.errors import ParameterError
from modalmotion.facts import Facts, facts_from_json
from modalmotion.representation import shown

T = TypeVar("T")


@shown("n_frames", "n_vertices", "n_faces", "topology", "unit", "subject", "label", "id")
@dataclass(frozen=True)
class SequenceInfo:
    """Description of a stored sequence.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    n_frames, n_vertices, n_faces : int
    topology, unit : str or None
    subject, label : str or None
    created : str
        When it was first received, ISO 8601 in UTC.
    facts : Facts
        Facts stated about it.
    answer : dict
        The full answer of the service.
    """

    id: str
    n_frames: int
    n_vertices: int
    n_faces: int
    topology: str | None
    unit: str | None
    subject: str | None
    label: str | None
    created: str
    facts: Facts
    answer: dict[str, Any] = field(repr=False, compare=False)


@shown("kind", "n_frames", "shapes", "spacings", "is_kept", "id")
@dataclass(frozen=True)
class ImagesInfo:
    """Description of stored images.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    kind : str
        volumes or planes.
    n_frames : int
    shapes : list of list of int
        Samples along each axis: of the volume, or of each plane of a frame.
    spacings : list of list of float, mm
    times : list of float or None, s
    is_kept : bool
        Whether they stay after they were tracked.
    notes : list of str
    answer : dict
        The full answer of the service.
    """

    id: str
    kind: str
    n_frames: int
    shapes: list[list[int]]
    spacings: list[list[float]]
    times: list[float] | None
    is_kept: bool
    notes: list[str]
    answer: dict[str, Any] = field(repr=False, compare=False)


@shown("topology", "n_vertices", "n_faces", "notes", "id")
@dataclass(frozen=True)
class TemplateInfo:
    """Natural coordinates of a surface.

    Parameters
    ----------
    id : str
        To be named by sequences whose vertices correspond: `signature(id, template=...)`.
    topology : str
        Or "mesh" where no natural coordinates are known.
    n_vertices, n_faces : int
    notes : list of str
    answer : dict
        The full answer of the service, with landmarks and how well they are determined.
    """

    id: str
    topology: str
    n_vertices: int
    n_faces: int
    notes: list[str]
    answer: dict[str, Any] = field(repr=False, compare=False)


@shown("label", "probability", "probabilities", "model")
@dataclass(frozen=True)
class ClassAnswer:
    """A model's answer for one sequence.

    Parameters
    ----------
    label : str or None
        Most probable class; None if the model abstains.
    probability : float
        Of the most probable class.
    probabilities : dict
        Of each class.
    model, model_id : str
    notes : list of str
        Why it abstains, and caveats of the model.
    answer : dict
        The full answer of the service.
    """

    label: str | None
    probability: float
    probabilities: dict[str, float]
    model: str
    model_id: str
    notes: list[str]
    answer: dict[str, Any] = field(repr=False, compare=False)


@shown("name", "version", "classes", "origin", "id")
@dataclass(frozen=True)
class ModelInfo:
    """A version of a model.

    Parameters
    ----------
    name : str
    version : int
    id : str
        sha256 of everything that its answers depend on.
    origin : str
        trained or shipped.
    classes : list of str
    versions : list of int
        All versions of this name.
    answer : dict
        The full answer of the service, with its card.
    """

    name: str
    version: int
    id: str
    origin: str
    classes: list[str]
    versions: list[int]
    answer: dict[str, Any] = field(repr=False, compare=False)


@shown("label", "amplitudes", "rms_errors", "id")
@dataclass(frozen=True, eq=False)
class SignatureArrays:
    """The trajectory of one of many signatures.

    Parameters
    ----------
    id : str
        Of the sequence.
    label : str
        Class stated by users; empty if unknown.
    modes : tuple of str
        Names of the modes.
    amplitudes : (frames, modes, n) float64, length unit
        Three of a mode, or one of offsets.
    amplitude_deviations : (frames, modes, n) float64, length unit, or None
        Standard deviation of each amplitude, where it is known.
    angular_frequencies : (modes,) float64, rad per s
    rms_errors, weighted_rms_errors : (frames,) float64, length unit
    times : (frames,) float64, s, or None
    """

    id: str
    label: str
    modes: tuple[str, ...]
    amplitudes: NDArray[np.float64]
    angular_frequencies: NDArray[np.float64]
    rms_errors: NDArray[np.float64]
    weighted_rms_errors: NDArray[np.float64]
    times: NDArray[np.float64] | None
    amplitude_deviations: NDArray[np.float64] | None


@shown()
@dataclass(frozen=True)
class TemplateModes:
    """Vibration modes of a surface.

    Parameters
    ----------
    labels : tuple of str
    angular_frequencies : (modes,) float64, rad per s
    shapes : (vertices, modes) float64
        Each with mean square 1 over the surface.
    """

    labels: tuple[str, ...]
    angular_frequencies: NDArray[np.float64]
    shapes: NDArray[np.float64]


@shown("data", "rms", "max_error", "kg_error", "transform")
@dataclass(frozen=True)
class CompressedSequence:
    """A compressed stream, and its errors as the service measured them after decoding.

    Parameters
    ----------
    data : bytes
    rms, max_error : float, length unit
        Of the distances of vertices: over all of them and all frames, and the largest.
    kg_error : float
        Karni-Gotsman error.
    bits_per_vertex_and_frame : float
    transform : str
    """

    data: bytes = field(repr=False)
    rms: float
    max_error: float
    kg_error: float
    bits_per_vertex_and_frame: float
    transform: str


def value_of(kind: Callable[..., T], answer: Any) -> T:
    """Build a value from the members of a JSON answer that its fields name.

    Raises
    ------
    BrokenAnswerError
        If a member is missing.
    """
    names = [name for name in kind.__annotations__ if name != "answer"]
    try:
        members = {name: answer[name] for name in names}
        if "facts" in members:
            members["facts"] = facts_from_json(members["facts"])
        return kind(**members, answer=answer)
    except (KeyError, TypeError, ParameterError) as error:
        raise BrokenAnswerError(
            f"The answer cannot be read: {error} is missing.",
            remedy="Check the address, and the versions of service and client.",
        ) from error


def compressed_of(answer: Answer) -> CompressedSequence:
    """Read a compressed stream and its headers."""
    try:
        return CompressedSequence(
            data=answer.content,
            rms=float(answer.headers["encoded-rms"]),
            max_error=float(answer.headers["encoded-max-error"]),
            kg_error=float(answer.headers["encoded-kg-error"]),
            bits_per_vertex_and_frame=float(answer.headers["encoded-bits-per-vertex-and-frame"]),
            transform=answer.headers["encoded-transform"],
        )
    except (KeyError, ValueError) as error:
        raise BrokenAnswerError(
            "The answer lacks the measured errors of the stream.",
            remedy="Check that no proxy removes headers.",
        ) from error


def template_modes_of(answer: Answer) -> TemplateModes:
    """Read vibration modes from .npz."""
    with (
        understood("modes of a template"),
        np.load(io.BytesIO(answer.content), allow_pickle=False) as arrays,
    ):
        return TemplateModes(
            tuple(map(str, arrays["modes"])), arrays["angular_frequencies"], arrays["shapes"]
        )


def pack_of(answer: Answer) -> list[SignatureArrays]:
    """Read many signatures from one .npz archive."""
    with (
        understood("an archive of signatures"),
        np.load(io.BytesIO(answer.content), allow_pickle=False) as pack,
    ):
        labels = pack["labels"]
        return [
            SignatureArrays(
                id=str(sequence_id),
                label=str(labels[number]),
                modes=tuple(map(str, pack[f"modes_{number}"])),
                amplitudes=pack[f"amplitudes_{number}"],
                angular_frequencies=pack[f"angular_frequencies_{number}"],
                rms_errors=pack[f"rms_errors_{number}"],
                weighted_rms_errors=pack[f"weighted_rms_errors_{number}"],
                times=pack.get(f"times_{number}"),
                amplitude_deviations=pack.get(f"amplitude_deviations_{number}"),
            )
            for number, sequence_id in enumerate(pack["ids"])
        ]
