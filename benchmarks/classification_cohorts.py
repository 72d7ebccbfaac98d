"""Small labelled cohorts: the default road beside the best time-series classifiers."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from classification import N_PHASES
from labelled_cohorts import COHORTS, recordings
from measure import Table, in_words
from numpy.typing import NDArray
from real_data import files_of, is_there
from scipy.stats import binomtest

from modalmotion.classification import TrainingCase, TrainingOptions, classify, train
from modalmotion.classification.estimators.estimator import MotionClassifier
from modalmotion.classification.features import surface_size
from modalmotion.classification.measures.intervals import share_interval
from modalmotion.formats import read_sequence
from modalmotion.signature.distance import resample_to_phase
from modalmotion.signature.making import ModalSignature, SignatureParameters

# Features were chosen on cohorts of the seeds 1 to 3.
SEEDS: Final = (4,)

WINDOW: Final = 12

# The model is the default one to the byte; its card is not read here.
QUICK: Final = TrainingOptions(repetitions=1, card="quick")

# Gaps beyond which a recording is resampled as a movement and not as a cycle: peers get the
# trajectories as they are read here.
_CLOSED: Final = 2.5

Array = NDArray[np.float64]
Folds = list[tuple[NDArray[np.int64], NDArray[np.int64]]]


class _Run(NamedTuple):
    """One classifier on one cohort: what was right, and seconds."""

    right: NDArray[np.bool_]
    training: float
    answer: float


def run(folder: Path, seeds: Sequence[int] = SEEDS) -> list[Table]:
    """Measure everything."""
    del folder
    found: dict[str, list[tuple[list[TrainingCase], dict[str, _Run]]]] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for name in COHORTS:
            for seed in seeds:
                cases = synthetic(name, seed)
                found.setdefault(name, []).append((cases, _compared(cases, _folds(cases))))
        if is_there("classification_cohorts: real recordings", "tongue", "robot", "fox"):
            cases = _tongue()
            found["tongue"] = [(cases, _compared(cases, _one_out(cases)))]
            for name in ("robot", "fox"):
                cases = _windows(name)
                found[f"{name} windows"] = [(cases, _compared(cases, _halves(cases)))]
    return [_accuracies(found, seeds), _costs(found)]


def synthetic(name: str, seed: int) -> list[TrainingCase]:
    """Simulate a synthetic cohort of that name."""
    return [
        TrainingCase(case.sequence, case.label, case.person)
        for case in recordings(COHORTS[name], seed)
    ]


def _tongue() -> list[TrainingCase]:
    paths = files_of("tongue")
    return [TrainingCase(read_sequence(path).sequence, path.stem.split("_")[1]) for path in paths]


def _windows(name: str) -> list[TrainingCase]:
    """Overlapping windows of both halves of each named motion, none across the middle.

    The half stands for the subject. A figure at rest is at rest in several motions; such windows
    are left out.
    """
    cases: list[tuple[str, TrainingCase]] = []
    names: dict[str, set[str]] = {}
    for path in files_of(name):
        sequence = read_sequence(path).sequence
        half = sequence.n_frames // 2
        for k, (first, last) in enumerate(((0, half), (half, sequence.n_frames))):
            n = min(WINDOW, last - first)
            for start in range(first, last - n + 1, max(1, n // 3)):
                part = replace(sequence, vertices=sequence.vertices[start : start + n], times=None)
                cases.append((part.id, TrainingCase(part, path.stem, f"{path.stem} {k}")))
                names.setdefault(part.id, set()).add(path.stem)
    return [case for sequence_id, case in cases if len(names[sequence_id]) == 1]


def _folds(cases: list[TrainingCase]) -> Folds:
    from sklearn.model_selection import StratifiedGroupKFold

    y, people = _labels(cases), [case.subject for case in cases]
    return list(StratifiedGroupKFold(5, shuffle=True, random_state=0).split(y, y, people))


def _one_out(cases: list[TrainingCase]) -> Folds:
    every = np.arange(len(cases))
    return [(np.delete(every, k), every[k : k + 1]) for k in every]


def _halves(cases: list[TrainingCase]) -> Folds:
    is_first = np.array([str(case.subject).endswith("0") for case in cases])
    return [(np.flatnonzero(is_first == side), np.flatnonzero(is_first != side)) for side in (1, 0)]


def _labels(cases: list[TrainingCase]) -> NDArray[Any]:
    return np.array([case.label for case in cases])


def _compared(cases: list[TrainingCase], folds: Folds) -> dict[str, _Run]:
    from aeon.classification.convolution_based import MiniRocketClassifier, MultiRocketClassifier
    from aeon.classification.shapelet_based import RDSTClassifier

    y = _labels(cases)
    signatures = _signatures(cases)
    is_cycle = float(np.median([signature.closure_gap for signature in signatures])) < _CLOSED
    paths = np.stack([_trajectories(signature, closed=is_cycle) for signature in signatures])
    sizes = np.stack([_spectrum(signature) for signature in signatures])
    found = {"ours": _ours(cases, folds)}
    for name, kind in (
        ("MiniRocket", MiniRocketClassifier),
        ("MultiRocket", MultiRocketClassifier),
        ("RDST", RDSTClassifier),
    ):
        # The first call compiles.
        kind(random_state=0).fit(paths, y)
        found[name] = _cross_validated(partial(kind, random_state=0), paths, y, folds)
    linear = partial(MotionClassifier, "linear")
    found["spectrum only"] = _cross_validated(linear, sizes, y, folds)
    found["majority"] = _Run(_majority(y, folds), 0.0, 0.0)
    return found


def _signatures(cases: list[TrainingCase]) -> list[ModalSignature]:
    """Seven modes of each, in closed form if all surfaces have the same."""
    of_each = [case.fitted(SignatureParameters()).signature for case in cases]
    if len({signature.surface for signature in of_each}) == 1:
        return of_each
    springs = SignatureParameters(closed_form=False)
    return [case.fitted(springs).signature for case in cases]


def _trajectories(signature: ModalSignature, *, closed: bool) -> Array:
    """All amplitudes in the body frame at common phases, in percent of the size."""
    a = signature.body_amplitudes
    a = 100.0 * (a - a.mean(axis=0)) / surface_size(signature)
    path = resample_to_phase(a, N_PHASES, times=signature.times, closed=closed)
    return np.asarray(path.reshape(N_PHASES, -1).T)


def _spectrum(signature: ModalSignature) -> Array:
    """RMS over time of each mode, as a share of the size."""
    a = signature.amplitudes - signature.amplitudes.mean(axis=0)
    return np.asarray(np.sqrt((a**2).sum(axis=2).mean(axis=0)) / surface_size(signature))


def _ours(cases: list[TrainingCase], folds: Folds) -> _Run:
    """`train` and `classify` with no option set; an answer without a label is wrong."""
    right = np.zeros(len(cases), dtype=np.bool_)
    training = answer = 0.0
    for inner, outer in folds:
        start = time.perf_counter()
        model = train([cases[i] for i in inner], "bench", QUICK)
        training += time.perf_counter() - start
        start = time.perf_counter()
        for i in outer:
            right[i] = classify(cases[i].motion, model).label == cases[i].label
        answer += time.perf_counter() - start
    return _Run(right, training / len(folds), answer / len(cases))


def _cross_validated(make: Callable[[], Any], X: Array, y: NDArray[Any], folds: Folds) -> _Run:
    right = np.zeros(len(y), dtype=np.bool_)
    training = answer = 0.0
    for inner, outer in folds:
        start = time.perf_counter()
        model = make().fit(X[inner], y[inner])
        training += time.perf_counter() - start
        start = time.perf_counter()
        right[outer] = model.predict(X[outer]) == y[outer]
        answer += time.perf_counter() - start
    return _Run(right, training / len(folds), answer / len(y))


def _majority(y: NDArray[Any], folds: Folds) -> NDArray[np.bool_]:
    right = np.zeros(len(y), dtype=np.bool_)
    for inner, outer in folds:
        names, counts = np.unique(y[inner], return_counts=True)
        right[outer] = y[outer] == names[counts.argmax()]
    return right


_PEERS: Final = ("MiniRocket", "MultiRocket", "RDST")
_OTHERS: Final = (*_PEERS, "spectrum only", "majority")


def _accuracies(
    found: dict[str, list[tuple[list[TrainingCase], dict[str, _Run]]]], seeds: Sequence[int]
) -> Table:
    table = Table(
        f"Labelled cohorts, subjects kept together, no option set (synthetic: seeds "
        f"{', '.join(map(str, seeds))})",
        ("cohort", "cases", "ours", "95 % interval", *_OTHERS, "p against the best"),
    )
    means = []
    for name, runs in found.items():
        right = {
            kind: np.concatenate([results[kind].right for _, results in runs])
            for kind in ("ours", *_OTHERS)
        }
        people = [
            f"{k} {case.subject or number}"
            for k, (cases, _) in enumerate(runs)
            for number, case in enumerate(cases)
        ]
        share = {kind: float(hits.mean()) for kind, hits in right.items()}
        best = max(_PEERS, key=lambda kind: share[kind])
        low, high = share_interval(right["ours"], people)
        means.append([share["ours"], *(share[kind] for kind in _OTHERS)])
        # McNemar's exact test over the cases of which one is right and the other wrong.
        won = int((right["ours"] & ~right[best]).sum())
        lost = int((~right["ours"] & right[best]).sum())
        p = binomtest(won, won + lost).pvalue if won + lost else 1.0
        cells = [
            name,
            str(len(people)),
            f"{share['ours']:.1%}",
            f"{low:.0%} to {high:.0%}",
            *(f"{share[kind]:.1%}" for kind in _OTHERS),
            f"{p:.2g}",
        ]
        # Never dramatically worse: behind by more than chance explains.
        is_behind = share["ours"] < share[best] and p < 0.05
        table.add_at_most(float(is_behind), 0.0, *cells)
    ours, *others = np.mean(means, axis=0)
    best_mean = max(others[: len(_PEERS)])
    cells = ["mean", "", f"{ours:.1%}", "", *(f"{share:.1%}" for share in others), ""]
    table.add_at_least(100 * ours, 100 * best_mean - 0.5, *cells)
    return table


def _costs(found: dict[str, list[tuple[list[TrainingCase], dict[str, _Run]]]]) -> Table:
    table = Table(
        "Their cost: training (ours from the recordings, with its fits, calibration and 5 folds; "
        "others from signatures) and one answer (ours from the recording, with set, flags and "
        "explanation)",
        (
            "cohort",
            *(f"{kind} {what}" for kind in ("ours", *_PEERS) for what in ("trains", "says")),
        ),
    )
    for name, runs in found.items():
        cells = []
        for kind in ("ours", *_PEERS):
            results = [result[kind] for _, result in runs]
            cells.append(in_words(float(np.mean([r.training for r in results]))))
            cells.append(in_words(float(np.mean([r.answer for r in results]))))
        table.add(name, *cells)
    return table
