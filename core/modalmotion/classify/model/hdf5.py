"""Models as HDF5: the model's own bytes, and beside them what can be said without reading it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classify.model.model import Model
from modalmotion.classify.model.record import ModelRecord, require_model_name
from modalmotion.classify.model.text import model_from_bytes, model_to_bytes
from modalmotion.errors import CorruptFileError, ModelNotReproducedError
from modalmotion.hdf5.contents import Contents, read_contents
from modalmotion.hdf5.image import INTENDED_USE, Attribute, Dataset, json_text, sealed_image
from modalmotion.representation import shown

KIND: Final = "model"
SCHEMA_VERSION: Final = 1


@shown("record.name", "record.version", "data")
@dataclass(frozen=True)
class KeptModel:
    """A model as a file holds it, its bytes not interpreted.

    Parameters
    ----------
    record : ModelRecord
        Version 0 until a store has given it a number.
    card : dict
        How it was made and tested, and what it is for; JSON values.
    data : bytes
        As `model_to_bytes` wrote them.
    """

    record: ModelRecord
    card: dict[str, Any]
    data: bytes


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
    return KeptModel(record, model.card.as_json(), model_to_bytes(model))


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
        If its name cannot be kept.
    """
    kept = kept_model(model) if isinstance(model, Model) else model
    record = kept.record
    attributes: dict[str, Attribute] = {
        "schema": f"modalmotion.{KIND}",
        "schema_version": SCHEMA_VERSION,
        "kind": KIND,
        "intended_use": INTENDED_USE,
        "model": require_model_name(record.name),
        "version": record.version,
    }
    datasets = [
        Dataset("contents", np.frombuffer(kept.data, dtype=np.uint8), "none", "byte"),
        json_text("classes", record.classes),
        json_text("parameters", parameters_as_json(record.parameters)),
        json_text("card", kept.card),
        json_text("origin", {"created": record.created, "training": record.training}),
    ]
    return sealed_image(attributes, {"model_id": record.id}, datasets)


def model_from_hdf5(source: bytes | Path) -> Model:
    """Read a model and have it predict its golden batch again.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged, foreign, or written by a newer version.
    ModelNotReproducedError
        If the file is whole, and the model in it does not answer here as where it was made.
    """
    kept = read_kept_model(source)[0]
    named = kept.record.reference
    try:
        model = model_from_bytes(kept.data)
    except CorruptFileError as error:
        # The seal is right: the bytes are those that were written.
        raise ModelNotReproducedError(
            f"The model {named} is whole, but is not what it was when it was made: {error.message}",
            remedy="Name another version, train it again, or use the versions of the libraries "
            "that its card states.",
            details={"model": named.name, "version": named.version},
        ) from error
    if model.id != kept.record.id:
        raise CorruptFileError(
            f"The file of the model {named} holds another model than it says.",
            remedy="Restore it from a copy, or delete this version and train it again.",
        )
    return model


def read_kept_model(source: bytes | Path) -> tuple[KeptModel, Contents]:
    """Read a model's file without interpreting the model in it."""
    with read_contents(source, KIND, SCHEMA_VERSION) as contents:
        origin = contents.json("origin", dict)
        number = contents.attributes["version"]
        if not isinstance(number, int):
            raise TypeError("the version is no number")
        record = ModelRecord(
            name=contents.text("model"),
            version=number,
            id=contents.text("model_id"),
            classes=tuple(contents.json("classes", list)),
            parameters=parameters_from_json(contents.json("parameters", dict)),
            created=origin["created"],
            training=origin["training"],
        )
        data = contents.array("contents", (None,)).tobytes()
        return KeptModel(record, contents.json("card", dict), data), contents


def numbered(kept: KeptModel, version: int, created: str) -> KeptModel:
    """Give a model its number and its time."""
    return replace(kept, record=replace(kept.record, version=version, created=created))
