"""Normal displacements: surfaces known along the normals of a reference.

A place of the reference has one normal displacement in each frame, the height above it at which the
surface of that frame, its rotation and drift removed, meets the normal there
(`NormalLines.heights`). Where vertices are on the surface does not matter: rotation and drift are
the surface's own, too.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from modalmotion import errors, mesh
from modalmotion.mesh import geometry, triangles
from modalmotion.mesh.alignment import (
    DisplacementBlock,
    Displacements,
    PositionBlock,
    Rotations,
)
from modalmotion.numeric.scales import power_of_two
from modalmotion.representation import Floats, Ints, shown
from modalmotion.template import Template
from modalmotion.template.template import nearest_in_use

# Below this the surface is no more on one side of its centroid than on the other: its winding
# says then which side is outside.
_FLAT: Final = 0.1

# Lines that a rotation is fitted to, and how often: the third turn moves nothing by 0.1 degrees.
_N_TURNING: Final = 512
_N_TURNS: Final = 2

# Of the mean square radius: draws a rotation that the shape hardly determines to that of the
# vertices.
_PULL: Final = 1e-2

# Consecutive multiples of it fall apart evenly: some of the lines, from everywhere. Multiples of
# the golden ratio would all be at one side where points follow a spiral, which goes round by it.
_SPREAD: Final = math.sqrt(2.0) - 1.0


@shown()
@dataclass(frozen=True, eq=False)
class NormalDisplacements:
    """Normal displacements of every frame.

    Parameters
    ----------
    blocks : tuple of DisplacementBlock
        Their displacements are the normal displacements, (frames, 1, vertices); their rotations and
        drifts are those of the surface and of its area centroid.
    directions : (vertices, 1, 3) float64
        Outward unit normals of the reference.
    """

    blocks: tuple[DisplacementBlock, ...]
    directions: Floats


def normal_reference(template: Template, start: Floats) -> tuple[Floats, Floats]:
    """Directions of normal displacements, and the place about which their rotations turn.

    Parameters
    ----------
    template : Template
    start : (vertices, 3) float64, length unit
        The reference.

    Returns
    -------
    directions : (vertices, 1, 3) float64
        Outward unit normals.
    centre : (3,) float64, length unit
        Area centroid.

    Raises
    ------
    TopologyError
        As in `normal_displacements_of`.
    """
    centre = template.weights @ start
    rest = start - centre
    rest[template.isolated] = 0.0
    scale = power_of_two(float(np.abs(rest).max(initial=0.0)))
    reference = _Reference.of(template, rest / scale)
    normals = reference.normals[_to_all_vertices(template)]
    return normals[:, None], centre + reference.centroid * scale


def normal_displacements_of(
    displacements: Displacements, template: Template
) -> NormalDisplacements:
    """Measure the normal displacements of a sequence.

    Parameters
    ----------
    displacements : Displacements
        Of its vertices, from the reference.
    template : Template

    Raises
    ------
    TopologyError
        If the shape is not a surface, or has one side only.
    """
    shape = displacements.shape
    reference = _Reference.of(template, np.ascontiguousarray(shape.rest.T))
    spread = _to_all_vertices(template)
    blocks = []
    for block in displacements.positions():
        heights, rotations, drifts = _measured(block, reference)
        u = np.zeros((len(heights), 1, len(spread)))
        u[:, 0, reference.lines.vertices] = heights
        blocks.append(DisplacementBlock(block.frames, u[:, :, spread], rotations, drifts, shape))
    return NormalDisplacements(tuple(blocks), reference.normals[spread][:, None])


@dataclass(frozen=True, eq=False)
class _Reference:
    """The reference with its lines, centred and in units of its scale.

    Parameters
    ----------
    faces : (faces, 3) int64
        Wound so that normals point outward.
    positions, normals : (vertices, 3) float64
    centroid : (3,) float64
        Of the area.
    lines : NormalLines
    """

    faces: Ints
    positions: Floats
    normals: Floats
    centroid: Floats
    lines: geometry.NormalLines

    @staticmethod
    def of(template: Template, x: Floats) -> "_Reference":
        """Take the positions (vertices, 3) of a template's reference."""
        faces = _sides_of(template)
        centroid = _centroids(x[None], faces)[0]
        of_faces = triangles.face_normals(x, faces)
        r = x[faces].mean(axis=1) - centroid
        outward = np.einsum("ij,ij->i", of_faces, r)
        most = np.linalg.norm(of_faces, axis=1) @ np.linalg.norm(r, axis=1)
        if outward.sum() < -_FLAT * most:
            faces = np.ascontiguousarray(faces[:, ::-1])
        normals = geometry.vertex_normals(x, faces)
        lines = geometry.NormalLines.of(faces, np.unique(faces), x, normals)
        return _Reference(faces, x, normals, centroid, lines)


