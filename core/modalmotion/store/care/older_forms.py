"""Files that older versions wrote, rewritten as today's; only `rebuild` reads them."""

from __future__ import annotations

import base64
import contextlib
import json
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.parameters import parameters_from_json
from modalmotion.classification.answer.classification import Classification
from modalmotion.classification.answer.hdf5 import classification_to_hdf5
from modalmotion.classification.estimators.scorer import Blend, Scorer
from modalmotion.classification.features import Column, FeatureReader
from modalmotion.classification.model.card import ModelCard
from modalmotion.classification.model.conformal import Calibration
from modalmotion.classification.model.domain import of_kind_alone
from modalmotion.classification.model.hdf5 import (
    kept_model,
    model_from_hdf5,
    model_to_hdf5,
    numbered,
)
from modalmotion.classification.model.member import Member
from modalmotion.classification.model.model import Model, Readable
from modalmotion.errors import ModalMotionError, NotFoundError, StoreError
from modalmotion.hdf5.contents import Contents
from modalmotion.hdf5.form import Form, form_of
from modalmotion.mesh.hdf5 import sequence_from_hdf5, sequence_in, sequence_to_hdf5
from modalmotion.signature.hdf5 import signature_in, signature_to_hdf5
from modalmotion.signature.making import modal_signature
from modalmotion.store.disk.atomic import write_atomic
from modalmotion.store.disk.sealed_json import JsonForm
from modalmotion.store.folder import Folder
from modalmotion.store.record import FORM as RECORD
from modalmotion.store.record import record_from, record_to_json
from modalmotion.template.hdf5 import template_from_hdf5
from modalmotion.tracking.hdf5 import track_in, track_to_hdf5


@dataclass(frozen=True)
class Rewriting:
    """Outcome for the files of older versions.

    Parameters
    ----------
    rewritten : dict of str to int
        Files that hold today's schema now, by kind.
    refused : dict of str to str
        Files that could not be taken, as they were, and why.
    """

    rewritten: dict[str, int]
    refused: dict[str, str]


def rewrite_older(folder: Folder) -> Rewriting:
    """Rewrite the files of a store that have an older schema, each as a whole or not at all.

    Damaged files are passed over; `reconcile` reports them.

    Parameters
    ----------
    folder : Folder
        Held by this process alone.

    Raises
    ------
    StoreError
        If a file cannot be written; run again, it goes on where it stopped.
    """
    rewritten: Counter[str] = Counter()
    refused: dict[str, str] = {}
    for path in _files(folder):
        try:
            form = form_of(path)
        except StoreError:
            continue
        if form not in OLDER:
            continue
        try:
            with form.read(path) as contents:
                image = OLDER[form](contents, folder)
        except ModalMotionError as error:
            refused[folder.short(path)] = str(error)
        else:
            write_atomic(path, image)
            rewritten[form.kind] += 1
    for sequence_id in sorted(folder.scan().records):
        try:
            data = _record(folder, sequence_id)
        except StoreError:
            continue
        write_atomic(folder.record(sequence_id), data)
        rewritten["record"] += 1
    return Rewriting(dict(rewritten), refused)


def _files(folder: Folder) -> Iterator[Path]:
    scan = folder.scan()
    yield from map(folder.upload, sorted(scan.uploads - scan.deletions))
    yield from map(folder.template, sorted(scan.templates))
    yield from map(folder.result, sorted(scan.results))
    yield from map(folder.model, sorted(scan.models - scan.deleted_models))


def _record(folder: Folder, sequence_id: str) -> bytes:
    """Add the field that a record of version 1 lacks; it is read from the vertices.

    Raises
    ------
    StoreError
        If it is not such a record.
    """
    record = record_from(OLD_RECORD.read(folder.record(sequence_id)))
    span = None
    if record.has_times and record.has_upload:
        with contextlib.suppress(StoreError):
            span = sequence_from_hdf5(folder.upload(sequence_id)).span
    return record_to_json(replace(record, span=span))


def _sequence(contents: Contents, _: Folder) -> bytes:
    """Version 1 had no facts: nothing is known of them."""
    return sequence_to_hdf5(sequence_in(contents))


def _classification(contents: Contents, _: Folder) -> bytes:
    """Add the fields that version 1 lacks: it ruled nothing out, so its set is all classes."""
    classes = tuple(contents.json("classes", list))
    label = contents.json("label", object)
    return classification_to_hdf5(
        Classification(
            sequence_id=contents.text("sequence_id"),
            model=contents.text("model"),
            model_id=contents.text("model_id"),
            label=None if label is None else str(label),
            classes=classes,
            probabilities=contents.array("probabilities", (len(classes),)),
            class_set=classes,
            coverage=1.0,
            flags=(),
            explanation=(),
            notes=tuple(contents.json("notes", list)),
            provenance=contents.json("provenance", dict),
        ),
        parameters_key=contents.optional_text("parameters_key"),
    )


