"""How models do on labelled cases that they have not seen, alone and compared."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
import scipy

from modalmotion.arguments.checking import Plotted
from modalmotion.classification.answer import Classification, classify
from modalmotion.classification.cases import UNUSABLE, AnyCase, LeftOut, TrainingCase
from modalmotion.classification.model import Model
from modalmotion.classification.performance import (
    METHODS,
    Answers,
    Performance,
    Z,
    macro_area,
    performance,
)
from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Floats, Ints, counted, csv_text, shown


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
    def of(case: TrainingCase, result: Classification) -> "CaseAnswer":
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
    notes : tuple of Note
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
    notes: tuple[Note, ...]
    cases: tuple[CaseAnswer, ...]

    @property
    def answers(self) -> Answers:
        """The answers as figures are made of them."""
        return _figures_of(self.classes, self.cases)

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
    progress: Reporter | None = None,
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
        Called with the number of cases that are done, and of all as far as known.
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
    return _evaluations((model,), cases, coverage, progress, left_out)[0]


def _evaluations(
    models: Sequence[Model],
    cases: Iterable[AnyCase],
    coverage: float,
    progress: Reporter | None,
    left_out: list[LeftOut] | None,
) -> list[Evaluation]:
    """Test models on the same cases: one that cannot be used with one of them is left out of all.

    Parameters are those of `evaluate`.
    """
    answers: list[list[CaseAnswer]] = [[] for _ in models]
    n_trained = [0] * len(models)
    for number, source in enumerate(reported(cases, progress)):
        called = source.name or f"case {number}"
        try:
            case = source if isinstance(source, TrainingCase) else source.read()
            for model in models:
                if case.label not in model.classes:
                    raise ParameterError(
                        f"{called} has the class {str(case.label)[:80]!r}, which the model "
                        f"{model.name!r} does not know.",
                        remedy=f"Give cases of its classes: {', '.join(model.classes)}.",
                        details={"case": number},
                    )
            results = [classify(case.motion, model, coverage) for model in models]
        except UNUSABLE as error:
            if left_out is None:
                raise
            left_out.append(LeftOut.of(error, called))
        else:
            for k, (model, result) in enumerate(zip(models, results, strict=True)):
                answers[k].append(CaseAnswer.of(case, result))
                n_trained[k] += _is_known(case, model)
    each = zip(models, answers, n_trained, strict=True)
    return [evaluation_of(model, own, coverage, n) for model, own, n in each]


def evaluation_of(
    model: Model, answers: Sequence[CaseAnswer], coverage: float, n_trained: int | None = None
) -> Evaluation:
    """Measure a model's answers to labelled cases, of which it was trained on so many.

    By default those whose ids are among its own.

    Raises
    ------
    ParameterError
        If there is no case.
    """
    if not answers:
        raise ParameterError("There is no case to test on.", remedy="Give at least one.")
    classes = model.classes
    if n_trained is None:
        n_trained = len({case.sequence_id for case in answers} & _trained_on(model))
    listed = _figures_of(classes, answers)
    y, labels = listed.y, listed.labels[0]
    covers = np.array([case.truth in case.class_set for case in answers])

    flags = sorted({flag for case in answers for flag in case.flags})
    note = Note.of("tested_on_training", n_trained=n_trained, n_cases=len(answers))
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
        notes=(note,) if n_trained else (),
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


def _trained_on(model: Model) -> set[str]:
    known = model.cross_validation
    return set() if known is None else {*known.sequence_ids}


def _is_known(case: TrainingCase, model: Model) -> bool:
    """Whether a model was trained on a recording, in whatever unit, which ids depend on."""
    known, motion = _trained_on(model), case.motion
    if not known or not isinstance(motion, MeshSequence):
        return case.sequence_id in known
    return any(replace(motion, unit=unit).id in known for unit in (None, *MM_PER_UNIT))


COMPARISON_METHODS: Final = (
    "Differences are the second model's figure minus the first's, on the same cases. Intervals of "
    "95 % and p of AUC, log loss and Brier score: normal, with the variance of the contributions "
    "of the subjects (of the AUC by DeLong, DeLong and Clarke-Pearson 1988). p of the accuracy: "
    "McNemar's exact test; a subject with several cases counts once, for the model that is right "
    "more often on them."
)
"""How a comparison is made."""


class Difference(NamedTuple):
    """A figure of two models.

    Parameters
    ----------
    first, second : float
    difference : float
        Second less first.
    low, high : float
        95 % interval of the difference.
    p : float
        Of no difference, two-sided.
    """

    first: float
    second: float
    difference: float
    low: float
    high: float
    p: float


@shown("models", "n_cases", "accuracy", "auc", "log_loss")
@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two models on the same labelled cases; every field is JSON-able.

    Parameters
    ----------
    models, model_ids : (str, str)
    n_cases, n_subjects : int
    accuracy : Difference
        An abstention counts as wrong.
    auc : Difference or None
        Macro, each class against the rest; None if only one class is there.
    log_loss, brier : Difference
        Smaller is better.
    only_first, only_second : int
        Cases on which that model alone is right.
    evaluations : (Evaluation, Evaluation)
    methods : str
    notes : tuple of Note
    """

    models: tuple[str, str]
    model_ids: tuple[str, str]
    n_cases: int
    n_subjects: int
    accuracy: Difference
    auc: Difference | None
    log_loss: Difference
    brier: Difference
    only_first: int
    only_second: int
    evaluations: tuple[Evaluation, Evaluation]
    methods: str
    notes: tuple[Note, ...]


