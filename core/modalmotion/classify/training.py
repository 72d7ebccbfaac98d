"""Training of a model. scikit-learn is imported here, and only when a model is trained."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sized
from dataclasses import dataclass, replace
from importlib.metadata import version
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classify.card import ModelCard
from modalmotion.classify.cases import CaseFile, TrainingCase
from modalmotion.classify.conformal import Calibration, calibrate
from modalmotion.classify.domain import Domain, domain_limit, domain_shape, motion_limits
from modalmotion.classify.intervals import accuracy_interval
from modalmotion.classify.machine import machine_to_bytes
from modalmotion.classify.model import Model
from modalmotion.classify.options import ClassWeights, TrainingOptions
from modalmotion.classify.reliability import calibration_curve, calibration_error
from modalmotion.classify.scorer import Blend, Scorer
from modalmotion.classify.table import CaseTable, best_readings, class_counts, collect
from modalmotion.features import FeatureReader
from modalmotion.signature import INTENDED_USE

# Digits that are kept: more would differ between numbers of threads.
_DIGITS: Final = 9

_N_GOLDEN: Final = 10

# Fewer calibration cases than this make sets of the usual 90 % hold a class always.
_FEW: Final = 9

WALLS_NOTE: Final = (
    "Walls are not told apart: the zero of theta is not known, so only features that do not "
    "depend on it are used, and the class does not say where."
)


def train(
    cases: Iterable[TrainingCase | CaseFile],
    name: str,
    options: TrainingOptions | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Model:
    """Train a model on labelled signatures.

    Parameters
    ----------
    cases : iterable of TrainingCase or CaseFile
        Read a few at a time; nothing but their features is kept.
    name : str
    options : TrainingOptions, optional
    progress : callable, optional
        Called with the share that is done, 0 to 1, and what is done now.

    Returns
    -------
    Model

    Raises
    ------
    ParameterError
        If a label is missing, a signature cannot be used or is of another kind than the
        others, one recording has two classes, or there are fewer than two classes.

    Notes
    -----
    Settings, typical motion and estimator are chosen anew within each fold, so that accuracy,
    calibration and class sets are of cases that took no part in anything.

    Cases are read and folds are fitted through joblib: wherever `parallel.joblib_backend`, or
    joblib's own `parallel_config`, says. The model does not depend on it.
    """
    from joblib import Parallel, delayed

    chosen = TrainingOptions() if options is None else options
    told = progress or _silent
    sized = len(cases) if isinstance(cases, Sized) else 0

    def reading(number: int) -> None:
        share = 0.4 * number / sized if sized else 0.0
        told(share, f"reading case {number}")

    table = collect(cases, chosen, reading)
    splits, is_grouped, notes = _splits(table, chosen)
    n, n_classes = len(table), len(table.classes)
    probabilities = np.full((n, n_classes), 1.0 / n_classes)
    distances = np.zeros(n)
    every = np.arange(n)
    works = [delayed(_fold)(table, inner, outer, chosen) for inner, outer in splits]
    works.append(delayed(_fit)(table, every, chosen))
    found = Parallel(return_as="generator", batch_size=1)(works)
    for k, (_, outer) in enumerate(splits):
        told(0.4 + 0.5 * k / (len(splits) + 1), f"fold {k + 1} of {len(splits)}")
        probabilities[outer], distances[outer] = next(found)
    told(0.4 + 0.5 * len(splits) / (len(splits) + 1), "all cases")
    fitted = next(found)
    model = _model(table, fitted, name, probabilities, distances, bool(splits), chosen)
    card = _card(table, chosen, splits, is_grouped, probabilities, fitted.kind)
    told(1.0, "trained")
    return replace(model, card=replace(card, notes=(*table.notes, *notes, *card.notes)))


def _silent(share: float, text: str) -> None:
    """Tell nobody."""
    del share, text


@dataclass(frozen=True, eq=False)
class _Fit:
    """What is fitted to some cases of a table."""

    reader: FeatureReader
    estimator: Any
    kind: str
    classes: NDArray[np.int64]
    centre: NDArray[np.float64]
    scale: NDArray[np.float64]
    means: NDArray[np.float64]
    whitening: NDArray[np.float64]
    X: NDArray[np.float64]

    def nearest(
        self, table: CaseTable, rows: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Features in the reading that is nearest to a class, and the distance."""
        values = table.features(self.reader)[rows]
        n, n_readings, d = values.shape
        z = (values.reshape(-1, d) - self.centre) / self.scale
        domain = Domain(self.means, self.whitening, np.inf, 0.0, 0.0)
        apart = domain.distance(z).reshape(n, n_readings)
        chosen = apart.argmin(axis=1)
        return values[np.arange(n), chosen], apart[np.arange(n), chosen]

    def probabilities(self, X: NDArray[np.float64], n_classes: int) -> NDArray[np.float64]:
        """Probabilities of all classes; 0 for those the fold has not seen."""
        found = np.zeros((len(X), n_classes))
        found[:, self.classes] = self.estimator.predict_proba(X)
        return found


