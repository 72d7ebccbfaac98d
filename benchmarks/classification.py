"""Labelled cohorts: the default road beside the best time-series classifiers, on the same folds."""

from __future__ import annotations

import time
import warnings
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from judged_classes import held_out
from labelled_cases import Folds, folds_of, halves, synthetic, tongue, windows
from labelled_cohorts import COHORTS
from measure import Table, in_words
from numpy.typing import NDArray
from real_data import is_there
from scipy.stats import binomtest

from modalmotion.classification import TrainingCase
from modalmotion.classification.features import surface_size
from modalmotion.signature.distance import resample_to_phase
from modalmotion.signature.making import SignatureParameters

# What is weighed was chosen on cohorts of the seeds 1 to 3.
SEED: Final = 4
N_PHASES: Final = 32

# Gaps beyond which a recording is resampled as a movement and not as a cycle.
_CLOSED: Final = 2.5


class _Run(NamedTuple):
    """One classifier on one cohort: what was right, in the order of the folds, and seconds."""

    right: NDArray[np.bool_]
    seconds: float


def run(folder: Path) -> list[Table]:
    """Measure everything."""
    del folder
    sets = {name: (made, folds_of(made, 5)) for name in COHORTS for made in [synthetic(name, SEED)]}
    if is_there("classification: real recordings", "tongue", "robot", "fox"):
        cases = tongue()
        sets["tongue"] = cases, folds_of(cases, len(cases) // 2)
        sets |= {
            name: (cases, halves(cases)) for name in ("robot", "fox") for cases in [windows(name)]
        }
    table = Table(
        f"Labelled cohorts, subjects kept together, no option set (seed {SEED}); time of all folds",
        ("cohort", "cases", "ours", "best peer", "right", "p", "ours takes", "it takes"),
    )
    for name, (cases, folds) in sets.items():
        _add(table, name, cases, folds)
    return [table]


def _add(table: Table, name: str, cases: list[TrainingCase], folds: Folds) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.perf_counter()
        answers = held_out(cases, folds, 0).cases
        ours = _Run(np.array([a.answer == a.truth for a in answers]), time.perf_counter() - start)
        runs = _peers(cases, folds)
    best = max(runs, key=lambda peer: float(runs[peer].right.mean()))
    peer = runs[best]
    # McNemar's exact test over the cases of which one is right and the other wrong.
    won, lost = int((ours.right & ~peer.right).sum()), int((~ours.right & peer.right).sum())
    p = binomtest(won, won + lost).pvalue if won + lost else 1.0
    cells = [name, str(len(cases)), f"{ours.right.mean():.1%}", best, f"{peer.right.mean():.1%}"]
    cells += [f"{p:.2g}", in_words(ours.seconds), in_words(peer.seconds)]
    # Never dramatically worse: behind by more than chance explains.
    table.add_at_most(float(lost > won and p < 0.05), 0.0, *cells)


def _peers(cases: list[TrainingCase], folds: Folds) -> dict[str, _Run]:
    from aeon.classification.convolution_based import MiniRocketClassifier, MultiRocketClassifier
    from aeon.classification.shapelet_based import RDSTClassifier

    y, paths, found = np.array([case.label for case in cases]), _trajectories(cases), {}
    for kind in (MiniRocketClassifier, MultiRocketClassifier, RDSTClassifier):
        # The first call compiles.
        kind(random_state=0).fit(paths, y)
        start, right = time.perf_counter(), []
        for inner, outer in folds:
            model = kind(random_state=0).fit(paths[inner], y[inner])
            right.append(model.predict(paths[outer]) == y[outer])
        found[kind.__name__] = _Run(np.concatenate(right), time.perf_counter() - start)
    return found


def _trajectories(cases: list[TrainingCase]) -> NDArray[np.float64]:
    """Amplitudes of seven modes in the body frame at common phases, in percent of the size."""
    signatures = [case.fitted(SignatureParameters()).signature for case in cases]
    if len({signature.surface for signature in signatures}) > 1:
        springs = SignatureParameters(closed_form=False)
        signatures = [case.fitted(springs).signature for case in cases]
    closed = float(np.median([signature.closure_gap for signature in signatures])) < _CLOSED
    found = []
    for signature in signatures:
        a = signature.body_amplitudes
        a = 100.0 * (a - a.mean(axis=0)) / surface_size(signature)
        path = resample_to_phase(a, N_PHASES, times=signature.times, closed=closed)
        found.append(path.reshape(N_PHASES, -1).T)
    return np.stack(found)
