"""How far a track may be off, how well it fits, and what its user should know of it."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from modalmotion.mesh import face_areas, geometry, vertex_areas
from modalmotion.mesh.checks import Uncertainty
from modalmotion.modes.topologies import CLOSED, CUP, SPHERE
from modalmotion.notes import Note
from modalmotion.representation import Floats, Ints
from modalmotion.template import Template
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.first_shape import FirstShape
from modalmotion.tracking.map_frames import FramesEstimate
from modalmotion.tracking.normal_equations import NormalEquations
from modalmotion.tracking.observation import Frame, ends_in, states_end
from modalmotion.tracking.result import Track, cavity_in, normals_of


def deviations_at(
    shapes: Floats, normals: Floats, across: Floats, along: Floats, truncation: float
) -> Floats:
    """State how far each vertex may be off along its normal, and in each tangent direction.

    Parameters
    ----------
    shapes : (vertices, modes) float64
    normals : (vertices, 3) float64
    across : (3 modes, 3 modes) float64, length unit squared
        As `across_covariance` returns it.
    along : (3 modes, 3 modes) float64, length unit squared
        Of the amplitudes, where frames that see the same truncation count as one.
    truncation : float, length unit
        T, of what the modes leave in each direction.

    Returns
    -------
    (vertices, 2) float64, length unit
    """
    n = np.einsum("vi,vij,vj->v", normals, _at(shapes, across), normals)
    full = _at(shapes, along)
    rest = np.trace(full, axis1=1, axis2=2) - np.einsum("vi,vij,vj->v", normals, full, normals)
    variances = np.stack([n, rest / 2.0], axis=1) + truncation**2
    deviations: Floats = np.sqrt(np.maximum(variances, 0.0))
    return deviations


def uncertainty_of(
    template: Template,
    shapes: Floats,
    across: Floats,
    along: Floats,
    truncations: Floats,
    n_values: float,
    pinned: int | None,
) -> Uncertainty:
    """Put together how far all positions of a track may be off.

    Parameters
    ----------
    template : Template
    shapes : (vertices, modes) float64
    across, along : (frames, 3 modes, 3 modes) float64, length unit squared
        As for `deviations_at`.
    truncations : (frames,) float64, length unit
    n_values : float
        Independent values of what the modes leave: each is shared by a patch of the surface.
    pinned : int or None
        Frame that is known.
    """
    if pinned is not None:
        along = along.copy()
        along[pinned] = 0.0
    w = template.weights
    return Uncertainty(
        source="track",
        shapes=shapes,
        across=across,
        along=along,
        rest=truncations,
        # A vertex without a share of the surface counts for nothing.
        alike=1.0 / (n_values * np.where(w > 0, w, np.inf)),
    )


def volume_deviation(
    gradient: Floats, of_lids: Floats, across: Floats, along: Floats, beyond: float
) -> float:
    """State how far a volume may be off, length unit cubed.

    The volume is linear in small changes of the amplitudes. Rims move along the surface where they
    move their lids: there residuals show nothing of it, and the whole covariance counts.

    Parameters
    ----------
    gradient : (modes, 3) float64, length unit squared
        Of the volume by the amplitudes.
    of_lids : (modes, 3) float64, length unit squared
        Of the part of it that the lids of openings move.
    across, along : (3 modes, 3 modes) float64, length unit squared
        As for `deviations_at`.
    beyond : float, length unit cubed
        Deviation by what the modes leave.
    """
    g = gradient.reshape(-1, 1)
    lid = of_lids.reshape(-1, 1)
    variance = float((g * (across @ g)).sum()) + beyond**2
    variance += max(float((lid * ((along - across) @ lid)).sum()), 0.0)
    return float(np.sqrt(max(variance, 0.0)))


def _at(shapes: Floats, covariance: Floats) -> Floats:
    """Covariance of each vertex, (vertices, 3, 3)."""
    m = shapes.shape[1]
    C = covariance.reshape(m, 3, m, 3)
    full = np.empty((len(shapes), 3, 3))
    for i in range(3):
        for j in range(i, 3):
            half = shapes @ C[:, i, :, j]
            full[:, i, j] = full[:, j, i] = (half * shapes).sum(axis=1)
    return full


def stated_deviations(
    surface: Deformable,
    vertices: Floats,
    found: FramesEstimate,
    truncations: Floats,
    n_values: float,
    pinned: int | None,
    shape: FirstShape | None = None,
) -> tuple[Floats, Floats | None]:
    """Deviations of vertices and of volumes; none where the surface is known.

    Where the points of the reference left holes, its own shape is open by more than on most of the
    surface, in all frames.
    """
    template = surface.template
    cavity = cavity_in(template)
    of_vertices = np.zeros((*vertices.shape[:2], 2))
    of_volumes = None if cavity is None else np.zeros(len(vertices))
    for k, x in enumerate(vertices):
        if k == pinned:
            continue
        T = float(truncations[k])
        of_vertices[k] = deviations_at(
            surface.shapes, normals_of(template, x), found.across[k], found.lasting[k], T
        )
        if cavity is not None and of_volumes is not None:
            gradient = surface.shapes.T @ geometry.volume_gradient(cavity, x)
            of_lids = surface.shapes.T @ geometry.lid_gradient(cavity, x)
            # The mean of what the modes leave over the surface is T / sqrt(n_values).
            beyond = float(face_areas(x, cavity.faces).sum()) * T / n_values**0.5
            of_volumes[k] = volume_deviation(
                gradient, of_lids, found.across[k], found.lasting[k], beyond
            )
            if shape is not None:
                # What the wall sweeps along its normals: rims along it are found in every frame.
                swept = vertex_areas(x, template.faces)[:, None] * normals_of(template, x)
                g = (shape.shapes.T @ swept).reshape(-1)
                of_volumes[k] = np.hypot(of_volumes[k], (g @ shape.covariance @ g) ** 0.5)
    if shape is not None:
        own = deviations_at(
            shape.shapes,
            normals_of(template, template.vertices),
            shape.covariance,
            shape.covariance,
            0.0,
        )[:, 0]
        beyond = np.maximum(own**2 - np.median(own) ** 2, 0.0)
        of_vertices[:, :, 0] = np.sqrt(of_vertices[:, :, 0] ** 2 + beyond)
    return of_vertices, of_volumes


# Cells of the natural coordinates in which a point covers the surface.
_CELLS: Final = {1: (24,), 2: (6, 12)}

# Of the RMS radius: points farther than that from the surface show none, or several.
_THICK: Final = 0.1

# Least spread of a surface that encloses a volume over its largest; extent of a frame's points over
# that of most; way of its surface's centre from the middle of its neighbours over the usual size.
_FLAT: Final = 0.06
_OTHER_SIZE: Final = 4.0
_JUMP: Final = 2.0

# Percentage points of the ejection fraction.
_WIDE_BOUND: Final = 5.0

# Shares of the surface that points are at, and of the points that counted, below which it is said.
_LOW_COVERAGE: Final = 0.8
_LOW_INLIERS: Final = 0.5

# Of the way from apex to base, the middle and half the length of the whole, and of parts near the
# apex and near the base; fewest vertices in each.
_PARTS: Final = ((0.5, 0.4), (0.2, 0.1), (0.8, 0.1))
_FEWEST: Final = 3

# Of the mean radius: how far the middle may be beside the axis; radius near the apex over that near
# the base, above which the two may be taken for one another.
_ASIDE: Final = 0.35
_SWAPPED: Final = 1.05

_ALONG: Final = Note.of("along_surface")
_GUESSED: Final = Note.of("treated_as_closed")


def quality_of(surface: Deformable, info: NormalEquations) -> tuple[float, float, float, float]:
    """Measure the fit of one frame.

    Returns
    -------
    rms, p95 : float, length unit
        Of the distances of the points that counted; NaN without any.
    inliers : float
        Share of the points that counted.
    coverage : float
        Share of the surface in cells that points are at.
    """
    counted = info.weights > 0
    if not counted.any():
        return np.nan, np.nan, 0.0, 0.0
    size = np.linalg.norm(info.residuals[counted], axis=1)
    template = surface.template
    shape = _CELLS[template.topology.n_axes]
    places = np.array(template.coordinates)
    is_closed = [end == CLOSED for end in template.topology.ends]
    places[:, is_closed] %= 1.0
    cells = np.clip((places * shape).astype(np.int64), 0, np.array(shape) - 1)
    cell = np.ravel_multi_index(tuple(cells.T), shape)
    share = np.bincount(cell, template.weights, minlength=int(np.prod(shape)))
    touched = np.unique(cell[info.feet[counted]])
    return (
        float(np.sqrt((size**2).mean())),
        float(np.quantile(size, 0.95)),
        float(info.weights[counted].sum() / len(info.weights)),
        float(share[touched].sum()),
    )


def notes_on(result: Track) -> list[Note]:
    """Return notes on what was not seen, what the prior added, and what makes a track doubtful."""
    seen = np.array([k not in result.unseen for k in range(result.n_frames)])
    x = result.sequence.vertices.astype(np.float64)
    centres = x.mean(axis=1)
    spreads = np.linalg.svd(x - centres[:, None], compute_uv=False) / np.sqrt(x.shape[1])
    sizes = np.linalg.norm(spreads, axis=1)
    size = float(np.median(sizes))
    away = np.zeros(len(x))
    away[1:-1] = np.linalg.norm(centres[1:-1] - (centres[:-2] + centres[2:]) / 2.0, axis=1)
    is_other = (sizes * _OTHER_SIZE < size) | (sizes > _OTHER_SIZE * size)
    # Its neighbours are half as far from theirs.
    is_away = away > max(_JUMP * size, 0.75 * float(away.max()))
    is_low = (result.coverage < _LOW_COVERAGE) & seen
    least = result.coverage[is_low].min(initial=1.0)
    far = result.residuals[:, 0]
    farthest = np.nanmax(far, initial=0.0)
    checks = {
        "frames_unobserved": ~seen,
        "coverage_low": is_low,
        "outliers": (result.inliers > 0) & (result.inliers < _LOW_INLIERS),
        "points_away": far > _THICK * size,
        "points_flat": ((spreads[:, 2] < _FLAT * spreads[:, 0]) & (result.volumes is not None)),
        "frames_elsewhere": is_other | is_away,
    }
    data: dict[str, dict[str, float]] = {
        "frames_unobserved": {"n_frames": len(x)},
        "coverage_low": {"share": _LOW_COVERAGE, "least": least},
        "points_away": {"distance": farthest, "radius": size},
    }
    told = (
        Note.of(code, frames=_frames(np.flatnonzero(own)), **data.get(code, {}))
        for code, own in checks.items()
        if own.any()
    )
    notes = [_ALONG, *told]
    bound = result.ejection_fraction_bound
    if bound is not None and bound > _WIDE_BOUND:
        notes.append(Note.of("ejection_fraction_uncertain", points=bound))
    return notes


def end_notes(
    result: Track, stated: Sequence[Frame], frames: Sequence[Frame], *, is_guessed: bool
) -> list[Note]:
    """Note where the ends of the surface are doubtful, which points on it do not show.

    Parameters
    ----------
    result : Track
    stated : sequence of Frame
        Points, with the landmarks that were stated.
    frames : sequence of Frame
        The same, with what the data say of ends, and nothing that was assumed.
    is_guessed : bool
        Whether nobody stated a surface, a topology or landmarks.
    """
    if is_guessed and result.template.topology == SPHERE:
        return [_GUESSED]
    if is_guessed or result.template.topology != CUP:
        return []
    known = [ends_in(frame) for frame in stated]
    others = [k for k in range(result.n_frames) if k not in (result.reference, *result.unseen)]
    unstated = [k for k in others if "base" not in known[k]]
    taken = [k for k in unstated if states_end(frames[k][len(stated[k]) :], "base")]
    missing = [k for k in unstated if k not in taken]
    notes = []
    if taken:
        notes.append(Note.of("base_from_data", frames=_frames(taken), n_frames=result.n_frames))
    if missing and result.n_frames > 1:
        notes.append(Note.of("base_from_volume", frames=_frames(missing), n_frames=result.n_frames))
    return notes


def axis_notes(result: Track, stated: Sequence[Frame]) -> list[Note]:
    """Return notes on what contradicts apex and base in the first frame that has both."""
    known = [ends_in(frame) for frame in stated]
    k = next((k for k, ends in enumerate(known) if {"apex", "base"} <= ends.keys()), None)
    if k is None or result.template.topology != CUP:
        return []
    x, ends = result.sequence.vertices[k].astype(np.float64), known[k]
    axis = ends["base"] - ends["apex"]
    heights = (x - ends["apex"]) @ axis / (axis @ axis)
    away = x - ends["apex"] - np.outer(heights, axis)
    middle, low, high = (away[np.abs(heights - at) < half] for at, half in _PARTS)
    if len(middle) < _FEWEST:
        return [Note.of("axis_unseen")]
    notes, aside, radius = [], float(np.linalg.norm(middle.mean(axis=0))), _radius(middle)
    if aside > _ASIDE * radius:
        notes.append(Note.of("axis_aside", distance=aside, radius=radius))
    if min(len(low), len(high)) >= _FEWEST and _radius(low) > _SWAPPED * _radius(high):
        notes.append(Note.of("ends_swapped", apex=_radius(low), base=_radius(high)))
    return notes


def _radius(section: Floats) -> float:
    return float(np.linalg.norm(section - section.mean(axis=0), axis=1).mean())


def _frames(which: Sequence[int] | Ints) -> str:
    """Name one frame, or the first of several."""
    if len(which) == 1:
        return f"frame {which[0]}"
    return f"{len(which)} frames, frame {which[0]} the first,"