def _sides_of(template: Template) -> Ints:
    """Triangles of a template, all wound the same way round."""
    faces = template.faces
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    is_surface = template.surface is None or template.surface.n_axes == 2
    if not len(faces) or not is_surface:
        raise errors.TopologyError(
            "Normal displacements need a surface, and this shape is a curve, a volume or points.",
            remedy="Ask for the kind material.",
        )
    oriented = mesh.oriented_faces(faces, template.n_vertices)
    if oriented is None:
        raise errors.TopologyError(
            "The surface is one-sided, so it has no outward normals.",
            remedy="Ask for the kind material.",
        )
    return oriented


def _centroids(x: Floats, faces: Ints) -> Floats:
    """Area centroids of shapes, (frames, 3), of positions (frames, vertices, 3)."""
    centroids = np.empty((len(x), 3))
    for k, positions in enumerate(x):
        areas = np.linalg.norm(triangles.face_normals(positions, faces), axis=1)
        total = float(areas.sum()) or 1.0
        middles = positions[faces].sum(axis=1) / 3.0
        centroids[k] = areas @ middles / total if areas.any() else middles.mean(axis=0)
    return centroids


def _measured(block: PositionBlock, reference: _Reference) -> tuple[Floats, Rotations, Floats]:
    """Heights above all lines, rotations and drifts of a block, in units of the scale."""
    shape, lines, middle = block.shape, reference.lines, reference.centroid
    rotations, _ = block.alignment()
    x = np.ascontiguousarray(block.positions.transpose(0, 2, 1))
    drifts = _centroids(x, reference.faces) - middle
    drifts[block.is_still] = 0.0
    x -= (middle + drifts)[:, None]
    matrices = rotations.matrices
    if block.remove_rotation:
        matrices = _turned(x, matrices, reference, shape.weights)
        matrices[block.is_still] = np.eye(3)
    aligned = x @ matrices
    aligned += middle
    aligned[block.is_still] = reference.positions
    return lines.heights(aligned), Rotations(matrices, rotations.is_determined), drifts


def _turned(x: Floats, matrices: Floats, reference: _Reference, weights: Floats) -> Floats:
    """Turn rotations of vertices into those of the surface: normal displacements are then least.

    A small turn w moves the surface by n . (w x r) along its normals; least squares, from the
    vertices' own rotation on, which stays where the shape determines none, as about the axis of
    a round one. What all lines have in common, as where a surface narrows, is no turn.
    """
    lines = reference.lines
    places = np.modf(np.arange(len(lines.vertices)) * _SPREAD)[0]
    some = lines.some(np.sort(np.argsort(places, kind="stable")[:_N_TURNING]))
    w = weights[some.vertices]
    r = some.starts - reference.centroid
    slopes = np.cross(r, some.directions[:, 2])
    pull = _PULL * float(w @ (r**2).sum(axis=1))
    if pull == 0.0:
        return matrices
    slopes -= w @ slopes / w.sum()
    A = (slopes * w[:, None]).T @ slopes + pull * np.eye(3)
    for _ in range(_N_TURNS):
        heights = some.heights(x @ matrices + reference.centroid)
        turns = np.linalg.solve(A, (heights @ (slopes * w[:, None])).T).T
        matrices = matrices @ scipy.spatial.transform.Rotation.from_rotvec(turns).as_matrix()
    return matrices


def _to_all_vertices(template: Template) -> Ints:
    """Vertex whose displacement each takes: where it coincides with another or has no triangle."""
    spread = template.representatives.copy()
    if len(template.isolated):
        spread[template.isolated] = nearest_in_use(template.vertices, template.isolated)
    return spread
