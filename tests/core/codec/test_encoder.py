"""The codec as a whole: what is asked for is kept, and the rest comes back exactly."""

from __future__ import annotations

from itertools import combinations
from typing import Any

import numpy as np
import pytest
from codec_sequences import (
    KINDS,
    Make,
    errors_of,
    jointed,
    lattice_sequence,
    mesh_of_tube,
    small_mesh_of_tube,
    triangles,
    wobbling,
)
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy import fft

from modalmotion.codec import Effort, decode, encode, inspect
from modalmotion.codec.coder import read_varint, write_varint
from modalmotion.codec.encoder import LONGEST_BLOCK
from modalmotion.codec.frames import fewest_corrections
from modalmotion.codec.search import least
from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes.topologies import CUP, CYLINDER, Topology
from modalmotion.progress import Progress


@pytest.mark.every(4)
@pytest.mark.parametrize("make", KINDS)
@pytest.mark.parametrize("effort", list(Effort))
def test_rms_and_max_error_are_kept_and_stated(
    make: Make, effort: Effort, rng: np.random.Generator
) -> None:
    sequence = make(rng)
    for target in (0.5, 0.05):
        encoded = encode(sequence, rms=target, effort=effort)
        rms, largest = errors_of(sequence, decode(encoded.data))
        assert rms <= target
        assert rms > 0.5 * target
        assert encoded.rms == pytest.approx(rms, rel=1e-9)
        assert encoded.max_error == pytest.approx(largest, rel=1e-12)
        encoded = encode(sequence, max_error=target, effort=effort)
        assert errors_of(sequence, decode(encoded.data))[1] <= target


@settings(deadline=None, max_examples=8)
@given(
    seed=st.integers(0, 1000),
    n_frames=st.integers(1, 8),
    n=st.integers(3, 12),
    share=st.floats(0.01, 10.0),
)
# A coarse step rounds learned components to the same one.
@example(seed=43, n_frames=6, n=9, share=0.2)
def test_an_error_that_is_large_against_the_extent_is_kept_too(
    seed: int, n_frames: int, n: int, share: float
) -> None:
    amplitudes = np.random.default_rng(seed).normal(size=(n_frames, 3, n))
    vertices = fft.idct(amplitudes, axis=2, norm="ortho").transpose(0, 2, 1)
    sequence = mesh_sequence(vertices)
    target = share * float(np.ptp(vertices, axis=(0, 1)).max())
    encoded = encode(sequence, max_error=target)
    assert errors_of(sequence, decode(encoded.data))[1] <= target


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_everything_but_the_positions_comes_back_exactly(
    dtype: type, rng: np.random.Generator
) -> None:
    sequence = lattice_sequence(rng, dtype)
    decoded = decode(encode(sequence, rms=0.1).data)
    assert decoded.vertices.dtype == dtype
    assert np.array_equal(decoded.faces, sequence.faces)
    assert decoded.times is not None
    assert np.array_equal(decoded.times, np.arange(9) / 30.0)
    assert (decoded.unit, decoded.topology, decoded.grid) == ("mm", CYLINDER, (8, 12))


def test_irregular_times_come_back_exactly(rng: np.random.Generator) -> None:
    times = np.sort(rng.uniform(size=9))
    sequence = mesh_sequence(wobbling(rng), times=times)
    decoded = decode(encode(sequence, rms=0.1).data)
    assert decoded.times is not None
    assert np.array_equal(decoded.times, times)


def test_the_orientation_of_faces_is_kept(
    rng: np.random.Generator,
) -> None:
    sequence = mesh_of_tube(rng)
    free = decode(encode(sequence, rms=0.1).data)
    assert triangles(free.faces) == triangles(sequence.faces)


def test_a_stream_keeps_within_the_bytes_it_was_given(rng: np.random.Generator) -> None:
    sequence = lattice_sequence(rng)
    sizes, errors = [], []
    for n_bytes in (300, 600, 1200, 20_000):
        encoded = encode(sequence, n_bytes=n_bytes, effort="fast")
        assert encoded.n_bytes <= n_bytes
        assert errors_of(sequence, decode(encoded.data))[0] == pytest.approx(encoded.rms)
        sizes.append(encoded.n_bytes)
        errors.append(encoded.rms)
    assert errors == sorted(errors, reverse=True)
    assert sizes[1] > 0.8 * 600
    assert errors[-1] == 0.0
    with pytest.raises(ParameterError, match="No stream of 20 bytes"):
        encode(sequence, n_bytes=20)


