"""Motion classes: accuracy and cost beside the best time-series classifiers, on the same folds."""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from labelled_cohorts import COHORTS, recordings
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray
from real_data import files_of, is_there

from modalmotion.classification import (
    TrainingCase,
    TrainingOptions,
    classify,
    evaluate,
    load_model,
    train,
)
from modalmotion.classification.estimators.estimator import MotionClassifier
from modalmotion.classification.features import KnownFeatures, axis_features
from modalmotion.classification.measures.reliability import calibration_curve, calibration_error
from modalmotion.classification.model.model import Model
from modalmotion.classification.model.shipped import DEFAULT_MODEL, OFFSET_MODEL
from modalmotion.classification.training.collection import collect
from modalmotion.classification.training.domain_fit import fit_domain
from modalmotion.classification.training.fold_fit import fit_rows
from modalmotion.formats import read_sequence
from modalmotion.mesh import Cavity, lattice_faces
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes.topology import CUP
from modalmotion.signature.distance import resample_to_phase
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.simulate import simulate_cohort, simulate_ventricle

SEED: Final = 1994
N_PER_CLASS: Final = 100
N_PHASES: Final = 32
MODE_COUNTS: Final = (7, 18, 37)

Array = NDArray[np.float64]


class _Recorded(NamedTuple):
    label: str
    signatures: dict[int, ModalSignature]
    volumes: Array


def run(folder: Path, n_per_class: int = N_PER_CLASS) -> list[Table]:
    """Measure everything; plots go to the folder."""
    cohort = _cohort(n_per_class)
    y = np.array([case.label for case in cohort])
    folds = _folds(y)
    peers, mini = _peers(cohort, y, folds)
    tables = [peers, _costs(cohort, folds, mini), _trade(cohort, y, folds, folder)]
    if is_there("classification: real recordings", "tongue", "robot", "fox"):
        tables.append(_real())
    return tables


def _cohort(n_per_class: int) -> list[_Recorded]:
    found = []
    rng = np.random.default_rng(SEED)
    for case in simulate_cohort(n_per_class, rng=rng, noise=0.6):
        signatures = {
            modes: modal_signature(case.sequence, TrainingOptions(modes=modes).signature_parameters)
            for modes in MODE_COUNTS
        }
        found.append(_Recorded(str(case.label), signatures, _volumes(case.sequence)))
    return found


def _volumes(sequence: MeshSequence) -> Array:
    """Cavity volume in each frame, a flat fan closing the base."""
    faces = sequence.faces
    if not len(faces) and sequence.grid is not None:
        faces = lattice_faces(CUP, sequence.grid)
    return Cavity(faces).volume(sequence.vertices.astype(np.float64))


def _folds(y: NDArray[Any]) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    from sklearn.model_selection import StratifiedKFold

    return list(StratifiedKFold(5, shuffle=True, random_state=0).split(y, y))


def _trajectories(signature: ModalSignature) -> Array:
    """All amplitudes in the body frame at common phases, in percent of the size."""
    a = signature.body_amplitudes
    a = 100.0 * (a - a.mean(axis=0)) / np.sqrt(np.prod(signature.lengths))
    path = resample_to_phase(a, N_PHASES, times=signature.times)
    return np.asarray(path.reshape(N_PHASES, -1).T)


def _features(signature: ModalSignature) -> Array:
    return np.asarray(axis_features(signature).values[0])


def _ends(signature: ModalSignature) -> Array:
    """End diastole and end systole only: the pose-free sizes of what lies between the two."""
    a = 100.0 * signature.amplitudes / np.sqrt(np.prod(signature.lengths))
    apart = np.linalg.norm(a - a[0], axis=(1, 2))
    two = replace(signature, amplitudes=signature.amplitudes[[0, int(apart.argmax())]], times=None)
    return np.asarray(axis_features(two, 1, 1).values[0])


def _cross_validated(
    make: Callable[[], Any], X: Array, y: NDArray[Any], folds: Sequence[Any]
) -> tuple[Array, float]:
    """Whether each case was named right when it was left out, and seconds to train a fold."""
    right, seconds = np.zeros(len(y)), 0.0
    for inner, outer in folds:
        model = make()
        start = time.perf_counter()
        model.fit(X[inner], y[inner])
        seconds += time.perf_counter() - start
        right[outer] = model.predict(X[outer]) == y[outer]
    return right, seconds / len(folds)


