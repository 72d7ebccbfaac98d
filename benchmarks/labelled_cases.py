"""Labelled cases of the bench and of the table of truth: cohorts, windows, few of a pool."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
from labelled_cohorts import COHORTS, recordings
from numpy.typing import NDArray
from real_data import DATA
from third_generator import hearts

from modalmotion.classification import SignatureFeatures, TrainingCase, TrainingOptions
from modalmotion.formats import read_sequence
from modalmotion.simulate import MotionClass, simulate_cohort

# The model is the default one to the byte; its card is not read here.
QUICK: Final = TrainingOptions(repetitions=1)
_FEW: Final = (MotionClass.NORMAL, MotionClass.AKINESIA)
_WINDOW: Final = 12

Folds = list[tuple[NDArray[np.int64], NDArray[np.int64]]]


def synthetic(name: str, seed: int) -> list[TrainingCase]:
    """Simulate a synthetic cohort of that name."""
    return list(recordings(COHORTS[name], seed))


def small(name: str, labels: Sequence[str], n: int, seed: Sequence[int]) -> list[TrainingCase]:
    """Simulate people who each do all of some motions of a cohort."""
    cohort = COHORTS[name]._replace(counts=dict.fromkeys(labels, n), n_people=n)
    return list(recordings(cohort, [*seed, len(name)]))


def tongue() -> list[TrainingCase]:
    """Read the words of the tongue."""
    paths = sorted((DATA / "tongue").glob("*.npz"))
    return [TrainingCase(read_sequence(path).sequence, path.stem.split("_")[1]) for path in paths]


def windows(name: str, start: int = 0) -> list[TrainingCase]:
    """Overlapping windows of both halves of each motion, but for those that several motions share.

    The half stands for the subject.
    """
    cases: list[tuple[str, TrainingCase]] = []
    names: dict[str, set[str]] = {}
    for path in sorted((DATA / name).glob("*.npz")):
        sequence = read_sequence(path).sequence
        half = sequence.n_frames // 2
        for k, (first, last) in enumerate(((0, half), (half, sequence.n_frames))):
            n = min(_WINDOW, last - first)
            at = first + min(start, last - first - n)
            for begin in range(at, last - n + 1, max(1, n // 3)):
                part = replace(sequence, vertices=sequence.vertices[begin : begin + n], times=None)
                cases.append((part.id, TrainingCase(part, path.stem, f"{path.stem} {k}")))
                names.setdefault(part.id, set()).add(path.stem)
    return [case for sequence_id, case in cases if len(names[sequence_id]) == 1]


def folds_of(cases: list[TrainingCase], n: int) -> Folds:
    """Split cases, subjects kept together."""
    from sklearn.model_selection import StratifiedGroupKFold

    y, people = zip(*((c.label, c.subject or str(k)) for k, c in enumerate(cases)), strict=True)
    return list(StratifiedGroupKFold(n, shuffle=True, random_state=0).split(y, y, people))


def halves(cases: list[TrainingCase]) -> Folds:
    """Train on windows of one half of each motion, and test on those of the other."""
    is_first = np.array([str(case.subject).endswith("0") for case in cases])
    return [(np.flatnonzero(is_first == side), np.flatnonzero(is_first != side)) for side in (1, 0)]


def few_cases(n: int, seed: int, *, is_third: bool) -> list[TrainingCase]:
    """Simulate normal and akinetic ventricles of the first or third generator, fitted once."""
    first = simulate_cohort(n, rng=np.random.default_rng(seed), classes=_FEW)
    drawn = hearts(n, seed, _FEW) if is_third else ((c.sequence, str(c.label)) for c in first)
    cases = (TrainingCase(beat, label, f"{seed} {k}") for k, (beat, label) in enumerate(drawn))
    return [case.fitted(QUICK.signature_parameters) for case in cases]


def of_pool(pool: list[TrainingCase], n: int, rng: np.random.Generator) -> list[TrainingCase]:
    """Draw so many cases of each class."""
    labels = np.array([case.label for case in pool])
    places = [np.flatnonzero(labels == name) for name in np.unique(labels)]
    return [pool[i] for of_class in places for i in rng.choice(of_class, n, replace=False)]


def of_one_table(few: list[TrainingCase], tested: list[TrainingCase]) -> tuple[float, float]:
    """Accuracy and AUC of one table of the motion with shrunk discriminants, of two classes."""
    from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
    from sklearn.metrics import roc_auc_score

    features = SignatureFeatures(modes=18)
    shrunk: Any = LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")
    shrunk.fit(features.fit_transform(few), labels := [case.label for case in few])
    shares, truth = shrunk.predict_proba(features.transform(tested)), np.unique(labels)[1]
    is_second = np.array([case.label == truth for case in tested])
    right = (shares.argmax(axis=1) == 1) == is_second
    return float(right.mean()), float(roc_auc_score(is_second, shares[:, 1]))


def area_of_volume(few: list[TrainingCase], tested: list[TrainingCase]) -> float:
    """AUC of logistic regression on ejection fraction and log volume, of two classes."""
    from sklearn.linear_model import LogisticRegression
    from sklearn.metrics import roc_auc_score
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    def two_numbers(cases: list[TrainingCase]) -> list[tuple[float, float]]:
        volumes = [np.asarray(case.signature.volumes) for case in cases]
        return [(1.0 - v.min() / v.max(), np.log(v.max())) for v in volumes]

    two: Any = make_pipeline(StandardScaler(), LogisticRegression(max_iter=1000))
    two.fit(two_numbers(few), [case.label for case in few])
    truth = [case.label == two.classes_[1] for case in tested]
    return float(roc_auc_score(truth, two.predict_proba(two_numbers(tested))[:, 1]))
