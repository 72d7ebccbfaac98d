"""Versions of models, shipped and trained: found by name, described and deleted."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from modalmotion.classification import Classification, available_models, load_model, shipped_for
from modalmotion.errors import NotFoundError
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import KeptModel, ModelRecord, ResultStore, kept_model, parse_reference
from modalmotion_service.errors import ConflictError

# A model that comes with the package has one version.
SHIPPED_VERSION: Final = 1


@dataclass(frozen=True)
class ChosenModel:
    """A version of a model that was named.

    Parameters
    ----------
    name : str
    version : int
    id : str
    classes : tuple of str
    parameters : SignatureParameters
        Of the signatures that it reads.
    source : Path or str
        Its file; the name of one that is shipped.
    """

    name: str
    version: int
    id: str
    classes: tuple[str, ...]
    parameters: SignatureParameters
    source: Path | str


class ModelVersions:
    """Finds versions of models by name.

    Parameters
    ----------
    store : ResultStore
    """

    def __init__(self, store: ResultStore) -> None:
        self._store = store

    def choose(self, text: str) -> ChosenModel:
        """Find the model that a request names, as "name" or "name@3".

        Raises
        ------
        NotFoundError
            If no model has that name, or that version.
        """
        reference = parse_reference(text)
        if reference.name in available_models():
            model = load_model(reference.name)
            if reference.version not in (None, SHIPPED_VERSION):
                raise NotFoundError(
                    f"There is no version {reference.version} of the model {reference.name!r}, "
                    "which is shipped with the service.",
                    remedy=f"Use {reference.name}.",
                )
            parameters = model.signature_parameters
            return ChosenModel(
                model.name, SHIPPED_VERSION, model.id, model.classes, parameters, model.name
            )
        record = self._store.model_record(reference.name, reference.version)
        path = self._store.model_path(record.name, record.version)
        return ChosenModel(
            record.name, record.version, record.id, record.classes, record.parameters, path
        )

    def choose_for(self, text: str, sequence_id: str) -> ChosenModel:
        """Find the model that a request for a sequence names, by its facts: see `shipped_for`.

        Raises
        ------
        NotFoundError
            If there is no such sequence or no such model.
        """
        return self.choose(shipped_for(text, self._store.sequence_record(sequence_id).facts))

    def records(self) -> dict[str, list[ModelRecord]]:
        """All versions by name, including shipped models."""
        records: dict[str, list[ModelRecord]] = {}
        for record in self._store.models():
            records.setdefault(record.name, []).append(record)
        for name in available_models():
            records[name] = [_shipped(name).record]
        return records

    def versions(self, name: str) -> list[int]:
        """Version numbers of a model.

        Raises
        ------
        NotFoundError
            If no model has that name.
        """
        if name in available_models():
            return [SHIPPED_VERSION]
        return [record.version for record in self._store.model_versions(name)]

    def describe(self, model: ChosenModel) -> KeptModel:
        """Give the stored model of a version, or the shipped one.

        Raises
        ------
        NotFoundError
            If it was deleted meanwhile.
        CorruptFileError
            If its file is damaged.
        """
        if isinstance(model.source, str):
            return _shipped(model.name)
        return self._store.kept_model(model.name, model.version)

    def delete(self, name: str, version: int) -> None:
        """Delete a version, its file there or not.

        Raises
        ------
        NotFoundError
            If there is none.
        ConflictError
            If it is shipped.
        """
        if name in available_models():
            model = self.choose(f"{name}@{version}")
            raise shipped_name(
                model.name, "cannot be deleted", "Leave it; no request has to use it."
            )
        self._store.delete_model(name, version)

    def version_of(self, result: Classification) -> int | None:
        """Version of the model behind a result; the lowest, where several are the same model.

        None where it has been deleted.
        """
        name, model_id = result.model, result.model_id
        if name in available_models() and load_model(name).id == model_id:
            return SHIPPED_VERSION
        known = self._store.models_with_id(model_id)
        return min((record.version for record in known if record.name == name), default=None)


def shipped_name(name: str, why: str, remedy: str) -> ConflictError:
    """Error for a model that belongs to the package."""
    return ConflictError(
        f"The model {name!r} is shipped with the service and {why}.",
        remedy=remedy,
        details={"model": name},
    )


def _shipped(name: str) -> KeptModel:
    model = kept_model(load_model(name))
    return replace(model, record=replace(model.record, version=SHIPPED_VERSION))
