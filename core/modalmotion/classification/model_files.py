"""Models in HDF5 files, plain arrays and plain texts, and those that come with the package."""

from dataclasses import dataclass, replace
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion import errors, mesh, notes
from modalmotion.classification import motion_features, outliers, performance
from modalmotion.classification.card import ModelCard, ModelRecord, require_model_name
from modalmotion.classification.model import (
    OF_DETECTOR,
    OF_MODEL,
    Arrays,
    Model,
    Readable,
    answering_parts,
)
from modalmotion.classification.motion import Column
from modalmotion.hdf5.image import ANY_IDS, Contents, Dataset, Form, Ids, json_text
from modalmotion.representation import shown
from modalmotion.signature.parameters import parameters_from_json

FORM: Final = Form("model", 12)

_LARGEST: Final = 512 * 2**20

DEFAULT_MODEL: Final = "ventricle-simulated"
"""The one that is asked where none is named, or `NORMAL_DISPLACEMENT_MODEL` in its place."""

NORMAL_DISPLACEMENT_MODEL: Final = "ventricle-simulated-normal-displacement"
"""The one that reads surfaces whose points may slide over the tissue."""

RULE: Final = (
    f"Where {DEFAULT_MODEL} is requested, or no model, a recording that states tracking=material "
    f"is read by it; any other, by {NORMAL_DISPLACEMENT_MODEL}."
)
"""Which of the two answers; it stands in their cards."""

# Datasets of a model, with their axes: those of one name have one length.
_AXES: Final = {
    "weights": "feature, class",
    "intercepts": "class",
    "centre": "feature",
    "shares": "class, end",
    "n_strangeness": "class",
    "strangeness": "score",
    "means": "class, kind",
    "whitening": "kind, kind",
    "points": "point, place",
    "scales": "place",
    "directions": "symmetry, kind",
    "signs": "symmetry, kind",
    "limits": "check",
    "bounds": "bound",
    "held_out_ids": "case, byte",
    "held_out_subjects": "case",
    "held_out_classes": "case",
    "held_out_probabilities": "repetition, case, class",
    "held_out_folds": "repetition, case",
}
_TEXTS: Final = ("readable", "tables", "columns", "detector", "notes")


@shown("record.name", "record.version", "record.id")
@dataclass(frozen=True)
class KeptModel:
    """A model as a file holds it, its arrays not interpreted.

    Parameters
    ----------
    record : ModelRecord
        Version 0 until a store numbers it.
    card : dict
        How it was made and tested, and what it is for; JSON values.
    arrays : dict of str to ndarray
        All that its answers depend on, and its held-out answers.
    texts : dict
        The same, of what is no array; JSON values.
    """

    record: ModelRecord
    card: dict[str, Any]
    arrays: Arrays
    texts: dict[str, Any]


def kept_model(model: Model, *, training: str | None = None) -> KeptModel:
    """Take a model to pieces that a store can keep.

    Parameters
    ----------
    model : Model
    training : str, optional
        See `ModelRecord`.
    """
    record = ModelRecord(
        name=model.name,
        version=0,
        id=model.id,
        classes=model.classes,
        parameters=model.signature_parameters,
        created="",
        training=training,
    )
    arrays, texts = answering_parts(model)
    if model.cross_validation is not None:
        arrays |= _held_out_arrays(model.cross_validation)
    return KeptModel(record, model.card.as_json(), arrays, {name: texts[name] for name in _TEXTS})


def numbered(model: KeptModel, version: int, created: str) -> KeptModel:
    """Give a model its number and its time."""
    return replace(model, record=replace(model.record, version=version, created=created))


def model_to_hdf5(model: Model | KeptModel) -> bytes:
    """Write a model as a sealed HDF5 file in memory.

    Returns
    -------
    bytes
        The same for the same model, version and times.

    Raises
    ------
    ParameterError
        If its name cannot be stored.
    """
    kept = kept_model(model) if isinstance(model, Model) else model
    record = kept.record
    datasets = [
        *(Dataset(name, array, "1", _AXES[name]) for name, array in sorted(kept.arrays.items())),
        *(json_text(name, text) for name, text in sorted(kept.texts.items())),
        json_text("classes", record.classes),
        json_text("card", kept.card),
        json_text("origin", {"created": record.created, "training": record.training}),
    ]
    name = require_model_name(record.name)
    return FORM.image({"model_id": record.id}, datasets, model=name, version=record.version)


def read_kept_model(source: bytes | Path, ids: Ids = ANY_IDS) -> KeptModel:
    """Read a model's file without interpreting the model in it."""
    _require_size(source)
    with FORM.read(source, ids) as contents:
        return kept_model_in(contents)


def kept_model_in(contents: Contents) -> KeptModel:
    """Take a model from the contents of its file, not interpreted."""
    origin, number = contents.json("origin", dict), contents.attributes["version"]
    if not isinstance(number, int):
        raise TypeError("the version is not a number")
    texts = {name: contents.json(name, object) for name in _TEXTS}
    record = ModelRecord(
        name=contents.text("model"),
        version=number,
        id=contents.text("model_id"),
        classes=tuple(map(str, contents.json("classes", list))),
        parameters=parameters_from_json(texts["readable"]["parameters"]),  # type: ignore[index]
        created=origin["created"],
        training=origin["training"],
    )
    arrays = {name: array for name, array in contents.arrays.items() if name in _AXES}
    return KeptModel(record, contents.json("card", dict), arrays, texts)


