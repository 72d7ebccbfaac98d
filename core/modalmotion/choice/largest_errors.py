"""Largest error of any vertex for many nested sets, in one pass over the frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.energies import Energies
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.nested_sets import Ladder
from modalmotion.numeric.products import product
from modalmotion.numeric.scale import lengths


def largest_errors(
    fitter: Fitter, ladder: Ladder, energies: Energies, counts: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Largest error of any vertex in any frame for each of several nested sets.

    Unlike the RMS error it may grow with the set, so none can be left out. Each set's
    residual is that of the one before without its further modes.

    Parameters
    ----------
    fitter : Fitter
    ladder : Ladder
    energies : Energies
        Their coefficients may have been limited to harmonics.
    counts : (sets,) int64
        Increasing.

    Returns
    -------
    (sets,) float64, length unit
    """
    basis, last = ladder.basis, int(counts[-1])
    # u = sum_j c_j psi_j
    psi = basis.orthonormal_rows(last)
    largest = np.zeros(len(counts))
    for block in fitter.displacements.blocks():
        scale = block.shape.scale
        u, loose_u = fitter.in_components(block)
        loose_psi = np.ascontiguousarray(psi[:, block.loose].T)
        f, n_directions, n = u.shape
        c = energies.coefficients[block.frames] * (energies.scale / scale)
        rows = u.reshape(n_directions * f, n)
        flat = np.ascontiguousarray(c.transpose(0, 2, 1)).reshape(n_directions * f, -1)
        done = 0
        for k, count in enumerate(counts.tolist()):
            rows -= product(np.ascontiguousarray(flat[:, done:count]), psi[done:count])
            loose_u = loose_u - loose_psi[:, done:count] @ (
                energies.coefficients[block.frames, done:count] * energies.scale
            )
            done = count
            squares = (rows.reshape(f, n_directions, n) ** 2).sum(axis=1)
            squares[:, block.shape.ignored] = 0.0
            largest[k] = max(
                largest[k],
                scale * float(np.sqrt(squares.max())),
                float(lengths(loose_u).max(initial=0.0)),
            )
    return largest
