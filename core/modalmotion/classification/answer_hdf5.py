"""Classifications as HDF5."""

from __future__ import annotations

import hashlib
from dataclasses import asdict
from pathlib import Path
from typing import Final

from modalmotion.classification.answer import Classification, ModeContribution
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Contents, Dataset, json_text
from modalmotion.mesh import UNKNOWN
from modalmotion.notes import notes_from_json
from modalmotion.signature.making import SignatureParameters

FORM: Final = Form("classification", 5)

_OF_ANSWER: Final = ("classes", "label", "class_set", "coverage", "flags", "notes", "provenance")


def classification_key(
    parameters: SignatureParameters,
    coverage: float,
    tracking: str = UNKNOWN,
    handedness: str = UNKNOWN,
    cavity: str = UNKNOWN,
) -> str:
    """Short name of a request to a model.

    Parameters
    ----------
    parameters : SignatureParameters
        Of the signature.
    coverage : float
        Of the class set.
    tracking : str
        What the points follow, where the answer's notes depend on it.
    handedness, cavity : str
        Of the coordinates, and what the surface encloses: facts that answers depend on.
    """
    facts = [f" {one}" for one in (tracking, handedness, cavity) if one != UNKNOWN]
    text = f"{parameters.key} {coverage!r}{''.join(facts)}"
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def classification_to_hdf5(
    classification: Classification, *, parameters_key: str | None = None
) -> bytes:
    """Write a classification as a sealed HDF5 file in memory.

    Parameters
    ----------
    classification : Classification
    parameters_key : str, optional
        Key of the request; see `classification_key`.

    Returns
    -------
    bytes
        The same for the same classification.

    Raises
    ------
    StoreError
        If the name of the model is not a text that HDF5 can contain.
    """
    ids = {"sequence_id": classification.sequence_id, "model_id": classification.model_id}
    if parameters_key is not None:
        ids["parameters_key"] = parameters_key
    datasets = [
        Dataset("probabilities", classification.probabilities, "1", "class"),
        *(json_text(name, getattr(classification, name)) for name in _OF_ANSWER),
        json_text("explanation", [asdict(part) for part in classification.explanation]),
    ]
    return FORM.image(ids, datasets, model=classification.model)


def classification_from_hdf5(source: bytes | Path) -> Classification:
    """Read a classification, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    StoreError
        As in `Form.read`.
    """
    return read_classification(source)[0]


def read_classification(source: bytes | Path) -> tuple[Classification, Contents]:
    """Read a classification together with the contents of its file."""
    with FORM.read(source) as contents:
        classes = tuple(contents.json("classes", list))
        label = contents.json("label", object)
        if label not in (None, *classes):
            raise ValueError(f"the label {str(label)[:80]!r} is not one of the classes")
        classification = Classification(
            sequence_id=contents.text("sequence_id"),
            model=contents.text("model"),
            model_id=contents.text("model_id"),
            label=None if label is None else str(label),
            classes=classes,
            probabilities=contents.array("probabilities", (len(classes),)),
            notes=notes_from_json(contents.json("notes", list)),
            provenance=contents.json("provenance", dict),
            class_set=tuple(contents.json("class_set", list)),
            coverage=float(contents.json("coverage", float)),
            flags=tuple(contents.json("flags", list)),
            explanation=tuple(
                ModeContribution(**{**part, "modes": tuple(part["modes"])})
                for part in contents.json("explanation", list)
            ),
        )
    return classification, contents