def compare_models(
    first: Model,
    second: Model,
    cases: Iterable[AnyCase],
    coverage: float = 0.9,
    progress: Reporter | None = None,
    left_out: list[LeftOut] | None = None,
) -> Comparison:
    """Test two models on the same cases.

    Parameters
    ----------
    first, second : Model
        Of one task: both know the classes of all cases. They may know others, read other modes
        and be of other topologies.
    cases : iterable of TrainingCase or CaseSource
        Of subjects that neither was trained on; sequences, where the two read signatures of
        different parameters. Read one by one.
    coverage : float
        Level of the class sets.
    progress : callable, optional
        Called with the number of cases that are done, and of all as far as known.
    left_out : list of LeftOut, optional
        Cases that cannot be used with both are added to it; else one of them ends the comparison.

    Returns
    -------
    Comparison

    Raises
    ------
    ParameterError
        As in `evaluate`.
    """
    return comparison_of(*_evaluations((first, second), cases, coverage, progress, left_out))


def comparison_of(first: Evaluation, second: Evaluation) -> Comparison:
    """Compare two evaluations, case by case.

    Raises
    ------
    ParameterError
        If they are of different cases, or of different labels of these.
    """
    listed = [[(c.sequence_id, c.truth) for c in each.cases] for each in (first, second)]
    if listed[0] != listed[1]:
        raise ParameterError(
            f"The two models were tested on different cases ({first.n_cases} and "
            f"{second.n_cases}), in another order, or with other labels.",
            remedy="Test both on the same cases.",
        )
    one, other = first.answers, second.answers
    place = np.unique(one.subjects, return_inverse=True)[1]
    right = other.right[0].astype(np.float64) - one.right[0]
    gains = np.bincount(place, right)
    won, lost = int((gains > 0).sum()), int((gains < 0).sum())
    # Of the sign test: both tails of a binomial distribution of one half.
    p = min(1.0, 2.0 * float(scipy.special.bdtr(min(won, lost), won + lost, 0.5)))
    notes, n_subjects = [], len(gains)
    if n_subjects < 10:
        notes.append(Note.of("few_subjects", subjects=counted(n_subjects, "subject")))
    notes += [
        replace(note, text=f"{each.model}: {note.text}")
        for each in (first, second)
        for note in each.notes
    ]

    def difference(figure: str, per_case: Floats) -> Difference:
        apart = per_case / len(per_case)
        a, b = getattr(first, figure), getattr(second, figure)
        return _with_interval(a, b, apart - apart.mean(), place)

    areas = [macro_area(each)[0] for each in (one, other)]
    return Comparison(
        models=(first.model, second.model),
        model_ids=(first.model_id, second.model_id),
        n_cases=first.n_cases,
        n_subjects=n_subjects,
        accuracy=difference("accuracy", right)._replace(p=p),
        auc=None
        if areas[0] is None or areas[1] is None
        else _with_interval(
            areas[0].value, areas[1].value, areas[1].influences - areas[0].influences, place
        ),
        log_loss=difference("log_loss", other.log_losses[0] - one.log_losses[0]),
        brier=difference("brier", other.briers[0] - one.briers[0]),
        only_first=int((right < 0).sum()),
        only_second=int((right > 0).sum()),
        evaluations=(first, second),
        methods=COMPARISON_METHODS,
        notes=tuple(notes),
    )


def _with_interval(first: float, second: float, influences: Floats, place: Ints) -> Difference:
    """Difference of two figures, of what each case adds to it beyond its share."""
    of_subjects = np.bincount(place, influences)
    m = len(of_subjects)
    error = float(np.sqrt((of_subjects**2).sum() * m / (m - 1))) if m > 1 else np.inf
    apart = second - first
    p = 2.0 * float(scipy.special.ndtr(-abs(apart) / error)) if error > 0 else float(apart == 0)
    return Difference(first, second, apart, apart - Z * error, apart + Z * error, p)
