"""How strange one of a bag of recordings is beside the others: conformal p-values.

The recording in question is in one bag with the controls, and everything is computed from the
bag as if nobody knew which it is. Where it comes from where the controls come from, each of the
n + 1 places in the order of strangeness is then as likely as any other, so P(p <= a) is
floor(a (n + 1)) / (n + 1) whatever the distribution: no Gaussian is believed (Vovk, Gammerman,
Shafer, Algorithmic Learning in a Random World, 2005, full conformal prediction).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Spread of a column, over its size, that is rounding.
_ROUNDING: Final = 1e-12


def fewest_controls(level: float) -> int:
    """Give the controls that a level needs: with fewer no p-value is as small.

    Parameters
    ----------
    level : float
        Between 0 and 1.
    """
    return math.ceil(1.0 / level - 1e-9) - 1


def attainable(level: float, n: int) -> float:
    """Share of false alarms among recordings like the n controls, at most the level."""
    return math.floor(level * (n + 1) + 1e-9) / (n + 1)


def p_values(scores: Array) -> Array:
    """Share of a bag that is at least as strange as each of it, (members,) float64."""
    ordered = np.sort(scores)
    p: Array = 1.0 - np.searchsorted(ordered, scores, side="left") / len(scores)
    return p


def strangeness(table: Array) -> Array:
    """Squared distance of each member of a bag from its centre, (members,) float64.

    Parameters
    ----------
    table : (members, columns) float64
        Columns of one unit: they are not scaled, so that those in which hardly anything moves
        count as little as they move.
    """
    squares: Array = ((table - table.mean(axis=0)) ** 2).sum(axis=1)
    return squares


def whole(scores: Sequence[Array]) -> Array:
    """Several kinds of strangeness together, each over its mean in the bag, (members,) float64."""
    together: Array = _over_mean(scores).sum(axis=0)
    return together


def family_p_values(scores: Sequence[Array]) -> Array:
    """Corrected p-values of several kinds of strangeness, (kinds, members) float64.

    The share of the bag whose greatest strangeness of any kind, each over its mean in the bag, is
    at least that of the member in this kind. At most a share `attainable` of recordings like the
    controls has any that is at most the level (Westfall and Young, 1993, in one step).

    Parameters
    ----------
    scores : sequence of (members,) float64
        One a kind.
    """
    scaled = _over_mean(scores)
    greatest = np.sort(scaled.max(axis=0))
    p: Array = 1.0 - np.searchsorted(greatest, scaled, side="left") / len(greatest)
    return p


def _over_mean(scores: Sequence[Array]) -> Array:
    table = np.array(scores)
    mean = table.mean(axis=1, keepdims=True)
    scaled: Array = table / np.where(mean > 0.0, mean, 1.0)
    return scaled


def standardised(table: Array) -> Array:
    """Columns about their mean over their deviation; those that do not vary are left out."""
    spread = table.std(axis=0)
    varies = spread > _ROUNDING * np.maximum(np.abs(table).max(axis=0), np.finfo(float).tiny)
    z: Array = (table[:, varies] - table[:, varies].mean(axis=0)) / spread[varies]
    return z


def without_covariates(table: Array, covariates: Array) -> Array:
    """Take out of each column what depends on covariates linearly, (members, columns).

    Parameters
    ----------
    table : (members, columns) float64
    covariates : (members, covariates) float64
    """
    if not covariates.shape[1]:
        return table
    design = np.column_stack([np.ones(len(table)), standardised(covariates)])
    coefficients, *_ = np.linalg.lstsq(design, table, rcond=None)
    # A member far out among the covariates bends the line towards itself: the others' scale.
    q, _ = np.linalg.qr(design)
    leverage = np.minimum((q**2).sum(axis=1), 0.99)
    rest: Array = (table - design @ coefficients) / np.sqrt(1.0 - leverage)[:, None]
    return rest


def exchange_p(table: Array, n: int, n_exchanges: int = 1999) -> float:
    """Share of exchanges that set the first n of a bag as far apart from the others.

    By the energy distance (Szekely and Rizzo, Testing for equal distributions in high dimension,
    InterStat, 2004).

    Parameters
    ----------
    table : (members, columns) float64
        Of one scale.
    n : int
    n_exchanges : int
    """
    squares = (table**2).sum(axis=1)
    apart = np.sqrt(np.maximum(squares[:, None] + squares - 2.0 * table @ table.T, 0.0))
    rng = np.random.default_rng(0)
    first = np.zeros((n_exchanges + 1, len(table)))
    first[0, :n] = 1.0
    for row in first[1:]:
        row[rng.permutation(len(table))[:n]] = 1.0
    second, m = 1.0 - first, len(table) - n
    from_first = first @ apart
    across = (from_first * second).sum(axis=1) / (n * m)
    within = (from_first * first).sum(axis=1) / n**2
    other = ((second @ apart) * second).sum(axis=1) / m**2
    energies = 2.0 * across - within - other
    return float((energies >= energies[0] * (1.0 - 1e-12)).mean())
