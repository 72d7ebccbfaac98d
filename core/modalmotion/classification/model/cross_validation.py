"""Cross-validation: what a model's recipe answered to each training case, held out."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.measures.performance import Answers
from modalmotion.hdf5.contents import Contents
from modalmotion.representation import csv_text, shown


@shown("probabilities", "classes")
@dataclass(frozen=True, eq=False)
class CrossValidation:
    """Answers to the training cases, each from folds that it took no part in.

    Parameters
    ----------
    classes : tuple of str
    sequence_ids : tuple of str
        Of the cases.
    names : tuple of str
        What the cases are called, such as paths; empty once it was in a file, which names nobody.
    subjects : tuple of str
        Once it was in a file "subject 1" and so on.
    y : (cases,) int64
        True classes.
    probabilities : (repetitions, cases, classes) float64
    folds : (repetitions, cases) int64
        In which fold each case was held out, from 0.
    """

    classes: tuple[str, ...]
    sequence_ids: tuple[str, ...]
    names: tuple[str, ...]
    subjects: tuple[str, ...]
    y: NDArray[np.int64]
    probabilities: NDArray[np.float64]
    folds: NDArray[np.int64]

    def answers(self, labels: NDArray[np.int64] | None = None) -> Answers:
        """Give the answers to measure.

        Parameters
        ----------
        labels : (repetitions, cases) int64, optional
            The most probable classes by default.
        """
        if labels is None:
            labels = self.probabilities.argmax(axis=2)
        return Answers(self.classes, self.y, self.subjects, self.probabilities, labels)

    def as_csv(self, names: Mapping[str, tuple[str, str]] | None = None) -> str:
        """Write the probabilities as a table, a line for each case and repetition.

        Parameters
        ----------
        names : mapping of sequence id to (str, str), optional
            Name and subject of cases, which a file does not hold.

        Returns
        -------
        str
            With the columns case, sequence_id, subject, class, repetition, fold, answer and one
            for each class; repetitions and folds count from 1.
        """
        known = names or {}
        lines = [
            ["case", "sequence_id", "subject", "class", "repetition", "fold", "answer"]
            + [f"p {label}" for label in self.classes]
        ]
        for repetition, (shares, folds) in enumerate(
            zip(self.probabilities, self.folds, strict=True)
        ):
            for i, sequence_id in enumerate(self.sequence_ids):
                name, subject = known.get(sequence_id, (self.names[i], self.subjects[i]))
                answer = self.classes[int(shares[i].argmax())]
                lines.append(
                    [name, sequence_id, subject, self.classes[self.y[i]]]
                    + [str(repetition + 1), str(folds[i] + 1), answer]
                    + [f"{share:.6g}" for share in shares[i]]
                )
        return csv_text(lines)


def validation_arrays(validation: CrossValidation) -> dict[str, NDArray[Any]]:
    """Write it as arrays for a file: without names, and subjects by number."""
    ids = b"".join(bytes.fromhex(sequence_id) for sequence_id in validation.sequence_ids)
    numbers = {name: k for k, name in enumerate(dict.fromkeys(validation.subjects))}
    return {
        "held_out_ids": np.frombuffer(ids, dtype=np.uint8).reshape(len(validation.y), -1),
        "held_out_subjects": np.array([numbers[name] for name in validation.subjects]),
        "held_out_classes": validation.y,
        "held_out_probabilities": validation.probabilities,
        "held_out_folds": validation.folds,
    }


def validation_of(classes: tuple[str, ...], contents: Contents) -> CrossValidation | None:
    """Read what `validation_arrays` wrote; None where there is nothing of it.

    Raises
    ------
    KeyError, ValueError
        If the arrays do not fit together.
    """
    if "held_out_classes" not in contents.arrays:
        return None
    y = contents.array("held_out_classes", (None,)).astype(np.int64)
    n = len(y)
    shares = contents.array("held_out_probabilities", (None, n, len(classes)))
    folds = contents.array("held_out_folds", (len(shares), n)).astype(np.int64)
    if not n or y.min() < 0 or y.max() >= len(classes):
        raise ValueError("a held-out case is of no class of the model")
    return CrossValidation(
        classes=classes,
        sequence_ids=tuple(
            row.tobytes().hex() for row in contents.array("held_out_ids", (n, None))
        ),
        names=("",) * n,
        subjects=tuple(
            f"subject {number + 1}" for number in contents.array("held_out_subjects", (n,)).tolist()
        ),
        y=y,
        probabilities=shares,
        folds=folds,
    )
