"""Answers of the service as values with members and arrays, and as files."""

from __future__ import annotations

import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.client.connection import JSON, Answer
from modalmotion.client.errors import understood
from modalmotion.errors import ParameterError
from modalmotion.mesh import facts_from_json
from modalmotion.representation import LONGEST_LINE, Floats, shown

_SHOWN: Final = (
    *("name", "version", "label", "probability", "subject", "kind", "topology", "n_frames"),
    *("n_vertices", "unit", "id"),
)


class Info(Mapping[str, Any]):
    """An object that the service answered with: ``info.id`` is ``info["id"]``.

    As attributes lists of numbers are float64 or int64 arrays, objects are `Info`, and `facts` are
    `modalmotion.Facts`; as items all are as the service sent them.

    Parameters
    ----------
    answer : mapping
    """

    def __init__(self, answer: Mapping[str, Any]) -> None:
        with understood("an object"):
            self._answer = dict(answer)

    def __getitem__(self, name: str) -> Any:
        return self._answer[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._answer)

    def __len__(self) -> int:
        return len(self._answer)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        if name not in self._answer:
            raise AttributeError(f"The answer has no {name!r}: it has {', '.join(self._answer)}.")
        value = self._answer[name]
        return facts_from_json(value) if name == "facts" else _as_value(value)

    def __repr__(self) -> str:
        said = [f"{name}={self._answer[name]!r}" for name in _SHOWN if name in self._answer]
        text = f"Info({', '.join(said) or ', '.join(self._answer)})"
        return text if len(text) <= LONGEST_LINE else f"{text[: LONGEST_LINE - 4]}...)"


def info_of(answer: Answer) -> Info:
    """Read an object."""
    return Info(answer.json)


def _as_value(value: Any) -> Any:
    if isinstance(value, dict):
        return Info(value)
    if isinstance(value, list):
        if value and all(isinstance(one, dict) for one in value):
            return [Info(one) for one in value]
        try:
            array = np.array(value)
        except ValueError:
            return value
        return array if value and array.dtype.kind in "fi" else value
    return value


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
        Three of a mode, or one of normal displacements.
    angular_frequencies : (modes,) float64, rad per s
    rms_errors, weighted_rms_errors : (frames,) float64, length unit
    times : (frames,) float64, s, or None
    amplitude_deviations : (frames, modes, n) float64, length unit, or None
        Standard deviation of each amplitude, where it is known.
    """

    id: str
    label: str
    modes: tuple[str, ...]
    amplitudes: Floats
    angular_frequencies: Floats
    rms_errors: Floats
    weighted_rms_errors: Floats
    times: Floats | None
    amplitude_deviations: Floats | None


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
    angular_frequencies: Floats
    shapes: Floats


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


def compressed_of(answer: Answer) -> CompressedSequence:
    """Read a compressed stream and its headers."""
    names = ("rms", "max_error", "kg_error", "bits_per_vertex_and_frame")
    with understood("a stream with its measured errors as headers"):
        return CompressedSequence(
            data=answer.content,
            transform=answer.headers["encoded-transform"],
            **{name: float(answer.headers[f"encoded-{name.replace('_', '-')}"]) for name in names},
        )


def template_modes_of(answer: Answer) -> TemplateModes:
    """Read vibration modes from .npz."""
    with (
        understood("modes of a template"),
        np.load(io.BytesIO(answer.content), allow_pickle=False) as arrays,
    ):
        labels = tuple(map(str, arrays["modes"]))
        return TemplateModes(labels, arrays["angular_frequencies"], arrays["shapes"])


def pack_of(answer: Answer) -> list[SignatureArrays]:
    """Read many signatures from one .npz archive."""
    arrays = [
        name for name in SignatureArrays.__annotations__ if name not in ("id", "label", "modes")
    ]
    with (
        understood("an archive of signatures"),
        np.load(io.BytesIO(answer.content), allow_pickle=False) as pack,
    ):
        return [
            SignatureArrays(
                id=str(sequence_id),
                label=str(pack["labels"][k]),
                modes=tuple(map(str, pack[f"modes_{k}"])),
                **{name: pack.get(f"{name}_{k}") for name in arrays},
            )
            for k, sequence_id in enumerate(pack["ids"])
        ]


HDF5: Final = "application/x-hdf5"
NPZ: Final = "application/x-npz"
PNG: Final = "image/png"
CSV: Final = "text/csv"
ZIP: Final = "application/zip"
STREAM: Final = "application/vnd.modalmotion.stream"
FHIR: Final = "application/fhir+json"

SAVED: Final = {
    "signature": ("/v1/signatures/{}", (".h5", ".npz", ".png", ".csv", ".json")),
    "readouts": ("/v1/signatures/{}/readouts", (".png", ".csv", ".json")),
    "strain": ("/v1/signatures/{}/strain", (".json",)),
    "reconstruction": ("/v1/signatures/{}/reconstruction", (".npz", ".vtkhdf", ".glb", ".zip")),
    "report": ("/v1/signatures/{}/report", (".pdf", ".json", ".csv")),
    "view": ("/v1/signatures/{}/view", (".html",)),
    "tradeoff": ("/v1/sequences/{}/tradeoff", (".png", ".json")),
    "stream": ("/v1/sequences/{}/encoded", (".mms",)),
    "template": ("/v1/templates/{}", (".png", ".json")),
    "modes": ("/v1/templates/{}/modes", (".png", ".npz", ".h5")),
    "track": ("/v1/tracks/{}", (".h5", ".png", ".json")),
    "model": ("/v1/models/{}", (".h5", ".png", ".csv", ".md")),
    "evaluation": ("/v1/models/{}/evaluations", (".png", ".csv")),
    "norm": ("/v1/norms/{}", (".h5",)),
    "features": ("/v1/features", (".csv", ".json")),
}
"""Path, with braces for an id or a name, and suffixes, by the name that `Client.save` takes."""

POSTED: Final = ("tradeoff", "evaluation", "features")
"""Those whose options are the body of a POST."""

_TYPES: Final = {
    ".csv": CSV,
    ".glb": "model/gltf-binary",
    ".h5": HDF5,
    ".html": "text/html",
    ".json": JSON,
    ".md": "text/markdown",
    ".mms": STREAM,
    ".npz": NPZ,
    ".pdf": "application/pdf",
    ".png": PNG,
    ".vtkhdf": "application/vnd.vtk.vtkhdf",
    ".zip": ZIP,
}


def form_of(what: str, path: Path) -> tuple[str, str]:
    """Look up the path of what is saved, and the media type that the file's suffix represents.

    Raises
    ------
    ParameterError
        If either is unknown.
    """
    if what not in SAVED:
        raise ParameterError(f"{what!r} cannot be saved.", remedy=f"Use one of {', '.join(SAVED)}.")
    place, suffixes = SAVED[what]
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise ParameterError(
            f"'{path.name}' has an unknown suffix.", remedy=f"Use one of {', '.join(suffixes)}."
        )
    return place, FHIR if (what, suffix) == ("report", ".json") else _TYPES[suffix]
