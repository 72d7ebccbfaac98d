"""Deleting a version of a model; its number stays taken, and its name, number and id known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Final

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classification.record import ModelRecord, ModelReference
from modalmotion.store.disk.atomic import remove_durably, write_atomic
from modalmotion.store.disk.sealed_json import JsonForm
from modalmotion.store.folder import Folder
from modalmotion.store.index.cursor import now

FORM: Final = JsonForm(
    "deleted-model",
    1,
    "Restore it from a copy. Keep the file in any case: it says that the version's number is "
    "taken.",
)


def begin_model_deletion(folder: Folder, record: ModelRecord) -> ModelRecord:
    """Note durably that a version is deleted, and give its record from then on.

    Raises
    ------
    StoreError
        If that fails; nothing is changed then.
    """
    gone = replace(record, deleted=now())
    fields = {
        "name": gone.name,
        "version": gone.version,
        "id": gone.id,
        "classes": list(gone.classes),
        "parameters": parameters_as_json(gone.parameters),
        "created": gone.created,
        "training": gone.training,
        "deleted": gone.deleted,
    }
    write_atomic(folder.deleted_model(record.reference), FORM.write(fields))
    return gone


def finish_model_deletion(folder: Folder, reference: ModelReference) -> None:
    """Remove the file of a version that is noted as deleted.

    Raises
    ------
    StoreError
        If that fails; the note stays, and the next `open` calls this again.
    """
    remove_durably(folder.model(reference))


def deleted_record(path: Path, reference: ModelReference) -> ModelRecord:
    """Read what is known of a deleted version.

    Raises
    ------
    CorruptFileError
        If the file is damaged, or is another version's.
    StoreError
        If it was written by another version.
    """
    values = FORM.read(path)
    record = ModelRecord(
        **{
            **values,
            "classes": tuple(values["classes"]),
            "parameters": parameters_from_json(values["parameters"]),
        }
    )
    if record.reference != reference:
        raise FORM.damaged(path, "it is another version's")
    return record
