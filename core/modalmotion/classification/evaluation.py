"""How a model does on labelled cases that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from modalmotion.arguments.checking import Plotted
from modalmotion.classification.answer import Classification, classify
from modalmotion.classification.cases import UNUSABLE, AnyCase, LeftOut, TrainingCase
from modalmotion.classification.model import Model
from modalmotion.classification.performance import (
    METHODS,
    Answers,
    Performance,
    performance,
)
from modalmotion.errors import ParameterError
from modalmotion.representation import csv_text, shown


@shown("truth", "answer", "probabilities", "flags", "sequence_id")
@dataclass(frozen=True)
class CaseAnswer:
    """Answer of a model to one labelled case.

    Parameters
    ----------
    name : str
        Of the case, such as a path; may be empty.
    sequence_id : str
    subject : str
    truth : str
        Its class.
    answer : str or None
        The label; None for an abstention.
    probabilities : tuple of float
        In the order of the model's classes.
    class_set, flags : tuple of str
    """

    name: str
    sequence_id: str
    subject: str
    truth: str
    answer: str | None
    probabilities: tuple[float, ...]
    class_set: tuple[str, ...]
    flags: tuple[str, ...]

    @staticmethod
    def of(case: TrainingCase, result: Classification) -> CaseAnswer:
        """Put a case and a model's answer together."""
        return CaseAnswer(
            name=case.name,
            sequence_id=result.sequence_id,
            subject=case.subject or f"sequence {result.sequence_id}",
            truth=case.label,
            answer=result.label,
            probabilities=tuple(result.probabilities.tolist()),
            class_set=result.class_set,
            flags=result.flags,
        )


@shown("model", "n_cases", "accuracy", "accuracy_interval", "auc", "calibration_error")
@dataclass(frozen=True, kw_only=True)
class Evaluation(Performance, Plotted):
    """Result of a test on labelled cases; every field is JSON-able.

    Where the model abstains its probabilities are equal, its answer is wrong and no class.

    Parameters
    ----------
    model, model_id : str
    classes : tuple of str
    n_cases, n_subjects : int
    abstained : float
        Share of cases without a label.
    flagged : dict of str to float
        Share of cases with each flag.
    coverage : float
        Requested level.
    class_coverage : dict of str to float
        Share of each class whose set held it.
    mean_set_size : float
    n_empty_sets : int
        Number of empty class sets.
    methods : str
        How the figures and their intervals are made.
    notes : tuple of str
        Caveats, such as cases that the model was trained on.
    cases : tuple of CaseAnswer
    """

    model: str
    model_id: str
    classes: tuple[str, ...]
    n_cases: int
    n_subjects: int
    abstained: float
    flagged: dict[str, float]
    coverage: float
    class_coverage: dict[str, float]
    mean_set_size: float
    n_empty_sets: int
    methods: str
    notes: tuple[str, ...]
    cases: tuple[CaseAnswer, ...]

    @property
    def answers(self) -> Answers:
        """The answers as figures are made of them."""
        return _figures_of(self.classes, self.cases)

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return asdict(self)

    def as_csv(self) -> str:
        """Write the answers as a table, a line for each case.

        Returns
        -------
        str
            With the columns case, sequence_id, subject, class, answer, class_set, flags and one
            for each class.
        """
        lines = [
            ["case", "sequence_id", "subject", "class", "answer", "class_set", "flags"]
            + [f"p {label}" for label in self.classes]
        ]
        lines += [
            [case.name, case.sequence_id, case.subject, case.truth, case.answer or ""]
            + ["; ".join(case.class_set), "; ".join(case.flags)]
            + [f"{share:.6g}" for share in case.probabilities]
            for case in self.cases
        ]
        return csv_text(lines)


