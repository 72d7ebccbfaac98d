"""The classifier of features in scikit-learn's form. scikit-learn is imported here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import GridSearchCV
from sklearn.svm import SVC
from sklearn.utils.class_weight import compute_class_weight
from sklearn.utils.multiclass import check_classification_targets
from sklearn.utils.validation import check_is_fitted, validate_data

from modalmotion.classification.estimators.ridge import (
    INTERCEPT,
    Ridge,
    Targets,
    kernel_ridge,
    ridge,
    targets,
)
from modalmotion.classification.estimators.scorer import Blend, Scorer, blended, kernel
from modalmotion.classification.estimators.shrinkage import shrunk_solution
from modalmotion.classification.estimators.standards import class_means, standards
from modalmotion.classification.estimators.temperature import (
    case_losses,
    fit_temperature,
    fit_temperatures,
    log_losses,
    softmax,
)

KINDS: Final = ("auto", "linear", "kernel", "blend", "svm", "forest")

# Penalties of the ridge regression over the number of cases, and widths of the kernel: gamma
# times the number of features.
_PENALTIES: Final = tuple(10.0 ** (p / 2) for p in range(-9, 3))
_WIDTHS: Final = (0.03, 0.1, 0.3, 1.0)

# Cases that a kernel is anchored at; more cost time and memory for little.
_MOST_ANCHORS: Final = 500

_N_INNER_FOLDS: Final = 10
_N_TREES: Final = 300
_LEAST_SHARE: Final = 1e-3

Array = NDArray[np.float64]


class _Fitted(NamedTuple):
    """A fitted scorer, and its scores of cases that were left out with their group."""

    scorer: Scorer
    held_out: Array
    loss: float


class MotionClassifier(ClassifierMixin, BaseEstimator):  # type: ignore[misc]
    """Standardised features, scores of each class, reliable probabilities.

    Penalty, kernel width and, for "auto", the kind are those under which cases that are left
    out with their group are predicted best (log loss).

    Parameters
    ----------
    kind : str
        "linear": discriminant analysis with a shrunk covariance; "kernel": ridge regression on
        class indicators with a Gaussian kernel; "blend": the mean of both; "auto": the best of
        these; "svm": a support vector machine; "forest": extremely randomised trees.
    class_weight : None, "balanced" or mapping of class to float
    random_state : int
        Of the random parts: the anchors of a kernel over many cases, and the trees.

    Attributes
    ----------
    classes_ : (classes,) array
    kind_ : str
        The kind that "auto" selected.
    loss_ : float
        Log loss of the cases left out, nats; NaN for "svm" and "forest".
    losses_ : (cases,) float64
        The same of each case, with its weight.
    held_out_ : (cases, classes) float64
        Log probabilities, up to a constant, of the cases left out; NaN for "svm" and "forest".
    blend_ : Blend or None
        All of it as plain arrays; None for "svm" and "forest".
    """

    def __init__(
        self,
        kind: str = "auto",
        class_weight: str | Mapping[Any, float] | None = None,
        random_state: int = 0,
    ) -> None:
        self.kind = kind
        self.class_weight = class_weight
        self.random_state = random_state

    def fit(self, X: Any, y: Any, groups: Any = None) -> MotionClassifier:
        """Fit to features (cases, features) and labels (cases,).

        Parameters
        ----------
        X : (cases, features) array
        y : (cases,) array
        groups : (cases,) array, optional
            Subjects; each case is one of its own by default.

        Raises
        ------
        ValueError
            If there are fewer than two classes, or an option has no such value.
        """
        X, y = validate_data(self, X, y, dtype=np.float64)
        check_classification_targets(y)
        classes, place = np.unique(y, return_inverse=True)
        weight_of = self.class_weight
        if isinstance(weight_of, Mapping):
            weight_of = {label: weight_of.get(label, 1.0) for label in classes}
        per_class = compute_class_weight(weight_of, classes=classes, y=y)
        g = np.arange(len(y)) if groups is None else np.unique(groups, return_inverse=True)[1]
        return self.fit_places(X, classes, place, per_class, g)

    def fit_places(
        self,
        X: Array,
        classes: NDArray[Any],
        place: NDArray[np.int64],
        per_class: Array,
        groups: NDArray[np.int64],
    ) -> MotionClassifier:
        """Fit to what `fit` has checked.

        Parameters
        ----------
        X : (cases, features) float64
        classes : (classes,) array
        place : (cases,) int64
            Of the label of each case among the classes.
        per_class : (classes,) float64
            Weights.
        groups : (cases,) int64
            Counted from 0.
        """
        if self.kind not in KINDS:
            raise ValueError(f"kind={self.kind!r} is not one of {', '.join(KINDS)}.")
        if len(classes) < 2:
            raise ValueError("A classifier needs at least two classes, only one class is given.")
        self.classes_ = classes
        self.n_features_in_ = X.shape[1]
        self._centre, self._scale = standards(X)
        z = (X - self._centre) / self._scale
        self.blend_: Blend | None = None
        self.loss_ = float("nan")
        self.losses_ = np.full(len(place), np.nan)
        self.held_out_ = np.full((len(place), len(self.classes_)), np.nan)
        if self.kind in ("svm", "forest"):
            self.kind_ = self.kind
            self._fit_machine(z, place, dict(enumerate(per_class.tolist())))
        else:
            self._fit_blend(z, place, per_class, groups)
        return self

    def decision_function(self, X: Any) -> Array:
        """Scores, (cases, classes) float64; of two classes that of the second, (cases,)."""
        scores = self._log_shares(X)
        return scores[:, 1] - scores[:, 0] if len(self.classes_) == 2 else scores

    def predict_proba(self, X: Any) -> Array:
        """Probabilities, (cases, classes) float64."""
        return softmax(self._log_shares(X))

    def predict(self, X: Any) -> NDArray[Any]:
        """Most probable classes, (cases,)."""
        scores = self._log_shares(X)
        labels: NDArray[Any] = self.classes_[scores.argmax(axis=1)]
        return labels

    def _log_shares(self, X: Any) -> Array:
        check_is_fitted(self)
        X = validate_data(self, X, reset=False, dtype=np.float64)
        if self.blend_ is not None:
            return self.blend_.log_shares(X)
        return self._machine_scores((X - self._centre) / self._scale) / self._temperature

    def _fit_blend(
        self, z: Array, y: NDArray[np.int64], per_class: Array, groups: NDArray[np.int64]
    ) -> None:
        weights = per_class[y]
        kinds = ("linear", "kernel") if self.kind in ("auto", "blend") else (self.kind,)
        fitted = {
            kind: _linear(z, y, per_class, groups)
            if kind == "linear"
            else _kernel(z, y, len(per_class), weights, groups, self.random_state)
            for kind in kinds
        }
        choices = {kind: [fit] for kind, fit in fitted.items()}
        if self.kind == "blend":
            choices = {}
        if len(fitted) == 2:
            choices["blend"] = list(fitted.values())
        candidates: list[tuple[float, str, float, Array, Array]] = []
        for kind, parts in choices.items():
            shares = [softmax(part.held_out / part.scorer.temperature) for part in parts]
            logs = blended(shares)
            temperature = fit_temperature(logs, y, weights)
            losses = case_losses(logs / temperature, y) * weights / weights.mean()
            held_out = logs / temperature
            candidates.append((float(losses.mean()), kind, temperature, losses, held_out))
        # A loss may be infinite where a held-out class has no share left.
        self.loss_, self.kind_, temperature, self.losses_, self.held_out_ = min(
            candidates, key=lambda candidate: candidate[0]
        )
        scorers = tuple(part.scorer for part in choices[self.kind_])
        self.blend_ = Blend(self._centre, self._scale, scorers, temperature)

    def _fit_machine(self, z: Array, y: NDArray[np.int64], class_weight: dict[int, float]) -> None:
        n, d = z.shape
        if self.kind == "svm":
            self._machine = SVC(class_weight=class_weight, decision_function_shape="ovr")
            folds = int(min(3, np.bincount(y).min()))
            if folds >= 2:
                grid = {"C": [1.0, 3.0, 10.0, 30.0], "gamma": [width / d for width in _WIDTHS]}
                search = GridSearchCV(self._machine, grid, cv=folds).fit(z, y)
                self._machine = search.best_estimator_
            else:
                self._machine.fit(z, y)
            scores = self._machine_scores(z)
        else:
            has_bags = n > 20
            self._machine = ExtraTreesClassifier(
                _N_TREES,
                class_weight=class_weight,
                bootstrap=True,
                oob_score=has_bags,
                min_samples_leaf=2,
                random_state=self.random_state,
            ).fit(z, y)
            scores = self._machine_scores(z)
            if has_bags:
                shares = np.nan_to_num(self._machine.oob_decision_function_)
                scores = np.log(np.maximum(shares, _LEAST_SHARE))
        self._temperature = fit_temperature(scores, y)

    def _machine_scores(self, z: Array) -> Array:
        if self.kind == "forest":
            logs: Array = np.log(np.maximum(self._machine.predict_proba(z), _LEAST_SHARE))
            return logs
        scores: Array = self._machine.decision_function(z)
        return np.stack([-scores, scores], axis=1) if scores.ndim == 1 else scores


def _linear(z: Array, y: NDArray[np.int64], per_class: Array, groups: NDArray[np.int64]) -> _Fitted:
    """Fit discriminant analysis with the covariance of Ledoit and Wolf, J Multivar Anal, 2004."""
    n_classes = len(per_class)
    held_out = np.zeros((len(y), n_classes))
    for train, test in _folds(y, groups):
        W, b = _discriminant(z[train], y[train], per_class)
        held_out[test] = z[test] @ W + b
    W, b = _discriminant(z, y, per_class)
    temperature = fit_temperature(held_out, y, per_class[y])
    loss = float(log_losses(held_out[None] / temperature, y, per_class[y])[0])
    return _Fitted(Scorer(np.zeros((0, z.shape[1])), 0.0, W, b, temperature), held_out, loss)


def _discriminant(z: Array, y: NDArray[np.int64], per_class: Array) -> tuple[Array, Array]:
    """Weights and intercepts of log p(k | z) = z' S^-1 m_k - m_k' S^-1 m_k / 2 + log prior_k."""
    n_classes = len(per_class)
    counts = np.bincount(y, minlength=n_classes)
    means = class_means(z, y, n_classes)
    W = shrunk_solution(z - means[y], means.T)
    prior = np.maximum(counts, 1e-3) * per_class
    b = np.log(prior / prior.sum()) - 0.5 * np.einsum("kd,dk->k", means, W)
    return W, b


def _kernel(
    z: Array,
    y: NDArray[np.int64],
    n_classes: int,
    weights: Array,
    groups: NDArray[np.int64],
    seed: int,
) -> _Fitted:
    """Kernel ridge regression, with the width and penalty that best predict the cases left out."""
    n, d = z.shape
    anchors = z
    if n > _MOST_ANCHORS:
        sample = np.random.default_rng(seed).permutation(n)[:_MOST_ANCHORS]
        anchors = z[np.sort(sample)]
    penalties = np.array(_PENALTIES) * n
    wanted = targets(y, n_classes, weights, groups)
    ridges = [_prepared(z, anchors, width / d, wanted) for width in _WIDTHS]
    scores = np.concatenate([fitted.held_out(penalties) for fitted, _ in ridges])
    temperatures = fit_temperatures(scores, y, weights)
    losses = log_losses(scores / temperatures[:, None, None], y, weights)
    # A loss is not a number where a case alone decides its own score.
    best = int(np.where(np.isnan(losses), np.inf, losses).argmin())
    of_width, of_penalty = divmod(best, len(penalties))
    fitted, B = ridges[of_width]
    W = fitted.weights(float(penalties[of_penalty]))
    of_anchors = W[:-1] if B is None else B @ W[:-1]
    temperature = float(temperatures[best])
    scorer = Scorer(anchors, _WIDTHS[of_width] / d, of_anchors, W[-1] * INTERCEPT, temperature)
    return _Fitted(scorer, scores[best], float(losses[best]))


def _prepared(
    z: Array, anchors: Array, gamma: float, wanted: Targets
) -> tuple[Ridge, Array | None]:
    """Prepare a regression on kernels, and what turns its weights into the anchors'."""
    if len(anchors) == len(z):
        return kernel_ridge(kernel(z, z, gamma), wanted), None
    features, B = _nystrom(z, anchors, gamma)
    return ridge(features, wanted), B


def _nystrom(z: Array, anchors: Array, gamma: float) -> tuple[Array, Array]:
    """Features K(z, a) B whose products are kernels, and B.

    Williams and Seeger, Using the Nystrom method to speed up kernel machines, NIPS, 2000.
    """
    values, vectors = np.linalg.eigh(kernel(anchors, anchors, gamma))
    positive = values > 1e-8 * values[-1]
    B = vectors[:, positive] / np.sqrt(values[positive])
    return kernel(z, anchors, gamma) @ B, B


def _folds(
    y: NDArray[np.int64], groups: NDArray[np.int64]
) -> Iterator[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Split into at most ten parts by group, classes spread evenly, without randomness."""
    _, first, place = np.unique(groups, return_index=True, return_inverse=True)
    # Groups in the order of their class take turns.
    turn = np.empty(len(first), dtype=np.int64)
    turn[np.lexsort((first, y[first]))] = np.arange(len(first))
    fold = turn[place] % min(_N_INNER_FOLDS, len(first))
    for k in range(int(fold.max()) + 1):
        test = np.flatnonzero(fold == k)
        train = np.flatnonzero(fold != k)
        if len(train) > 1:
            yield train, test
