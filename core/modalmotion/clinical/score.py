"""Comparison of an estimated motion with the true one, by published measures."""

from dataclasses import dataclass
from typing import Final

import numpy as np

from modalmotion import errors, mesh
from modalmotion.clinical.strain import wall_strain
from modalmotion.mesh.sequence import MM_PER_UNIT, MeshSequence
from modalmotion.representation import Floats, shown
from modalmotion.template import make_template
from modalmotion.tracking.closest import closest_points

LEVELS: Final = (1 / 6, 1 / 2, 5 / 6)
WALLS: Final = 4
"""Landmarks: four around, at the middles of three thirds of the wall from apex to base."""

PUBLISHED: Final = "2.9, 2.14, 1.96, 1.49"
"""End-point errors in publications, mm, of other recordings and landmarks."""


@shown(
    "end_point_end_systole", "along_normal", "ejection_fraction", "gls", "gcs", "inside", "stated"
)
@dataclass(frozen=True)
class Score:
    """Errors of an estimated motion.

    Parameters
    ----------
    end_point, end_point_end_systole : float, mm
        Mean distance between 12 landmarks moved by either surface: over all later frames, and at
        the true end systole.
    along_normal : float, mm
        Mean distance of the true vertices from the estimated surface, all frames.
    ejection_fraction, gls, gcs : float, percentage points
        Estimated minus true.
    inside : float or None
        Share of estimated vertices within 1.96 stated deviations of the true surface. None if no
        deviation is stated.
    stated : float or None, mm
        Mean of the stated deviations: a large share is easily had by large deviations.
    """

    end_point: float
    end_point_end_systole: float
    along_normal: float
    ejection_fraction: float
    gls: float
    gcs: float
    inside: float | None
    stated: float | None


def score(truth: MeshSequence, answer: MeshSequence, deviations: Floats | None = None) -> Score:
    """Compare an estimated motion with the true one, frame by frame.

    Parameters
    ----------
    truth, answer : MeshSequence
        Of the same frames, in the same coordinates; meshes may differ. An unknown unit counts as
        mm.
    deviations : (frames, vertices) float64, optional
        Stated standard deviation of each vertex of the answer across the surface, mm; 0 if none
        is stated of a vertex.

    Raises
    ------
    ShapeError
        If the numbers of frames differ, or deviations do not belong to the answer.
    NonFiniteError
        If a deviation is negative or not a number.
    TopologyError
        If a surface has no cavity, or is not a cup, tube or sphere.
    """
    if truth.n_frames != answer.n_frames:
        raise errors.ShapeError(
            f"The true motion has {truth.n_frames} frames, the answer {answer.n_frames}.",
            remedy="Give both at the same times: see `modalmotion.resample`.",
        )
    if deviations is not None and deviations.shape != answer.vertices.shape[:2]:
        raise errors.ShapeError(
            f"deviations have the shape {deviations.shape}, the answer's vertices "
            f"{answer.vertices.shape}.",
            remedy="Give one number for each vertex in each frame.",
        )
    if deviations is not None and len(bad := np.argwhere(~(deviations >= 0))):
        frame, vertex = bad[0]
        raise errors.NonFiniteError(
            f"The deviation of vertex {vertex} in frame {frame} is {deviations[frame, vertex]}.",
            remedy="Give standard deviations in mm, or 0 if unknown.",
        )
    x, y = (MM_PER_UNIT[s.unit or "mm"] * s.vertices.astype(np.float64) for s in (truth, answer))
    places = np.array([(s, 2 * np.pi * k / WALLS) for s in LEVELS for k in range(WALLS)])
    s, theta = make_template(truth).coordinates.T
    marks = [int(np.argmin((s - a) ** 2 + np.sin((theta - b) / 2) ** 2)) for a, b in places]
    held = closest_points(x[0, marks], y[0], answer.faces)
    moved = np.einsum("nk,fnki->fni", held.shares, y[:, held.corners]) - held.feet
    ends = np.linalg.norm(moved - (x[:, marks] - x[0, marks]), axis=2).mean(axis=1)
    away = [closest_points(a, b, answer.faces).distances.mean() for a, b in zip(x, y, strict=True)]
    (*true, systole), (*estimated, _) = _figures(truth), _figures(answer)
    ef, gls, gcs = np.subtract(estimated, true).tolist()
    inside = stated = None
    if deviations is not None and (is_stated := deviations > 0).any():
        off = [closest_points(b, a, truth.faces).distances for a, b in zip(x, y, strict=True)]
        inside = float((np.array(off) <= 1.96 * deviations)[is_stated].mean())
        stated = float(deviations[is_stated].mean())
    return Score(
        end_point=float(ends[1:].mean()) if len(ends) > 1 else 0.0,
        end_point_end_systole=float(ends[systole]),
        along_normal=float(np.mean(away)),
        ejection_fraction=ef,
        gls=gls,
        gcs=gcs,
        inside=inside,
        stated=stated,
    )


def _figures(sequence: MeshSequence) -> tuple[float, float, float, int]:
    template = make_template(sequence)
    cavity = mesh.cavity_of(template.faces, template.n_vertices)
    volumes = np.abs(cavity.volume(sequence.vertices.astype(np.float64)))
    start, end = int(volumes.argmax()), int(volumes.argmin())
    strain = wall_strain(sequence, template, start, end).end_systolic
    ejected = 100.0 * float(1.0 - volumes[end] / volumes[start])
    return ejected, strain["GLS"].value, strain["GCS"].value, end
