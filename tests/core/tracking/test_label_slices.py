"""Ends of a cavity in slices: levels between slices, frames that outvote one another."""

from __future__ import annotations

import tracemalloc
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from modalmotion.errors import ShapeError
from modalmotion.images import Volume
from modalmotion.notes import Note
from modalmotion.representation import Floats
from modalmotion.tracking import track
from modalmotion.tracking.label_maps import ends_in_slices

STEP, PIXEL = 8.0, 1.5
LENGTH, CUT = 50.0, 25.0


def stack(
    radius: float = 25.0,
    base: float = CUT,
    *,
    first: float = -52.0,
    drop: int = 0,
    turned: bool = False,
) -> Volume:
    """Slices of a spheroid cut at `base`, the last `drop` of them not drawn."""
    n = 64
    affine = np.diag([PIXEL, PIXEL, STEP, 1.0])[:3]
    affine[:, 3] = [-PIXEL * (n - 1) / 2, -PIXEL * (n - 1) / 2, first]
    index = np.moveaxis(np.indices((n, n, 14)), 0, -1)
    x, y, z = np.moveaxis(index @ affine[:, :3].T + affine[:, 3], -1, 0)
    inside = (x**2 + y**2) / radius**2 + z**2 / LENGTH**2 < 1.0
    inside &= z < base - drop * STEP
    values = np.where(inside, 3, 0).astype(np.uint8)
    if turned:
        affine[:, 3] += affine[:, 2] * (values.shape[2] - 1)
        affine[:, 2] *= -1.0
        values = values[:, :, ::-1]
    return Volume(values, affine)


class Ends(NamedTuple):
    """What is proposed, by name."""

    apices: Floats
    bases: Floats
    axes: Floats
    apex_covariance: Floats
    base_covariance: Floats
    notes: tuple[Note, ...]
    left_out: tuple[int, ...]


def found(*volumes: Volume | None) -> Ends:
    marks, notes, left_out = ends_in_slices(volumes)
    apex, base = marks["apex"], marks["base"]
    assert apex.normals is not None
    assert apex.covariance is not None
    assert base.covariance is not None
    off = apex.covariance, base.covariance
    return Ends(apex.places, base.places, apex.normals, *off, notes, left_out)


def test_levels_lie_within_their_deviations_wherever_slices_begin() -> None:
    firsts = -52.0 - STEP * np.linspace(0.0, 1.0, 8, endpoint=False)
    off = np.array(
        [
            [ends.apices[0, 2] + LENGTH, ends.bases[0, 2] - CUT]
            for ends in (found(stack(first=first)) for first in firsts)
        ]
    )
    one = found(stack())
    sd = np.sqrt([one.apex_covariance[0, 0], one.base_covariance[0, 0]])
    assert (np.sqrt((off**2).mean(axis=0)) < 1.2 * sd).all()
    # The tip is extrapolated to less than half of a slice; the base is half of one off at most.
    assert (np.abs(off).max(axis=0) < [0.4 * STEP, 0.75 * STEP]).all()
    assert one.axes[0] == pytest.approx([0.0, 0.0, 1.0], abs=0.01)


def test_the_order_of_slices_says_nothing() -> None:
    one, other = found(stack()), found(stack(turned=True))
    for a, b in pairwise([one, other]):
        assert a.apices == pytest.approx(b.apices, abs=1e-9)
        assert a.bases == pytest.approx(b.bases, abs=1e-9)


def test_a_frame_that_lacks_a_slice_is_outvoted() -> None:
    others = [stack(first=-52.0 - shift) for shift in (0.0, 1.0, 2.0)]
    alone = found(stack(drop=1)).bases[0, 2]
    ends = found(*others, stack(drop=1))
    assert abs(ends.bases[3, 2] - CUT) < 0.6 * abs(alone - CUT)
    assert ends.bases[:3, 2] == pytest.approx(CUT, abs=0.4 * STEP)


def volume(radius: float, base: float) -> float:
    """Of a spheroid of unit semi-axes times these, cut at `base`."""
    z = np.linspace(-LENGTH, base, 2000)
    return float(np.trapezoid(radius**2 * (1.0 - z**2 / LENGTH**2), z))


@pytest.mark.parametrize("radius", [22.0, 17.0])
def test_the_base_descends_with_the_volume_that_is_ejected(radius: float) -> None:
    # 0.185 mm a percentage point: base and volume follow from each other.
    base = CUT
    for _ in range(20):
        base = CUT - 0.185 * 100.0 * (1.0 - volume(radius, base) / volume(25.0, CUT))
    off, sd = [], []
    for shift in STEP * np.linspace(0.0, 1.0, 6, endpoint=False):
        # The reader takes the highest slice of the second frame for the atrium.
        ends = found(stack(first=-52.0 - shift), stack(radius, base, first=-52.0 - shift, drop=1))
        off.append(ends.bases[0, 2] - ends.bases[1, 2] - (CUT - base))
        C = ends.base_covariance
        sd.append(np.sqrt(C[0, 0] + C[1, 1] - 2.0 * C[0, 1]))
    assert np.abs(off).max() < 0.35 * STEP
    assert np.sqrt(np.mean(np.square(off))) < 1.2 * np.mean(sd)


def test_errors_of_levels_are_shared_and_less_so_where_frames_differ() -> None:
    def correlation(ends: Ends) -> float:
        own = ends.base_covariance
        return float(own[0, 1] / np.sqrt(own[0, 0] * own[1, 1]))

    alike, unlike = found(stack(), stack()), found(stack(), stack(16.0, 14.0))
    assert 0.2 < correlation(unlike) < correlation(alike) < 1.0
    assert np.linalg.eigvalsh(unlike.base_covariance).min() > 0


