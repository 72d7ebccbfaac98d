"""Files that older versions wrote, rewritten as today's; only `rebuild` reads them."""

from __future__ import annotations

import contextlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from modalmotion.classification.answer.classification import Classification
from modalmotion.classification.answer.hdf5 import classification_to_hdf5
from modalmotion.errors import ModalMotionError, StoreError
from modalmotion.hdf5.contents import Contents
from modalmotion.hdf5.form import Form, form_of
from modalmotion.mesh.hdf5 import sequence_from_hdf5, sequence_in, sequence_to_hdf5
from modalmotion.store.disk.atomic import write_atomic
from modalmotion.store.disk.sealed_json import JsonForm
from modalmotion.store.folder import Folder
from modalmotion.store.record import FORM as RECORD
from modalmotion.store.record import record_from, record_to_json


@dataclass(frozen=True)
class Rewriting:
    """What became of the files of older versions.

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

    What is damaged is passed over: bringing index and folder together names it.

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
                image = OLDER[form](contents)
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
    """Add what a record of version 1 did not say, for which vertices are looked at.

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


def _sequence(contents: Contents) -> bytes:
    """Version 1 had no facts: nothing is known of them."""
    return sequence_to_hdf5(sequence_in(contents))


def _classification(contents: Contents) -> bytes:
    """Add what version 1 did not say: it ruled nothing out, so its set is that of all classes."""
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


OLDER: Final[dict[Form, Callable[[Contents], bytes]]] = {
    Form("classification", 1): _classification,
    Form("sequence", 1): _sequence,
}
"""How each older form is rewritten."""

OLD_RECORD: Final = JsonForm(RECORD.kind, 1, RECORD.remedy)
"""Form of the records of sequences that are rewritten."""
