"""Contours know where they end: arcs at the rim, stacks between slices; whatever else is left."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from clouds import Floats

from modalmotion.tracking import Observation, track
from modalmotion.tracking.contour_ends import _planes_of, with_contour_ends
from modalmotion.tracking.ends_of_data import lies_evenly
from modalmotion.tracking.observation import Frame

APEX, RADIUS, SPACING = np.array([0.0, 0.0, -60.0]), 25.0, 10.0


def radius_at(z: float) -> float:
    """Of half an ellipsoid with its tip at -60 and its middle at 0."""
    return float(RADIUS * np.sqrt(max(1.0 - (z / 60.0) ** 2, 0.0)))


def slices(level: float, lean: float, lowest: float = -55.0, wide: float = 1.0) -> Floats:
    """Short-axis sections every 10 mm, of what lies below a rim that leans about y."""
    rings = []
    for z in np.arange(lowest, 15.0, SPACING).tolist():
        n = max(6, round(2.0 * np.pi * radius_at(z) / 1.5))
        t = 2.0 * np.pi * (np.arange(n) + 0.5) / n
        r = wide * radius_at(min(z, 0.0))
        ring = np.stack([r * np.cos(t), r * np.sin(t), np.full(n, z)], axis=1)
        rings.append(ring[z <= level + lean * ring[:, 0]])
    return np.concatenate(rings)


def arcs(level: float, early: float) -> list[Floats]:
    """Long-axis sections with points every 3 mm of height, the last so many steps below the rim."""
    z = np.arange(level - 3.0 * early, -55.0, -3.0)
    r = np.array([radius_at(min(h, 0.0)) for h in z.tolist()])
    half = np.stack([r, z], axis=1)
    both = np.concatenate([half, half[::-1] * [-1.0, 1.0]])
    turns = np.pi * (np.arange(3) / 3.0 + 0.1)
    return [
        np.column_stack([np.outer(both[:, 0], [np.cos(t), np.sin(t)]), both[:, 1]]) for t in turns
    ]


def frame_of(points: Floats, base: float | None) -> Frame:
    marks = [Observation(APEX[None], places=("apex",))]
    if base is not None:
        marks.append(Observation(np.array([[0.0, 0.0, base]]), places=("base",)))
    return (Observation(points), *marks)


def added(frames: list[Frame]) -> list[Frame]:
    full, _ = with_contour_ends(frames, None, 0)
    return [own[len(frame) :] for frame, own in zip(frames, full, strict=True)]


def test_ends_of_arcs_lie_on_the_rim() -> None:
    lean = 0.27
    frames = [frame_of(slices(2.0, lean), 2.0), frame_of(slices(-6.0, lean), None)]
    none, (ends, level) = added(frames)
    assert none == ()
    assert ends.end == "base"
    x = ends.points
    assert x[:, 2] == pytest.approx(-6.0 + lean * x[:, 0], abs=0.5)
    assert level.places == ("base",)
    assert level.points[0, 2] == pytest.approx(-6.0, abs=1.5)
    assert level.normals is not None
    assert np.abs(level.normals) == pytest.approx(np.array([[0.0, 0.0, 1.0]]), abs=1e-6)


def test_a_rim_without_arcs_is_between_the_last_slice_and_the_next() -> None:
    frames = [frame_of(slices(8.0, 0.0), 8.0), frame_of(slices(-3.0, 0.0, wide=0.7), None)]
    (_, (*_, level)), errors = with_contour_ends(frames, None, 0)
    assert level.places == ("base",)
    # Slices at -5 and 5; of frame 0 at 5 and 15, where the base is 2 mm below their middle.
    assert -5.0 < level.points[0, 2] < 5.0
    # Its error is stated beside it, and not by how softly it is held.
    assert 1.5 < errors["base"][1, 1] ** 0.5 < SPACING / 12**0.5
    assert not errors["base"][0].any()


def test_a_rim_between_slices_is_where_the_ejected_volume_puts_it() -> None:
    # Up to the middle the volume is 2/3 of that of a cylinder; the width alone changes it by 44 %.
    wide = np.array([1.0, 0.85, 0.75, 0.75, 0.85, 0.95])
    whole = (40.0 + 8.0) * np.ones(6)
    for _ in range(20):
        volumes = wide**2 * whole
        bases = 8.0 - 0.185 * 68.0 / 90.0 * 100.0 * (1.0 - volumes / volumes[0])
        below = np.minimum(bases, 0.0)
        whole = 40.0 + np.maximum(bases, 0.0) + below - below**3 / (3.0 * 60.0**2)
    frames = [
        frame_of(slices(base, 0.0, wide=w), base if k == 0 else None)
        for k, (base, w) in enumerate(zip(bases.tolist(), wide.tolist(), strict=True))
    ]
    full, _ = with_contour_ends(frames, None, 0)
    levels = [own[-1].points[0, 2] for own in full[1:]]
    assert levels == pytest.approx(bases[1:], abs=1.5)
    result = track(frames, topology="cup", modes=18)
    truth = 100.0 * (1.0 - volumes.min() / volumes[0])
    assert result.ejection_fraction == pytest.approx(truth, abs=1.5)


@pytest.mark.parametrize("early", [0.0, 0.5, 2.5])
def test_the_reference_shows_how_far_beyond_their_points_arcs_go_on(early: float) -> None:
    frames = [
        frame_of(np.concatenate([slices(-8.0, 0.0), *arcs(8.0, early)]), 8.0),
        frame_of(np.concatenate([slices(-8.0, 0.0), *arcs(0.0, early)]), None),
    ]
    _, (ends, _) = added(frames)
    assert ends.points[:, 2] == pytest.approx(np.zeros(6), abs=0.4)


def test_slices_however_close_are_no_cloud_that_ends_at_the_last_one() -> None:
    frames = [frame_of(slices(2.0, 0.0), 2.0), frame_of(slices(-6.0, 0.0), None)]
    assert all(any(map(lies_evenly, frame)) for frame in frames)
    assert not any(any(map(lies_evenly, frame)) for frame in with_contour_ends(frames, None, 0)[0])


def test_a_gap_below_a_closed_contour_is_no_rim() -> None:
    points = slices(8.0, 0.0)
    gap = (points[:, 2] == -15.0) & (points[:, 0] > 18.0)
    frames = [frame_of(points, 8.0), frame_of(points[~gap], None)]
    _, own = added(frames)
    assert [part.places for part in own] == [("base",)]


@pytest.mark.parametrize("kind", ["cloud", "moving planes", "no axis"])
def test_what_shows_no_end_is_left_as_it_was(kind: str, rng: np.random.Generator) -> None:
    points = slices(2.0, 0.2)
    frames = [frame_of(points, 2.0), frame_of(points, None)]
    if kind == "cloud":
        loose = points + rng.normal(0.0, 1.0, points.shape)
        frames = [frame_of(loose, 2.0), frame_of(loose, None)]
    if kind == "moving planes":
        frames[1] = frame_of(points + 3.0, None)
    if kind == "no axis":
        frames = [(Observation(points),), (Observation(points),)]
    assert with_contour_ends(frames, None, 0) == (tuple(frames), {})


def test_a_base_that_is_stated_once_descends_with_its_contours() -> None:
    levels = (4.0, -2.0, -8.0, -8.0, -2.0, 2.0)
    frames = [frame_of(slices(level, 0.27), None) for level in levels]
    frames[0] = frame_of(slices(levels[0], 0.27), levels[0])
    result = track(frames, topology="cup", modes=18)
    rim = result.template.coordinates[:, 0] >= result.template.coordinates[:, 0].max() - 1e-9
    found = result.sequence.vertices[:, rim, 2].mean(axis=1)
    assert found == pytest.approx(np.array(levels), abs=2.5)
    assert any("assumed where the data end" in note for note in result.notes)


def test_planes_are_looked_for_in_many_points_without_much_memory() -> None:
    # Each point beside an eighth of all others would take 2 GB.
    points = np.random.default_rng(0).normal(size=(30_000, 3))
    points *= 30.0 / np.linalg.norm(points, axis=1)[:, None]
    tracemalloc.start()
    try:
        planes = _planes_of(points, np.array([0.0, 0.0, 1.0]), 0.01)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert not len(planes.offsets)
    assert peak < 100e6
