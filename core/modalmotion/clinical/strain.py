"""Strain of a ventricle's wall, where its points follow the tissue."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.segments import at_places, require_ventricle
from modalmotion.errors import ParameterError
from modalmotion.mesh import face_normals
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on, reconstruct
from modalmotion.template import Template

DIRECTIONS = ("circumferential", "longitudinal")
"""Directions of strain, along the surface."""


@shown("names", "whole", "by_segment", "sequence_id")
@dataclass(frozen=True, eq=False)
class Strain:
    """Lagrangian strain since end diastole, percent: how much longer the wall is, negative shorter.

    Parameters
    ----------
    names : tuple of str
        Of the segments, or of the rings: see `RegionalMotion`.
    whole : (frames, 2) float64, percent
        Mean over the surface, circumferential and longitudinal.
    whole_bounds : (frames, 2) float64, percentage points
        Difference of these from the mean that the signature's own surfaces have: what leaving
        out all other modes does to it. No accuracy of the measurement.
    by_segment : (frames, segments, 2) float64, percent
        NaN for a segment without triangles.
    end_diastole : int
        Frame from which strain is measured.
    reason : str
        Why there are rings only; empty where there are segments.
    sequence_id : str
    """

    names: tuple[str, ...]
    whole: NDArray[np.float64]
    whole_bounds: NDArray[np.float64]
    by_segment: NDArray[np.float64]
    end_diastole: int
    reason: str
    sequence_id: str

    @property
    def peak(self) -> NDArray[np.float64]:
        """Most negative strain of the whole in each direction, (2,) float64, percent."""
        peak: NDArray[np.float64] = self.whole.min(axis=0)
        return peak


def wall_strain(
    signature: ModalSignature,
    sequence: MeshSequence,
    end_diastole: int,
    *,
    template: Template | None = None,
) -> Strain:
    """Measure the strain of a ventricle's wall along and around it.

    The wall is a surface, so there is no radial strain: that needs a second wall.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from, as it was sent.
    end_diastole : int
        Frame of the undeformed wall.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Returns
    -------
    Strain

    Raises
    ------
    ParameterError
        If nothing says that the points follow the tissue.
    TopologyError
        If the surface is not a cup.

    Notes
    -----
    Of each triangle the deformation gradient F from end diastole; the strain along a unit vector e
    is |F e| - 1: Lagrangian strain, as in Voigt et al., Definitions for a common standard for 2D
    speckle tracking echocardiography, Eur Heart J Cardiovasc Imaging, 2015.
    """
    if sequence.facts.tracking != "material" and signature.facts.tracking != "material":
        raise ParameterError(
            "Strain is how far points of the tissue move apart; nothing says that these vertices "
            "follow the tissue.",
            remedy="State the fact tracking=material where they do (tagging, feature tracking).",
        )
    used = fitted_on(signature, sequence, template)
    landmarks = require_ventricle(used, signature.surface)
    faces = used.faces
    start = sequence.vertices[end_diastole].astype(np.float64)
    directions, areas = _directions(start, faces, landmarks.axis, landmarks.origin)
    own = np.empty((sequence.n_frames, len(faces), 2))
    modal = np.empty_like(own)
    edges = _edges(start, faces)
    # e = E w: e along the edges of its triangle; then F e is the same sum of moved edges.
    weights = np.linalg.pinv(edges) @ directions
    first = _edges(reconstruct(signature, sequence, [end_diastole])[0], faces)
    modal_weights = np.linalg.pinv(first) @ directions
    for frame in range(sequence.n_frames):
        x = sequence.vertices[frame].astype(np.float64)
        own[frame] = _stretches(x, faces, weights)
        superposed = reconstruct(signature, sequence, [frame])[0]
        modal[frame] = _stretches(superposed, faces, modal_weights)
    names, place, reason = at_places(
        used,
        sequence.facts,
        used.coordinates[faces, 0].mean(axis=1),
        used.vertices[faces].mean(axis=1),
    )
    by_segment = np.full((sequence.n_frames, len(names), 2), np.nan)
    for number in range(len(names)):
        mine = np.where(place == number, areas, 0.0)
        if mine.any():
            by_segment[:, number] = np.einsum("f,tfd->td", mine / mine.sum(), own)
    share = areas / areas.sum()
    whole = 100.0 * np.einsum("f,tfd->td", share, own)
    of_modes = 100.0 * np.einsum("f,tfd->td", share, modal)
    return Strain(
        names=names,
        whole=whole,
        whole_bounds=np.abs(whole - of_modes),
        by_segment=100.0 * by_segment,
        end_diastole=end_diastole,
        reason=reason,
        sequence_id=signature.sequence_id,
    )


def _edges(x: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Two edges of each triangle as columns, (faces, 3, 2)."""
    a, b, c = (x[faces[:, k]] for k in range(3))
    return np.stack([b - a, c - a], axis=2)


def _directions(
    x: NDArray[np.float64],
    faces: NDArray[np.int64],
    axis: NDArray[np.float64],
    origin: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Around the axis and along the wall in each triangle, (faces, 3, 2), and its area."""
    normals = face_normals(x, faces)
    size = np.linalg.norm(normals, axis=1)
    units = normals / np.where(size > 0, size, 1.0)[:, None]
    around = np.cross(axis, x[faces].mean(axis=1) - origin)
    # Within the triangle's plane.
    around -= (around * units).sum(axis=1)[:, None] * units
    length = np.linalg.norm(around, axis=1)
    around /= np.where(length > 0, length, 1.0)[:, None]
    return np.stack([around, np.cross(units, around)], axis=2), size / 2.0


def _stretches(
    x: NDArray[np.float64], faces: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.float64]:
    """|F e| - 1 along both directions, (faces, 2)."""
    stretched: NDArray[np.float64] = np.linalg.norm(_edges(x, faces) @ weights, axis=1) - 1.0
    return stretched
