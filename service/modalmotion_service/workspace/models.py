"""Models: versions found by name, and sequences classified by them."""

import asyncio
import contextlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from modalmotion.classification import (
    NORMAL_DISPLACEMENT_MODEL,
    Classification,
    available_models,
    load_model,
    shipped_for,
)
from modalmotion.errors import NotFoundError, TopologyError
from modalmotion.hdf5.sealed import is_sound
from modalmotion.mesh.facts import UNKNOWN
from modalmotion.progress import Progress, Reporter, part_of, silent
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import (
    KeptModel,
    ModelRecord,
    classification_key,
    kept_model,
    parse_reference,
)
from modalmotion_service.errors import ConflictError
from modalmotion_service.schemas.requests import ClassificationRequest
from modalmotion_service.work.tasks.classification import name_class
from modalmotion_service.workspace.operation import State

# A model that comes with the package has one version.
_SHIPPED_VERSION: Final = 1
# Part of a classification that making the signature is counted as.
_SIGNING: Final = 0.8


@dataclass(frozen=True)
class ChosenModel(ModelRecord):
    """A version of a model that was named.

    Parameters
    ----------
    source : Path or str
        Its file; the name of one that is shipped.
    """

    source: Path | str = ""


def choose(state: State, text: str) -> ChosenModel:
    """Find the model that a request names, as "name" or "name@3".

    Raises
    ------
    NotFoundError
        If no model has that name, or that version.
    """
    reference = parse_reference(text)
    if reference.name not in available_models():
        record = state.store.model_record(reference.name, reference.version)
        path = state.store.model_path(record.name, record.version)
        return ChosenModel(**vars(record), source=path)
    if reference.version not in (None, _SHIPPED_VERSION):
        raise NotFoundError(
            f"There is no version {reference.version} of the model {reference.name!r}, which is "
            "shipped with the service.",
            remedy=f"Use {reference.name}.",
        )
    model = load_model(reference.name)
    known = (model.id, model.classes, model.signature_parameters)
    return ChosenModel(model.name, _SHIPPED_VERSION, *known, created="", source=model.name)


def choose_for(state: State, text: str, sequence_id: str) -> ChosenModel:
    """Find the model that a request for a sequence names, by its facts: see `shipped_for`.

    Raises
    ------
    NotFoundError
        If there is no such sequence or no such model.
    """
    return choose(state, shipped_for(text, state.store.sequence_record(sequence_id).facts))


def records(state: State) -> dict[str, list[ModelRecord]]:
    """All versions by name, including shipped models."""
    found: dict[str, list[ModelRecord]] = {}
    for record in state.store.models():
        found.setdefault(record.name, []).append(record)
    # Of a name that is shipped `choose` takes no other.
    return found | {name: [choose(state, name)] for name in available_models()}


def describe(state: State, model: ChosenModel) -> tuple[KeptModel, list[int]]:
    """Give the stored model of a version, or the shipped one, and the versions of its name.

    Raises
    ------
    NotFoundError
        If it was deleted meanwhile.
    CorruptFileError
        If its file is damaged.
    """
    if isinstance(model.source, str):
        shipped = kept_model(load_model(model.name))
        return replace(shipped, record=model), [model.version]
    versions = [record.version for record in state.store.model_versions(model.name)]
    return state.store.kept_model(model.name, model.version), versions


def require_own(name: str, why: str, remedy: str) -> None:
    """Refuse what is not done with a model that belongs to the package.

    Raises
    ------
    ConflictError
        If it does.
    """
    if name in available_models():
        raise ConflictError(
            f"The model {name!r} is shipped with the service and {why}.",
            remedy=remedy,
            details={"model": name},
        )


def _version_of(state: State, result: Classification) -> int | None:
    """Version of the model behind a result, the lowest of several; None if it was deleted."""
    name, model_id = result.model, result.model_id
    if name in available_models() and load_model(name).id == model_id:
        return _SHIPPED_VERSION
    known = state.store.models_with_id(model_id)
    return min((record.version for record in known if record.name == name), default=None)


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


async def classification(
    state: State,
    sequence_id: str,
    model: ChosenModel,
    coverage: float,
    report: Reporter = silent,
) -> tuple[KeptClassification, bool]:
    """Classify a stored sequence, and tell whether the result is new."""
    analysis, store = state.analysis, state.store
    parameters, facts = analysis.resolved(sequence_id, model.parameters)
    tracking = facts.tracking if model.name == NORMAL_DISPLACEMENT_MODEL else UNKNOWN
    key = classification_key(parameters, coverage, tracking, facts.handedness, facts.cavity)

    async def named(asked: SignatureParameters) -> tuple[bytes, str | None]:
        signature = await analysis.signature(sequence_id, asked, part_of(report, 0.0, _SIGNING))
        report(Progress(_SIGNING, stage="class"))
        topology = store.sequence_record(sequence_id).topology
        return await analysis.work(
            name_class, signature, model.source, coverage, topology, facts, key
        )

    def is_missing() -> bool:
        if (model.id, key) not in store.classifications(sequence_id):
            return True
        # Lost or damaged it is made again, as a signature is.
        return not is_sound(store.classification_path(sequence_id, model.id, key))

    is_new = await asyncio.to_thread(is_missing)
    if is_new:
        analysis.quota.require()
        # As `fitted_in` does it where a sequence is at hand.
        try:
            image, imposed = await named(parameters)
        except TopologyError:
            image, imposed = await named(replace(parameters, topology=None))
        if imposed is not None:
            with contextlib.suppress(TopologyError):
                image, _ = await named(replace(parameters, topology=imposed))
        await analysis.stored(store.put_classification_image, image, sequence_id, model.id, key)
    kept = await asyncio.to_thread(_kept, state, sequence_id, model.id, key)
    return replace(kept, version=model.version), is_new


def _kept(state: State, sequence_id: str, model_id: str, key: str) -> KeptClassification:
    result = state.store.classification(sequence_id, model_id, key)
    path = state.store.classification_path(sequence_id, model_id, key)
    return KeptClassification(result, _version_of(state, result), path)


def classifications(state: State, sequence_id: str) -> list[KeptClassification]:
    """Give all classifications of a stored sequence.

    Raises
    ------
    NotFoundError
        If there is no such sequence.
    CorruptFileError
        If a file is damaged.
    """
    keys = state.store.classifications(sequence_id)
    return [_kept(state, sequence_id, model_id, key) for model_id, key in keys]


def known_classification(
    state: State, sequence_id: str, model: str | None
) -> KeptClassification | None:
    """Find a kept classification by its model, as "name" for the newest or "name@3".

    Of several by one version that of the usual coverage is given; None if no model is named.

    Raises
    ------
    NotFoundError
        If there is none.
    """
    if model is None:
        return None
    name, version = parse_reference(model)
    usual = ClassificationRequest().coverage

    def rank(one: KeptClassification) -> Any:
        return one.version or 0, one.result.coverage == usual, str(one.path)

    known = [
        one
        for one in classifications(state, sequence_id)
        if one.result.model == name and version in (None, one.version)
    ]
    if not known:
        raise NotFoundError(
            f"The model {model[:80]} has not classified this sequence.",
            remedy=f"POST /v1/signatures/{sequence_id}/classifications names its class; then ask "
            "again.",
        )
    return max(known, key=rank)
