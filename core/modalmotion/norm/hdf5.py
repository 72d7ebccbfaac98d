"""Norms as HDF5: plain arrays and plain texts, checked on reading."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classification.model.kept_members import Values, reader_of, reader_texts
from modalmotion.classification.model.model import Readable
from modalmotion.classification.model.record import require_model_name
from modalmotion.clinical import Fraction
from modalmotion.hdf5.contents import Contents
from modalmotion.hdf5.form import Form
from modalmotion.hdf5.image import Dataset, json_text
from modalmotion.norm.controls import QUANTITIES, Reading
from modalmotion.norm.norm import Norm

FORM: Final = Form("norm", 1)

# Of each control, in JSON.
_TEXTS: Final = ("conditions", "covariates", "tracking", "sequence_id", "subject")


def norm_to_hdf5(norm: Norm) -> bytes:
    """Write a norm as a sealed HDF5 file in memory.

    It holds features of the controls and no shape. Names of files are left out.

    Parameters
    ----------
    norm : Norm

    Returns
    -------
    bytes
        The same for the same norm.
    """
    controls = norm.controls
    readable = norm.readable
    datasets = [
        Dataset("values", np.array([c.values for c in controls]), "1", "control, reading, feature"),
        Dataset(
            "quantities", np.array([c.quantities for c in controls]), "%, ml", "control, quantity"
        ),
        json_text(
            "readable",
            {
                "topologies": readable.topologies,
                "n_modes": readable.n_modes,
                "connectivity_id": readable.connectivity_id,
                "parameters": parameters_as_json(readable.parameters),
            },
        ),
        json_text("reader", reader_texts(norm.reader)),
        json_text("columns", norm.columns),
        json_text("controls", [_texts(one) for one in controls]),
        json_text("notes", norm.notes),
    ]
    return FORM.image({"norm_id": norm.id}, datasets, name=norm.name)


def norm_from_hdf5(source: bytes | Path) -> Norm:
    """Read a norm, bit for bit as it was written.

    Parameters
    ----------
    source : bytes or Path

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged, or is no norm.
    """
    with FORM.read(source) as contents:
        norm = _norm(contents)
        if norm.id != contents.text("norm_id"):
            raise ValueError("its contents are not those that its id names")
    return norm


def _norm(contents: Contents) -> Norm:
    texts = contents.json("controls", list)
    columns = tuple(map(str, contents.json("columns", list)))
    values = contents.array("values", (len(texts), None, len(columns)))
    quantities = contents.array("quantities", (len(texts), len(QUANTITIES)))
    readable = contents.json("readable", dict)
    return Norm(
        name=require_model_name(contents.text("name")),
        readable=Readable(
            topologies=tuple(map(str, readable["topologies"])),
            n_modes=int(readable["n_modes"]),
            connectivity_id=str(readable["connectivity_id"]),
            parameters=parameters_from_json(readable["parameters"]),
        ),
        reader=reader_of(contents.json("reader", dict), Values(np.zeros(0))),
        columns=columns,
        controls=tuple(
            _control(text, own, numbers)
            for text, own, numbers in zip(texts, values, quantities, strict=True)
        ),
        notes=tuple(map(str, contents.json("notes", list))),
    )


def _texts(one: Reading) -> dict[str, Any]:
    texts = {name: getattr(one, name) for name in _TEXTS}
    return {**texts, "fraction": None if one.fraction is None else str(one.fraction)}


def _control(text: Mapping[str, Any], values: Any, quantities: Any) -> Reading:
    fraction = text["fraction"]
    return Reading(
        values=values,
        quantities=quantities,
        fraction=None if fraction is None else Fraction(fraction),
        **{name: text[name] for name in _TEXTS},
    )
