"""Models that come with the package, and models in files."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from modalmotion.classification.model.hdf5 import model_from_hdf5
from modalmotion.classification.model.model import Model
from modalmotion.errors import NotFoundError

DEFAULT_MODEL: Final = "ventricle-simulated"


def available_models() -> tuple[str, ...]:
    """Names of the models that come with the package, sorted."""
    folder = files(__package__) / "data"
    return tuple(
        sorted(file.name.removesuffix(".h5") for file in folder.iterdir() if file.is_file())
    )


def load_model(which: str | Path = DEFAULT_MODEL) -> Model:
    """Load a model.

    Parameters
    ----------
    which : str or Path
        A str is the name of a model that comes with the package, and never a path, so that it
        may come from a stranger; a Path is a file written by `model_to_hdf5`, as a command or a
        service that trains a model gives it.

    Returns
    -------
    Model

    Raises
    ------
    NotFoundError
        If there is no such model.
    OlderFileError, CorruptFileError, ModelNotReproducedError
        As `model_from_hdf5` does.
    """
    if isinstance(which, Path):
        return model_from_hdf5(which)
    if which not in available_models():
        raise NotFoundError(
            f"There is no model named {which[:80]!r}.",
            remedy=f"Use one of: {', '.join(available_models())}.",
        )
    return _load_shipped(which)


@cache
def _load_shipped(name: str) -> Model:
    return model_from_hdf5((files(__package__) / "data" / f"{name}.h5").read_bytes())
