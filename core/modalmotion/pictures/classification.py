"""Pictures of classes, and of a model's card and evaluation."""

from __future__ import annotations

from textwrap import fill
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from modalmotion.classification import answer, performance
from modalmotion.classification.card import ModelCard
from modalmotion.pictures.views import lighten, new_figure
from modalmotion.representation import numeral, probability

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from modalmotion.classification import Evaluation

_INK = "#33373d"
_SOFT = "#8a9099"
_IN_SET = "#2f6690"
_RULED_OUT = "#c9c4bc"
_AGAINST = "#b5533c"

# Most classes and modes that are legible.
_MOST_CLASSES: Final = 20
_MOST_MODES: Final = 10

# Sentences below an answer; letters that fit into an inch, and inches that a line needs.
_MOST_NOTES: Final = 3
_LETTERS_PER_INCH: Final = 14.5
_LINE: Final = 0.17


def answer_figure(result: answer.Classification) -> Figure:
    """Draw the probability of each class, the class set, and the reasons of the prediction.

    Below are the first notes: why there is no class, or why no class is in the set, and how an
    unknown handedness was treated. An answer without a class shows these notes only.

    Parameters
    ----------
    result : Classification

    Returns
    -------
    matplotlib.figure.Figure
    """
    has_label = result.label is not None
    n_classes = min(len(result.classes), _MOST_CLASSES)
    n_modes = min(len(result.explanation), _MOST_MODES)
    n_panels = 1 + bool(n_modes)
    width = 5.6 * n_panels + 0.6
    # Equal probabilities are not a measurement, so an answer without a class has no bars.
    notes = result.notes[: len(result.flags) or _MOST_NOTES]
    text = "\n".join(fill(note.text, int(_LETTERS_PER_INCH * width)) for note in notes)
    bars = 1.6 + 0.34 * max(n_classes, n_modes, 3) if has_label else 0.6
    height = bars + _LINE * (text.count("\n") + 1) * bool(text)
    below, above = (height - bars) / height, 0.35 / height
    figure = new_figure(width, height, dpi=110)
    figure.set_layout_engine("constrained", rect=(0.0, below, 1.0, 1.0 - below - above))
    if has_label:
        panels = figure.subplots(1, n_panels, squeeze=False)[0]
        _draw_classes(panels[0], result)
        if n_modes:
            _draw_modes(panels[1], result)
    said = f"{result.label}, {probability(result.probability)}" if has_label else "no class"
    flags = f" ({', '.join(result.flags)})" if result.flags else ""
    title = f"{result.model}: {said}{flags}"
    style: dict[str, Any] = {"color": _INK, "in_layout": False}
    figure.text(0.5, 1 - 0.1 / height, title, fontsize=12, ha="center", va="top", **style)
    figure.text(0.15 / width, 0.1 / height, text, fontsize=9, va="bottom", **style)
    return figure


def _draw_classes(axes: Any, result: answer.Classification) -> None:
    shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
    ranked = sorted(shares, key=lambda name: -shares[name])[:_MOST_CLASSES][::-1]
    colours = [_IN_SET if name in result.class_set else _RULED_OUT for name in ranked]
    values = [shares[name] for name in ranked]
    bars = axes.barh(ranked, values, color=colours, height=0.7)
    axes.bar_label(bars, [probability(value) for value in values], padding=4, fontsize=8)
    level = f"{100 * result.coverage:g} %"
    axes.set(xlim=(0.0, 1.12), xlabel="probability")
    title = "Blue cannot be excluded at" if result.class_set else "Unlike every class at"
    axes.set_title(f"{title} {level}", fontsize=10, color=_INK)
    _plain(axes)


