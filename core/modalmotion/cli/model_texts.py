"""What the commands of models print."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from modalmotion.numerals import numeral

if TYPE_CHECKING:
    from modalmotion.classification import Classification, Evaluation, ModelCard


def card_lines(name: str, model_id: str, card: ModelCard) -> str:
    """Say what a model was made of and how it does."""
    n_cases = sum(card.n_cases.values())
    lines = [f"{name} (id {model_id[:12]}): {n_cases} sequences of {len(card.classes)} classes"]
    lines += [
        f"  {card.n_cases[label]:5d} sequences of {card.n_subjects[label]} subjects  {label}"
        for label in card.classes
    ]
    if card.accuracy is not None:
        how = "subjects apart" if card.is_grouped else "cases apart"
        accuracy = accuracy_text(card.accuracy, card.accuracy_interval)
        lines += [f"cross-validated, {how}: {accuracy}", *_matrix(card.classes, card.confusion)]
        lines += _sets(card.coverage, card.class_coverage, card.mean_set_size)
        lines.append(f"expected calibration error {card.calibration_error:.3f}")
    return "\n".join(lines + [f"note: {note}" for note in card.notes])


def evaluation_lines(result: Evaluation) -> str:
    """Say what a test found."""
    lines = [
        f"{result.model} (id {result.model_id[:12]}) on {result.n_cases} sequences",
        accuracy_text(result.accuracy, result.accuracy_interval),
        f"balanced {100 * result.balanced_accuracy:.1f} %",
        f"without a class {100 * result.abstained:.1f} %",
    ]
    lines += [f"  {100 * share:5.1f} %  {flag}" for flag, share in result.flagged.items()]
    lines += _matrix(result.classes, result.confusion)
    lines += _sets(result.coverage, result.class_coverage, result.mean_set_size)
    lines.append(f"expected calibration error {result.calibration_error:.3f}")
    return "\n".join(lines)


def accuracy_text(share: float, interval: tuple[float, float] | None) -> str:
    """Say an accuracy with its interval, in percent."""
    if interval is None:
        return f"accuracy {100 * share:.1f} %"
    low, high = interval
    return f"accuracy {100 * share:.1f} % (95 % interval {100 * low:.1f} to {100 * high:.1f})"


def _matrix(classes: tuple[str, ...], confusion: tuple[tuple[int, ...], ...]) -> list[str]:
    """Write out counts of answers (columns) by true class (rows)."""
    if not confusion:
        return []
    answers = [*classes, "no class"][: len(confusion[0])]
    keys = [str(number + 1) for number in range(len(classes))] + ["-"]
    width = 1 + max(len(str(count)) for row in confusion for count in row)
    width = max(width, 1 + max(map(len, keys)))
    lines = ["confusion (answers in columns, by the number of their class):"]
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
    held = ", ".join(f"{label} {100 * share:.1f} %" for label, share in by_class.items())
    mean = "" if size is None else f"; {size:.2f} classes in a set"
    return [f"class sets at {100 * coverage:g} % hold the true class: {held}{mean}"]


def answer_lines(result: Classification) -> str:
    """Say what a model says of a sequence."""
    if result.label is None:
        lines = [f"{result.model}: no class"]
    else:
        lines = [f"{result.model}: {result.label}, probability {result.probability:.3f}"]
    lines += [f"flag: {flag}" for flag in result.flags]
    shares = dict(zip(result.classes, result.probabilities.tolist(), strict=True))
    for name, share in sorted(shares.items(), key=lambda item: -item[1]):
        mark = "*" if name in result.class_set else " "
        lines.append(f"  {share:6.3f} {mark} {name}")
    lines.append(f"* cannot be ruled out at {100 * result.coverage:g} %")
    for part in result.explanation[:5]:
        lines.append(
            f"  {part.score:+7.2f}  {numeral(part.amplitude):>8} {part.unit or 'length units'}  "
            f"{' '.join(part.modes)}"
        )
    return "\n".join(lines + [f"note: {note}" for note in result.notes])


def answer_json(result: Classification) -> str:
    """Write out what a model says of a sequence as JSON."""
    answer = {
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
    return json.dumps(answer, indent=2)
