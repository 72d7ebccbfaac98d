"""Largest error of any vertex for many nested sets, in one pass over the frames."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from modalmotion.alignment.reference import displacement_blocks
from modalmotion.choice.energies import Energies
from modalmotion.choice.nested_sets import Ladder
from modalmotion.choice.parameters import SignatureParameters
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product
from modalmotion.numeric.qr import inverse_of_triangle
from modalmotion.template import Template
from modalmotion.template.body_frame import Components, local_frames, to_local


def largest_errors(
    sequence: MeshSequence,
    template: Template,
    ladder: Ladder,
    energies: Energies,
    counts: NDArray[np.int64],
    asked: SignatureParameters,
) -> NDArray[np.float64]:
    """Largest error of any vertex in any frame for each of several nested sets.

    Unlike the RMS error it may grow with the set, so none can be left out. Each set's
    residual is that of the one before without its further modes.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
    ladder : Ladder
    energies : Energies
        Their coefficients may have been limited to harmonics.
    counts : (sets,) int64
        Increasing.
    asked : SignatureParameters

    Returns
    -------
    (sets,) float64, length unit
    """
    basis, last = ladder.basis, int(counts[-1])
    # u = sum_j c_j psi_j with the orthonormal shapes psi = Phi R^-1
    inverse = inverse_of_triangle(np.ascontiguousarray(basis.triangle[:last, :last]))
    psi = product(np.ascontiguousarray(inverse.T), basis.rows[:last])
    frames = None if asked.components == Components.CARTESIAN else local_frames(template)
    largest = np.zeros(len(counts))
    first = 0
    for u, _, scale in displacement_blocks(
        sequence, template.weights, reference=asked.reference, remove_rotation=asked.remove_rotation
    ):
        r = u.transpose(0, 2, 1)
        if frames is not None:
            r = to_local(r, frames)
        f, _, n = r.shape
        c = energies.coefficients[first : first + f] * (energies.scale / scale)
        rows = np.ascontiguousarray(r).reshape(3 * f, n)
        flat = np.ascontiguousarray(c.transpose(0, 2, 1)).reshape(3 * f, -1)
        done = 0
        for k, count in enumerate(counts.tolist()):
            rows -= product(np.ascontiguousarray(flat[:, done:count]), psi[done:count])
            done = count
            squares = (rows.reshape(f, 3, n) ** 2).sum(axis=1)
            squares[:, template.isolated] = 0.0
            largest[k] = max(largest[k], scale * float(np.sqrt(squares.max())))
        first += f
    return largest
