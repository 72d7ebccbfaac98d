"""Training of a model. scikit-learn is imported here, and only when a model is trained."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classify.cases import TrainingCase
from modalmotion.classify.model import Model
from modalmotion.classify.options import TrainingOptions
from modalmotion.errors import ParameterError
from modalmotion.features import READINGS, motion_features
from modalmotion.signature import ModalSignature

# Digits that are kept: more would differ between machines.
_DIGITS: Final = 6

# Times that the readings are chosen anew from the classes they gave.
_N_ROUNDS: Final = 5

# Share of each feature's variance that is added to the covariance within classes.
_SHRINKAGE: Final = 1e-2

_N_GOLDEN: Final = 10


@dataclass(frozen=True)
class LinearOptions:
    """How a model is trained.

    Parameters
    ----------
    regularisation : float
        C of the logistic regression: larger fits closer.
    known_share : float
        Share of the training cases that count as known; the farther ones set the limit.
    least_motion : float
        See `Model`.
    least_periodic_share : float
        See `Model`.
    """

    regularisation: float = 0.5
    known_share: float = 0.995
    least_motion: float = 0.003
    least_periodic_share: float = 0.5


def train(
    cases: Iterable[TrainingCase],
    name: str,
    options: TrainingOptions | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> Model:
    """Train a model on labelled signatures.

    Parameters
    ----------
    cases : iterable of TrainingCase
        Read one by one; nothing but their features is kept.
    name : str
    options : TrainingOptions, optional
    progress : callable, optional
        Called with the share that is done, 0 to 1, and what is done now.
    """
    chosen = TrainingOptions() if options is None else options
    if progress is not None:
        progress(0.0, f"reading signatures of {chosen.modes} modes")
    model = train_model(name, ((case.signature, case.label) for case in cases))
    if progress is not None:
        progress(1.0, "trained")
    return model


def train_model(
    name: str,
    cases: Iterable[tuple[ModalSignature, str]],
    *,
    options: LinearOptions | None = None,
    notes: dict[str, tuple[str, ...]] | None = None,
    card: dict[str, Any] | None = None,
) -> Model:
    """Train multinomial logistic regression on standardised motion features.

    Parameters
    ----------
    name : str
    cases : iterable of (ModalSignature, str)
        Right-handed, all with the same modes.
    options : LinearOptions, optional
    notes, card : dict, optional
        See `Model`.

    Returns
    -------
    Model

    Raises
    ------
    ParameterError
        If there are fewer than two classes, or the signatures differ in modes.
    """
    from sklearn.linear_model import LogisticRegression

    options = LinearOptions() if options is None else options
    both, labels, feature_names, topologies, n_modes = _collected(cases)
    classes = tuple(sorted(set(labels)))
    if len(classes) < 2:
        raise ParameterError(
            f"The training cases have {len(classes)} class(es).",
            remedy="Give cases of at least two classes.",
            details={"classes": list(classes)},
        )
    y = np.array([classes.index(label) for label in labels])
    X = _with_best_readings(both, y)
    centre, scale = _rounded(X.mean(axis=0)), X.std(axis=0)
    scale = _rounded(np.where(scale > 0, scale, 1.0))
    Z = (X - centre) / scale
    means, whitening = _domain(Z, y)
    fitted = LogisticRegression(C=options.regularisation, max_iter=5000, tol=1e-8).fit(Z, y)
    coefficients, intercepts = fitted.coef_, fitted.intercept_
    if len(classes) == 2:
        # One row for the second class against the first.
        coefficients = np.concatenate([-coefficients / 2, coefficients / 2])
        intercepts = np.concatenate([-intercepts / 2, intercepts / 2])
    golden = _rounded(X[:: max(1, len(X) // _N_GOLDEN)][:_N_GOLDEN])
    model = Model(
        name=name,
        classes=classes,
        feature_names=feature_names,
        topologies=topologies,
        modes=n_modes,
        centre=centre,
        scale=scale,
        coefficients=_rounded(coefficients),
        intercepts=_rounded(intercepts),
        class_means=_rounded(means),
        whitening=_rounded(whitening),
        farthest=np.inf,
        least_motion=options.least_motion,
        least_periodic_share=options.least_periodic_share,
        golden_features=golden,
        golden_probabilities=np.zeros((len(golden), len(classes))),
        notes={} if notes is None else notes,
        card={} if card is None else card,
    )
    farthest = np.quantile(model.distance(X), options.known_share)
    return replace(
        model,
        farthest=float(_rounded(np.asarray(farthest))),
        golden_probabilities=model.probabilities(golden),
    )


def _collected(
    cases: Iterable[tuple[ModalSignature, str]],
) -> tuple[NDArray[np.float64], list[str], tuple[str, ...], tuple[str, ...], int]:
    """Features in the two readings of inward, (cases, 2, features), and what describes them."""
    rows, labels, described = [], [], set()
    topologies = set()
    # Cases are right-handed, so only the side of inward is to be found.
    readings = [reading for reading in READINGS if not reading.is_mirrored]
    for signature, label in cases:
        features = [motion_features(signature, reading) for reading in readings]
        rows.append([f.values for f in features])
        labels.append(str(label))
        described.add((features[0].names, len(signature.modes)))
        topologies.add(signature.surface)
    if len(described) > 1:
        raise ParameterError(
            "The training cases differ in their modes.",
            remedy="Fit all signatures with the same number of modes.",
        )
    names, n_modes = described.pop() if described else ((), 0)
    return np.array(rows), labels, names, tuple(sorted(topologies)), n_modes


def _with_best_readings(both: NDArray[np.float64], y: NDArray[np.int64]) -> NDArray[np.float64]:
    """Features in the reading that is nearer to the case's own class, found by turns."""
    X = both[:, 0]
    for _ in range(_N_ROUNDS):
        means, whitening = _domain(X, y)
        apart = (both - means[y][:, None]) @ whitening.T
        chosen = (apart**2).sum(axis=2).argmin(axis=1)
        X = both[np.arange(len(both)), chosen]
    return X


def _domain(
    Z: NDArray[np.float64], y: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Class means, and W with W'W the inverse of the covariance within classes."""
    means = np.stack([Z[y == k].mean(axis=0) for k in range(y.max() + 1)])
    apart = Z - means[y]
    covariance = apart.T @ apart / len(Z)
    variances = np.diag(covariance)
    covariance += np.diag(_SHRINKAGE * np.where(variances > 0, variances, 1.0))
    L = np.linalg.cholesky(covariance)
    whitening: NDArray[np.float64] = np.linalg.inv(L)
    return means, whitening


def _rounded(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Round to `_DIGITS` significant digits."""
    rounded = [float(f"{value:.{_DIGITS}g}") for value in np.ravel(values)]
    return np.array(rounded).reshape(np.shape(values))