def _fit(table: CaseTable, rows: NDArray[np.int64], options: TrainingOptions) -> _Fit:
    from modalmotion.classify.estimator import MotionClassifier

    y, groups, n_classes = table.y[rows], table.groups[rows], len(table.classes)
    weights: Any = options.class_weights
    if isinstance(weights, Mapping):
        weights = {table.classes.index(k): w for k, w in weights.items() if k in table.classes}
    else:
        weights = None if weights == ClassWeights.NONE else str(weights)
    best: tuple[float, FeatureReader, NDArray[np.float64], Any] | None = None
    for choice in table.readers():
        reader = table.fitted(choice, rows, options.pose)
        X = best_readings(table.features(reader)[rows], y, n_classes)
        estimator = MotionClassifier(str(options.estimator), weights, options.seed)
        estimator.fit(X, y, groups)
        # Where there is no loss to compare, the first choice, which is never misled by a pose.
        loss = float(np.nan_to_num(estimator.loss_, nan=0.0))
        if best is None or loss < best[0]:
            best = loss, reader, X, estimator
    assert best is not None  # noqa: S101 (there is at least one reader)
    _, reader, X, estimator = best
    centre, spread = X.mean(axis=0), X.std(axis=0)
    scale = np.where(spread > 1e-12 * np.abs(X).max(axis=0), spread, np.inf)
    means, whitening = domain_shape((X - centre) / scale, y, n_classes)
    return _Fit(
        reader, estimator, estimator.kind_, estimator.classes_, centre, scale, means, whitening, X
    )


