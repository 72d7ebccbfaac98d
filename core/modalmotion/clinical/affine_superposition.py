"""Positions superposed from amplitudes, with the affine part of the motion exact.

A heart that contracts uniformly moves by an affine map, which a few modes cannot represent exactly:
the residual biases the volume, always with the same sign. The amplitudes of an affine map follow
from the reference alone. So the map whose amplitudes are nearest to those of the frame is applied
exactly, and the modes carry only the remaining amplitudes. The result has the same amplitudes as
before, and is exact for every affine motion that they determine.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np

from modalmotion.representation import Floats
from modalmotion.signature.fit import Basis, project
from modalmotion.signature.making import ModalSignature, SignatureKind
from modalmotion.signature.superposition import normal_reference
from modalmotion.template import Template
from modalmotion.template.body_frame import (
    HELD,
    Components,
    from_local,
    local_frames,
    to_local,
    unit_coordinates,
)

# Floats of positions in memory at once.
_BLOCK: Final = 500_000


def superposed_positions(
    signature: ModalSignature, template: Template, basis: Basis, rest: Floats
) -> Iterator[tuple[slice, Floats]]:
    """Positions in the frame of the reference, without rotation, some frames at a time.

    Parameters
    ----------
    signature : ModalSignature
    template : Template
    basis : Basis
        Of the signature's modes on the template.
    rest : (vertices, 3) float64
        Reference positions near the origin, in a unit in which they are of size 1.

    Yields
    ------
    frames : slice
    positions : (n, vertices, 3) float64
        In the unit of `rest`, in which the caller passes the amplitudes.
    """
    n_frames, n_vertices = signature.n_frames, len(rest)
    step = max(1, _BLOCK // (3 * n_vertices))
    if signature.kind == SignatureKind.NORMAL_DISPLACEMENT:
        # Normal displacements have no affine part that could be separated.
        normals, _ = normal_reference(template, rest)
        for first in range(0, n_frames, step):
            part = slice(first, first + step)
            u = from_local(_superposed(signature.amplitudes[part], basis.shapes.T), normals)
            yield part, u + rest
        return
    is_local = signature.parameters.components != Components.CARTESIAN
    frames = local_frames(template) if is_local else None
    q = unit_coordinates(rest, template.weights)
    of_maps = _amplitudes_of_maps(basis, q, frames)
    a = signature.amplitudes.reshape(n_frames, -1)
    # a ~ c D by least squares, over the maps that the amplitudes determine
    U, S, Vt = np.linalg.svd(of_maps, full_matrices=False)
    seen = S > HELD
    c = a @ (Vt[seen].T / S[seen] @ U[:, seen].T)
    remaining = (a - c @ of_maps).reshape(signature.amplitudes.shape)
    A, axes = c.reshape(n_frames, -1, 3), np.ascontiguousarray(q.T)
    for first in range(0, n_frames, step):
        part = slice(first, first + step)
        u = _superposed(remaining[part], basis.shapes.T)
        if frames is not None:
            u = from_local(u, frames)
        # x + A q + sum_p a_p phi_p
        u += _superposed(A[part], axes)
        u += rest
        yield part, u


def _superposed(coefficients: Floats, rows: Floats) -> Floats:
    """Sum of fields times coefficients, (frames, vertices, n)."""
    f, m, n = coefficients.shape
    by_direction = np.ascontiguousarray(coefficients.transpose(0, 2, 1)).reshape(n * f, m)
    return (by_direction @ rows).reshape(f, n, -1).transpose(0, 2, 1)


def _amplitudes_of_maps(basis: Basis, q: Floats, frames: Floats | None) -> Floats:
    """Amplitudes of the motions by coordinate i along direction j, (3 i + j, 3 modes) float64."""
    rows = []
    for coordinate in q.T:
        for direction in range(3):
            u = np.zeros((1, 3, len(q)))
            u[0, direction] = coordinate
            if frames is not None:
                u = to_local(u, frames)
            rows.append(project(basis, u.transpose(0, 2, 1)).ravel())
    return np.array(rows)