def test_modes_beat_what_a_coarse_stream_of_numbers_takes(rng: np.random.Generator) -> None:
    # Smooth motion at an error of its noise: far below a bit for each coordinate.
    encoded = encode(lattice_sequence(rng), rms=0.1)
    assert encoded.bits_per_vertex_and_frame < 4.0


@pytest.mark.parametrize(
    "asked", [{"rms": 0.1, "n_bytes": 10}, {"rms": -1.0}, {"max_error": float("nan")}]
)
def test_a_target_that_makes_no_sense_is_refused(
    asked: dict[str, Any], rng: np.random.Generator
) -> None:
    with pytest.raises(ParameterError):
        encode(lattice_sequence(rng), **asked)


def test_without_a_target_no_vertex_moves_by_more_than_a_share_of_the_diagonal(
    rng: np.random.Generator,
) -> None:
    sequence = lattice_sequence(rng)
    positions = sequence.vertices.reshape(-1, 3)
    most = 0.003 * float(np.linalg.norm(np.ptp(positions.astype(np.float64), axis=0)))
    encoded = encode(sequence)
    assert 0.5 * most < encoded.max_error <= most
    assert encoded.data == encode(sequence, max_error=most).data
    # All vertices in one place: nothing is lost.
    still = mesh_sequence(np.ones((2, 6, 3)), grid=(2, 3), topology="plane")
    assert encode(still).max_error == 0.0


def test_an_unknown_effort_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(ParameterError, match=r"effort .* is unknown"):
        encode(lattice_sequence(rng), rms=0.1, effort="heroic")


def test_progress_runs_from_nothing_to_all(rng: np.random.Generator) -> None:
    seen: list[Progress] = []
    encode(lattice_sequence(rng), n_bytes=900, effort="fast", progress=seen.append)
    shares = [progress.share for progress in seen]
    assert shares[0] == 0
    assert shares[-1] == 1
    assert shares == sorted(shares)


def test_progress_is_told_inside_a_block(rng: np.random.Generator) -> None:
    seen: list[Progress] = []
    encoded = encode(mesh_of_tube(rng), rms=0.1, progress=seen.append)
    shares = [progress.share for progress in seen]
    assert len(inspect(encoded.data).block_frames) == 1
    assert len([share for share in shares if 0 < share < 1]) >= 4
    assert shares == sorted(shares)


def test_long_sequences_are_read_in_part_and_block_by_block(rng: np.random.Generator) -> None:
    n_frames = 2 * LONGEST_BLOCK + 5
    vertices = wobbling(rng, grid=(3, 4), n_frames=n_frames)
    sequence = mesh_sequence(vertices, grid=(3, 4), topology="cylinder", times=np.arange(n_frames))
    data = encode(sequence, max_error=0.3, effort="fast").data
    assert len(inspect(data).block_frames) == 3
    whole = decode(data)
    part = decode(data, frames=range(300, 420))
    assert np.array_equal(part.vertices, whole.vertices[300:420])
    assert part.times is not None
    assert part.times[0] == 300.0
    # A block that is not asked for is not decoded.
    damaged = bytearray(data)
    damaged[-10] ^= 1
    assert np.array_equal(decode(bytes(damaged), frames=range(2)).vertices, whole.vertices[:2])
    with pytest.raises(MalformedFileError):
        decode(bytes(damaged))
    for bad in (range(5, 5), range(n_frames + 1), range(0, 10, 2), range(-1, 4)):
        with pytest.raises(ParameterError):
            decode(data, frames=bad)


