"""Picture of a model's answer about one sequence. Needs matplotlib (extra ``plot``)."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

from modalmotion.classification.answer import Classification
from modalmotion.errors import needs_extra
from modalmotion.numerals import numeral, probability

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_INK = "#33373d"
_SOFT = "#8a9099"
_IN_SET = "#2f6690"
_RULED_OUT = "#c9c4bc"
_AGAINST = "#b5533c"

# More classes, and more modes, than can be read.
_MOST_CLASSES: Final = 20
_MOST_MODES: Final = 10

# Sentences below an answer; letters that fit into an inch, and inches that a line needs.
_MOST_NOTES: Final = 3
_LETTERS_PER_INCH: Final = 14.5
_LINE: Final = 0.17


def answer_figure(result: Classification) -> Figure:
    """Draw the probability of each class, the class set, and the reasons of the prediction.

    Below are the first notes: why there is no class, or why no class is in the set, and what was
    made of a handedness that is not stated. An answer without a class is these words alone.

    Parameters
    ----------
    result : Classification

    Returns
    -------
    matplotlib.figure.Figure
    """
    with needs_extra("plot"):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

    has_label = result.label is not None
    n_classes = min(len(result.classes), _MOST_CLASSES)
    n_modes = min(len(result.explanation), _MOST_MODES)
    n_panels = 1 + bool(n_modes)
    width = 5.6 * n_panels + 0.6
    # Equal probabilities are no measurement, so an answer without a class has no bars.
    notes = result.notes[: len(result.flags) or _MOST_NOTES]
    text = "\n".join(fill(note, int(_LETTERS_PER_INCH * width)) for note in notes)
    bars = 1.6 + 0.34 * max(n_classes, n_modes, 3) if has_label else 0.6
    height = bars + _LINE * (text.count("\n") + 1) * bool(text)
    figure = Figure(figsize=(width, height), dpi=110)
    FigureCanvasAgg(figure)
    if has_label:
        panels = figure.subplots(1, n_panels, squeeze=False)[0]
        _draw_classes(panels[0], result)
        if n_modes:
            _draw_modes(panels[1], result)
    said = f"{result.label}, {probability(result.probability)}" if has_label else "no class"
    flags = f" ({', '.join(result.flags)})" if result.flags else ""
    title = f"{result.model}: {said}{flags}"
    figure.text(0.5, 1 - 0.1 / height, title, fontsize=12, color=_INK, ha="center", va="top")
    figure.text(0.15 / width, 0.1 / height, text, fontsize=9, color=_INK, va="bottom")
    if has_label:
        below = (height - bars) / height
        figure.tight_layout(rect=(0.0, below, 1.0, 1.0 - 0.35 / height))
    return figure


def _draw_classes(axes: Any, result: Classification) -> None:
    shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
    ranked = sorted(shares, key=lambda name: -shares[name])[:_MOST_CLASSES][::-1]
    colours = [_IN_SET if name in result.class_set else _RULED_OUT for name in ranked]
    values = [shares[name] for name in ranked]
    axes.barh(range(len(ranked)), values, color=colours, height=0.7)
    for row, value in enumerate(values):
        axes.text(value + 0.015, row, probability(value), va="center", fontsize=8, color=_INK)
    axes.set_yticks(range(len(ranked)), ranked, fontsize=9)
    axes.set_xlim(0.0, 1.12)
    axes.set_xlabel("probability", color=_INK)
    level = f"{100 * result.coverage:g} %"
    title = f"Blue cannot be ruled out at {level}"
    if not result.class_set:
        title = f"Unlike every class at {level}"
    axes.set_title(title, fontsize=10, color=_INK)
    _plain(axes)


def _draw_modes(axes: Any, result: Classification) -> None:
    parts = result.explanation[:_MOST_MODES][::-1]
    scores = [part.score for part in parts]
    colours = [_IN_SET if score >= 0 else _AGAINST for score in scores]
    axes.barh(range(len(parts)), scores, color=colours, height=0.7)
    axes.axvline(0.0, color=_SOFT, linewidth=1)
    names = [
        f"{' '.join(part.modes)}   {numeral(part.amplitude, 2)} {part.unit or ''}".rstrip()
        for part in parts
    ]
    axes.set_yticks(range(len(parts)), names, fontsize=8)
    axes.set_xlabel("for (blue) and against the class, log of odds", color=_INK)
    axes.set_title("What moved it: modes, with their RMS amplitude", fontsize=10, color=_INK)
    _plain(axes)


def _plain(axes: Any) -> None:
    axes.tick_params(axis="y", length=0)
    axes.grid(axis="x", alpha=0.25)
    axes.set_axisbelow(True)
    for side in ("top", "right", "left"):
        axes.spines[side].set_visible(False)
