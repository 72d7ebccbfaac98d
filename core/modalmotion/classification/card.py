"""The card of a model, and its record: what is known of it without reading its arrays."""

import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from modalmotion.arguments.checking import Plotted
from modalmotion.classification.performance import Curve, Interval, Measured, RocCurve
from modalmotion.errors import NotFoundError, ParameterError
from modalmotion.notes import Note, notes_from_json
from modalmotion.representation import plain, shown
from modalmotion.signature.making import SignatureParameters

# Tables of features that are named in words, the weightiest.
_N_NAMED: Final = 3


@shown("classes", "accuracy", "calibration_error", "coverage", "training_set")
@dataclass(frozen=True)
class ModelCard(Plotted):
    """Facts to know about a model before relying on it; every field is JSON-able.

    Parameters
    ----------
    classes : tuple of str
    training_set : str
        sha256 in hex of sequence ids, labels and subjects, in any order.
    n_cases : dict of str to int
        Training cases of each class.
    n_subjects : dict of str to int
        Subjects of each class.
    coverage : float
        Requested level of the class sets below.
    options : dict
        As trained, and under "features" the tables with their weights.
    versions : dict of str to str
    intended_use : str
    has_seen : str
    has_not_seen : str
    is_grouped : bool
        Whether no subject was on both sides of a split.
    class_coverage : dict of str to float
        Share of each class whose set held it, in cross-validation.
    mean_set_size : float
    notes : tuple of Note
        Observations from training.
    extra : dict
        Additions by its maker, such as a test on a held-out cohort.
    accuracy, accuracy_interval, confusion, calibration_curve, calibration_error
        Of cross-validation, as in `Performance`; None or empty if there was none.
    balanced_accuracy, auc, auc_interval, class_auc, log_loss, log_loss_interval, brier
        Likewise.
    brier_interval, sensitivity, specificity, roc
        Likewise.
    methods : str
        How the figures and their intervals are made.
    repetitions : int
        Of the cross-validation; the figures above are their means.
    confounds : tuple of dict
        Conditions of the recordings, and how well each alone separates the classes.
    """

    classes: tuple[str, ...]
    training_set: str
    n_cases: dict[str, int]
    n_subjects: dict[str, int]
    coverage: float
    options: dict[str, Any]
    versions: dict[str, str]
    intended_use: str
    has_seen: str
    has_not_seen: str
    is_grouped: bool = False
    class_coverage: dict[str, float] = field(default_factory=dict)
    mean_set_size: float | None = None
    notes: tuple[Note, ...] = ()
    extra: dict[str, Any] = field(default_factory=dict)
    accuracy: float | None = None
    accuracy_interval: Interval | None = None
    confusion: tuple[tuple[int, ...], ...] = ()
    calibration_curve: Curve = ()
    calibration_error: float | None = None
    balanced_accuracy: float | None = None
    auc: float | None = None
    auc_interval: Interval | None = None
    class_auc: dict[str, Measured] = field(default_factory=dict)
    log_loss: float | None = None
    log_loss_interval: Interval | None = None
    brier: float | None = None
    brier_interval: Interval | None = None
    sensitivity: dict[str, Measured] = field(default_factory=dict)
    specificity: dict[str, Measured] = field(default_factory=dict)
    roc: dict[str, RocCurve] = field(default_factory=dict)
    methods: str = ""
    repetitions: int = 0
    confounds: tuple[dict[str, Any], ...] = ()

    @property
    def reads(self) -> str:
        """What the model reads, in words, the weightiest first."""
        choices = self.options.get("features", ())
        parts = [f"{name} ({weight:.0%})" for name, weight in choices[:_N_NAMED]]
        more = len(choices) - _N_NAMED
        return "; ".join(parts) + (f"; {more} more of less weight" if more > 0 else "")

    def as_json(self) -> dict[str, Any]:
        """Return the card as JSON-able values, tuples as lists."""
        return dict(plain(self))

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> "ModelCard":
        """Read the output of `as_json`."""
        plain = {name: tuples_of(value) for name, value in values.items()}
        return ModelCard(**{**plain, "notes": notes_from_json(values["notes"])})


def tuples_of(value: Any) -> Any:
    """Return JSON values with tuples in place of lists."""
    if isinstance(value, dict):
        return {k: tuples_of(v) for k, v in value.items()}
    return tuple(tuples_of(v) for v in value) if isinstance(value, list | tuple) else value


