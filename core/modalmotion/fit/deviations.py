"""Standard deviations of amplitudes: what errors of the positions make of them.

To first order an amplitude is linear in the errors e of the positions. Its error is

    sum_v P_jv q_vi . (e_v - rho_v(e)),

P the projector of the fit, q_vi what component i of vertex v answers to, and rho(e) the rigid
motion that the fit takes out of e: for displacements the turn that fits them best, for offsets the
path of the area centroid and the turn that makes offsets least.

An offset answers to the part of e along the normal n of the frame's surface, over the cosine of its
angle with the line that the offset is measured on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.fit.basis import Basis
from modalmotion.mesh.areas import face_normals
from modalmotion.mesh.normal_lines import vertex_normals
from modalmotion.mesh.sequence import MEAN, MeshSequence, Reference
from modalmotion.mesh.uncertainty import Uncertainty
from modalmotion.numeric.products import product
from modalmotion.numeric.scale import power_of_two
from modalmotion.template import Template

# Below this cosine the surface has turned away from the line: it meets it at the rim, whose
# points move along the line as they are.
_STEEP = 0.5

# Of the mean square radius: keeps the turn that the shape says nothing about.
_PULL = 1e-2


def amplitude_deviations(
    sequence: MeshSequence,
    uncertainty: Uncertainty,
    template: Template,
    basis: Basis,
    rotations: NDArray[np.float64],
    reference: Reference,
    *,
    directions: NDArray[np.float64] | None = None,
    is_offset: bool = False,
    remove_rotation: bool = True,
) -> NDArray[np.float64]:
    """Propagate errors of positions to amplitudes.

    Parameters
    ----------
    sequence : MeshSequence
    uncertainty : Uncertainty
        Of its positions.
    template : Template
        Taken as exact: an error of the coordinates on it is not counted.
    basis : Basis
        The modes that were fitted.
    rotations : (frames, 3, 3) float64
        Removed before the fit.
    reference : int or "mean"
        What displacements are measured from, whose own errors count too.
    directions : (vertices, n, 3) float64, optional
        Local directions of the components; x, y, z by default. Of offsets the lines.
    is_offset : bool
    remove_rotation : bool

    Returns
    -------
    (frames, modes, n) float64, length unit
        Zero in the reference frame.
    """
    covariances = uncertainty.across if is_offset else uncertainty.along
    own = np.empty(
        (sequence.n_frames, len(basis.modes), 3 if directions is None else directions.shape[1])
    )
    # Squares of lengths in any unit neither overflow nor vanish.
    unit = power_of_two(float(np.abs(sequence.vertices).max(initial=0.0)))
    for f, vertices in enumerate(sequence.vertices):
        x, R = vertices.astype(np.float64) / unit, rotations[f]
        q = _answers(x, template, R, directions, is_offset=is_offset)
        rigid = _rigid(x, template, q, is_offset=is_offset, remove_rotation=remove_rotation)
        covariance, rest = covariances[f] / unit / unit, float(uncertainty.rest[f]) / unit
        own[f] = _deviations(basis.projector, q, rigid, uncertainty, covariance, rest)
    return unit * _from_reference(own, uncertainty.between_frames, reference)


@dataclass(frozen=True, eq=False)
class _Rigid:
    """Rigid motions that the fit takes out.

    Parameters
    ----------
    moves : (vertices, 3, k) float64
        Displacement of each vertex by each.
    sizes : (k, vertices, 3) float64
        How much of each is in an error of each vertex.
    """

    moves: NDArray[np.float64]
    sizes: NDArray[np.float64]


def _answers(
    x: NDArray[np.float64],
    template: Template,
    R: NDArray[np.float64],
    directions: NDArray[np.float64] | None,
    *,
    is_offset: bool,
) -> NDArray[np.float64]:
    """Find what each component of each vertex answers to, (vertices, n, 3), before turning back."""
    if directions is None:
        return np.broadcast_to(R.T, (len(x), 3, 3))
    lines: NDArray[np.float64] = directions @ R.T
    if not is_offset:
        return lines
    normals = vertex_normals(x, template.faces)[template.representatives]
    line = lines[:, 0]
    cosines = (normals * line).sum(axis=1)
    # Which way triangles are wound is no matter.
    steep = np.abs(cosines) < _STEEP
    answers: NDArray[np.float64] = normals / np.where(steep, 1.0, cosines)[:, None]
    answers[steep] = line[steep]
    return answers[:, None]


def _rigid(
    x: NDArray[np.float64],
    template: Template,
    q: NDArray[np.float64],
    *,
    is_offset: bool,
    remove_rotation: bool,
) -> _Rigid:
    """Rigid motions in an error of a frame's positions."""
    w = template.weights
    if not is_offset:
        if not remove_rotation:
            return _Rigid(np.zeros((len(x), 3, 0)), np.zeros((0, len(x), 3)))
        r = x - w @ x
        turns = np.stack([np.cross(axis, r) for axis in np.eye(3)], axis=2)
        inertia = np.einsum("v,vik,vil->kl", w, turns, turns)
        sizes = (
            np.linalg.pinv(inertia, hermitian=True) @ (turns * w[:, None, None]).reshape(-1, 3).T
        )
        return _Rigid(turns, sizes.reshape(3, len(x), 3))
    centroid, drift = _centroid_slopes(x, template.faces)
    shifts = np.broadcast_to(np.eye(3), (len(x), 3, 3))
    if not remove_rotation:
        return _Rigid(shifts, drift)
    r = x - centroid
    along = q[:, 0]
    slopes = np.cross(r, along)
    weighted = slopes * w[:, None]
    pull = _PULL * float(w @ (r**2).sum(axis=1))
    A = weighted.T @ slopes + pull * np.eye(3)
    # Offsets, the drift taken out, lead to the turn.
    heights = weighted.T[:, :, None] * along
    heights -= np.tensordot(weighted.T @ along, drift, axes=1)
    turn = np.linalg.solve(A, heights.reshape(3, -1)).reshape(3, len(x), 3)
    turns = np.stack([np.cross(axis, r) for axis in np.eye(3)], axis=2)
    return _Rigid(np.concatenate([shifts, turns], axis=2), np.concatenate([drift, turn]))


