"""The one table of what the client writes to files: where it comes from, and in which forms."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from modalmotion.errors import ParameterError, StoreError

JSON: Final = "application/json"
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
    StoreError
        If the file cannot be written there.
    """
    if what not in SAVED:
        raise ParameterError(f"{what!r} cannot be saved.", remedy=f"Use one of {', '.join(SAVED)}.")
    require_place(path)
    place, suffixes = SAVED[what]
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise ParameterError(
            f"'{path.name}' has an unknown suffix.", remedy=f"Use one of {', '.join(suffixes)}."
        )
    return place, FHIR if (what, suffix) == ("report", ".json") else _TYPES[suffix]


def require_place(path: Path) -> None:
    """Check that a file can be written there, before anything is asked for.

    Raises
    ------
    StoreError
        If there is no such folder, or a folder of that name.
    """
    reason = None
    if not path.parent.is_dir():
        reason = f"there is no folder '{path.parent}'"
    elif path.is_dir():
        reason = "it is a folder"
    elif not os.access(path.parent, os.W_OK):
        reason = f"the folder '{path.parent}' may not be written to"
    if reason is not None:
        raise StoreError(
            f"'{path.name}' cannot be written: {reason}.",
            remedy="Make the folder, or name a file in another one.",
        )


def write(content: bytes, path: Path) -> None:
    """Write a file, all of it or none.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise StoreError(
            f"'{path.name}' cannot be written: {error.strerror}.",
            remedy="Check its folder, and the room on its disk.",
        ) from error
