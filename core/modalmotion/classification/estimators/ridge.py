"""Ridge regression on class indicators, with every case predicted without its subject."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, eq=False)
class Ridge:
    """Singular value decomposition of weighted features, from which every penalty is cheap.

    Parameters
    ----------
    U : (cases, rank) float64
    singular : (rank,) float64
    Vt : (rank, features + 1) float64
        The last feature is 1 and gives the intercept.
    Y : (cases, classes) float64
        Indicators, times the roots of the weights.
    roots : (cases,) float64
        Of the weights.
    groups : tuple of (n,) int64
        Cases of one subject each.
    """

    U: NDArray[np.float64]
    singular: NDArray[np.float64]
    Vt: NDArray[np.float64]
    Y: NDArray[np.float64]
    roots: NDArray[np.float64]
    groups: tuple[NDArray[np.int64], ...]

    def weights(self, penalty: float) -> NDArray[np.float64]:
        """Weights of the features and the intercept, (features + 1, classes) float64."""
        s = self.singular
        # V s / (s^2 + penalty) U' Y
        solved: NDArray[np.float64] = self.Vt.T @ (
            (s / (s**2 + penalty))[:, None] * (self.U.T @ self.Y)
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
        shares = self.singular**2 / (self.singular**2 + penalties[:, None])
        residuals = self.Y - self.U @ (shares[:, :, None] * (self.U.T @ self.Y))
        left = np.empty_like(residuals)
        # Groups of one size at once.
        for size in np.unique([len(g) for g in self.groups]).tolist():
            members = np.array([g for g in self.groups if len(g) == size])
            U = self.U[members]
            if size == 1:
                leverage = shares @ (U[:, 0] ** 2).T
                left[:, members[:, 0]] = residuals[:, members[:, 0]] / (1.0 - leverage)[..., None]
                continue
            for k in range(len(penalties)):
                H = (U * shares[k]) @ U.transpose(0, 2, 1)
                left[k, members] = np.linalg.solve(np.eye(size) - H, residuals[k, members])
        scores: NDArray[np.float64] = (self.Y - left) / self.roots[:, None]
        return scores


def ridge(
    features: NDArray[np.float64],
    y: NDArray[np.int64],
    n_classes: int,
    weights: NDArray[np.float64],
    groups: NDArray[np.int64],
) -> Ridge:
    """Prepare a ridge regression.

    Parameters
    ----------
    features : (cases, features) float64
    y : (cases,) int64
    n_classes : int
    weights : (cases,) float64
    groups : (cases,) int64
        Counted from 0.
    """
    # A large constant, so that the penalty hardly touches the intercept.
    with_one = np.concatenate([features, np.full((len(features), 1), INTERCEPT)], axis=1)
    roots = np.sqrt(weights)
    U, singular, Vt = np.linalg.svd(roots[:, None] * with_one, full_matrices=False)
    above = singular > 1e-10 * singular[0]
    Y = np.eye(n_classes)[y] * roots[:, None]
    return Ridge(U[:, above], singular[above], Vt[above], Y, roots, _members(groups))


def kernel_ridge(
    kernels: NDArray[np.float64],
    y: NDArray[np.int64],
    n_classes: int,
    weights: NDArray[np.float64],
    groups: NDArray[np.int64],
) -> Ridge:
    """Prepare a ridge regression on features that are known by their products alone.

    One symmetric decomposition in the place of two, of the kernel and of its features. The
    weights are then of the kernels at the cases.

    Parameters
    ----------
    kernels : (cases, cases) float64
        Products of the features of all cases.
    y, n_classes, weights, groups
        As in `ridge`.
    """
    roots = np.sqrt(weights)
    values, vectors = np.linalg.eigh(roots[:, None] * (kernels + INTERCEPT**2) * roots)
    above = values > 1e-13 * values[-1]
    U, singular = vectors[:, above], np.sqrt(values[above])
    # With U S V' the weighted features, V' = S^-1 U' (weighted features): here of their products.
    at_cases = U.T / singular[:, None] * roots
    Vt = np.concatenate([at_cases, INTERCEPT * at_cases.sum(axis=1, keepdims=True)], axis=1)
    Y = np.eye(n_classes)[y] * roots[:, None]
    return Ridge(U, singular, Vt, Y, roots, _members(groups))


def _members(groups: NDArray[np.int64]) -> tuple[NDArray[np.int64], ...]:
    order = np.argsort(groups, kind="stable")
    return tuple(np.split(order, np.flatnonzero(np.diff(groups[order])) + 1))


INTERCEPT = 10.0
"""Value of the constant feature."""