def _centroid_slopes(
    x: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Area centroid, (3,), and its derivatives by the positions, (3, vertices, 3).

    C = sum A m / sum A with areas A and middles m: dC = sum ((m - C) dA + A dm) / sum A.
    """
    n = face_normals(x, faces)
    size = np.linalg.norm(n, axis=1)
    areas, unit = size / 2.0, n / np.where(size > 0, size, 1.0)[:, None]
    total = float(areas.sum()) or 1.0
    middles = x[faces].mean(axis=1)
    centroid: NDArray[np.float64] = areas @ middles / total
    slopes = np.zeros((len(x), 3, 3))
    for k in range(3):
        side = x[faces[:, (k + 2) % 3]] - x[faces[:, (k + 1) % 3]]
        growth = 0.5 * np.cross(unit, side)
        part = (middles - centroid)[:, :, None] * growth[:, None]
        part += (areas / 3.0)[:, None, None] * np.eye(3)
        np.add.at(slopes, faces[:, k], part / total)
    return centroid, np.ascontiguousarray(slopes.transpose(1, 0, 2))


def _deviations(
    P: NDArray[np.float64],
    q: NDArray[np.float64],
    rigid: _Rigid,
    uncertainty: Uncertainty,
    covariance: NDArray[np.float64],
    rest: float,
) -> NDArray[np.float64]:
    """State the standard deviations in one frame, (modes, n)."""
    n_modes, n_vertices = P.shape
    n, k, m = q.shape[1], len(rigid.sizes), uncertainty.shapes.shape[1]
    # How much each rigid motion adds to each amplitude.
    answers = np.einsum("vic,vck->vik", q, rigid.moves).reshape(n_vertices, n * k)
    of_rigid = product(P, np.ascontiguousarray(answers)).reshape(n_modes, n, k)
    # Errors apart: each vertex counts with its own, and with those that are the same.
    squares = product(P**2, uncertainty.alike[:, None] * (q**2).sum(axis=2))
    spread = rigid.sizes * uncertainty.alike[:, None]
    mixed = np.einsum("vic,kvc->vik", q, spread).reshape(n_vertices, n * k)
    mixed = product(P, np.ascontiguousarray(mixed)).reshape(n_modes, n, k)
    gram = np.einsum("kvc,lvc->kl", spread, rigid.sizes)
    variances = squares - 2.0 * (mixed * of_rigid).sum(axis=2)
    variances += np.einsum("jik,kl,jil->ji", of_rigid, gram, of_rigid)
    variances *= rest**2
    if m:
        L = np.empty((n_modes, n, m, 3))
        sizes = np.empty((k, m, 3))
        for c in range(3):
            for i in range(n):
                L[:, i, :, c] = product(P * q[:, i, c], uncertainty.shapes)
            sizes[:, :, c] = product(np.ascontiguousarray(rigid.sizes[:, :, c]), uncertainty.shapes)
        L -= np.tensordot(of_rigid, sizes, axes=1)
        flat = L.reshape(n_modes * n, 3 * m)
        variances += (product(flat, covariance) * flat).sum(axis=1).reshape(n_modes, n)
    deviations: NDArray[np.float64] = np.sqrt(np.maximum(variances, 0.0))
    return deviations


def _from_reference(
    own: NDArray[np.float64], between_frames: float, reference: Reference
) -> NDArray[np.float64]:
    """Deviations of differences from the reference, whose errors are correlated with a frame's.

    var(e - e') = s^2 - 2 c s s' + s'^2; of the mean shape with all frames' errors in it.
    """
    frames = np.arange(len(own))
    lags = np.abs(frames[:, None] - frames)
    correlations = np.float64(between_frames) ** lags
    if reference == MEAN:
        mixed = own * np.tensordot(correlations, own, axes=1) / len(own)
        variances = own**2 - 2.0 * mixed + mixed.mean(axis=0)
    else:
        c = correlations[:, reference][:, None, None]
        variances = own**2 - 2.0 * c * own * own[reference] + own[reference] ** 2
    deviations: NDArray[np.float64] = np.sqrt(np.maximum(variances, 0.0))
    return deviations