def _draw_modes(axes: Any, result: answer.Classification) -> None:
    parts = result.explanation[:_MOST_MODES][::-1]
    scores = [part.score for part in parts]
    colours = [_IN_SET if score >= 0 else _AGAINST for score in scores]
    axes.barh(range(len(parts)), scores, color=colours, height=0.7)
    axes.axvline(0.0, color=_SOFT, linewidth=1)
    names = [
        f"{' '.join(part.modes)}   {numeral(part.amplitude, 2)} {part.unit or ''}".rstrip()
        for part in parts
    ]
    axes.set_yticks(range(len(parts)), names)
    axes.set_xlabel("for (blue) and against the class, log of odds")
    axes.set_title("Modes that determined it, with their RMS amplitude", fontsize=10, color=_INK)
    _plain(axes)


def _plain(axes: Any) -> None:
    axes.tick_params(axis="y", length=0, labelsize=8)
    lighten(axes, "top", "right", "left", grid="x")


_COLOURS = (_IN_SET, "#c8553d", "#5b8e7d", "#8e5572", "#d9a441", "#4a4e69", "#7fb7be", "#a3a847")


def card_figure(card: ModelCard, title: str) -> Figure:
    """Draw a model's performance in cross-validation.

    Parameters
    ----------
    card : ModelCard
    title : str
        Such as the model's name.

    Returns
    -------
    matplotlib.figure.Figure
        The confusion matrix by shares of the true class, with counts; the ROC curve of each class;
        and the share of correct answers against the stated probability.
    """
    return _figure(f"{title}: {_accuracy(card)}", card.classes, card)


def evaluation_figure(result: Evaluation) -> Figure:
    """Draw a model's performance on cases of a test: as `card_figure` does."""
    low, high = result.accuracy_interval
    title = (
        f"{result.model}: accuracy {100 * result.accuracy:.1f} % (95 % interval {100 * low:.1f} "
        f"to {100 * high:.1f}), {result.n_cases} cases"
    )
    return _figure(title, result.classes, result)


def _figure(
    title: str,
    classes: tuple[str, ...],
    measured: ModelCard | Evaluation,
) -> Figure:
    n = max(len(classes), 1)
    side = min(max(3.6, 0.62 * n + 1.6), 9.0)
    n_rows = 2 if measured.confusion else 1
    figure = new_figure(side + 6.2, side + 0.9 + 4.2 * (n_rows - 1), dpi=110)
    heights = [side, 3.8][:n_rows]
    panels = figure.subplots(
        n_rows, 2, squeeze=False, width_ratios=[side, 4.2], height_ratios=heights
    )
    n_repetitions = max(1, measured.repetitions) if isinstance(measured, ModelCard) else 1
    _draw_confusion(panels[0, 0], classes, measured.confusion)
    if n_repetitions > 1:
        panels[0, 0].set_title(
            f"Confusion, {n_repetitions} repetitions together", fontsize=10, color=_INK
        )
    curve, error = measured.calibration_curve, measured.calibration_error
    _draw_calibration(panels[0, 1], curve, error, n_repetitions)
    if n_rows > 1:
        _draw_roc(panels[1, 0], classes, measured)
        panels[1, 1].set_axis_off()
    figure.suptitle(title, fontsize=12, color=_INK)
    return figure


def _draw_roc(axes: Any, classes: tuple[str, ...], measured: ModelCard | Evaluation) -> None:
    """Draw the ROC curve of each class against the rest."""
    axes.set_title("ROC, each class against the rest", fontsize=10, color=_INK)
    if not measured.roc:
        _say_nothing(axes, "one class only")
        return
    axes.plot([0, 1], [0, 1], color=_SOFT, linewidth=1, linestyle="--")
    # Of two classes the second curve is the first one's mirror image.
    shown = list(measured.roc)[:1] if len(classes) == 2 else list(measured.roc)
    for number, label in enumerate(shown):
        x, y = zip(*measured.roc[label], strict=True)
        area, low, high = measured.class_auc[label]
        name = f"{_short(label)}: AUC {area:.3f} ({low:.2f} to {high:.2f})"
        colour = _COLOURS[number % len(_COLOURS)]
        style = "-" if number < len(_COLOURS) else ":"
        axes.plot(x, y, color=colour, linestyle=style, linewidth=1.6, label=name)
    axes.legend(loc="lower right", fontsize=7 if len(shown) <= 10 else 5, frameon=False)
    _square(axes, "1 − specificity", "sensitivity")


