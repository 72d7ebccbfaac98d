"""Models that come with the package, and models in files."""

from __future__ import annotations

from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Final

from modalmotion.classification.model.hdf5 import model_from_hdf5
from modalmotion.classification.model.model import Model
from modalmotion.errors import NotFoundError
from modalmotion.facts import Facts

DEFAULT_MODEL: Final = "ventricle-simulated"
"""The one that is asked where none is named: of material points, or `OFFSET_MODEL` for it."""

OFFSET_MODEL: Final = "ventricle-simulated-offset"
"""The one that reads surfaces whose points may slide over the tissue."""

RULE: Final = (
    f"Where {DEFAULT_MODEL} is requested, or no model, a recording that states tracking=material "
    f"is read by it; any other, stated as offset or not at all, by {OFFSET_MODEL}."
)
"""Which of the two answers; it stands in their cards."""


def shipped_for(name: str, facts: Facts) -> str:
    """Name of the shipped model that reads what a recording's points follow.

    Parameters
    ----------
    name : str
        As requested, with or without a version. Any but the default model's stays as it is.
    facts : Facts
        Of the recording. Only points that are stated to be material are read as such: motion
        within a surface that nobody measured looks like a ventricle without torsion.
    """
    if name.split("@")[0] == DEFAULT_MODEL and facts.tracking != "material":
        return name.replace(DEFAULT_MODEL, OFFSET_MODEL, 1)
    return name


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
            remedy=f"Use one of: {', '.join(available_models())}; of a file give its Path.",
        )
    return _load_shipped(which)


@cache
def _load_shipped(name: str) -> Model:
    return model_from_hdf5((files(__package__) / "data" / f"{name}.h5").read_bytes())
