"""The default picture of a value. Needs matplotlib (plot)."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from modalmotion.classification import Classification, Evaluation, Model, ModelCard
from modalmotion.clinical import ClinicalReadouts
from modalmotion.clinical.strain import Strain
from modalmotion.clinical.ventricle import VentricleReadouts
from modalmotion.errors import ParameterError
from modalmotion.exports.picture_files import picture_bytes, write_picture
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numerals import with_article
from modalmotion.pictures.bulls_eye import bulls_eye_figure
from modalmotion.pictures.classification import answer_figure
from modalmotion.pictures.model_card import card_figure, evaluation_figure
from modalmotion.pictures.readouts import volume_figure
from modalmotion.pictures.signature import amplitudes_figure, signature_figure
from modalmotion.pictures.strain import strain_figure
from modalmotion.pictures.template import template_figure
from modalmotion.pictures.track import data_figure, deviations_figure, usual_frame
from modalmotion.pictures.tradeoff import tradeoff_figure
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.template import Template
from modalmotion.tracking import Track
from modalmotion.tradeoff import Tradeoff

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot(value: Any, path: str | Path | None = None) -> Figure:
    """Draw a value.

    Parameters
    ----------
    value : object
        A sequence (with the superposition of its first 7 modes), a signature, read-outs, a strain,
        a track, a class, a model, its card or its test, a trade-off or a template.
    path : str or Path, optional
        File to write as well: .png, .svg or .pdf.

    Returns
    -------
    matplotlib.figure.Figure
        Notebooks show it.

    Raises
    ------
    ParameterError
        If the value has no picture.
    """
    figure = _drawn(value)
    if path is not None:
        write_picture(figure, Path(path))
    # For notebooks, which display only figures of pyplot.
    figure._repr_png_ = lambda: picture_bytes(figure, "png")  # type: ignore[attr-defined]
    return figure


def _drawn(value: Any) -> Figure:
    match value:
        case MeshSequence():
            return signature_figure(value, modal_signature(value))
        case ModalSignature():
            return amplitudes_figure(value)
        case Track():
            has_data = value.data is not None
            return data_figure(value) if has_data else deviations_figure(value, usual_frame(value))
        case ClinicalReadouts():
            return volume_figure(value)
        case VentricleReadouts() if value.regions is not None:
            return bulls_eye_figure(value.regions)
        case Strain():
            return strain_figure(value)
        case Classification():
            return answer_figure(value)
        case Model():
            return card_figure(value.card, value.name)
        case ModelCard():
            return card_figure(value, "model")
        case Evaluation():
            return evaluation_figure(value)
        case Tradeoff():
            return tradeoff_figure(value)
        case Template():
            return template_figure(value)
    raise ParameterError(
        f"There is no picture of {with_article(type(value).__name__)}.",
        remedy="Give a sequence (read(path)), or a result: a signature, read-outs, strain, a "
        "track, a class, a model, a trade-off.",
    )
