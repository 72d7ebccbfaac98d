"""Text output of the model commands."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Final

from modalmotion.representation import numeral, probability

if TYPE_CHECKING:
    from modalmotion.classification import Classification, Comparison, Evaluation, Model, ModelCard


def model_json(model: Model) -> dict[str, object]:
    """Values of a model's card as JSON."""
    return {"name": model.name, "id": model.id, "card": model.card.as_json()}


def card_lines(name: str, model_id: str, card: ModelCard) -> str:
    """Write a model's training cases and its measured accuracy."""
    n_cases = sum(card.n_cases.values())
    lines = [f"{name} (id {model_id[:12]}): {n_cases} sequences of {len(card.classes)} classes"]
    lines += [
        f"  {card.n_cases[label]:5d} sequences of {card.n_subjects[label]} subjects  {label}"
        for label in card.classes
    ]
    if card.reads:
        lines.append(f"Reads: {card.reads}")
    if card.accuracy is not None:
        how = "subjects apart" if card.is_grouped else "cases apart"
        accuracy = accuracy_text(card.accuracy, card.accuracy_interval)
        lines.append(f"cross-validated, {how}: {accuracy}")
        lines += [*_spread(card), *_figures(card)]
        lines += _matrix(card.classes, card.confusion, len(card.repetitions))
        lines += _sets(card.coverage, card.class_coverage, card.mean_set_size)
    return "\n".join(lines + [f"note: {note}" for note in card.notes])


def evaluation_lines(result: Evaluation) -> str:
    """Write the results of a test."""
    lines = [
        f"{result.model} (id {result.model_id[:12]}) on {result.n_cases} sequences",
        accuracy_text(result.accuracy, result.accuracy_interval),
        f"balanced {100 * result.balanced_accuracy:.1f} %",
        f"without a class {100 * result.abstained:.1f} %",
    ]
    lines += [f"  {100 * share:5.1f} %  {flag}" for flag, share in result.flagged.items()]
    lines += [*_figures(result), *_matrix(result.classes, result.confusion)]
    lines += _sets(result.coverage, result.class_coverage, result.mean_set_size)
    n_empty = result.n_empty_sets
    lines.append(f"{n_empty} of {result.n_cases} sets {'is' if n_empty == 1 else 'are'} empty")
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def comparison_lines(result: Comparison) -> str:
    """Write two models side by side."""
    first, second = result.models
    names = [f"{m} (id {i[:12]})" for m, i in zip(result.models, result.model_ids, strict=True)]
    lines = [
        f"{result.n_cases} sequences of {result.n_subjects} subjects",
        f"difference: {names[1]} minus {names[0]}",
    ]
    for name, figure in (
        ("accuracy", result.accuracy),
        ("AUC", result.auc),
        ("log loss", result.log_loss),
        ("Brier score", result.brier),
    ):
        if figure is not None:
            lines.append(
                f"  {name:12s} {figure.first:.3f}  {figure.second:.3f}  {figure.difference:+.3f} "
                f"(95 % interval {figure.low:+.3f} to {figure.high:+.3f}), p = {figure.p:.3g}"
            )
    lines.append(
        f"right alone: {first} on {result.only_first} sequences, {second} on {result.only_second}"
    )
    lines.append(result.methods)
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def accuracy_text(share: float, interval: tuple[float, float] | None) -> str:
    """Write an accuracy with its interval, in percent."""
    if interval is None:
        return f"accuracy {100 * share:.1f} %"
    low, high = interval
    return f"accuracy {100 * share:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f})"


def _spread(card: ModelCard) -> list[str]:
    """Write how far the repetitions differ."""
    if len(card.repetitions) < 2:
        return []
    parts = []
    for name, (text, factor, form) in _REPEATED.items():
        values = [each[name] for each in card.repetitions]
        known = [factor * value for value in values if value is not None]
        if known:
            parts.append(f"{text} {min(known):{form}} to {max(known):{form}}")
    return [f"{len(card.repetitions)} repetitions: {', '.join(parts)}"]


_REPEATED: Final = {
    "accuracy": ("accuracy %", 100.0, ".1f"),
    "auc": ("AUC", 1.0, ".3f"),
    "log_loss": ("log loss", 1.0, ".3f"),
}