def model_from_hdf5(source: bytes | Path) -> Model:
    """Read a model, and check that it is the one that its file names.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    _require_size(source)
    with FORM.read(source) as contents:
        kept = kept_model_in(contents)
        model = _model(kept, contents)
    if model.id != kept.record.id:
        raise errors.CorruptFileError(
            f"{contents.name} does not contain the model {kept.record.reference}: its sha256 is "
            f"{model.id[:12]}…, not {kept.record.id[:12]}….",
            remedy="Restore it from a copy, or delete this version and train it again.",
        )
    return model


def _require_size(source: bytes | Path) -> None:
    if isinstance(source, bytes):
        name, size = "The HDF5 image", len(source)
    else:
        name, size = f"'{source.name}'", source.stat().st_size if source.is_file() else 0
    if size > _LARGEST:
        raise errors.CorruptFileError(
            f"{name} has {size} bytes; a model has at most {_LARGEST}.", remedy="Name a model."
        )


def _model(kept: KeptModel, contents: Contents) -> Model:
    classes, texts = kept.record.classes, kept.texts
    readable = Readable.from_json(texts["readable"])
    columns = tuple(Column(str(name), tuple(map(int, modes))) for name, modes in texts["columns"])
    modes = {k for column in columns for k in column.modes}
    if len(set(classes)) < max(len(classes), 2) or not modes <= set(range(readable.n_modes)):
        raise ValueError("the parts of the model do not fit together")
    sizes = {"class": len(classes), "feature": len(columns), "end": 2, "symmetry": 2, "bound": 3}
    sizes |= {"place": len(outliers.PLACE), "check": len(outliers.CHECKS)}
    arrays = contents.table({name: ("1", _AXES[name]) for name in kept.arrays}, sizes)
    ends = np.cumsum(arrays["n_strangeness"].astype(np.int64))
    detector = texts["detector"]
    return Model(
        name=kept.record.name,
        classes=classes,
        readable=readable,
        tables=tuple(map(motion_features.Extractor.from_json, texts["tables"])),
        columns=columns,
        outliers=outliers.OutlierDetector(
            reader=motion_features.Extractor.from_json(detector["reader"]),
            knows_size=bool(detector["knows_size"]),
            has_unit=bool(detector["has_unit"]),
            **{name: arrays[name] for name in OF_DETECTOR},
        ),
        strangeness=tuple(np.split(arrays["strangeness"], ends[:-1])),
        notes={str(label): notes.notes_from_json(said) for label, said in texts["notes"].items()},
        card=ModelCard.from_json(kept.card),
        cross_validation=_held_out(classes, arrays),
        **{name: arrays[name] for name in OF_MODEL},
    )


def _held_out_arrays(validation: performance.CrossValidation) -> Arrays:
    """Write held-out answers without names, and subjects by number."""
    ids = b"".join(bytes.fromhex(sequence_id) for sequence_id in validation.sequence_ids)
    numbers = {name: k for k, name in enumerate(dict.fromkeys(validation.subjects))}
    return {
        "held_out_ids": np.frombuffer(ids, dtype=np.uint8).reshape(len(validation.y), -1),
        "held_out_subjects": np.array([numbers[name] for name in validation.subjects]),
        "held_out_classes": validation.y,
        "held_out_probabilities": validation.probabilities,
        "held_out_folds": validation.folds,
    }


def _held_out(classes: tuple[str, ...], arrays: Arrays) -> performance.CrossValidation | None:
    if "held_out_classes" not in arrays:
        return None
    y, ids = arrays["held_out_classes"].astype(np.int64), arrays["held_out_ids"]
    if not len(y) or y.min() < 0 or y.max() >= len(classes):
        raise ValueError("a held-out case has a class that the model does not know")
    return performance.CrossValidation(
        classes=classes,
        sequence_ids=tuple(row.tobytes().hex() for row in ids),
        names=("",) * len(y),
        subjects=tuple(f"subject {int(k) + 1}" for k in arrays["held_out_subjects"]),
        y=y,
        probabilities=arrays["held_out_probabilities"],
        folds=arrays["held_out_folds"].astype(np.int64),
    )


def shipped_for(name: str, facts: mesh.Facts) -> str:
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
        return name.replace(DEFAULT_MODEL, NORMAL_DISPLACEMENT_MODEL, 1)
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
        A str that ends in .h5 or .hdf5, or a Path, is a file written by `model_to_hdf5`; any
        other str is the name of a model that comes with the package. A name from a stranger is
        to be checked against `available_models` first.

    Returns
    -------
    Model

    Raises
    ------
    NotFoundError
        If there is no such model.
    CorruptFileError
        As `model_from_hdf5` does.
    """
    if isinstance(which, Path) or which.endswith((".h5", ".hdf5")):
        return model_from_hdf5(Path(which))
    if which not in available_models():
        raise errors.NotFoundError(
            f"There is no model named {which[:80]!r}.",
            remedy=f"Use one of: {', '.join(available_models())}; or a file: mine.h5.",
        )
    return _load_shipped(which)


@cache
def _load_shipped(name: str) -> Model:
    return model_from_hdf5((files(__package__) / "data" / f"{name}.h5").read_bytes())
