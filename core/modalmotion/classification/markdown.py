"""A model's card as Markdown, as the Hugging Face Hub reads it: facts on top, then words."""

from __future__ import annotations

import html
import json
import re
import shlex
from collections.abc import Mapping, Sequence
from typing import Any, Final

from modalmotion.classification.card import ModelCard
from modalmotion.classification.model_files import DEFAULT_MODEL, OFFSET_MODEL

# What would be read as Markdown or as a table, in texts of others.
_MARKS: Final = re.compile(r"([\\`*_{}\[\]|#~$])")


def card_markdown(
    name: str,
    model_id: str,
    card: ModelCard,
    *,
    version: int | None = None,
    file: str | None = None,
) -> str:
    """Write a card as Markdown with a YAML head (`model-index`), for people and for registries.

    Parameters
    ----------
    name, model_id : str
    card : ModelCard
    version : int, optional
    file : str, optional
        Where the model is, for the example; a file of its name by default, and for a shipped
        model its name.

    Returns
    -------
    str
        The same for the same card. No licence is stated: whoever publishes a model names it.
    """
    reference = name if version is None else f"{name}@{version}"
    parts = [
        _head(name, card),
        f"# {_plain(reference)}",
        f"Classifies the motion of a surface: {_listed(card.classes)}. Model id `{model_id}`.",
        "## Intended use",
        _plain(card.intended_use),
        "## Training data",
        _table(
            ("class", "sequences", "subjects"),
            [(label, card.n_cases[label], card.n_subjects[label]) for label in card.classes],
        ),
        f"Digest of ids, labels and subjects: `{card.training_set}`.",
        f"Has seen: {_plain(card.has_seen)}",
        f"Has not seen: {_plain(card.has_not_seen)}",
        "## Evaluation",
        *_evaluation(card),
        "## Class sets",
        _sets(card),
        *_confounds(card),
        "## Training",
        f"Reads: {_plain(card.reads)}" if card.reads else "",
        _table(("option", "value"), sorted(card.options.items())),
        _table(("library", "version"), sorted(card.versions.items())),
        *_notes(card),
        "## How to use it",
        *_use(name, version, file),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _use(name: str, version: int | None, file: str | None) -> list[str]:
    """Show a command that works: with a file, unless the model comes with the package."""
    if file is None and version is None and name in (DEFAULT_MODEL, OFFSET_MODEL):
        return [f"```sh\nmodalmotion classify beat.npz --model {name}\n```"]
    own = f"{name}.h5" if version is None else f"{name}-{version}.h5"
    # No path may end the block.
    place = own if file is None or "`" in file or not file.isprintable() else file
    words = (
        "Here `--model` takes the path of the model's file; only models included in the package "
        "have names there."
    )
    return [f"```sh\nmodalmotion classify beat.npz --model {shlex.quote(place)}\n```", words]


def _head(name: str, card: ModelCard) -> str:
    """Facts for machines; JSON is YAML too, so that no text can break out of its place."""
    facts: dict[str, Any] = {
        "library_name": "modalmotion",
        "tags": ["modalmotion", "motion", "mesh", "medical", "not-a-medical-device"],
    }
    measured = [
        {"type": kind, "name": said, "value": value}
        for kind, said, value in _metrics(card)
        if value is not None
    ]
    if measured:
        facts["model-index"] = [
            {
                "name": name,
                "results": [
                    {
                        "task": {"type": "other", "name": "Motion classification"},
                        "dataset": {
                            "type": card.training_set,
                            "name": "Training cases, cross-validated",
                        },
                        "metrics": measured,
                    }
                ],
            }
        ]
    lines = [f"{key}: {json.dumps(value, allow_nan=False)}" for key, value in facts.items()]
    return "\n".join(["---", *lines, "---"])


def _metrics(card: ModelCard) -> list[tuple[str, str, float | None]]:
    return [
        ("accuracy", "Accuracy", card.accuracy),
        ("balanced_accuracy", "Balanced accuracy", card.balanced_accuracy),
        ("roc_auc", "AUC, macro", card.auc),
        ("log_loss", "Log loss", card.log_loss),
        ("brier_score", "Brier score", card.brier),
        ("calibration_error", "Expected calibration error", card.calibration_error),
    ]


def _evaluation(card: ModelCard) -> list[str]:
    if card.accuracy is None:
        return ["There was no cross-validation: its accuracy is unknown."]
    intervals = {
        "Accuracy": card.accuracy_interval,
        "AUC, macro": card.auc_interval,
        "Log loss": card.log_loss_interval,
        "Brier score": card.brier_interval,
    }
    rows = [
        (said, f"{value:.3f}", _interval(intervals.get(said)))
        for _, said, value in _metrics(card)
        if value is not None
    ]
    how = (
        "No subject was on both sides."
        if card.is_grouped
        else "Cases were separated, not subjects."
    )
    parts = [
        f"Cross-validation, {max(len(card.repetitions), 1)} times. {how}",
        _table(("figure", "value", "95 % interval"), rows),
    ]
    if card.sensitivity:
        parts.append(
            _table(
                ("class", "sensitivity", "specificity", "AUC"),
                [
                    (
                        label,
                        *(
                            _figure(each.get(label))
                            for each in (card.sensitivity, card.specificity, card.class_auc)
                        ),
                    )
                    for label in card.classes
                ],
            )
        )
    if card.confusion:
        # An extra last column counts answers without a class.
        names = [*card.classes, "no class"][: len(card.confusion[0])]
        rows_of = zip(card.classes, card.confusion, strict=True)
        parts.append(
            _table(
                ("true class, and answers", *names),
                [(label, *counts) for label, counts in rows_of],
            )
        )
    return [*parts, _plain(card.methods)]


def _sets(card: ModelCard) -> str:
    if not card.class_coverage:
        return f"Sets of classes are made at a coverage of {card.coverage:g}; none was measured."
    rows = [(label, f"{share:.3f}") for label, share in card.class_coverage.items()]
    size = "" if card.mean_set_size is None else f" Their mean size is {card.mean_set_size:.2f}."
    return (
        f"Sets of classes that cannot be excluded, at a coverage of {card.coverage:g}.{size}\n\n"
        + _table(("class", "share whose set contains it"), rows)
    )


def _confounds(card: ModelCard) -> list[str]:
    if not card.confounds:
        return []
    lines = [f"- {_plain(str(one.get('text', one)))}" for one in card.confounds]
    return ["## Conditions that separate the classes", "\n".join(lines)]


def _notes(card: ModelCard) -> list[str]:
    if not card.notes:
        return []
    return ["## Caveats", "\n".join(f"- {_plain(note)}" for note in card.notes)]


def _table(names: Sequence[str], rows: Sequence[Sequence[object]]) -> str:
    if not rows:
        return ""
    lines = [
        [*map(_cell, names)],
        ["---"] * len(names),
        *([_cell(value) for value in row] for row in rows),
    ]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(value: object) -> str:
    text = json.dumps(value) if isinstance(value, Mapping | list | tuple) else str(value)
    return _plain(text)


def _figure(measured: Sequence[float] | None) -> str:
    if measured is None:
        return ""
    value, low, high = measured
    return f"{value:.3f} ({low:.3f} to {high:.3f})"


def _interval(ends: Sequence[float] | None) -> str:
    return "" if ends is None else f"{ends[0]:.3f} to {ends[1]:.3f}"


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(_plain, names))


def _plain(text: str) -> str:
    """Text that is nothing but text, on one line."""
    return _MARKS.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))