def _figures(measured: ModelCard | Evaluation) -> list[str]:
    """Write AUC, losses, calibration, and sensitivity and specificity of each class."""
    if measured.log_loss is None or measured.brier is None:
        return []
    area = "" if measured.auc is None else f"AUC {_with(measured.auc, measured.auc_interval)}, "
    lines = [
        f"{area}log loss {_with(measured.log_loss, measured.log_loss_interval)}",
        f"Brier score {_with(measured.brier, measured.brier_interval)}",
        f"expected calibration error {measured.calibration_error:.3f}",
    ]
    for label, (value, *interval) in measured.sensitivity.items():
        line = f"  {label}: sensitivity {_with(100 * value, [100 * x for x in interval], 1)} %"
        if label in measured.specificity:
            value, *interval = measured.specificity[label]
            line += f", specificity {_with(100 * value, [100 * x for x in interval], 1)} %"
        if label in measured.class_auc:
            value, *interval = measured.class_auc[label]
            line += f", AUC {_with(value, interval)}"
        lines.append(line)
    return lines


def _with(value: float, interval: Sequence[float] | None, digits: int = 3) -> str:
    """Write a value with its interval."""
    if interval is None:
        return f"{value:.{digits}f}"
    low, high = interval
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _matrix(
    classes: tuple[str, ...], confusion: tuple[tuple[int, ...], ...], n_repetitions: int = 1
) -> list[str]:
    """Write counts of answers (columns) by true class (rows)."""
    if not confusion:
        return []
    answers = [*classes, "no class"][: len(confusion[0])]
    keys = [str(number + 1) for number in range(len(classes))] + ["-"]
    width = 1 + max(len(str(count)) for row in confusion for count in row)
    width = max(width, 1 + max(map(len, keys)))
    repeated = f", {n_repetitions} repetitions together" if n_repetitions > 1 else ""
    lines = [f"confusion (answers in columns, by the number of their class{repeated}):"]
    lines.append("     " + "".join(key.rjust(width) for key in keys[: len(answers)]))
    for key, label, row in zip(keys, classes, confusion, strict=False):
        counts = "".join(str(count).rjust(width) for count in row)
        lines.append(f"  {key:>3}{counts}  {label}")
    if len(answers) > len(classes):
        lines.append("  - no class")
    return lines


def _sets(coverage: float, by_class: dict[str, float], size: float | None) -> list[str]:
    if not by_class:
        return []
    shares = ", ".join(f"{label} {100 * share:.1f} %" for label, share in by_class.items())
    mean = "" if size is None else f"; {size:.2f} classes in a set"
    return [f"class sets at {100 * coverage:g} % contain the true class: {shares}{mean}"]


def answer_lines(result: Classification) -> str:
    """Write a model's answer for a sequence."""
    if result.label is None:
        lines = [f"{result.model}: no class"]
    else:
        lines = [f"{result.model}: {result.label}, probability {probability(result.probability)}"]
    lines += [f"flag: {flag}" for flag in result.flags]
    # Equal probabilities are not a measurement.
    if result.label is not None:
        shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
        for name, share in sorted(shares.items(), key=lambda item: -item[1]):
            mark = "*" if name in result.class_set else " "
            lines.append(f"  {probability(share):>6} {mark} {name}")
        if result.class_set:
            lines.append(f"* cannot be excluded at {100 * result.coverage:g} %")
    for part in result.explanation[:5]:
        lines.append(
            f"  {part.score:+7.2f}  {numeral(part.amplitude):>8} {part.unit or 'length units'}  "
            f"{' '.join(part.modes)}"
        )
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def answer_json(result: Classification) -> dict[str, object]:
    """Give the members of a model's answer for a sequence, as JSON has them."""
    return {
        "sequence_id": result.sequence_id,
        "model": result.model,
        "model_id": result.model_id,
        "label": result.label,
        "probabilities": dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
        "class_set": list(result.class_set),
        "coverage": result.coverage,
        "flags": list(result.flags),
        "explanation": [asdict(part) for part in result.explanation],
        "notes": list(result.notes),
    }
