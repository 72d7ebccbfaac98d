"""Heights of lines along normals: where the surface meets them, however its points lie on it."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from modalmotion.mesh import lattice_faces
from modalmotion.mesh.geometry import NormalLines, vertex_normals
from modalmotion.modes.topologies import CYLINDER, PLANE

ROWS, COLUMNS = 9, 12
FACES = lattice_faces(PLANE, (ROWS, COLUMNS))
S, T = (x.ravel() for x in np.meshgrid(np.arange(ROWS), np.arange(COLUMNS), indexing="ij"))
SHEET = np.stack([S, T, np.zeros_like(S)], axis=1).astype(float)


def lines_of(positions: NDArray[np.float64], faces: NDArray[np.int64]) -> NormalLines:
    normals = vertex_normals(positions, faces)
    return NormalLines.of(faces, np.unique(faces), positions, normals)


def slid(share: float) -> NDArray[np.float64]:
    """Points of the sheet elsewhere on it, its rim on its rim."""
    s, t = S / (ROWS - 1), T / (COLUMNS - 1)
    x = s + share * np.sin(np.pi * s) * np.sin(np.pi * t)
    y = t - share * np.sin(np.pi * t) * s * (1 - s) * 2
    return np.stack([x * (ROWS - 1), y * (COLUMNS - 1), np.zeros(len(s))], axis=1)


def nearest_meeting(
    start: NDArray[np.float64], along: NDArray[np.float64], corners: NDArray[np.float64]
) -> float:
    """Slow twin: all triangles against one line (Moller and Trumbore), the nearest meeting."""
    a, b, c = corners.transpose(1, 0, 2)
    p = np.cross(along, c - a)
    det = ((b - a) * p).sum(axis=1)
    with np.errstate(all="ignore"):
        u = ((start - a) * p).sum(axis=1) / det
        q = np.cross(start - a, b - a)
        v, h = (q @ along) / det, ((c - a) * q).sum(axis=1) / det
    hit = (u >= -1e-9) & (v >= -1e-9) & (u + v <= 1 + 1e-9)
    return float(h[hit][np.abs(h[hit]).argmin()]) if hit.any() else np.nan


def test_a_sheet_that_is_lifted_is_met_at_its_height_wherever_its_points_are() -> None:
    lines = lines_of(SHEET, FACES)
    lifted = np.stack([slid(share) + np.array([0, 0, 1.5]) for share in (0.0, 0.1, 0.25)])
    np.testing.assert_allclose(lines.heights(lifted), 1.5 * np.sign(lines.directions[0, 2, 2]))


def test_the_surface_itself_has_no_height_to_the_last_bit() -> None:
    bent = SHEET + np.stack([0 * S, 0 * S, np.sin(S) + 0.3 * T**2], axis=1)
    assert not lines_of(bent, FACES).heights(bent[None]).any()


def test_heights_are_those_of_a_search_through_all_triangles(rng: np.random.Generator) -> None:
    tube = lattice_faces(CYLINDER, (ROWS, COLUMNS))
    angle = 2 * np.pi * T / COLUMNS
    around = np.stack([5 * np.cos(angle), 5 * np.sin(angle), 2.0 * S], axis=1)
    lines = lines_of(around, tube)
    turned = angle + 0.7 + 0.05 * S
    radius = 4 + 0.3 * np.cos(2 * turned) + 0.1 * S
    other = np.stack([radius * np.cos(turned), radius * np.sin(turned), 2.2 * S - 0.8], axis=1)
    heights = lines.heights(other[None])[0]
    corners = other[tube]
    for k in rng.permutation(len(heights)):
        twin = nearest_meeting(lines.starts[k], lines.directions[k, 2], corners)
        assert heights[k] == pytest.approx(twin, abs=1e-9)


def test_beyond_the_rim_the_height_is_that_of_the_point_of_the_rim_next_to_the_line() -> None:
    lines = lines_of(SHEET, FACES)
    up = np.sign(lines.directions[0, 2, 2])
    # Half as long, and rising towards its far end, which is 2 high.
    short = np.stack([S / 2, T, S / 4], axis=1)
    heights = lines.heights(short[None])[0].reshape(ROWS, COLUMNS) * up
    rows = np.arange(ROWS)[:, None]
    expected = np.where(rows <= (ROWS - 1) / 2, rows / 2, 2.0)
    np.testing.assert_allclose(heights, np.broadcast_to(expected, heights.shape), atol=1e-12)


def test_of_several_meetings_the_one_joined_to_the_vertex_counts() -> None:
    # The far half is folded back over the near one, 3 above it.
    folded = SHEET.copy()
    back = S > (ROWS - 1) / 2
    folded[back, 0] = (ROWS - 1) - folded[back, 0]
    folded[back, 2] = 3.0
    lines = lines_of(SHEET, FACES)
    heights = lines.heights(folded[None])[0].reshape(ROWS, COLUMNS)
    assert not heights[: ROWS // 2 - 1].any()


def test_triangles_folded_by_noise_leave_heights_of_its_size(rng: np.random.Generator) -> None:
    noisy = np.stack([SHEET + rng.normal(0.0, 0.6, SHEET.shape) for _ in range(20)])
    heights = lines_of(SHEET, FACES).heights(noisy)
    assert np.isfinite(heights).all()
    assert np.sqrt((heights**2).mean()) < 1.2


def test_some_of_the_lines_are_the_same_lines() -> None:
    lines, rows = lines_of(SHEET, FACES), np.array([3, 40, 77])
    moved = (slid(0.2) + np.array([0, 0, 1]))[None]
    np.testing.assert_array_equal(lines.some(rows).heights(moved), lines.heights(moved)[:, rows])


def test_normals_are_of_length_one_and_zero_where_there_is_no_triangle() -> None:
    positions = np.concatenate([SHEET, [[5.0, 5.0, 5.0]]])
    normals = vertex_normals(positions, FACES)
    np.testing.assert_allclose(np.abs(normals[:-1, 2]), 1.0)
    assert not normals[-1].any()
