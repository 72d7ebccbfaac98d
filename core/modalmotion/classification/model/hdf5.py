"""Models as HDF5: plain arrays and plain texts, checked on reading; nothing in them is run."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.cross_validation import validation_arrays, validation_of
from modalmotion.classification.model.decision import Decision
from modalmotion.classification.model.kept_domain import domain_arrays, domain_of
from modalmotion.classification.model.kept_members import (
    member_arrays,
    members_of,
    reader_texts,
)
from modalmotion.classification.model.model import Model, Readable
from modalmotion.classification.model.record import ModelRecord, require_model_name
from modalmotion.errors import CorruptFileError, ModelNotReproducedError
from modalmotion.hdf5.contents import Contents
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Dataset, json_text
from modalmotion.representation import shown

FORM: Final = Form("model", 6)

# The golden batch must come out as it was stored, up to the last digits.
_GOLDEN_TOLERANCE: Final = 1e-9

_LARGEST: Final = 512 * 2**20

# Datasets of the model's own, with their axes; all but these and its texts say what it is.
_AXES: Final = {
    "typical": "value",
    "patterns": "value",
    "centre": "feature",
    "scale": "feature",
    "n_scorers": "member",
    "n_anchors": "scorer",
    "anchors": "value",
    "gammas": "scorer",
    "weights": "value",
    "intercepts": "scorer, class",
    "scorer_temperatures": "scorer",
    "temperatures": "member",
    "temperature": "",
    "member_weights": "member",
    "machine": "byte",
    "means": "class, kind",
    "whitening": "kind, direction",
    "spreads": "class",
    "points": "case, place",
    "scales": "place",
    "directions": "twin, kind",
    "centres": "class, twin",
    "course": "mean or deviation, measure",
    "limits": "check",
    "least": "limit",
    "domain": "",
    "n_scores": "class",
    "scores": "score",
    "decision": "",
    "held_out_ids": "case, byte",
    "held_out_subjects": "case",
    "held_out_classes": "case",
    "held_out_probabilities": "repetition, case, class",
    "held_out_folds": "repetition, case",
    "golden_features": "case, feature",
    "golden_probabilities": "case, class",
    "readable": "",
    "readers": "",
    "domain_reader": "",
    "columns": "",
    "notes": "",
}


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
        All that its answers depend on, as in the file: texts as JSON.
    """

    record: ModelRecord
    card: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


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
    return KeptModel(record, model.card.as_json(), _arrays(model))


def numbered(model: KeptModel, version: int, created: str) -> KeptModel:
    """Give a model its number and its time."""
    return replace(model, record=replace(model.record, version=version, created=created))


def model_to_hdf5(model: Model | KeptModel) -> bytes:
    """Write a model as a sealed HDF5 file in memory.

    Parameters
    ----------
    model : Model or KeptModel

    Returns
    -------
    bytes
        The same for the same model, version and times.

    Raises
    ------
    ParameterError
        If its name cannot be stored.
    """
    stored_model = kept_model(model) if isinstance(model, Model) else model
    record = stored_model.record
    datasets = [
        *(
            Dataset(name, array, "none" if array.dtype.kind in "Su" else "1", _AXES[name])
            for name, array in sorted(stored_model.arrays.items())
        ),
        json_text("classes", record.classes),
        json_text("parameters", parameters_as_json(record.parameters)),
        json_text("card", stored_model.card),
        json_text("origin", {"created": record.created, "training": record.training}),
    ]
    name = require_model_name(record.name)
    return FORM.image({"model_id": record.id}, datasets, model=name, version=record.version)


def read_kept_model(source: bytes | Path) -> tuple[KeptModel, Contents]:
    """Read a model's file without interpreting the model in it."""
    _require_size(source)
    with FORM.read(source) as contents:
        return stored_model_in(contents), contents


def model_from_hdf5(source: bytes | Path) -> Model:
    """Read a model and have it predict its golden batch again.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As `Form.read` says.
    ModelNotReproducedError
        If the file is whole, and the model in it does not answer here as where it was made.
    """
    _require_size(source)
    with FORM.read(source) as contents:
        stored_model = stored_model_in(contents)
        model = _model(stored_model, contents)
    if model.id != stored_model.record.id:
        raise CorruptFileError(
            f"{contents.name} holds another model than {stored_model.record.reference}, as it "
            f"says: its sha256 is {model.id[:12]}…, not {stored_model.record.id[:12]}….",
            remedy="Restore it from a copy, or delete this version and train it again.",
        )
    _require_golden(model, stored_model.record)
    return model


def _require_size(source: bytes | Path) -> None:
    if isinstance(source, bytes):
        name, size = "The HDF5 image", len(source)
    else:
        name, size = f"'{source.name}'", source.stat().st_size if source.is_file() else 0
    if size > _LARGEST:
        raise CorruptFileError(
            f"{name} has {size} bytes; a model has at most {_LARGEST}.", remedy="Name a model."
        )


