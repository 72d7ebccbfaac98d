"""Trabeculae that close: their muscle keeps its volume, and lies beyond the edge that is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from ellipsoid_images import (
    AXES,
    LANDMARKS,
    LENGTH,
    MIDDLE,
    RADIUS,
    Floats,
    Look,
    enclosed,
    spheroid,
    uneven,
    volume,
)

from modalmotion.images import ImageSequence, Volume
from modalmotion.mesh import Cavity
from modalmotion.mesh.sequence import mesh_sequence, standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CYLINDER
from modalmotion.tracking import image_frames, track
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.image_view import DISTINCT, FAINT, Facets, Imaging, Levels, View, view_of
from modalmotion.tracking.trabecular_correction import (
    has_trabeculae,
    muscle_within,
    opened,
    spread_over,
    with_trabeculae,
)

SHAPE = (40, 40, 52)
# Height over the middle at which trabeculae end, mm.
MIDDLING = 8.0
AFFINE = np.column_stack([2.0 * np.eye(3), MIDDLE - (np.array(SHAPE) - 1.0)])
LOOK = Look(noise=1.0)
LEVELS = Levels(LOOK.blood, LOOK.wall, 1.0)
IMAGING = Imaging(LEVELS, np.zeros(3), MIDDLE, np.zeros((1, 3)), layers=FAINT).within(4.0)


def trabeculated(depth: float, share: float, radius: float = RADIUS) -> Volume:
    """A layer so deep within the wall, of which such a share is muscle, below the middle."""
    whole = volume(radius, LOOK, affine=AFFINE, shape=SHAPE)
    index = np.stack(np.meshgrid(*map(np.arange, SHAPE), indexing="ij"), axis=-1)
    local = (index @ AFFINE[:, :3].T + AFFINE[:, 3] - MIDDLE) @ AXES
    half = np.array([radius, radius, LENGTH])
    size = np.linalg.norm(local / half, axis=-1)
    away = (size - 1.0) * size / np.maximum(np.linalg.norm(local / half**2, axis=-1), 1e-9)
    inside = np.clip(0.5 - away, 0.0, 1.0) * np.clip(0.5 + (away + depth), 0.0, 1.0)
    below = share * inside * (local[..., 2] < MIDDLING)
    return Volume(whole.values - below * (LOOK.blood - LOOK.wall), AFFINE)


TEMPLATE = spheroid()
SURFACE = Deformable.of(TEMPLATE, 18)


def seen(image: Volume) -> View:
    """Edges about the surface."""
    facets = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
    return view_of(image, facets, TEMPLATE.vertices, IMAGING, 4.0)


def mean_of(field: Floats) -> float:
    """Mean over the surface where there are trabeculae."""
    inner = (TEMPLATE.vertices - MIDDLE) @ AXES[:, 2] < MIDDLING - 6.0
    return float((field * TEMPLATE.weights)[inner].sum() / TEMPLATE.weights[inner].sum())


def test_muscle_is_what_is_dark_wherever_the_edge_is() -> None:
    # In a plane wall; 4 mm of half muscle within cones of 24 mm are 1.7.
    flat = muscle_within(seen(trabeculated(4.0, 0.5)), IMAGING, SURFACE, 1e9)
    assert mean_of(flat) == pytest.approx(2.0, abs=0.4)
    view = seen(trabeculated(4.0, 0.5))
    assert mean_of(muscle_within(view, IMAGING, SURFACE, 24.0)) / mean_of(flat) == pytest.approx(
        (1.0 - (1.0 - 4.0 / 24.0) ** 3) / 3.0 * 24.0 / 4.0, abs=0.05
    )
    # An edge that lies half a mm farther in has half a mm of muscle less within it.
    nearer = replace(view, edges=view.edges._replace(offsets=view.edges.offsets - 0.5))
    moved = mean_of(muscle_within(nearer, IMAGING, SURFACE, 1e9))
    assert moved == pytest.approx(mean_of(flat) - 0.5, abs=0.25)
    without = muscle_within(seen(trabeculated(0.0, 0.0)), IMAGING, SURFACE, 1e9)
    assert mean_of(without) == pytest.approx(0.0, abs=0.15)


def test_muscle_beyond_blood_is_none_of_trabeculae() -> None:
    view = seen(trabeculated(0.0, 0.0))
    away = view.offsets[None] - view.edges.offsets[:, None]
    own = muscle_within(view, IMAGING, SURFACE, 1e9)
    for low, high, expected in ((-8.0, -4.5, 0.0), (-3.5, 0.0, 3.5)):
        profiles = np.where((away > low) & (away < high), LOOK.wall, view.profiles)
        found = muscle_within(replace(view, profiles=profiles), IMAGING, SURFACE, 1e9)
        assert mean_of(found - own) == pytest.approx(expected, abs=0.4)


def test_a_layer_is_part_of_the_wall_where_none_is_looked_for() -> None:
    facets = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
    image = trabeculated(4.0, 0.5)
    with_layers = view_of(image, facets, TEMPLATE.vertices, IMAGING, 4.0).edges
    without = replace(IMAGING, layers=-np.inf)
    edges = view_of(image, facets, TEMPLATE.vertices, without, 4.0).edges
    assert (edges.inside == 1.0).all()
    is_layer = with_layers.inside < 1.0
    assert is_layer.mean() > 0.3
    assert (edges.offsets < with_layers.offsets)[is_layer].mean() > 0.9


def test_faint_layers_are_seen_where_trabeculae_are_known_to_be() -> None:
    facets = Facets.of(TEMPLATE.faces, TEMPLATE.vertices, TEMPLATE.weights)
    # A quarter of muscle: a likeness of 0.5.
    image = trabeculated(4.0, 0.25)
    clear = replace(IMAGING, layers=DISTINCT)
    distinct = view_of(image, facets, TEMPLATE.vertices, clear, 4.0).edges
    faint = view_of(image, facets, TEMPLATE.vertices, IMAGING, 4.0).edges
    assert (distinct.inside < 1.0).mean() < 0.15
    assert (faint.inside < 1.0).mean() > 0.3


def test_what_is_missing_lies_beyond_the_edge() -> None:
    view = seen(trabeculated(0.0, 0.0))
    moved = opened(view, np.full(TEMPLATE.n_vertices, 1.5))
    assert moved.edges.offsets - view.edges.offsets == pytest.approx(1.5)


def test_muscle_has_its_volume_wherever_it_is_spread() -> None:
    x, faces = TEMPLATE.vertices, TEMPLATE.faces
    cavity = Cavity(faces)
    normals = Facets.of(faces, x, TEMPLATE.weights).normals(x)
    shape = np.where((x - MIDDLE) @ AXES[:, 2] < MIDDLING, 1.0, -0.5)
    for volume_of in (800.0, 12_000.0):
        depth = spread_over(SURFACE, x, shape, volume_of)
        added = abs(float(cavity.volume(x + depth[:, None] * normals))) - abs(
            float(cavity.volume(x))
        )
        assert added == pytest.approx(volume_of, rel=1e-3)
        assert not depth[shape < 0].any()
        assert np.ptp(depth[shape > 0]) == pytest.approx(0.0, abs=1e-12)
    # More muscle than there was is none that is missing.
    assert not spread_over(SURFACE, x, shape, -1.0).any()
    assert not spread_over(SURFACE, x, 0.0 * shape, 800.0).any()


def test_the_reference_stays_and_missing_frames_are_left_out() -> None:
    views = [seen(trabeculated(4.0, 0.5)), None, seen(trabeculated(0.0, 0.0))]
    shapes = np.stack([TEMPLATE.vertices] * 3)
    (first, missing, last), means = with_trabeculae(views, [IMAGING] * 3, SURFACE, shapes, 0)
    assert first is views[0]
    assert missing is None
    assert last is not None
    before = views[2]
    assert before is not None
    moved = last.edges.offsets - before.edges.offsets
    assert float(np.quantile(moved, 0.7)) == pytest.approx(2.0, abs=0.5)
    assert means[2] == pytest.approx(float(np.mean(moved)), abs=0.5)
    assert not means[:2].any()
    (_, same), none = with_trabeculae([None, before], [IMAGING] * 2, SURFACE, shapes[:2], 0)
    assert same is before
    assert not none.any()


def test_only_layers_all_round_are_trabeculae() -> None:
    shape = mesh_sequence(TEMPLATE.vertices[None], TEMPLATE.faces, grid=(20, 40), topology="cup")
    imaging = replace(IMAGING, layers=-np.inf)
    assert has_trabeculae(trabeculated(4.0, 0.5), shape, imaging, 4.0)
    assert not has_trabeculae(trabeculated(0.0, 0.0), shape, imaging, 4.0)
    # Blood of many brightnesses is no noise.
    assert has_trabeculae(uneven(trabeculated(4.0, 0.5)), shape, imaging, 4.0)
    assert not has_trabeculae(uneven(trabeculated(0.0, 0.0)), shape, imaging, 4.0)
    tube = standard_surface(Lattice(CYLINDER, (4, 8)))
    assert not has_trabeculae(trabeculated(4.0, 0.5), tube, imaging, 4.0)


@pytest.mark.thorough
def test_a_surface_does_not_follow_trabeculae_inward(monkeypatch: pytest.MonkeyPatch) -> None:
    # Radius 22 to 18: half of 4 mm is muscle, then all of 2.5.
    beat = ImageSequence((trabeculated(4.0, 0.5), trabeculated(2.5, 1.0, 18.0)))
    marks = {"apex": LANDMARKS["apex"], "base": np.tile(LANDMARKS["base"], (2, 1))}
    result = track(beat, landmarks=marks, modes=18)
    assert result.volumes is not None
    off = abs(result.volumes[1] - enclosed(18.0))
    assert off < 0.1 * enclosed(18.0)
    monkeypatch.setattr(image_frames, "with_trabeculae", lambda views, *_: (views, np.zeros(2)))
    followed = track(beat, landmarks=marks, modes=18)
    assert followed.volumes is not None
    assert off < 0.6 * (enclosed(18.0) - followed.volumes[1])
