"""Models of the service: which one is meant, and what it says of a sequence."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from modalmotion.classification import Classification, available_models, load_model
from modalmotion.errors import NotFoundError
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import (
    KeptModel,
    ModelRecord,
    ResultStore,
    classification_key,
    kept_model,
    parse_reference,
)
from modalmotion_service.errors import ConflictError
from modalmotion_service.http.timing import stage
from modalmotion_service.schemas import ReadingAnswer
from modalmotion_service.work.tasks import classification
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.shared_work import SharedWork

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
    parameters : SignatureParameters
        Of the signatures that it reads.
    source : Path or str
        Its file; the name of one that is shipped.
    """

    name: str
    version: int
    id: str
    parameters: SignatureParameters
    source: Path | str


@dataclass(frozen=True)
class KeptClassification:
    """What a model has said of a kept sequence.

    Parameters
    ----------
    result : Classification
    version : int or None
        Of the model; None where nobody knows it any more.
    path : Path
        Its HDF5 file.
    """

    result: Classification
    version: int | None
    path: Path


class Models:
    """Finds models, asks them, describes them.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
        Makes the signatures that models read; its workers load models and ask them.
    """

    def __init__(self, store: ResultStore, analysis: Analysis) -> None:
        self._store = store
        self._analysis = analysis
        self._shared_work = SharedWork()

    def choose(self, text: str) -> ChosenModel:
        """Find the model that a request names, as "name" or "name@3".

        Raises
        ------
        NotFoundError
            If there is none of that name, or of that version.
        """
        asked = parse_reference(text)
        if asked.name in available_models():
            model = load_model(asked.name)
            if asked.version not in (None, SHIPPED_VERSION):
                raise NotFoundError(
                    f"There is no version {asked.version} of the model {asked.name!r}, which is "
                    "shipped with the service.",
                    remedy=f"Use {asked.name}.",
                )
            parameters = model.signature_parameters
            return ChosenModel(model.name, SHIPPED_VERSION, model.id, parameters, model.name)
        record = self._store.model_record(asked.name, asked.version)
        path = self._store.model_path(record.name, record.version)
        return ChosenModel(record.name, record.version, record.id, record.parameters, path)

    def records(self) -> dict[str, list[ModelRecord]]:
        """All versions by name, those that are shipped too."""
        records: dict[str, list[ModelRecord]] = {}
        for record in self._store.models():
            records.setdefault(record.name, []).append(record)
        for name in available_models():
            records[name] = [_shipped(name).record]
        return records

    def versions(self, name: str) -> list[int]:
        """Versions that there are of a name.

        Raises
        ------
        NotFoundError
            If there are none.
        """
        if name in available_models():
            return [SHIPPED_VERSION]
        return [record.version for record in self._store.model_versions(name)]

    def describe(self, chosen: ChosenModel) -> KeptModel:
        """Give what is known of a version; of one that is shipped too.

        Raises
        ------
        NotFoundError
            If it was deleted meanwhile.
        CorruptFileError
            If its file is damaged.
        """
        if isinstance(chosen.source, str):
            return _shipped(chosen.name)
        return self._store.kept_model(chosen.name, chosen.version)

    def delete(self, chosen: ChosenModel) -> None:
        """Delete a version.

        Raises
        ------
        NotFoundError
            If it was deleted meanwhile.
        ConflictError
            If it is shipped.
        """
        if isinstance(chosen.source, str):
            raise shipped_name(
                chosen.name, "cannot be deleted", "Leave it; no request has to use it."
            )
        self._store.delete_model(chosen.name, chosen.version)

    async def require_sound(self, chosen: ChosenModel) -> None:
        """Raise what keeps a version from being asked.

        Raises
        ------
        CorruptFileError
            If its file is damaged.
        ModelNotReproducedError
            If it no longer says what it said when it was made.
        """
        await self._analysis.work(classification.require_loads, chosen.source)

    async def draw(self, kept: KeptModel) -> bytes:
        """Draw the confusion matrix and the calibration curve of a model's card, as PNG."""
        return await self._analysis.work(
            classification.draw_card, kept.card, str(kept.record.reference)
        )

    async def classification(
        self, sequence_id: str, chosen: ChosenModel, coverage: float
    ) -> tuple[KeptClassification, bool]:
        """Give what a model says of a kept sequence, and whether that is new."""
        parameters, _ = self._analysis.resolved(sequence_id, chosen.parameters)
        key = classification_key(parameters, coverage)

        async def make() -> None:
            signature = await self._analysis.signature(sequence_id, parameters)
            with stage("worker"):
                result = await self._analysis.work(
                    classification.name_class, signature, chosen.source, coverage
                )
            with stage("store"):
                await asyncio.to_thread(self._store.put_classification, result, key)

        is_new = (chosen.id, key) not in await asyncio.to_thread(
            self._store.classifications, sequence_id
        )
        if is_new:
            await self._shared_work.join((sequence_id, chosen.id, key), make)
        result = await asyncio.to_thread(self._store.classification, sequence_id, chosen.id, key)
        path = self._store.classification_path(sequence_id, chosen.id, key)
        return KeptClassification(result, chosen.version, path), is_new

    def classifications(self, sequence_id: str) -> list[KeptClassification]:
        """Give everything that models have said of a kept sequence.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        CorruptFileError
            If a file is damaged.
        """
        found = []
        for model_id, key in self._store.classifications(sequence_id):
            result = self._store.classification(sequence_id, model_id, key)
            path = self._store.classification_path(sequence_id, model_id, key)
            found.append(KeptClassification(result, self._version_of(result), path))
        return found

    async def classify(
        self, upload: Upload, chosen: ChosenModel, coverage: float
    ) -> tuple[Classification, ReadingAnswer]:
        """Say what a model says of an upload; nothing is kept."""
        with stage("worker"):
            return await self._analysis.work(
                classification.classify_upload,
                upload,
                chosen.parameters,
                chosen.source,
                coverage,
            )

    def _version_of(self, result: Classification) -> int | None:
        """Version that a model is or was; the first, where several are the same model."""
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
    kept = kept_model(load_model(name))
    return replace(kept, record=replace(kept.record, version=SHIPPED_VERSION))