@pytest.mark.parametrize("make", KINDS)
def test_decoding_does_not_hang_on_last_bits(
    make: Make, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Another processor or another number of threads sums in another order.
    from modalmotion.codec.block import Block

    data = encode(make(rng), max_error=0.2).data
    original = decode(data).vertices
    scaled = Block.scaled

    def elsewhere(block: Block, modes: object, *_: object) -> NDArray[np.float64]:
        exact: NDArray[np.float64] = scaled(block, modes)  # type: ignore[arg-type]
        last_bits: NDArray[np.float64] = rng.uniform(-5e-7, 5e-7, size=exact.shape)
        return exact + last_bits

    monkeypatch.setattr(Block, "scaled", elsewhere)
    for _ in range(5):
        assert np.array_equal(decode(data).vertices, original)


def test_one_thread_and_two_give_the_same_stream_and_vertices(rng: np.random.Generator) -> None:
    from threadpoolctl import threadpool_limits

    for make in (lattice_sequence, small_mesh_of_tube):
        sequence = make(rng)
        with threadpool_limits(1):
            one = encode(sequence, rms=0.1)
        with threadpool_limits(2):
            two = decode(one.data)
        with threadpool_limits(1):
            assert np.array_equal(decode(one.data).vertices, two.vertices)


def test_a_cup_lattice_uses_its_pole(rng: np.random.Generator) -> None:
    vertices = wobbling(rng)
    sequence = mesh_sequence(vertices, grid=(8, 12), topology=CUP)
    encoded = encode(sequence, max_error=0.1)
    assert "cup" in encoded.transform
    assert errors_of(sequence, decode(encoded.data))[1] <= 0.1


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**63 - 1))
def test_varints_come_back(value: int) -> None:
    assert read_varint(write_varint(value), 0) == (value, len(write_varint(value)))


def test_a_topology_may_be_stated_without_a_grid(rng: np.random.Generator) -> None:
    sequence = mesh_sequence(
        wobbling(rng)[:, :12], topology=Topology.parse("closed curve"), unit="cm"
    )
    decoded = decode(encode(sequence, rms=0.2).data)
    assert decoded.topology == sequence.topology
    assert decoded.unit == "cm"


def test_corrections_are_the_fewest_that_bring_every_vertex_back(rng: np.random.Generator) -> None:
    width, room = 115, 100.0
    left = rng.normal(0.0, 70.0, (3, 3, 400))
    steps = fewest_corrections(left, width, room)
    after = left - width * steps
    assert (np.sqrt((after**2).sum(axis=1)) <= room).all()
    frame, vertex = np.nonzero((left**2).sum(axis=1) > room**2)
    assert len(frame) > 300
    needed = np.zeros((3, 400), dtype=np.int64)
    for f, v in zip(frame, vertex, strict=True):
        whole = np.rint(left[f, :, v] / width)
        # Slowly: the smallest set of coordinates that is enough.
        needed[f, v] = next(
            n
            for n in (1, 2, 3)
            for chosen in combinations(range(3), n)
            if np.linalg.norm(left[f, :, v] - width * whole * np.isin(range(3), chosen)) <= room
        )
    np.testing.assert_array_equal((steps != 0).sum(axis=1), needed)


def test_the_least_cost_is_looked_for_between_steps_too() -> None:
    asked: list[float] = []

    def cost(step: float) -> int:
        asked.append(step)
        return int(1e6 * (1 + np.log(step / 1.3) ** 2))

    assert least(cost, 1.0, 1.35, 5) == pytest.approx(1.35)
    assert min(asked, key=lambda step: abs(np.log(step / 1.3))) == asked[-1]
    assert asked[-1] == pytest.approx(1.3, rel=1e-4)
    asked.clear()
    # No more than may be asked.
    least(cost, 1.0, 1.35, 3)
    assert len(asked) == 3


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube, jointed])
@pytest.mark.parametrize("bound", [{"rms": 0.3}, {"rms": 0.03}, {"max_error": 0.1}])
def test_no_effort_takes_more_bytes_than_a_lower_one(
    make: Make, bound: dict[str, float], rng: np.random.Generator
) -> None:
    sequence = make(rng)
    asked: dict[str, Any] = bound
    sizes = [encode(sequence, effort=effort, **asked).n_bytes for effort in Effort]
    assert sizes == sorted(sizes, reverse=True)


@pytest.mark.parametrize(("seed", "share"), [(36, 0.03), (62, 0.01), (75, 0.01)])
def test_components_that_a_coarse_step_makes_alike_are_shared(seed: int, share: float) -> None:
    """Else their difference takes numbers so large that the block would be stored as it is."""
    sequence = jointed(np.random.default_rng(seed), n_links=9, n_frames=30)
    bound = share * float(np.ptp(sequence.vertices, axis=(0, 1)).max())
    encoded = encode(sequence, max_error=bound, effort="fast")
    assert "stored" not in encoded.transform
    assert errors_of(sequence, decode(encoded.data))[1] <= bound