def _signature(contents: Contents, folder: Folder) -> bytes:
    """Make the signature again.

    Version 1 knew the error by weight alone, and tolerances held it; version 2 took all noise
    for independent; version 3 had no amplitudes of the reference.

    Raises
    ------
    ModalMotionError
        If what it was made from is lost, or its tolerance cannot be held.
    """
    parameters = parameters_from_json(contents.json("parameters", dict))
    try:
        sequence = sequence_from_hdf5(folder.upload(contents.text("sequence_id")))
        template = None
        if parameters.template is not None:
            template = template_from_hdf5(folder.template(parameters.template))
    except NotFoundError as error:
        raise StoreError(
            "Its errors and noise are of older definitions, and its vertices are not kept.",
            remedy="Delete it, and send the sequence again.",
        ) from error
    return signature_to_hdf5(modal_signature(sequence, parameters, template=template))


def _sure_signature(contents: Contents, folder: Folder) -> bytes:
    """Version 4 had no deviations of amplitudes: made again where they are known now."""
    signature = signature_in(contents)
    if signature.parameters.auto:
        # Without its vertices it stays without deviations, too.
        with contextlib.suppress(StoreError):
            return _signature(contents, folder)
    return signature_to_hdf5(signature)


def _track(contents: Contents, _: Folder) -> bytes:
    """Version 1 lacks the covariances across the surface: its amplitudes have no deviations."""
    return track_to_hdf5(track_in(contents))


def _model(contents: Contents, _: Folder) -> bytes:
    """Take a model out of the JSON text, with arrays in base64, that version 1 was."""
    stored = json.loads(contents.array("contents", (None,)).tobytes())
    if stored["schema"] != 4:
        raise ValueError(f"its model has the schema {stored['schema']!r}, not 4")
    if stored["machine"]:
        # skops names a class by its module, and the modules have moved.
        raise StoreError(
            "Its support vector machine or forest is bound to the program that trained it.",
            remedy="Train it again.",
        )
    reader, domain = stored["reader"], stored["domain"]
    if reader["typical"] is not None:
        real, imaginary = _array(reader["typical"])
        reader["typical"] = real + 1j * imaginary
    scorers = tuple(
        Scorer(
            anchors=_array(one["anchors"]),
            gamma=one["gamma"],
            weights=_array(one["weights"]),
            intercepts=_array(one["intercepts"]),
            temperature=one["temperature"],
        )
        for one in stored["scorers"]
    )
    model = Model(
        name=stored["name"],
        classes=tuple(stored["classes"]),
        readable=Readable(
            topologies=tuple(stored["topologies"]),
            n_modes=stored["n_modes"],
            connectivity_id=stored["connectivity_id"],
            parameters=parameters_from_json(contents.json("parameters", dict)),
        ),
        members=(
            Member(
                reader=FeatureReader(**reader),
                columns=tuple(
                    Column(name, tuple(modes), power) for name, modes, power in stored["columns"]
                ),
                blend=Blend(
                    _array(stored["centre"]),
                    _array(stored["scale"]),
                    scorers,
                    stored["temperature"],
                ),
                machine=b"",
                weight=1.0,
            ),
        ),
        temperature=1.0,
        domain=of_kind_alone(
            FeatureReader(**reader),
            **{
                **domain,
                "means": _array(domain["means"]),
                "whitening": _array(domain["whitening"]),
            },
        ),
        calibration=Calibration(tuple(map(_array, stored["calibration"]))),
        golden_features=_array(stored["golden_features"]),
        golden_probabilities=_array(stored["golden_probabilities"]),
        notes={label: tuple(texts) for label, texts in stored["notes"].items()},
        card=ModelCard.from_json(stored["card"]),
    )
    origin = contents.json("origin", dict)
    stored_model = kept_model(model, training=origin["training"])
    image = model_to_hdf5(numbered(stored_model, contents.attributes["version"], origin["created"]))
    # Nothing is written that does not answer as it did.
    if model_from_hdf5(image).id != contents.text("model_id"):
        raise ValueError("it holds another model than it says")
    return image


def _array(stored: dict[str, Any]) -> NDArray[np.float64]:
    data = base64.b64decode(stored["float64"], validate=True)
    return np.frombuffer(data, dtype="<f8").astype(np.float64).reshape(stored["shape"])


OLDER: Final[dict[Form, Callable[[Contents, Folder], bytes]]] = {
    Form("classification", 1): _classification,
    Form("sequence", 1): _sequence,
    Form("model", 1): _model,
    Form("signature", 1): _signature,
    Form("signature", 2): _signature,
    Form("signature", 3): _signature,
    Form("signature", 4): _sure_signature,
    Form("track", 1): _track,
}
"""How each older form is rewritten."""

OLD_RECORD: Final = JsonForm(RECORD.kind, 1, RECORD.remedy)
"""Form of the records of sequences that are rewritten."""