def _fold(
    table: CaseTable,
    inner: NDArray[np.int64],
    outer: NDArray[np.int64],
    options: TrainingOptions,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Probabilities of cases that took no part in a fit, and their distances from it."""
    fold = _fit(table, inner, options)
    X, distances = fold.nearest(table, outer)
    return fold.probabilities(X, len(table.classes)), distances


def _splits(
    table: CaseTable, options: TrainingOptions
) -> tuple[list[tuple[NDArray[np.int64], NDArray[np.int64]]], bool, list[str]]:
    """Folds of the cross-validation, whether they keep subjects together, and what to know."""
    from sklearn.model_selection import StratifiedGroupKFold, StratifiedKFold

    n_classes = len(table.classes)
    subjects = [len(np.unique(table.groups[table.y == k])) for k in range(n_classes)]
    cases = np.bincount(table.y, minlength=n_classes)
    shuffled = {"shuffle": True, "random_state": options.seed}
    if min(subjects) >= 2:
        folds = min(options.folds, min(subjects))
        split = StratifiedGroupKFold(folds, **shuffled).split(table.y, table.y, table.groups)
        return list(split), True, []
    alone = table.classes[int(np.argmin(subjects))]
    note = (
        f"The class {alone!r} has one subject only: how well it is told of another subject "
        "cannot be known. "
    )
    if cases.min() < 2:
        return [], False, [note + "There was no cross-validation, so class sets hold everything."]
    folds = min(options.folds, int(cases.min()))
    split = StratifiedKFold(folds, **shuffled).split(table.y, table.y)
    note += "Cross-validation split recordings of one subject, and is too hopeful."
    return list(split), False, [note]


def _model(
    table: CaseTable,
    fitted: _Fit,
    name: str,
    probabilities: NDArray[np.float64],
    distances: NDArray[np.float64],
    is_validated: bool,
    options: TrainingOptions,
) -> Model:
    estimator = fitted.estimator
    blend, machine = _rounded_blend(estimator, fitted), b""
    if estimator.blend_ is None:
        machine = machine_to_bytes(estimator)
    least_motion, least_smooth = motion_limits(table.sizes, table.smooth_shares)
    limit = np.inf
    calibration = Calibration(tuple(np.zeros(0) for _ in table.classes))
    if is_validated:
        limit = domain_limit(distances, options.known_share)
        calibration = calibrate(_rounded(probabilities), table.y, len(table.classes))
    golden = _rounded(fitted.X[:: max(1, len(fitted.X) // _N_GOLDEN)][:_N_GOLDEN])
    always: tuple[str, ...] = ()
    if (table.reader.has_axis or _has_closed(table)) and not table.reader.walls:
        always = (WALLS_NOTE,)
    typical = fitted.reader.typical
    if typical is not None:
        typical = _rounded(typical.real) + 1j * _rounded(typical.imag)
    model = Model(
        name=name,
        classes=table.classes,
        readable=table.readable,
        reader=replace(fitted.reader, typical=typical),
        columns=table.columns(fitted.reader),
        blend=blend,
        machine=machine,
        domain=Domain(
            _rounded(fitted.means),
            _rounded(fitted.whitening),
            float(_rounded(np.array(limit))),
            float(_rounded(np.array(least_motion))),
            float(_rounded(np.array(least_smooth))),
        ),
        calibration=calibration,
        golden_features=golden,
        golden_probabilities=np.zeros((len(golden), len(table.classes))),
        notes={"": always},
        card=_empty_card(table),
    )
    return replace(model, golden_probabilities=model.probabilities(golden))


def _has_closed(table: CaseTable) -> bool:
    topology = table.example.topology
    return topology is not None and bool(topology.closed_axes)


def _rounded_blend(estimator: Any, fitted: _Fit) -> Blend:
    centre, scale = _rounded(fitted.centre), _rounded(fitted.scale)
    if estimator.blend_ is None:
        return Blend(centre, scale, (), 1.0)
    scorers = tuple(
        Scorer(
            _rounded(s.anchors),
            float(s.gamma),
            _rounded(s.weights),
            _rounded(s.intercepts),
            float(_rounded(np.array(s.temperature))),
        )
        for s in estimator.blend_.scorers
    )
    return Blend(centre, scale, scorers, float(_rounded(np.array(estimator.blend_.temperature))))


def _empty_card(table: CaseTable) -> ModelCard:
    return ModelCard(
        classes=table.classes,
        training_set=table.hash,
        n_cases={},
        n_subjects={},
        accuracy=None,
        accuracy_interval=None,
        is_grouped=False,
        confusion=(),
        calibration_curve=(),
        calibration_error=None,
        coverage=0.9,
        class_coverage={},
        mean_set_size=None,
        options={},
        versions={},
        intended_use=INTENDED_USE,
        has_seen="",
        has_not_seen="",
    )


def _card(
    table: CaseTable,
    options: TrainingOptions,
    splits: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
    is_grouped: bool,
    probabilities: NDArray[np.float64],
    kind: str,
) -> ModelCard:
    labels = [table.classes[k] for k in table.y]
    pairs = dict.fromkeys(zip(labels, table.subjects, strict=True))
    n_cases, n_subjects = class_counts(labels), class_counts(label for label, _ in pairs)
    few = [label for label, count in n_cases.items() if count < _FEW]
    notes: tuple[str, ...] = ()
    if few:
        notes = (
            (
                f"Fewer than {_FEW} cases of {', '.join(few)}: class sets of 90 % always hold "
                f"{'it' if len(few) == 1 else 'them'}."
            ),
        )
    card = replace(
        _empty_card(table),
        n_cases=n_cases,
        n_subjects=n_subjects,
        is_grouped=is_grouped,
        coverage=options.coverage,
        options={**options.as_json(), "chosen": kind},
        versions={p: version(p) for p in ("modalmotion", "numpy", "scipy", "scikit-learn")},
        has_seen=(
            f"{len(table)} recordings of {len(set(table.subjects))} subjects: "
            + ", ".join(f"{count} {label}" for label, count in n_cases.items())
            + f"; {' or '.join(table.readable.topologies)}, {table.readable.n_modes} modes."
        ),
        has_not_seen=(
            "Any other class, subject, device or way to segment: the figures hold for recordings "
            "like these only."
        ),
        notes=notes,
    )
    if not splits:
        return card
    said = probabilities.argmax(axis=1)
    right = said == table.y
    confusion = np.zeros((len(table.classes),) * 2, dtype=np.int64)
    np.add.at(confusion, (table.y, said), 1)
    curve = calibration_curve(probabilities.max(axis=1), right)
    held, sizes = _cross_sets(table, splits, probabilities, options.coverage)
    return replace(
        card,
        accuracy=float(right.mean()),
        accuracy_interval=accuracy_interval(right, table.subjects),
        confusion=tuple(tuple(row) for row in confusion.tolist()),
        calibration_curve=curve,
        calibration_error=calibration_error(curve),
        class_coverage={
            label: float(held[table.y == k].mean()) for k, label in enumerate(table.classes)
        },
        mean_set_size=float(sizes.mean()),
    )


def _cross_sets(
    table: CaseTable,
    splits: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
    probabilities: NDArray[np.float64],
    coverage: float,
) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Whether each case's set, calibrated on the other folds, holds its class; and its size."""
    held = np.zeros(len(table), dtype=np.bool_)
    sizes = np.zeros(len(table), dtype=np.int64)
    for inner, outer in splits:
        fold = calibrate(probabilities[inner], table.y[inner], len(table.classes))
        kept = fold.holds(probabilities[outer], coverage)
        held[outer] = kept[np.arange(len(outer)), table.y[outer]]
        sizes[outer] = kept.sum(axis=1)
    return held, sizes


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to `_DIGITS` significant digits."""
    rounded = [float(f"{value:.{_DIGITS}g}") for value in np.ravel(values)]
    return np.array(rounded).reshape(np.shape(values))
