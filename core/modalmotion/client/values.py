"""Answers of the service as values with members and arrays, and as files."""

import io
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.client.connection import JSON, Answer
from modalmotion.client.errors import understood
from modalmotion.errors import ParameterError
from modalmotion.mesh import facts_from_json
from modalmotion.representation import LONGEST_LINE

# Arrays of a signature that is one of many.
PACKED: Final = (
    *("modes", "amplitudes", "amplitude_deviations", "angular_frequencies", "times"),
    *("rms_errors", "weighted_rms_errors"),
)
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


def compressed_of(answer: Answer) -> Info:
    """Read a compressed stream as `data`, with its errors as the service measured them."""
    names = ("rms", "max_error", "kg_error", "bits_per_vertex_and_frame")
    with understood("a stream with its measured errors as headers"):
        stated = {one: float(answer.headers[f"encoded-{one.replace('_', '-')}"]) for one in names}
        transform = answer.headers["encoded-transform"]
        return Info({**stated, "transform": transform, "data": answer.content})


def arrays_of(answer: Answer) -> Info:
    """Read an archive .npz: its arrays by name."""
    with (
        understood("an archive of arrays"),
        np.load(io.BytesIO(answer.content), allow_pickle=False) as arrays,
    ):
        return Info(arrays)


def pack_of(answer: Answer) -> list[Info]:
    """Read many signatures from one .npz archive."""
    with understood("an archive of signatures"):
        pack = arrays_of(answer)
        known = zip(pack["ids"].tolist(), pack["labels"].tolist(), strict=True)
        return [
            Info({"id": one, "label": label} | {name: pack.get(f"{name}_{k}") for name in PACKED})
            for k, (one, label) in enumerate(known)
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
