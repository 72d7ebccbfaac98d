"""Phantoms: their images show the surface that they are said to show."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import ParameterError
from modalmotion.images import PlaneSet, Volume
from modalmotion.mesh import Cavity
from modalmotion.simulate import ImageKind, PhantomSettings, VentricleParameters, simulate_images
from modalmotion.simulate.phantom import Phantom

CLEAN = PhantomSettings(noise=0.0, coarseness=2.0)

NOISY = PhantomSettings(coarseness=2.0)


def taken(kind: str, settings: PhantomSettings = CLEAN, seed: int = 3) -> Phantom:
    own = VentricleParameters(shape_variation=1.0)
    return simulate_images(
        kind, own, n_frames=1, settings=settings, rng=np.random.default_rng(seed)
    )


@pytest.fixture(scope="module")
def ct() -> Phantom:
    return taken("ct")


def rays(phantom: Phantom, away: float, number: int = 0) -> np.ndarray:
    """Brightness so many mm outward from vertices below the base, across the axis."""
    rows = phantom.truth.vertices[number].astype(np.float64).reshape(32, 64, 3)[8:26]
    out = rows - rows.mean(axis=1, keepdims=True)
    out /= np.linalg.norm(out, axis=2, keepdims=True)
    frame = phantom.images.frames[number]
    assert isinstance(frame, Volume)
    return frame.sample((rows + away * out).reshape(-1, 3))


def test_the_edge_of_blood_and_wall_lies_at_the_truth(ct: Phantom) -> None:
    at = {away: float(np.median(rays(ct, away))) for away in (-4.0, 0.0, 4.0)}
    assert at[-4.0] == pytest.approx(1000.0, rel=0.02)
    assert at[4.0] == pytest.approx(450.0, rel=0.02)
    assert at[0.0] == pytest.approx(725.0, rel=0.1)


def test_a_label_map_has_the_cavity_that_is_drawn() -> None:
    phantom = taken("labels", seed=4)
    frame = phantom.images.frames[0]
    assert isinstance(frame, Volume)
    assert set(np.unique(frame.values)) == {0, 1, 2, 3}
    truth = Cavity(phantom.truth.faces)
    found = (frame.values == 3).sum() * abs(np.linalg.det(frame.affine[:, :3]))
    assert found == pytest.approx(
        truth.volume(phantom.truth.vertices.astype(np.float64))[0], rel=0.06
    )


def test_papillary_muscles_are_in_the_pool_and_as_large_as_is_said(ct: Phantom) -> None:
    without = taken("ct", replace(CLEAN, papillary=False))
    one, other = ct.images.frames[0], without.images.frames[0]
    assert isinstance(one, Volume)
    assert isinstance(other, Volume)
    missing = (other.values.astype(float) - one.values).sum() / 550.0 * CLEAN.coarseness**3
    assert missing == pytest.approx(ct.papillary_volume, rel=0.1)
    assert without.papillary_volume == 0.0
    assert 2000.0 < ct.papillary_volume < 8000.0


def test_trabeculae_keep_their_muscle_and_look_like_wall_at_end_systole() -> None:
    plain = replace(CLEAN, papillary=False, noise=0.0)
    beat = [
        simulate_images(
            "ct",
            n_frames=2,
            settings=replace(plain, trabeculae=depth),
            rng=np.random.default_rng(3),
        )
        for depth in (0.0, 6.0)
    ]
    missing = []
    for without, own in zip(beat[0].images.frames, beat[1].images.frames, strict=True):
        assert isinstance(without, Volume)
        assert isinstance(own, Volume)
        missing.append(
            float((without.values.astype(float) - own.values).sum()) / 550.0 * CLEAN.coarseness**3
        )
    assert missing[0] == pytest.approx(beat[1].papillary_volume, rel=0.1)
    assert missing[0] > 5000.0
    assert missing == pytest.approx([missing[0]] * 2, rel=0.15)


def test_there_is_no_edge_at_the_valve_and_another_chamber_beside(ct: Phantom) -> None:
    frame = ct.images.frames[0]
    assert isinstance(frame, Volume)
    base, apex = ct.landmarks["base"][0], ct.landmarks["apex"][0]
    up = (base - apex) / np.linalg.norm(base - apex)
    through = frame.sample(base + np.linspace(-10, 10, 21)[:, None] * up)
    assert np.nanmin(through) > 950.0
    rows = ct.truth.vertices[0].astype(np.float64).reshape(32, 64, 3)[16]
    out = rows[32] - rows.mean(axis=0)
    beside = frame.sample(rows[32] + np.linspace(10, 20, 11)[:, None] * out / np.linalg.norm(out))
    assert np.nanmax(beside) > 950.0


def test_the_same_generator_gives_the_same_images() -> None:
    one, other = (taken("mri", NOISY).images.frames[0] for _ in range(2))
    assert isinstance(one, Volume)
    assert isinstance(other, Volume)
    assert (one.values == other.values).all()
    assert one.spacing == pytest.approx((2.8, 2.8, 16.0))


@pytest.mark.thorough
def test_slices_show_all_aside_by_the_shifts_that_are_told() -> None:
    still, moved = (taken("cine", replace(CLEAN, slice_shift=shift)) for shift in (0.0, 3.0))
    one, other = still.images.frames[0], moved.images.frames[0]
    assert isinstance(one, PlaneSet)
    assert isinstance(other, PlaneSet)
    assert not still.shifts.any()
    for plane, shifted, shift in zip(one.planes, other.planes, moved.shifts, strict=True):
        assert plane.normal @ shift == pytest.approx(0.0, abs=1e-9)
        points = plane.origin + (np.array([[40, 40], [33, 46]]) @ plane.affine[:, :2].T)
        assert shifted.sample(points + shift) == pytest.approx(plane.sample(points), abs=120.0)


@pytest.mark.thorough
def test_speckle_and_limits_are_as_they_are_named() -> None:
    echo = taken(ImageKind.ECHO)
    assert float(np.median(rays(echo, -4.0))) < 0.5 * float(np.median(rays(echo, 4.0)))
    with pytest.raises(ParameterError, match="coarseness"):
        PhantomSettings(coarseness=9.0)