def stored_model_in(contents: Contents) -> KeptModel:
    """Take a model from the contents of its file, not interpreted."""
    origin = contents.json("origin", dict)
    number = contents.attributes["version"]
    if not isinstance(number, int):
        raise TypeError("the version is not a number")
    record = ModelRecord(
        name=contents.text("model"),
        version=number,
        id=contents.text("model_id"),
        classes=tuple(map(str, contents.json("classes", list))),
        parameters=parameters_from_json(contents.json("parameters", dict)),
        created=origin["created"],
        training=origin["training"],
    )
    arrays = {name: array for name, array in contents.arrays.items() if name in _AXES}
    return KeptModel(record, contents.json("card", dict), arrays)


def _arrays(model: Model) -> dict[str, NDArray[Any]]:
    domain, members = model.domain, model.members
    scores = model.calibration.scores
    # Members have features of their own: their arrays follow one another, row by row.
    arrays = {
        **member_arrays(members, len(model.classes)),
        "temperature": np.array(model.temperature, dtype=np.float64),
        **domain_arrays(domain),
        "n_scores": np.array([len(of_class) for of_class in scores], dtype=np.int64),
        "scores": np.concatenate(scores),
        "golden_features": model.golden_features,
        "golden_probabilities": model.golden_probabilities,
    }
    if model.cross_validation is not None:
        arrays |= validation_arrays(model.cross_validation)
    texts: dict[str, Any] = {
        "readable": {
            "topologies": model.readable.topologies,
            "n_modes": model.readable.n_modes,
            "connectivity_id": model.readable.connectivity_id,
        },
        "readers": [reader_texts(member.reader) for member in members],
        "domain_reader": reader_texts(domain.reader),
        "columns": [[[c.name, c.modes, c.power] for c in member.columns] for member in members],
        "notes": model.notes,
    }
    if model.decision is not None:
        texts["decision"] = model.decision.as_json()
    return {**arrays, **{name: json_text(name, text).values for name, text in texts.items()}}


def _model(stored_model: KeptModel, contents: Contents) -> Model:
    record = stored_model.record
    readable = contents.json("readable", dict)
    members = members_of(contents, len(record.classes))
    n = len(record.classes)
    d = sum(len(member.columns) for member in members)
    golden = contents.array("golden_features", (None, d))
    n_scores = contents.array("n_scores", (n,)).astype(np.int64)
    scores = contents.array("scores", (int(n_scores.sum()),))
    n_modes = int(readable["n_modes"])
    if (
        len(set(record.classes)) < max(n, 2)
        or not len(golden)
        or not all(
            0 <= mode < n_modes for m in members for column in m.columns for mode in column.modes
        )
    ):
        raise ValueError("the parts of the model do not fit together")
    return Model(
        name=record.name,
        classes=record.classes,
        readable=Readable(
            topologies=tuple(map(str, readable["topologies"])),
            n_modes=n_modes,
            connectivity_id=str(readable["connectivity_id"]),
            parameters=record.parameters,
        ),
        members=members,
        temperature=float(contents.number("temperature")),
        domain=domain_of(contents, n),
        calibration=Calibration(tuple(np.split(scores, np.cumsum(n_scores)[:-1]))),
        golden_features=golden,
        golden_probabilities=contents.array("golden_probabilities", (len(golden), n)),
        notes={
            str(label): tuple(map(str, texts))
            for label, texts in contents.json("notes", dict).items()
        },
        card=ModelCard.from_json(stored_model.card),
        cross_validation=validation_of(record.classes, contents),
        decision=Decision.from_json(record.classes, contents.json("decision", dict))
        if "decision" in contents.arrays
        else None,
    )


def _require_golden(model: Model, record: ModelRecord) -> None:
    try:
        # A foreign model may divide by zero; its probabilities are then not numbers.
        with np.errstate(all="ignore"):
            predicted = model.probabilities(model.golden_features)
            apart = np.abs(predicted - model.golden_probabilities).max()
        reason = f"a probability of its golden batch is off by {apart:.2g}."
    except CorruptFileError as error:
        apart, reason = np.inf, error.message
    except (ValueError, TypeError, AttributeError, IndexError) as error:
        apart, reason = np.inf, f"its estimator cannot predict ({str(error)[:100]})."
    if not apart <= _GOLDEN_TOLERANCE:
        reference = record.reference
        raise ModelNotReproducedError(
            f"The model {reference} is whole, but is not what it was when it was made: {reason}",
            remedy="Name another version, train it again, or use the versions of the libraries "
            "that its card states.",
            details={"model": reference.name, "version": reference.version},
        )
