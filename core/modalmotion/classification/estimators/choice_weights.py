"""Weights of several predictions of the same cases, by how well each predicts cases left out."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

# Draws of the Bayesian bootstrap.
_N_DRAWS: Final = 300

# Power of the likelihood: losses of cases left out from one another's fits are not independent.
# Below as many groups it falls with the root of their number: of many choices one or another
# predicts a few cases well by luck.
_POWER: Final = 0.5
_GROUPS_OF_FULL_POWER: Final = 64


def choice_weights(
    losses: NDArray[np.float64],
    prior: NDArray[np.float64],
    groups: NDArray[np.int64],
    seed: int,
) -> NDArray[np.float64]:
    """Weigh choices by the losses of cases that were left out.

    Parameters
    ----------
    losses : (choices, cases) float64, nats
    prior : (choices,) float64
        Weights where cases say nothing; they add up to 1.
    groups : (cases,) int64
        Cases that count together, such as those of one subject.
    seed : int

    Returns
    -------
    (choices,) float64
        They add up to 1. Two choices whose losses differ by less than chance share their weight.

    Notes
    -----
    Pseudo-Bayesian model averaging with the Bayesian bootstrap: Yao, Vehtari, Simpson and Gelman,
    Using stacking to average Bayesian predictive distributions, Bayesian Analysis, 2018.
    """
    _, place, counts = np.unique(groups, return_inverse=True, return_counts=True)
    of_groups = np.zeros((len(losses), len(counts)))
    np.add.at(of_groups.T, place, losses.T)
    rng = np.random.default_rng(seed)
    draws = rng.dirichlet(np.ones(len(counts)), _N_DRAWS) * len(counts)
    power = _POWER * min(1.0, (len(counts) / _GROUPS_OF_FULL_POWER) ** 0.5)
    logs = np.log(prior) - power * draws @ of_groups.T
    shares = np.exp(logs - logs.max(axis=1, keepdims=True))
    weights: NDArray[np.float64] = (shares / shares.sum(axis=1, keepdims=True)).mean(axis=0)
    return weights