def _square(axes: Any, x: str, y: str) -> None:
    axes.set(xlim=(-0.02, 1.03), ylim=(-0.02, 1.03), xlabel=x, ylabel=y)
    lighten(axes)


def _accuracy(card: ModelCard) -> str:
    n_cases = sum(card.n_cases.values())
    if card.accuracy is None:
        return f"{n_cases} cases, not cross-validated"
    interval = ""
    if card.accuracy_interval is not None:
        low, high = card.accuracy_interval
        interval = f" (95 % interval {100 * low:.1f} to {100 * high:.1f})"
    how = "cross-validation by subject" if card.is_grouped else "cross-validation"
    if card.repetitions > 1:
        how = f"{card.repetitions} times {how}"
    return f"accuracy {100 * card.accuracy:.1f} %{interval}, {how}, {n_cases} cases"


def _draw_confusion(
    axes: Any, classes: tuple[str, ...], confusion: tuple[tuple[int, ...], ...]
) -> None:
    axes.set_title("Confusion", fontsize=10, color=_INK)
    if not confusion:
        _say_nothing(axes, "no cross-validation")
        return
    counts = np.array(confusion, dtype=np.float64)
    totals = counts.sum(axis=1, keepdims=True)
    shares = np.divide(counts, totals, out=np.zeros_like(counts), where=totals > 0)
    answers = [*classes, "no class"][: counts.shape[1]]
    axes.imshow(shares, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
    # Numbers are legible in a small matrix; a large one has shades only.
    size = 9 if len(classes) <= 8 else 7
    if len(classes) <= 25:
        for (row, column), count in np.ndenumerate(counts):
            if count:
                colour = "white" if shares[row, column] > 0.55 else _INK
                style = {"ha": "center", "va": "center", "color": colour, "fontsize": size}
                axes.text(column, row, f"{count:.0f}", **style)
    axes.set_xticks(range(len(answers)), [_short(name) for name in answers], fontsize=size)
    axes.set_yticks(range(len(classes)), [_short(name) for name in classes], fontsize=size)
    axes.tick_params(length=0)
    if len(answers) > 3 and max(map(len, answers)) > 6:
        for label in axes.get_xticklabels():
            label.set(rotation=35, horizontalalignment="right", rotation_mode="anchor")
    axes.set(xlabel="answer", ylabel="true class")


def _draw_calibration(
    axes: Any, curve: tuple[tuple[float, float, int], ...], error: float | None, n_repetitions: int
) -> None:
    stated = "" if error is None else f", expected calibration error {error:.3f}"
    axes.set_title(f"Calibration{stated}", fontsize=10, color=_INK)
    bins = [bin_ for bin_ in curve if bin_[2] > 0]
    if not bins:
        _say_nothing(axes, "no answers to compare")
        return
    probability, share, n_cases = (np.array(column) for column in zip(*bins, strict=True))
    axes.plot([0, 1], [0, 1], color=_SOFT, linewidth=1, linestyle="--", label="as stated")
    # Repetitions are on the same cases.
    low, high = performance.wilson_interval(share, n_cases / n_repetitions)
    reach = np.maximum([share - low, high - share], 0.0)
    style = {"color": _IN_SET, "marker": "o", "linewidth": 1.5, "capsize": 2, "elinewidth": 1}
    words = "measured, with its 95 % interval"
    axes.errorbar(probability, share, yerr=reach, label=words, **style)
    axes.legend(loc="lower right", fontsize=8, frameon=False)
    _square(axes, "probability stated", "share that was right")


def _say_nothing(axes: Any, text: str) -> None:
    axes.set_axis_off()
    axes.text(0.5, 0.5, text, ha="center", va="center", color=_SOFT, transform=axes.transAxes)


def _short(name: str) -> str:
    return name if len(name) <= 22 else f"{name[:20]}…"
