"""What a sequence keeps is its own; masked and extreme numbers are refused by name."""

from __future__ import annotations

import numpy as np
import pytest

import modalmotion as mm
from modalmotion.mesh.checks import LARGEST, SMALLEST, given_up

FACES = np.array([[0, 1, 2], [0, 2, 3]])


def positions() -> np.ndarray:
    return np.random.default_rng(0).normal(size=(3, 4, 3))


def test_the_callers_arrays_stay_theirs() -> None:
    x, faces, times = positions(), FACES.copy(), np.array([0.0, 0.5, 1.0])
    sequence = mm.mesh_sequence(x, faces, times=times)
    before, name = np.array(sequence.vertices), sequence.id
    for array in (x, faces, times):
        assert array.flags.writeable
        array[...] = 0
    assert (sequence.vertices == before).all()
    assert (sequence.faces == FACES).all()
    assert sequence.times is not None
    assert sequence.times.tolist() == [0.0, 0.5, 1.0]
    assert mm.mesh_sequence(before, FACES, times=[0.0, 0.5, 1.0]).id == name


def test_a_view_does_not_change_with_its_base() -> None:
    base = np.zeros((6, 4, 3))
    base[::2] = positions()
    for view in (base[::2], base[:3], base.view(np.ndarray)[0:3]):
        sequence = mm.mesh_sequence(view)
        before = np.array(sequence.vertices)
        view.base[...] += 1.0  # type: ignore[index]
        assert (sequence.vertices == before).all()
    frozen = base[:3]
    frozen.setflags(write=False)
    sequence = mm.mesh_sequence(frozen)
    base += 1.0
    assert (sequence.vertices != frozen).all()


def test_what_nobody_can_change_is_not_copied() -> None:
    x = given_up(positions())
    sequence = mm.mesh_sequence(x)
    assert sequence.vertices is x
    assert mm.mesh_sequence(sequence.vertices).vertices is x
    assert np.shares_memory(mm.mesh_sequence(x[1:]).vertices, x)
    raw = np.frombuffer(positions().tobytes()).reshape(3, 4, 3)
    assert np.shares_memory(mm.mesh_sequence(raw).vertices, raw)
    # Another type is new anyway.
    narrow = mm.mesh_sequence(positions().astype(np.float16)).vertices
    assert narrow.dtype == np.float64
    assert not narrow.flags.writeable


def test_masked_numbers_are_missing() -> None:
    mask = np.zeros((3, 4, 3), dtype=np.bool_)
    clear = np.ma.masked_array(positions(), mask=mask)  # type: ignore[no-untyped-call]
    assert mm.mesh_sequence(clear).id == mm.mesh_sequence(positions()).id
    mask[1, 2, 0] = True
    holes = np.ma.masked_array(positions(), mask=mask)  # type: ignore[no-untyped-call]
    with pytest.raises(mm.NonFiniteError, match="masked at frame 1, vertex 2") as refused:
        mm.mesh_sequence(holes)
    assert (refused.value.frame, refused.value.vertex) == (1, 2)
    times = np.ma.masked_array([0.0, 1.0, 2.0], mask=[0, 1, 0])  # type: ignore[no-untyped-call]
    with pytest.raises(mm.NonFiniteError, match="'times' is masked at frame 1"):
        mm.mesh_sequence(positions(), times=times)


@pytest.mark.parametrize("value", [1.7e308, -1.7e308, 5e306, 2 * LARGEST])
def test_numbers_whose_sums_overflow_are_refused_by_name(value: float) -> None:
    x = positions()
    x[1, 2, 1] = value
    with pytest.raises(mm.ParameterError, match=r"Frame 1, vertex 2: y is .*sums overflow") as one:
        mm.mesh_sequence(x)
    assert (one.value.frame, one.value.vertex) == (1, 2)
    with pytest.raises(mm.ParameterError, match="Frame 2 is timed at"):
        mm.mesh_sequence(positions(), times=[-1.0, 0.0, abs(value)])


@pytest.mark.parametrize("scale", [1e-310, 1e-320, 1e-304])
def test_numbers_too_small_to_be_divided_by_are_refused_by_name(scale: float) -> None:
    with pytest.raises(mm.ParameterError, match="no coordinate reaches 1e-300") as refused:
        mm.mesh_sequence(positions() * scale, FACES)
    assert "smaller unit" in refused.value.remedy
    assert mm.mesh_sequence(np.zeros((2, 4, 3))).n_vertices == 4
    assert SMALLEST < 1.0 < LARGEST
