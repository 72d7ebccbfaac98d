"""How a model does on labelled cases that it has not seen."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from modalmotion.classification.answer.classifier import classify
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.reliability import calibration_curve, calibration_error
from modalmotion.classification.training.cases import TrainingCase
from modalmotion.classification.training.intervals import accuracy_interval
from modalmotion.errors import ParameterError
from modalmotion.representation import shown


@shown("model", "n_cases", "accuracy", "accuracy_interval", "calibration_error", "coverage")
@dataclass(frozen=True)
class Evaluation:
    """Result of a test on labelled cases; every field is JSON-able.

    Parameters
    ----------
    model, model_id : str
    classes : tuple of str
    n_cases : int
    accuracy : float
        Share of all cases with the right label; an abstention counts as wrong.
    accuracy_interval : (float, float)
        95 % interval, wider where several cases are of one subject.
    balanced_accuracy : float
        Mean over classes of the share that was right.
    confusion : tuple of tuple of int
        Rows are true classes, columns answers; the last column counts abstentions.
    abstained : float
        Share of cases without a label.
    flagged : dict of str to float
        Share of cases with each flag.
    calibration_curve : tuple of (float, float, int)
        Mean probability of the label, share that was right, number of cases, by bins.
    calibration_error : float
        Expected calibration error (ECE) of the cases with a label.
    coverage : float
        Requested level.
    class_coverage : dict of str to float
        Share of each class whose set held it.
    mean_set_size : float
    """

    model: str
    model_id: str
    classes: tuple[str, ...]
    n_cases: int
    accuracy: float
    accuracy_interval: tuple[float, float]
    balanced_accuracy: float
    confusion: tuple[tuple[int, ...], ...]
    abstained: float
    flagged: dict[str, float]
    calibration_curve: tuple[tuple[float, float, int], ...]
    calibration_error: float
    coverage: float
    class_coverage: dict[str, float]
    mean_set_size: float

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return asdict(self)


def evaluate(
    model: Model,
    cases: Iterable[TrainingCase],
    coverage: float = 0.9,
    progress: Callable[[float, str], None] | None = None,
) -> Evaluation:
    """Test a model.

    Parameters
    ----------
    model : Model
    cases : iterable of TrainingCase
        With classes of the model, of subjects that it was not trained on. Read one by one.
    coverage : float
        Level of the class sets.
    progress : callable, optional
        Called with the number of cases that are done, as a float, and a text.

    Returns
    -------
    Evaluation

    Raises
    ------
    ParameterError
        If there is no case, or one has a class that the model does not know.
    """
    place = {label: k for k, label in enumerate(model.classes)}
    truth, answers, confidence, covered, sizes, subjects = [], [], [], [], [], []
    flags: dict[str, int] = {}
    for number, case in enumerate(cases):
        if case.label not in place:
            raise ParameterError(
                f"The case {number} has the class {str(case.label)[:80]!r}, which the model "
                f"{model.name!r} does not know.",
                remedy=f"Give cases of its classes: {', '.join(model.classes)}.",
                details={"case": number},
            )
        answer = classify(case.motion, model, coverage)
        truth.append(place[case.label])
        answers.append(-1 if answer.label is None else place[answer.label])
        confidence.append(answer.probability)
        covered.append(case.label in answer.class_set)
        sizes.append(len(answer.class_set))
        subjects.append(case.subject or f"sequence {case.sequence_id}")
        for flag in answer.flags:
            flags[flag] = flags.get(flag, 0) + 1
        if progress is not None:
            progress(float(number + 1), "classified")
    if not truth:
        raise ParameterError("There is no case to test on.", remedy="Give at least one.")
    y, labels, covers = np.array(truth), np.array(answers), np.array(covered)
    n = len(model.classes)
    confusion = np.zeros((n, n + 1), dtype=np.int64)
    np.add.at(confusion, (y, labels), 1)
    right, labelled = labels == y, labels >= 0
    curve = calibration_curve(np.array(confidence)[labelled], right[labelled])
    present = [k for k in range(n) if (y == k).any()]
    return Evaluation(
        model=model.name,
        model_id=model.id,
        classes=model.classes,
        n_cases=len(y),
        accuracy=float(right.mean()),
        accuracy_interval=accuracy_interval(right, subjects),
        balanced_accuracy=float(np.mean([right[y == k].mean() for k in present])),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
        abstained=float(1.0 - labelled.mean()),
        flagged={flag: count / len(y) for flag, count in sorted(flags.items())},
        calibration_curve=curve,
        calibration_error=calibration_error(curve),
        coverage=coverage,
        class_coverage={model.classes[k]: float(covers[y == k].mean()) for k in present},
        mean_set_size=float(np.mean(sizes)),
    )