def evaluate(
    model: Model,
    cases: Iterable[AnyCase],
    coverage: float = 0.9,
    progress: Callable[[float, str], None] | None = None,
    left_out: list[LeftOut] | None = None,
) -> Evaluation:
    """Test a model.

    Parameters
    ----------
    model : Model
    cases : iterable of TrainingCase or CaseSource
        With classes of the model, of subjects that it was not trained on. Read one by one.
    coverage : float
        Level of the class sets.
    progress : callable, optional
        Called with the number of cases that are done, as a float, and a text.
    left_out : list of LeftOut, optional
        Cases that cannot be used are added to it; else one of them ends the test.

    Returns
    -------
    Evaluation

    Raises
    ------
    ParameterError
        If there is no case, or one has a class that the model does not know.
    """
    (answers,) = answers_of((model,), cases, coverage, progress, left_out)
    return evaluation_of(model, answers, coverage)


def answers_of(
    models: Sequence[Model],
    cases: Iterable[AnyCase],
    coverage: float,
    progress: Callable[[float, str], None] | None,
    left_out: list[LeftOut] | None,
) -> list[list[CaseAnswer]]:
    """Ask models about labelled cases: see `evaluate`."""
    answers: list[list[CaseAnswer]] = [[] for _ in models]
    for number, source in enumerate(cases):
        try:
            case = source if isinstance(source, TrainingCase) else source.read()
            for model in models:
                require_known(model, case.label, number, case.name)
            results = [classify(case.motion, model, coverage) for model in models]
        except UNUSABLE as error:
            if left_out is None:
                raise
            left_out.append(LeftOut.of(error, source.name or f"case {number}"))
            continue
        for its, result in zip(answers, results, strict=True):
            its.append(CaseAnswer.of(case, result))
        if progress is not None:
            progress(float(number + 1), "classified")
    return answers


def require_known(model: Model, label: str, number: int, name: str = "") -> None:
    """Check that a model knows the class of a case.

    Raises
    ------
    ParameterError
        If it does not.
    """
    if label not in model.classes:
        raise ParameterError(
            f"The case {name or number} has the class {str(label)[:80]!r}, which the model "
            f"{model.name!r} does not know.",
            remedy=f"Give cases of its classes: {', '.join(model.classes)}.",
            details={"case": number},
        )


def evaluation_of(model: Model, answers: Sequence[CaseAnswer], coverage: float) -> Evaluation:
    """Measure a model's answers to labelled cases.

    Raises
    ------
    ParameterError
        If there is no case.
    """
    if not answers:
        raise ParameterError("There is no case to test on.", remedy="Give at least one.")
    classes = model.classes
    listed = _figures_of(classes, answers)
    y, labels = listed.y, listed.labels[0]
    covers = np.array([case.truth in case.class_set for case in answers])

    flags = sorted({flag for case in answers for flag in case.flags})
    return Evaluation(
        **vars(performance(listed, abstains=True)),
        model=model.name,
        model_id=model.id,
        classes=classes,
        n_cases=len(y),
        n_subjects=len(set(listed.subjects)),
        abstained=float((labels < 0).mean()),
        flagged={flag: float(np.mean([flag in c.flags for c in answers])) for flag in flags},
        coverage=coverage,
        class_coverage={
            label: float(covers[y == k].mean()) for k, label in enumerate(classes) if (y == k).any()
        },
        mean_set_size=float(np.mean([len(case.class_set) for case in answers])),
        n_empty_sets=sum(not case.class_set for case in answers),
        methods=METHODS,
        notes=_notes(model, answers),
        cases=tuple(answers),
    )


def _figures_of(classes: tuple[str, ...], answers: Sequence[CaseAnswer]) -> Answers:
    place = {label: k for k, label in enumerate(classes)}
    return Answers(
        classes,
        np.array([place[case.truth] for case in answers]),
        [case.subject for case in answers],
        np.array([[case.probabilities for case in answers]]),
        np.array([[-1 if c.answer is None else place[c.answer] for c in answers]]),
    )


def _notes(model: Model, answers: Sequence[CaseAnswer]) -> tuple[str, ...]:
    """Say which cases the model knows from its training."""
    known = model.cross_validation
    trained = set() if known is None else set(known.sequence_ids)
    n = sum(case.sequence_id in trained for case in answers)
    if not n:
        return ()
    note = (
        f"{n} of the {len(answers)} cases are in the training set: the figures are too "
        "optimistic. Test on "
        "other subjects, or read the card, whose figures are of held-out cases."
    )
    return (note,)