NAME_PATTERN: Final = "[a-z0-9](?:[a-z0-9._-]{0,62}[a-z0-9])?"
VERSION_PATTERN: Final = "[1-9][0-9]{0,8}"

_NAME: Final = re.compile(NAME_PATTERN)
_REFERENCE: Final = re.compile(f"({NAME_PATTERN})(?:@({VERSION_PATTERN}))?")


class ModelReference(NamedTuple):
    """Name and version of a model.

    Parameters
    ----------
    name : str
    version : int or None
        None represents the newest.
    """

    name: str
    version: int | None

    def __str__(self) -> str:
        return self.name if self.version is None else f"{self.name}@{self.version}"


@shown("name", "version", "classes", "created", "deleted", "id")
@dataclass(frozen=True)
class ModelRecord:
    """One version of a model, as the index knows it.

    Parameters
    ----------
    name : str
    version : int
        Counted from 1 for each name; never used twice, not even after a deletion.
    id : str
        sha256 of everything that the model's answers depend on, in hex.
    classes : tuple of str
    parameters : SignatureParameters
        Of the signatures that it reads.
    created : str
        When it was put, UTC, ISO 8601 with microseconds.
    training : str or None
        Name of the training that made it, so that one which is begun again finds it.
    deleted : str or None
        When it was deleted; only its name, number and id are known from then on.
    """

    name: str
    version: int
    id: str
    classes: tuple[str, ...]
    parameters: SignatureParameters
    created: str
    training: str | None = None
    deleted: str | None = None

    @property
    def reference(self) -> ModelReference:
        """Name and version."""
        return ModelReference(self.name, self.version)


def is_model_name(text: object) -> bool:
    """Return whether a model may be called this; only such a text becomes a folder's name."""
    # Lower case, for on some file systems "A" and "a" are one folder.
    return isinstance(text, str) and _NAME.fullmatch(text) is not None


def require_model_name(text: str) -> str:
    """Check the name of a new model.

    Raises
    ------
    ParameterError
        If it cannot be kept.
    """
    if not is_model_name(text):
        raise ParameterError(
            f"A model cannot be called {text[:80]!r}.",
            remedy="Use 1 to 64 lower-case letters, digits, '.', '_' and '-', with a letter or "
            "a digit at both ends.",
            details={"pattern": f"^{NAME_PATTERN}$"},
        )
    return text


def parse_reference(text: str) -> ModelReference:
    """Read a reference to a model: "name" for its newest version, or "name@3".

    Raises
    ------
    NotFoundError
        If it is neither: no model has such a name.
    """
    match = _REFERENCE.fullmatch(text)
    if match is None:
        raise NotFoundError(
            f"{text[:80]!r} is not the name of a model.",
            remedy="Use its name, such as wall-motion, for the newest version, or its name and a "
            "version, such as wall-motion@3.",
        )
    return ModelReference(match[1], None if match[2] is None else int(match[2]))


# Facts in YAML, as the Hugging Face Hub reads them.
_HUB_HEAD: Final = """---
library_name: modalmotion
tags: [modalmotion, motion, mesh, medical, not-a-medical-device]
---

"""

# What would be read as Markdown or as a table, in texts of others.
_MARKS: Final = re.compile(r"([\\`*_{}\[\]|#~$])")


def card_markdown(name: str, model_id: str, card: ModelCard, *, head: bool = False) -> str:
    """Write a card as Markdown, the same for the same card; with the head that the Hub reads."""
    classes = ", ".join(map(_plain, card.classes))
    parts = [
        f"# {_plain(name)}",
        f"Classifies the motion of a surface: {classes}. Model id `{model_id}`.",
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
    ]
    page = "\n\n".join(part for part in parts if part) + "\n"
    return _HUB_HEAD + page if head else page


def _evaluation(card: ModelCard) -> list[str]:
    if card.accuracy is None:
        return ["There was no cross-validation: its accuracy is unknown."]
    apart = (
        "No subject was on both sides"
        if card.is_grouped
        else "Cases were kept apart, but subjects were not"
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
        return (
            f"Class sets have a nominal coverage of {card.coverage:g}; the actual coverage was "
            "not measured."
        )
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


def _plain(text: str) -> str:
    """Text that is nothing but text, on one line."""
    return _MARKS.sub(r"\\\1", html.escape(" ".join(text.split()), quote=False))