def _peers(
    cohort: list[_Recorded], y: NDArray[Any], folds: Sequence[Any]
) -> tuple[Table, tuple[Any, float]]:
    from aeon.classification.convolution_based import MiniRocketClassifier, MultiRocketClassifier
    from aeon.classification.shapelet_based import RDSTClassifier

    table = Table(
        f"{len(y)} simulated ventricles, 0.6 mm noise, mild to severe, 5 folds, 21 amplitudes",
        ("classifier", "accuracy", "training a fold"),
    )
    raw = np.stack([_trajectories(case.signatures[7]) for case in cohort])
    fraction = np.array([[1.0 - case.volumes.min() / case.volumes[0]] for case in cohort])
    ends = np.stack([_ends(case.signatures[7]) for case in cohort])
    found: dict[str, float] = {}
    mini: tuple[Any, float] = (None, 0.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        # The first call compiles.
        MiniRocketClassifier(n_kernels=84, random_state=0).fit(raw[:40], y[:40])
        for name, make in (
            ("MiniRocket", partial(MiniRocketClassifier, random_state=0)),
            ("MultiRocket", partial(MultiRocketClassifier, random_state=0)),
            ("RDST", partial(RDSTClassifier, random_state=0)),
        ):
            right, seconds = _cross_validated(make, raw, y, folds)
            found[name] = float(right.mean())
            if name == "MiniRocket":
                mini = make().fit(raw[folds[0][0]], y[folds[0][0]]), seconds
            table.add(name, f"{right.mean():.1%}", in_words(seconds))
    for name, X in (("ejection fraction only", fraction), ("two frames only", ends)):
        right, seconds = _cross_validated(MotionClassifier, X, y, folds)
        table.add(name, f"{right.mean():.1%}", in_words(seconds))
    X = np.stack([_features(case.signatures[7]) for case in cohort])
    for kind in ("linear", "kernel", "svm", "forest", "auto"):
        right, seconds = _cross_validated(partial(MotionClassifier, kind), X, y, folds)
        cells = (f"ours, {kind}", f"{right.mean():.1%}", in_words(seconds))
        table.add(*cells)
    right, seconds = _as_trained(cohort, folds)
    cells = ("ours, as trained", f"{right.mean():.1%}", in_words(seconds))
    table.add_at_least(100 * right.mean(), 100 * max(found.values()) - 0.5, *cells)
    table.add_at_most(seconds, mini[1], "  training against MiniRocket", "", cells[2])
    return table, mini


def _as_trained(cohort: list[_Recorded], folds: Sequence[Any]) -> tuple[Array, float]:
    """Give the same of what `train` fits in a fold, the choice of features included."""
    options = TrainingOptions()
    cases = [TrainingCase(case.signatures[7], case.label) for case in cohort]
    table = collect(cases, options)
    right, seconds = np.zeros(len(cases)), 0.0
    for inner, outer in folds:
        start = time.perf_counter()
        fitted = fit_rows(table, inner, options)
        seconds += time.perf_counter() - start
        readings = fit_domain(table, inner).judge(outer).readings
        shares = fitted.probabilities(outer, readings, len(table.classes))
        right[outer] = shares.argmax(axis=1) == table.y[outer]
    return right, seconds / len(folds)


def _costs(cohort: list[_Recorded], folds: Sequence[Any], mini: tuple[Any, float]) -> Table:
    """Time of one answer from a signature, of models of several kinds, beside MiniRocket's."""
    table = Table("One sequence, warm", ("call", "time", "MiniRocket over it"))
    cases = [TrainingCase(cohort[i].signatures[7], cohort[i].label) for i in folds[0][0]]
    signature = cohort[int(folds[0][1][0])].signatures[7]
    models = {"model of this table": (train(cases, "bench", TrainingOptions(folds=2)), signature)}
    models |= {name: _shipped(name) for name in (DEFAULT_MODEL, OFFSET_MODEL)}
    models["model with pieces of motions"] = _of_gestures()
    calls: dict[str, Callable[[], object]] = {
        "MiniRocket": lambda: mini[0].predict(_trajectories(signature)[None])
    }
    for name, (model, own) in models.items():
        calls[name] = partial(_answer, model, own)
        calls[f"  {name}, with class set, flags and explanation"] = partial(classify, own, model)
    # Of this process alone: others that run beside it take none of its time. Warm: a score of calls
    # one after another.
    times = side_by_side(calls, n_samples=30, clock=time.process_time, sample_seconds=0.02)
    base = times["MiniRocket"].median
    for name, found in times.items():
        cells = (name, in_words(found.median), f"{base / found.median:.1f}")
        if name in models and name != "model with pieces of motions":
            table.add_at_least(base / found.median, 5.0, *cells)
        else:
            table.add(*cells)
    return table


def _answer(model: Model, signature: ModalSignature) -> Array:
    """Features of a signature, in the reading that is nearest to a class, and probabilities."""
    known = KnownFeatures()
    seen = model.domain.reader.read(signature, known)
    found = model.read(signature, known)
    nearest = int(model.distance(seen.kinds).argmin()) if len(found.values) > 1 else 0
    return model.probabilities(found.values[[nearest]])


def _shipped(name: str) -> tuple[Model, ModalSignature]:
    model = load_model(name)
    beat = simulate_ventricle(rng=np.random.default_rng(SEED))
    return model, modal_signature(beat, model.signature_parameters)


def _of_gestures() -> tuple[Model, ModalSignature]:
    """Train on gestures of which the order decides, and take another of them."""
    cases = [TrainingCase(c.sequence, c.label, c.person) for c in recordings(COHORTS["words"], 1)]
    model = train(cases, "words", TrainingOptions(repetitions=1, card="quick"))
    another = next(iter(recordings(COHORTS["words"], 2))).sequence
    return model, modal_signature(another, model.signature_parameters)


def _trade(cohort: list[_Recorded], y: NDArray[Any], folds: Sequence[Any], folder: Path) -> Table:
    """Accuracy of the default pipeline against amplitudes, harmonics and training cases."""
    table = Table("The trade", ("what", "features", "accuracy", "calibration error"))
    lines: dict[str, list[tuple[float, float]]] = {"amplitudes": [], "harmonics": [], "cases": []}

    def measured(what: str, x: float, X: Array, splits: Sequence[Any]) -> None:
        share, error = _honest(X, y, splits)
        lines[what].append((x, share))
        table.add(f"{x:g} {what}", str(X.shape[1]), f"{share:.1%}", f"{error:.3f}")

    for modes in MODE_COUNTS:
        X = np.stack([_features(case.signatures[modes]) for case in cohort])
        measured("amplitudes", 3 * modes, X, folds)
    for n in (1, 2, 3, 4):
        rows = [axis_features(c.signatures[7], n, max(1, n - 1)).values[0] for c in cohort]
        measured("harmonics", n, np.stack(rows), folds)
    X = np.stack([_features(case.signatures[7]) for case in cohort])
    for n in (5, 10, 20, 40, 80):
        fewer = [(inner[: 5 * n], outer) for inner, outer in folds if 5 * n <= len(inner)]
        if fewer:
            measured("cases", n, X, fewer)
    _plot(lines, folder / "classification_trade.png")
    return table


def _honest(X: Array, y: NDArray[Any], folds: Sequence[Any]) -> tuple[float, float]:
    confidence, right = [], []
    for inner, outer in folds:
        model = MotionClassifier().fit(X[inner], y[inner])
        shares = model.predict_proba(X[outer])
        confidence.append(shares.max(axis=1))
        right.append(model.classes_[shares.argmax(axis=1)] == y[outer])
    hits = np.concatenate(right)
    curve = calibration_curve(np.concatenate(confidence), hits)
    return float(hits.mean()), calibration_error(curve)


def _plot(lines: dict[str, list[tuple[float, float]]], path: Path) -> None:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    labels = ("amplitudes a frame", "harmonics of a beat", "training cases a class")
    for axis, (what, points), label in zip(axes, lines.items(), labels, strict=True):
        x, share = zip(*points, strict=True)
        axis.plot(x, [100 * s for s in share], "o-", color="#20639b", linewidth=1.5, markersize=4)
        if what == "cases":
            axis.set_xscale("log")
        axis.set_xticks(x, [f"{v:g}" for v in x])
        axis.minorticks_off()
        axis.set_xlabel(label)
        axis.grid(alpha=0.3)
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("accuracy, %")
    figure.savefig(path, dpi=110)


def _real() -> Table:
    table = Table(
        "Real and animated recordings", ("what", "cases", "accuracy", "majority", "chance")
    )
    words, asked = [], TrainingOptions().signature_parameters
    for path in files_of("tongue"):
        sequence = read_sequence(path).sequence
        words.append(TrainingCase(modal_signature(sequence, asked), path.stem.split("_")[1]))
    right = []
    for left_out in words:
        others = [case for case in words if case is not left_out]
        model = train(others, "tongue", TrainingOptions(folds=3))
        right.append(classify(left_out.signature, model).label == left_out.label)
    # The majority of the others is never the word that is left out.
    table.add("tongue, one left out", str(len(right)), f"{np.mean(right):.0%}", "0%", "50%")
    for name in ("robot", "fox"):
        known, new = _windows(name)
        model = train(known, name, TrainingOptions(folds=2))
        found = evaluate(model, new)
        counts = np.sum(found.confusion, axis=1)
        table.add(
            f"{name}, windows of the second half",
            str(found.n_cases),
            f"{found.accuracy:.0%}",
            f"{counts.max() / counts.sum():.0%}",
            f"{1 / len(found.classes):.0%}",
        )
    return table


def _windows(name: str, length: int = 12) -> tuple[list[TrainingCase], list[TrainingCase]]:
    """Windows of the first and of the second half of each named motion.

    A figure at rest is at rest in several motions; such windows are left out.
    """
    asked = TrainingOptions().signature_parameters
    halves: tuple[list[TrainingCase], list[TrainingCase]] = ([], [])
    names: dict[str, set[str]] = {}
    for path in files_of(name):
        sequence = read_sequence(path).sequence
        half = sequence.n_frames // 2
        for cases, first, last in zip(halves, (0, half), (half, sequence.n_frames), strict=True):
            n = min(length, last - first)
            for start in range(first, last - n + 1, max(1, n // 3)):
                part = replace(sequence, vertices=sequence.vertices[start : start + n], times=None)
                cases.append(TrainingCase(modal_signature(part, asked), path.stem))
                names.setdefault(part.id, set()).add(path.stem)
    known, new = (
        [case for case in cases if len(names[case.signature.sequence_id]) == 1] for cases in halves
    )
    return known, new
