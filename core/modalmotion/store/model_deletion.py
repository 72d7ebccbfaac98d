"""Deleting a version of a model; its number stays taken, and its name, number and id known."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

from modalmotion.choice.parameters import parameters_as_json, parameters_from_json
from modalmotion.classification.model.record import ModelRecord, ModelReference
from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.hdf5.sealed import read_file
from modalmotion.store.disk.atomic import remove_durably, write_atomic
from modalmotion.store.folder import Folder
from modalmotion.store.index.cursor import now

SCHEMA: Final = "modalmotion.deleted-model"
SCHEMA_VERSION: Final = 1


def begin_model_deletion(folder: Folder, record: ModelRecord) -> ModelRecord:
    """Note durably that a version is deleted, and give its record from then on.

    Raises
    ------
    StoreError
        If that fails; nothing is changed then.
    """
    gone = replace(record, deleted=now())
    content = {
        "schema": SCHEMA,
        "schema_version": SCHEMA_VERSION,
        "record": {
            "name": gone.name,
            "version": gone.version,
            "id": gone.id,
            "classes": list(gone.classes),
            "parameters": parameters_as_json(gone.parameters),
            "created": gone.created,
            "training": gone.training,
            "deleted": gone.deleted,
        },
    }
    text = json.dumps({**content, "sha256": _digest(content)}, indent=1)
    write_atomic(folder.deleted_model(record.reference), text.encode())
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
        If it was written by a newer version of the program.
    """
    try:
        content: dict[str, Any] = json.loads(read_file(path))
        is_whole = content.pop("sha256") == _digest(content)
        schema = content["schema"], content["schema_version"]
        values = content["record"]
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise _damaged(path) from error
    if not is_whole:
        raise _damaged(path)
    if schema != (SCHEMA, SCHEMA_VERSION):
        raise StoreError(
            f"'{path.name}' of the model {reference.name} has the schema {schema!r}.",
            remedy="Read it with the modalmotion that wrote it, or a newer one.",
        )
    record = ModelRecord(
        **{
            **values,
            "classes": tuple(values["classes"]),
            "parameters": parameters_from_json(values["parameters"]),
        }
    )
    if record.reference != reference:
        raise _damaged(path)
    return record


def _damaged(path: Path) -> CorruptFileError:
    return CorruptFileError(
        f"'{path.name}' of the model {path.parent.name} is damaged.",
        remedy="Restore it from a copy. Keep the file in any case: it says that the version's "
        "number is taken.",
    )


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
