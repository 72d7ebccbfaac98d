"""A model's card as Markdown, as the Hugging Face Hub reads it: facts on top, then words."""

from __future__ import annotations

import html
import json
import re
import shlex
from collections.abc import Iterable, Mapping, Sequence
from typing import Final

from modalmotion.classification.card import ModelCard
from modalmotion.classification.model_files import DEFAULT_MODEL, NORMAL_DISPLACEMENT_MODEL

# Facts for registries, in YAML.
_HEAD: Final = """---
library_name: modalmotion
tags: [modalmotion, motion, mesh, medical, not-a-medical-device]
---"""

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
    """Write a card as Markdown with a YAML head, for people and for registries.

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
        _HEAD,
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
        _list("## Conditions that separate the classes", (one["text"] for one in card.confounds)),
        "## Training",
        f"Reads: {_plain(card.reads)}" if card.reads else "",
        _table(("option", "value"), sorted(card.options.items())),
        _table(("library", "version"), sorted(card.versions.items())),
        _list("## Caveats", map(str, card.notes)),
        "## How to use it",
        *_use(name, version, file),
    ]
    return "\n\n".join(part for part in parts if part) + "\n"


def _use(name: str, version: int | None, file: str | None) -> list[str]:
    """Show a command that works: with a file, unless the model comes with the package."""
    if file is None and version is None and name in (DEFAULT_MODEL, NORMAL_DISPLACEMENT_MODEL):
        return [f"```sh\nmodalmotion classify beat.npz --model {name}\n```"]
    own = f"{name}.h5" if version is None else f"{name}-{version}.h5"
    # No path may end the block.
    place = own if file is None or "`" in file or not file.isprintable() else file
    words = (
        "Here `--model` takes the path of the model's file; only models included in the package "
        "have names there."
    )
    return [f"```sh\nmodalmotion classify beat.npz --model {shlex.quote(place)}\n```", words]


def _evaluation(card: ModelCard) -> list[str]:
    if card.accuracy is None:
        return ["There was no cross-validation: its accuracy is unknown."]
    apart = (
        "No subject was on both sides" if card.is_grouped else "Cases were kept apart, subjects not"
    )
    every = (
        ("Accuracy", card.accuracy, card.accuracy_interval),
        ("Balanced accuracy", card.balanced_accuracy, None),
        ("AUC, macro", card.auc, card.auc_interval),
        ("Log loss", card.log_loss, card.log_loss_interval),
        ("Brier score", card.brier, card.brier_interval),
        ("Expected calibration error", card.calibration_error, None),
    )
    rows = [
        (name, *_figure((value, *(ends or ())))) for name, value, ends in every if value is not None
    ]
    by_class = (card.sensitivity, card.specificity, card.class_auc)
    return [
        f"Cross-validation, {max(card.repetitions, 1)} times. {apart}.",
        _table(("figure", "value", "95 % interval"), rows),
        _table(
            ("class", "sensitivity", "specificity", "AUC"),
            [
                (label, *(" ".join(_figure(each.get(label, ()))) for each in by_class))
                for label in card.classes
            ],
        ),
        # An extra last column counts answers without a class.
        _table(
            ("true class, and answers", *[*card.classes, "no class"][: len(card.confusion[0])]),
            [(label, *n) for label, n in zip(card.classes, card.confusion, strict=True)],
        ),
        _plain(card.methods),
    ]


def _sets(card: ModelCard) -> str:
    if not card.class_coverage:
        return f"Sets of classes are made at a coverage of {card.coverage:g}; none was measured."
    rows = [(label, f"{share:.3f}") for label, share in card.class_coverage.items()]
    size = "" if card.mean_set_size is None else f" Their mean size is {card.mean_set_size:.2f}."
    return (
        f"Sets of classes that cannot be excluded, at a coverage of {card.coverage:g}.{size}\n\n"
        + _table(("class", "share whose set contains it"), rows)
    )


def _list(heading: str, texts: Iterable[str]) -> str:
    lines = [f"- {_plain(text)}" for text in texts]
    return "\n\n".join([heading, "\n".join(lines)]) if lines else ""


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


def _figure(measured: Sequence[float]) -> tuple[str, str]:
    """Write a value, and the interval that may follow it."""
    value, *ends = [f"{number:.3f}" for number in measured] or [""]
    return value, f"({' to '.join(ends)})" if ends else ""


def _listed(names: Sequence[str]) -> str:
    return ", ".join(map(_plain, names))


def _plain(text: str) -> str:
    """Text that is nothing but text, on one line."""
    return _MARKS.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))
