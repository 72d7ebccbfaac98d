"""Classes named by models, and models described."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import Any

from modalmotion.classification import (
    Classification,
    Model,
    ModelCard,
    classify,
    load_model,
    shipped_for,
)
from modalmotion.mesh import Facts
from modalmotion.signature.making import SignatureParameters
from modalmotion.store import model_from_hdf5, signature_from_hdf5
from modalmotion_service.schemas.sequences import ReadingAnswer
from modalmotion_service.work.tasks.files import png_of
from modalmotion_service.work.upload import Upload


@dataclass(frozen=True)
class NamedClass:
    """The class of a kept signature's motion.

    Parameters
    ----------
    classification : Classification
    imposed : str or None
        The topology in which the model would rather have the sequence, which states none.
    """

    classification: Classification
    imposed: str | None


def name_class(
    signature: Path, model: Path | str, coverage: float, stated: str | None, facts: Facts
) -> NamedClass:
    """Ask a model for the class of a kept signature's motion.

    Parameters
    ----------
    signature : Path
    model : Path or str
    coverage : float
    stated : str or None
        Topology that the sequence states.
    facts : Facts
        Of the sequence; kept signatures have none.
    """
    asked = loaded(model)
    kept = replace(signature_from_hdf5(signature), facts=facts)
    imposed = asked.readable.imposed_on(kept.surface, stated)
    return NamedClass(
        classify(kept, asked, coverage), None if imposed is None else imposed.topology
    )


def require_loads(model: Path | str) -> None:
    """Load a model, which checks its file."""
    loaded(model)


def classify_upload(
    upload: Upload,
    parameters: SignatureParameters,  # noqa: ARG001 (they are the model's; its price is read here)
    model: Path | str,
    coverage: float,
) -> tuple[Classification, ReadingAnswer]:
    """Read an upload, fit it, and ask a model for the class of its motion."""
    reading = upload.read()
    if isinstance(model, str):
        model = shipped_for(model, reading.sequence.facts)
    return classify(reading.sequence, loaded(model), coverage), ReadingAnswer.of(reading)


def draw_card(card: dict[str, Any], title: str) -> bytes:
    """Draw the confusion matrix and the calibration curve of a card, as PNG."""
    from modalmotion.pictures.classification import card_figure

    return png_of(card_figure(ModelCard.from_json(card), title))


# A file of a model never changes, and a version is never given twice.
@lru_cache(maxsize=8)
def loaded(model: Path | str) -> Model:
    """Load a model, or give the one that was loaded before."""
    return model_from_hdf5(model) if isinstance(model, Path) else load_model(model)
