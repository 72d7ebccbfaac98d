"""Labelled cohorts: our defaults beside the best time-series classifiers, on the same folds."""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator
from importlib import import_module
from typing import Final

import numpy as np
from judged_classes import held_out
from labelled_cases import Folds, folds_of, halves, synthetic, tongue, windows
from labelled_cohorts import COHORTS
from measure import in_words, table
from numpy.typing import NDArray
from real_data import is_there
from scipy.stats import binomtest

from modalmotion.classification import TrainingCase
from modalmotion.classification.motion import Motion
from modalmotion.signature.distance import resample_to_phase
from modalmotion.signature.making import SignatureParameters

SEED: Final = 4  # what is weighed was chosen on cohorts of the seeds 1 to 3
PEERS: Final = {
    "MiniRocketClassifier": "convolution_based",
    "MultiRocketClassifier": "convolution_based",
    "RDSTClassifier": "shapelet_based",
}
_CLOSED: Final = 2.5  # gap beyond which a recording is resampled as a movement, no cycle


def run() -> Iterator[str]:
    """Measure everything."""
    sets = {name: (made, folds_of(made, 5)) for name in COHORTS for made in [synthetic(name, SEED)]}
    if is_there("classification: real recordings", "tongue", "robot", "fox"):
        sets["tongue"] = (words := tongue()), folds_of(words, len(words) // 2)
        for name in ("robot", "fox"):
            sets[name] = (cases := windows(name)), halves(cases)
    heads = ["cohort", "cases", "ours", "best peer", "right", "p", "ours takes", "it takes"]
    title = f"Labelled cohorts, subjects kept together, no option set (seed {SEED})"
    yield table(title, heads, [(name, *_beside(*made)) for name, made in sets.items()])


def _beside(cases: list[TrainingCase], folds: Folds) -> tuple[str, ...]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        start = time.perf_counter()
        ours = np.array([each.answer == each.truth for each in held_out(cases, folds, 0).cases])
        seconds = time.perf_counter() - start
        peers = {name: _peer(name, cases, folds) for name in PEERS}
    best = max(peers, key=lambda name: float(peers[name][0].mean()))
    right, theirs = peers[best]
    # McNemar's exact test over the cases of which one is right and the other wrong.
    won, lost = int((ours & ~right).sum()), int((~ours & right).sum())
    p = binomtest(won, won + lost).pvalue if won + lost else 1.0
    shares = (f"{ours.mean():.1%}", best, f"{right.mean():.1%}", f"{p:.2g}")
    return (str(len(cases)), *shares, in_words(seconds), in_words(theirs))


def _peer(name: str, cases: list[TrainingCase], folds: Folds) -> tuple[NDArray[np.bool_], float]:
    """Return what a classifier of aeon has right, in the order of the folds, and its seconds."""
    kind = getattr(import_module(f"aeon.classification.{PEERS[name]}"), name)
    y, paths = np.array([case.label for case in cases]), _trajectories(cases)
    kind(random_state=0).fit(paths, y)  # the first call compiles
    start, right = time.perf_counter(), []
    for inner, outer in folds:
        model = kind(random_state=0).fit(paths[inner], y[inner])
        right.append(model.predict(paths[outer]) == y[outer])
    return np.concatenate(right), time.perf_counter() - start


def _trajectories(cases: list[TrainingCase]) -> NDArray[np.float64]:
    """Amplitudes of seven modes in the body frame at 32 phases, in percent of the size."""
    signatures = [case.fitted(SignatureParameters()).signature for case in cases]
    if len({signature.surface for signature in signatures}) > 1:
        springs = SignatureParameters(topology="mesh")
        signatures = [case.fitted(springs).signature for case in cases]
    closed = float(np.median([signature.closure_gap for signature in signatures])) < _CLOSED
    found = []
    for signature in signatures:
        a = signature.body_amplitudes
        a = 100.0 * (a - a.mean(axis=0)) / Motion(signature).size
        path = resample_to_phase(a, 32, times=signature.times, closed=closed)
        found.append(path.reshape(32, -1).T)
    return np.stack(found)
