"""Ridge regression on class indicators, with every case predicted without its subject."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Of the matrices of groups that are solved with at once.
_MOST_NUMBERS: Final = 1_000_000


@dataclass(frozen=True, eq=False)
class Targets:
    """What a regression on class indicators is to give, whatever the features.

    Parameters
    ----------
    Y : (cases, classes) float64
        Indicators, times the roots of the weights.
    roots : (cases,) float64
        Of the weights.
    groups : tuple of (groups of one size, size) int64
        Cases of one subject each.
    """

    Y: NDArray[np.float64]
    roots: NDArray[np.float64]
    groups: tuple[NDArray[np.int64], ...]


def targets(
    y: NDArray[np.int64],
    n_classes: int,
    weights: NDArray[np.float64],
    groups: NDArray[np.int64],
) -> Targets:
    """Targets of cases.

    Parameters
    ----------
    y : (cases,) int64
    n_classes : int
    weights : (cases,) float64
    groups : (cases,) int64
        Counted from 0.
    """
    roots = np.sqrt(weights)
    sizes = np.bincount(groups)[groups]
    order = np.argsort(groups, kind="stable")
    members = tuple(
        order[sizes[order] == size].reshape(-1, size) for size in np.unique(sizes).tolist()
    )
    return Targets(np.eye(n_classes)[y] * roots[:, None], roots, members)


@dataclass(frozen=True, eq=False)
class Ridge:
    """Singular value decomposition of weighted features, from which every penalty is cheap.

    Parameters
    ----------
    U : (cases, rank) float64
    singular : (rank,) float64
    Vt : (rank, features + 1) float64
        The last feature is 1 and gives the intercept.
    targets : Targets
    """

    U: NDArray[np.float64]
    singular: NDArray[np.float64]
    Vt: NDArray[np.float64]
    targets: Targets

    def weights(self, penalty: float) -> NDArray[np.float64]:
        """Weights of the features and the intercept, (features + 1, classes) float64."""
        s = self.singular
        # V s / (s^2 + penalty) U' Y
        solved: NDArray[np.float64] = self.Vt.T @ (
            (s / (s**2 + penalty))[:, None] * (self.U.T @ self.targets.Y)
        )
        return solved

    def held_out(self, penalties: NDArray[np.float64]) -> NDArray[np.float64]:
        """Scores of each case by fits without its group, (penalties, cases, classes) float64.

        Parameters
        ----------
        penalties : (penalties,) float64

        Notes
        -----
        With the hat matrix H of the whole fit the residuals of a group that is left out are
        (I - H_gg)^-1 (Y_g - (H Y)_g) (Cook and Weisberg, Residuals and influence in
        regression, 1982), so nothing is fitted anew.
        """
        Y = self.targets.Y
        shares = self.singular**2 / (self.singular**2 + penalties[:, None])
        residuals = Y - self.U @ (shares[:, :, None] * (self.U.T @ Y))
        left = np.empty_like(residuals)
        # Groups of one size at once.
        for members in self.targets.groups:
            U, size = self.U[members], members.shape[1]
            if size == 1:
                leverage = shares @ (U[:, 0] ** 2).T
                left[:, members[:, 0]] = residuals[:, members[:, 0]] / (1.0 - leverage)[..., None]
                continue
            # As many penalties at once as memory has room for.
            step = max(1, _MOST_NUMBERS // (members.size * size))
            for k in range(0, len(penalties), step):
                some = slice(k, k + step)
                H = (U * shares[some, None, None]) @ U.transpose(0, 2, 1)
                left[some, members] = np.linalg.solve(np.eye(size) - H, residuals[some, members])
        scores: NDArray[np.float64] = (Y - left) / self.targets.roots[:, None]
        return scores


def ridge(features: NDArray[np.float64], targets: Targets) -> Ridge:
    """Prepare a ridge regression on features (cases, features)."""
    # A large constant, so that the penalty hardly touches the intercept.
    with_one = np.concatenate([features, np.full((len(features), 1), INTERCEPT)], axis=1)
    U, singular, Vt = np.linalg.svd(targets.roots[:, None] * with_one, full_matrices=False)
    above = singular > 1e-10 * singular[0]
    return Ridge(U[:, above], singular[above], Vt[above], targets)


def kernel_ridge(kernels: NDArray[np.float64], targets: Targets) -> Ridge:
    """Prepare a ridge regression on features that are known by their products alone.

    One symmetric decomposition in the place of two, of the kernel and of its features. The
    weights are then of the kernels at the cases.

    Parameters
    ----------
    kernels : (cases, cases) float64
        Products of the features of all cases.
    targets : Targets
    """
    roots = targets.roots
    values, vectors = np.linalg.eigh(roots[:, None] * (kernels + INTERCEPT**2) * roots)
    above = values > 1e-13 * values[-1]
    U, singular = vectors[:, above], np.sqrt(values[above])
    # With U S V' the weighted features, V' = S^-1 U' (weighted features): here of their products.
    at_cases = U.T / singular[:, None] * roots
    Vt = np.concatenate([at_cases, INTERCEPT * at_cases.sum(axis=1, keepdims=True)], axis=1)
    return Ridge(U, singular, Vt, targets)


INTERCEPT = 10.0
"""Value of the constant feature."""
