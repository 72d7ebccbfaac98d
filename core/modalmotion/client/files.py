"""The one table of what the client writes to files: where it comes from, and in which forms."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, NamedTuple

from modalmotion.errors import ParameterError, StoreError

JSON: Final = "application/json"
HDF5: Final = "application/x-hdf5"
NPZ: Final = "application/x-npz"
PNG: Final = "image/png"
CSV: Final = "text/csv"
ZIP: Final = "application/zip"
STREAM: Final = "application/vnd.modalmotion.stream"

_OF_SIGNATURE: Final = "/v1/signatures/{}"


class Saved(NamedTuple):
    """Where something comes from, and its forms.

    Parameters
    ----------
    path : str
        With braces for its id or its name.
    forms : dict
        Media types by suffix.
    has_body : bool
        Whether its options are the body of a POST.
    """

    path: str
    forms: dict[str, str]
    has_body: bool = False


SAVED: Final = {
    "signature": Saved(
        _OF_SIGNATURE, {".h5": HDF5, ".npz": NPZ, ".png": PNG, ".csv": CSV, ".json": JSON}
    ),
    "readouts": Saved(f"{_OF_SIGNATURE}/readouts", {".png": PNG, ".csv": CSV, ".json": JSON}),
    "strain": Saved(f"{_OF_SIGNATURE}/strain", {".json": JSON}),
    "reconstruction": Saved(
        f"{_OF_SIGNATURE}/reconstruction",
        {
            ".npz": NPZ,
            ".vtkhdf": "application/vnd.vtk.vtkhdf",
            ".glb": "model/gltf-binary",
            ".zip": ZIP,
        },
    ),
    "report": Saved(
        f"{_OF_SIGNATURE}/report",
        {".pdf": "application/pdf", ".json": "application/fhir+json", ".csv": CSV},
    ),
    "view": Saved(f"{_OF_SIGNATURE}/view", {".html": "text/html"}),
    "tradeoff": Saved("/v1/sequences/{}/tradeoff", {".png": PNG, ".json": JSON}, has_body=True),
    "stream": Saved("/v1/sequences/{}/encoded", {".mms": STREAM}),
    "template": Saved("/v1/templates/{}", {".png": PNG, ".json": JSON}),
    "modes": Saved("/v1/templates/{}/modes", {".png": PNG, ".npz": NPZ, ".h5": HDF5}),
    "track": Saved("/v1/tracks/{}", {".h5": HDF5, ".png": PNG, ".json": JSON}),
    "model": Saved(
        "/v1/models/{}",
        {".h5": HDF5, ".hdf5": HDF5, ".png": PNG, ".csv": CSV, ".md": "text/markdown"},
    ),
    "evaluation": Saved("/v1/models/{}/evaluations", {".png": PNG, ".csv": CSV}, has_body=True),
    "norm": Saved("/v1/norms/{}", {".h5": HDF5}),
    "features": Saved("/v1/features", {".csv": CSV, ".json": JSON}, has_body=True),
}
"""By the name that `Client.save` takes."""


def form_of(what: str, path: Path) -> tuple[Saved, str]:
    """Look up what is saved, and the media type that the file's suffix stands for.

    Raises
    ------
    ParameterError
        If either is unknown.
    StoreError
        If the file cannot be written there.
    """
    saved = SAVED.get(what)
    if saved is None:
        raise ParameterError(f"{what!r} cannot be saved.", remedy=f"Use one of {', '.join(SAVED)}.")
    require_place(path)
    media_type = saved.forms.get(path.suffix.lower())
    if media_type is None:
        raise ParameterError(
            f"'{path.name}' has an unknown suffix.", remedy=f"Use one of {', '.join(saved.forms)}."
        )
    return saved, media_type


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
