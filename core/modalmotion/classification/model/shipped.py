"""Models that come with the package, and models in files."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from modalmotion.classification.model.model import Model
from modalmotion.classification.model.text import model_from_bytes
from modalmotion.errors import CorruptFileError, NotFoundError

DEFAULT_MODEL: Final = "ventricle-simulated"


def available_models() -> tuple[str, ...]:
    """Names of the models that come with the package, sorted."""
    folder = files(__package__) / "data"
    return tuple(
        sorted(file.name.removesuffix(".json") for file in folder.iterdir() if file.is_file())
    )


def load_model(which: str | Path = DEFAULT_MODEL) -> Model:
    """Load a model.

    Parameters
    ----------
    which : str or Path
        A str is the name of a model that comes with the package, and never a path, so that it
        may come from a stranger; a Path is a file written by `model_to_bytes`, or the HDF5 file
        of a model that was trained by a command or a service.

    Returns
    -------
    Model

    Raises
    ------
    NotFoundError
        If there is no such model.
    CorruptFileError
        If the file is no model, was altered, or predicts its golden batch differently here.
    """
    if isinstance(which, Path):
        try:
            content = which.read_bytes()
        except OSError as error:
            raise NotFoundError(
                f"The model file {which.name!r} cannot be read: {error.strerror}.",
                remedy="Name an existing file.",
            ) from error
        # Here, for what is shipped needs no h5py.
        from modalmotion.classification.model.hdf5 import model_from_hdf5
        from modalmotion.hdf5.gate import SIGNATURE

        if content.startswith(SIGNATURE):
            return model_from_hdf5(which)
        try:
            return model_from_bytes(content)
        except CorruptFileError as error:
            raise CorruptFileError(
                f"{which.name!r}: {error.message}", remedy=error.remedy, details=error.details
            ) from error
    if which not in available_models():
        raise NotFoundError(
            f"There is no model named {which[:80]!r}.",
            remedy=f"Use one of: {', '.join(available_models())}.",
        )
    return _load_shipped(which)


@cache
def _load_shipped(name: str) -> Model:
    return model_from_bytes((files(__package__) / "data" / f"{name}.json").read_bytes())
