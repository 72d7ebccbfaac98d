"""Energies of a motion where all vertices count alike, whatever their share of the surface."""

from __future__ import annotations

import numpy as np

from modalmotion.choice.energies import Energies, energies_of
from modalmotion.choice.fitter import Fitter
from modalmotion.fit.basis import Basis
from modalmotion.fit.fit import Fit
from modalmotion.numeric.products import product
from modalmotion.numeric.scale import power_of_two


def plain_energies_of(fitter: Fitter, basis: Basis, fit: Fit) -> Energies:
    """Take the plain energies of a motion from the fit of the largest set.

    Parameters
    ----------
    fitter : Fitter
    basis : Basis
        Of the largest set, in the order of the fit's amplitudes.
    fit : Fit
    """
    weighted = energies_of(basis, fit)
    # A scale of its own: vertices in no triangle may lie anywhere.
    largest = max(float(fit.motion_rms.max()), float(np.abs(fit.amplitudes).max(initial=0.0)))
    scale = power_of_two(largest)
    m, n = basis.projector.shape
    psi = basis.orthonormal_rows(m)
    columns = np.ascontiguousarray(psi.T)
    cross = np.empty_like(weighted.coefficients)
    for block in fitter.displacements.blocks():
        u, loose_u = fitter.in_components(block)
        c = weighted.coefficients[block.frames]
        loose_u = loose_u - columns[block.loose] @ (c * weighted.scale)
        f, n_directions, _ = u.shape
        c = c * (weighted.scale / block.shape.scale)
        # r = u - sum_j c_j psi_j
        rows = u.reshape(n_directions * f, n)
        flat = np.ascontiguousarray(c.transpose(0, 2, 1)).reshape(n_directions * f, m)
        rows -= product(flat, psi)
        rows *= block.shape.scale / scale
        u[:, :, block.loose] = loose_u.transpose(0, 2, 1) / scale
        dots = product(rows, columns).reshape(f, n_directions, m)
        cross[block.frames] = dots.transpose(0, 2, 1) / n
    return Energies(
        coefficients=weighted.coefficients * (weighted.scale / scale),
        outside=(fit.errors.rms / scale) ** 2,
        scale=scale,
        overlaps=product(psi, columns) / n,
        cross=cross,
    )
