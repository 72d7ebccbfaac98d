"""The domain, fitted to some cases of a table."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.estimators.temperature import fit_temperature
from modalmotion.classification.model.domain import (
    CHECKS,
    OF_CLASS,
    PLACE,
    Domain,
    Judgement,
    Sights,
)
from modalmotion.classification.training.domain_limits import joint_limits
from modalmotion.classification.training.readings import best_readings, class_shape
from modalmotion.classification.training.table import CaseTable

_OF_CYCLES: Final = np.array([check in ("gap", "leap", "turns") for check in CHECKS])

# Of the cases that are beyond a limit: those beyond that of the class that is named.
_SHARE_OF_STRANGE: Final = 0.2

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class DomainFit:
    """A domain without limits, and all cases as it sees them.

    Parameters
    ----------
    domain : Domain
    sights : Sights
        Of all cases.
    """

    domain: Domain
    sights: Sights

    def judge(self, rows: NDArray[np.int64]) -> Judgement:
        """Say how some cases lie."""
        return self.domain.judge(self.sights.of(rows))


def fit_domain(table: CaseTable, rows: NDArray[np.int64]) -> DomainFit:
    """Fit a domain to some cases; nothing is beyond its limits."""
    sights, y, n_classes = table.sights, table.y[rows], len(table.classes)
    own = best_readings(sights.kinds[rows], y, n_classes, sights.allowed[rows])
    middle, spread = own.mean(axis=0), own.std(axis=0)
    spread = np.where(spread > 1e-12 * np.abs(own).max(axis=0), spread, np.inf)
    means, whitening = class_shape((own - middle) / spread, y, n_classes)
    # Distances are of kinds as they are, not standardised: (k - middle) / spread - mean.
    means = middle + means * np.where(np.isfinite(spread), spread, 0.0)
    whitening = whitening / spread[:, None]
    apart = np.linalg.norm((own - means[y]) @ whitening, axis=1)
    directions = np.stack([_direction(own, y, n_classes, signs < 0) for signs in sights.signs])
    points = sights.places[rows]
    measures = sights.measures[rows][:, len(PLACE) - 1 :]
    domain = Domain(
        reader=table.domain_reader,
        means=means,
        whitening=whitening,
        spreads=_root_means(apart, y, n_classes),
        points=np.nan_to_num(points),
        scales=_within(points, y, n_classes),
        directions=directions,
        centres=_class_means(own @ directions.T, y, n_classes),
        course=np.stack([np.nan_to_num(measures.mean(axis=0)), _spread(measures)]),
        limits=np.full(len(CHECKS), np.inf),
        least_motion=0.0,
        least_smooth=0.0,
        has_unit=table.has_unit,
        hand_is_stated=table.hand_is_stated,
        hand_temperature=1.0,
    )
    return DomainFit(domain, sights)


def with_limits(
    domain: Domain, scores: Array, hand: Array, groups: NDArray[np.int64], known_share: float
) -> Domain:
    """Give a domain the limits that held-out cases set.

    Parameters
    ----------
    domain : Domain
    scores : (cases, checks) float64
        Of cases that took no part in the fit; see `Judgement`.
    hand : (cases,) float64
    groups : (cases,) int64
        Cases that are not independent.
    known_share : float
        Share of cases like these that are within all limits.
    """
    # The distance from the class that is named counts beside an empty set alone.
    alone = joint_limits(
        scores[:, OF_CLASS:], 1.0 - _SHARE_OF_STRANGE * (1.0 - known_share), groups
    )
    limits = np.concatenate([joint_limits(scores[:, :OF_CLASS], known_share, groups), alone])
    if not domain.reader.is_cycle:
        limits[_OF_CYCLES] = np.inf
    temperature = 1.0
    if hand.any():
        # Log odds of the motion over its mirror image; each case is the one it is.
        logs = 0.5 * np.stack([-hand, hand], axis=1)
        temperature = fit_temperature(logs, np.zeros(len(hand), dtype=np.int64))
    return replace(domain, limits=limits, hand_temperature=float(temperature))


def _direction(
    own: Array, y: NDArray[np.int64], n_classes: int, changes: NDArray[np.bool_]
) -> Array:
    """Along which motions and their twins lie apart (Fisher), over the columns that change."""
    direction = np.zeros(own.shape[1])
    z = own[:, changes]
    scale = z.std(axis=0)
    varies = scale > 1e-12 * np.abs(z).max(axis=0, initial=0.0)
    if not varies.any():
        return direction
    z = z[:, varies] / scale[varies]
    means, whitening = class_shape(z, y, n_classes)
    W = whitening * np.sqrt(z.shape[1])
    towards = W @ (W.T @ means[np.unique(y)].mean(axis=0))
    length = float(np.linalg.norm(W.T @ means[np.unique(y)].mean(axis=0)))
    if length > 0.0:
        direction[np.flatnonzero(changes)[varies]] = towards / length / scale[varies]
    return direction


def _class_means(values: Array, y: NDArray[np.int64], n_classes: int) -> Array:
    """Mean of each class; of a class without cases that of all."""
    means = np.repeat(values.mean(axis=0)[None], n_classes, axis=0)
    for k in np.unique(y):
        means[k] = values[y == k].mean(axis=0)
    return means


def _root_means(apart: Array, y: NDArray[np.int64], n_classes: int) -> Array:
    """Give the RMS distance of each class's cases; of a class without any that of all, at least."""
    whole = float(np.sqrt((apart**2).mean())) or 1.0
    means = [
        np.sqrt((apart[y == k] ** 2).mean()) if (y == k).any() else 0.0 for k in range(n_classes)
    ]
    return np.array([float(mean) or whole for mean in means])


def _within(values: Array, y: NDArray[np.int64], n_classes: int) -> Array:
    """Give deviations within a class; infinite where nothing varies or some are not known."""
    apart = values - _class_means(values, y, n_classes)[y]
    return _finite(np.sqrt((apart**2).mean(axis=0)), values)


def _spread(values: Array) -> Array:
    return _finite(values.std(axis=0), values)


def _finite(spread: Array, values: Array) -> Array:
    known = np.isfinite(spread) & (spread > 1e-9 * np.abs(values).max(axis=0, initial=0.0))
    return np.where(known, spread, np.inf)