def test_a_cavity_open_at_both_ends_is_noted() -> None:
    tube = stack(first=-20.0)
    assert any("Both ends" in note for note in found(tube).notes)
    assert found(stack()).notes == ()


def test_missing_frames_have_no_ends_and_few_slices_are_refused() -> None:
    ends = found(stack(), None)
    assert np.isnan(ends.bases[1]).all()
    assert np.isnan(ends.base_covariance[1]).all()
    flat = stack()
    with pytest.raises(ShapeError, match="in 2 slices of frame 0"):
        found(Volume(flat.values[:, :, :2] | flat.values[:, :, 5:7], flat.affine))


def emptied(frame: Volume, *slices: int) -> Volume:
    values = frame.values.copy()
    values[:, :, list(slices)] = 0
    return Volume(values, frame.affine)


def test_two_neighbours_that_one_frame_lacks_do_not_cut_a_cavity() -> None:
    others = [stack(), stack(), stack()]
    whole, torn = found(*others, stack()), found(*others, emptied(stack(), 4, 5))
    assert torn.apices[3] == pytest.approx(whole.apices[3], abs=0.5)
    assert torn.bases[3] == pytest.approx(whole.bases[3], abs=0.5)
    # What lies apart in all frames is something else.
    apart = found(*(emptied(frame, 3, 4) for frame in others))
    assert (apart.apices[:, 2] > whole.apices[0, 2] + STEP).all()


@pytest.mark.parametrize("first", [-52.0, -54.0, -56.0])
def test_a_slice_that_no_frame_has_does_not_lower_the_base(first: float) -> None:
    full = stack(first=first)
    top = int(np.flatnonzero(full.values.any(axis=(0, 1)))[-1])
    # One frame ends above the slice that was left out, the others below it.
    below = emptied(full, top - 1, top)
    bases = found(emptied(full, top - 1), below, below, below).bases[:, 2]
    assert bases[1:] == pytest.approx(bases[0], abs=0.25 * STEP)


@pytest.mark.parametrize("n_slices", [3, 6])
def test_slices_that_one_frame_lacks_say_nothing_of_its_base(n_slices: int) -> None:
    others = [stack(first=-52.0 - shift) for shift in (0.0, 1.0, 2.0)]
    whole, torn = found(*others, stack()), found(*others, stack(drop=n_slices))
    assert torn.bases[:3, 2] == pytest.approx(whole.bases[:3, 2], abs=0.15 * STEP)
    off = abs(torn.bases[3] - whole.bases[3])
    assert off[2] < 2.0 * torn.base_covariance[3, 3] ** 0.5 < STEP
    assert np.hypot(*off[:2]) < PIXEL
    assert (torn.left_out, whole.left_out) == ((3,), ())
    assert [note.code for note in torn.notes] == ["slices_left_out"]


def test_slices_that_one_frame_has_too_many_do_not_raise_the_others() -> None:
    others = [stack(first=-52.0 - shift) for shift in (0.0, 1.0, 2.0)]
    whole, wrong = found(*others, stack()), found(*others, stack(base=CUT + 3.0 * STEP))
    assert wrong.bases[:3, 2] == pytest.approx(whole.bases[:3, 2], abs=0.15 * STEP)
    assert abs(wrong.bases[3, 2] - whole.bases[3, 2]) < 2.0 * wrong.base_covariance[3, 3] ** 0.5


def test_a_map_much_larger_than_a_heart_takes_no_more_memory() -> None:
    affine = np.column_stack([np.diag([PIXEL, PIXEL, STEP]), np.zeros(3)])
    tall = np.ones((4, 4, 500), np.uint8)
    tracemalloc.start()
    try:
        found(Volume(tall, affine), Volume(np.where(np.arange(500) < 3, tall, 0), affine))
        assert tracemalloc.get_traced_memory()[1] < 5e8
    finally:
        tracemalloc.stop()


@pytest.mark.parametrize("share", [0.9, 1.1, 1.6])
def test_a_lowest_section_that_is_too_wide_leaves_the_tip_near(share: float) -> None:
    whole = stack(first=-54.0)
    lowest = int(np.flatnonzero(whole.values.any(axis=(0, 1)))[0])
    values = whole.values.copy()
    # Of the area of the next one.
    n = values.shape[0]
    x, y = PIXEL * (np.indices((n, n)) - (n - 1) / 2)
    area = share * PIXEL**2 * np.count_nonzero(values[:, :, lowest + 1])
    values[:, :, lowest] = np.where(x**2 + y**2 < area / np.pi, 3, 0)
    drawn = Volume(values, whole.affine)
    off = found(drawn).apices[0] - found(whole).apices[0]
    assert abs(off[2]) < 0.5 * STEP


def test_a_shape_is_taken_from_a_frame_that_has_its_slices() -> None:
    result = track([stack(drop=5), stack(), stack(22.0, 20.0)], labels=(3,), modes=7)
    assert result.provenance["reference"] == 1
    codes = [note.code for note in result.notes]
    assert {"slices_left_out", "reference_unobserved"} <= {*codes}
    assert result.volumes is not None
    assert result.volume_deviations is not None
    off = abs(float(result.volumes[0] - result.volumes[1]))
    assert off < 2.0 * float(result.volume_deviations[0])
