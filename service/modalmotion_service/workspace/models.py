"""Models: versions found by name, sequences classified, cards drawn."""

from __future__ import annotations

import asyncio
import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from modalmotion.classification import (
    OFFSET_MODEL,
    Classification,
    available_models,
    load_model,
    shipped_for,
)
from modalmotion.errors import NotFoundError, TopologyError
from modalmotion.hdf5.sealed import is_sound
from modalmotion.mesh.facts import UNKNOWN
from modalmotion.progress import StageReport
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
from modalmotion_service.http.observation import stage
from modalmotion_service.schemas.general import ReadingAnswer
from modalmotion_service.schemas.requests import ClassificationRequest
from modalmotion_service.work.tasks import classification
from modalmotion_service.work.upload import Upload
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.owner_work import SharedWork, unheard

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


# Part of a classification that making the signature is counted as.
_SIGNING: Final = 0.8


@dataclass(frozen=True)
class KeptClassification:
    """A stored classification of a sequence.

    Parameters
    ----------
    result : Classification
    version : int or None
        Of the model; None if it has been deleted.
    path : Path
        Its HDF5 file.
    """

    result: Classification
    version: int | None
    path: Path


class Models(ModelVersions):
    """Runs models.

    Parameters
    ----------
    store : ResultStore
    analysis : Analysis
        Makes the signatures that models read; its workers load and run models.
    """

    def __init__(self, store: ResultStore, analysis: Analysis) -> None:
        super().__init__(store)
        self._analysis = analysis
        self._shared_work = SharedWork()

    async def draw(self, model: KeptModel) -> bytes:
        """Draw the confusion matrix and the calibration curve of a model's card, as PNG."""
        return await self._analysis.work(
            classification.draw_card, model.card, str(model.record.reference)
        )

    async def classification(
        self,
        sequence_id: str,
        model: ChosenModel,
        coverage: float,
        report: StageReport = unheard,
    ) -> tuple[KeptClassification, bool]:
        """Classify a stored sequence, and tell whether the result is new.

        Parameters
        ----------
        sequence_id : str
        model : ChosenModel
        coverage : float
        report : StageReport
        """
        parameters, facts = self._analysis.resolved(sequence_id, model.parameters)
        tracking = facts.tracking if model.name == OFFSET_MODEL else UNKNOWN
        key = classification_key(parameters, coverage, tracking, facts.handedness, facts.cavity)

        async def named(asked: SignatureParameters, tell: StageReport) -> classification.NamedClass:
            def tell_of_signature(share: float, text: str) -> None:
                tell(_SIGNING * share, text)

            signature = await self._analysis.signature(sequence_id, asked, tell_of_signature)
            tell(_SIGNING, "class")
            topology = self._store.sequence_record(sequence_id).topology
            with stage("worker"):
                return await self._analysis.work(
                    classification.name_class,
                    signature,
                    model.source,
                    coverage,
                    topology,
                    facts,
                )

        async def make(tell: StageReport) -> None:
            self._analysis.quota.require()
            # As `fitted_in` does it where a sequence is at hand.
            try:
                result = await named(parameters, tell)
            except TopologyError:
                result = await named(replace(parameters, topology=None), tell)
            if result.imposed is not None:
                with contextlib.suppress(TopologyError):
                    result = await named(replace(parameters, topology=result.imposed), unheard)
            with stage("store"):
                await asyncio.to_thread(self._store.put_classification, result.classification, key)

        def is_missing() -> bool:
            if (model.id, key) not in self._store.classifications(sequence_id):
                return True
            # Lost or damaged it is made again, as a signature is.
            return not is_sound(self._store.classification_path(sequence_id, model.id, key))

        is_new = await asyncio.to_thread(is_missing)
        if is_new:
            await self._shared_work.join((sequence_id, model.id, key), make, report)
        result = await asyncio.to_thread(self._store.classification, sequence_id, model.id, key)
        path = self._store.classification_path(sequence_id, model.id, key)
        return KeptClassification(result, model.version, path), is_new

    def classifications(self, sequence_id: str) -> list[KeptClassification]:
        """Give all classifications of a stored sequence.

        Raises
        ------
        NotFoundError
            If there is no such sequence.
        CorruptFileError
            If a file is damaged.
        """
        classifications = []
        for model_id, key in self._store.classifications(sequence_id):
            result = self._store.classification(sequence_id, model_id, key)
            path = self._store.classification_path(sequence_id, model_id, key)
            version = self.version_of(result)
            classifications.append(KeptClassification(result, version, path))
        return classifications

    def known_classification(self, sequence_id: str, text: str) -> KeptClassification:
        """Find a kept classification by its model, as "name" for the newest or "name@3".

        Of several by one version that of the usual coverage is given.

        Raises
        ------
        NotFoundError
            If there is none.
        """
        name, version = parse_reference(text)
        known = [
            one
            for one in self.classifications(sequence_id)
            if one.result.model == name and version in (None, one.version)
        ]
        if not known:
            raise NotFoundError(
                f"The model {text[:80]} has not classified this sequence.",
                remedy=f"POST /v1/signatures/{sequence_id}/classifications names its class; then "
                "ask again.",
            )
        usual = ClassificationRequest().coverage
        return max(
            known,
            key=lambda one: (one.version or 0, one.result.coverage == usual, str(one.path)),
        )

    async def classify(
        self, upload: Upload, model: ChosenModel, coverage: float
    ) -> tuple[Classification, ReadingAnswer]:
        """Classify an upload; nothing is stored."""
        with stage("worker"):
            return await self._analysis.work(
                classification.classify_upload,
                upload,
                model.parameters,
                model.source,
                coverage,
            )
