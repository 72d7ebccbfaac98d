"""The codec as a whole: bounds, identity, damage."""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from modalmotion.codec import Effort, decode, decode_blocks, encode, inspect
from modalmotion.codec.encoder import LONGEST_BLOCK
from modalmotion.codec.modes_section import read_modes
from modalmotion.codec.varint import read_varint, write_varint
from modalmotion.errors import LimitError, MalformedFileError, ParameterError
from modalmotion.formats.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh import lattice_faces
from modalmotion.sequence import MeshSequence, mesh_sequence
from modalmotion.topology import CUP, CYLINDER, Topology

DATA = Path(__file__).resolve().parents[2] / ".." / "shared" / "data"


def wobbling(
    rng: np.random.Generator,
    topology: str = "cylinder",
    grid: tuple[int, int] = (8, 12),
    n_frames: int = 9,
) -> NDArray[np.float64]:
    """A tube that beats, with a little noise, mm."""
    s, theta = np.meshgrid(
        (np.arange(grid[0]) + 0.5) / grid[0], np.arange(grid[1]) / grid[1], indexing="ij"
    )
    frames = []
    for t in np.arange(n_frames) / n_frames:
        radius = 20.0 + 4.0 * np.cos(2 * np.pi * t) * s + np.cos(2 * np.pi * (2 * theta - t))
        angle = 2 * np.pi * theta
        frames.append(np.stack([radius * np.cos(angle), radius * np.sin(angle), 60.0 * s], axis=-1))
    moving: NDArray[np.float64] = np.array(frames).reshape(n_frames, -1, 3)
    return moving + rng.normal(scale=0.02, size=moving.shape)


def lattice_sequence(rng: np.random.Generator, dtype: type = np.float32) -> MeshSequence:
    vertices: NDArray[np.float64] = wobbling(rng).astype(dtype)
    return mesh_sequence(
        vertices,
        lattice_faces(CYLINDER, (8, 12)),
        grid=(8, 12),
        topology="cylinder",
        times=np.arange(9) / 30.0,
        unit="mm",
    )


def mesh_of_tube(rng: np.random.Generator, dtype: type = np.float32) -> MeshSequence:
    """The same without a lattice: spring modes."""
    faces = lattice_faces(CYLINDER, (8, 12))
    shuffled = rng.permutation(96)
    vertices = wobbling(rng)[:, np.argsort(shuffled)]
    return mesh_sequence(vertices.astype(dtype), shuffled[faces])


def errors_of(sequence: MeshSequence, decoded: MeshSequence) -> tuple[float, float]:
    difference = decoded.vertices.astype(np.float64) - sequence.vertices.astype(np.float64)
    rms = float(np.sqrt((difference**2).sum(axis=-1).mean()))
    return rms, float(np.abs(difference).max())


def triangles(faces: NDArray[np.int64]) -> list[tuple[int, ...]]:
    """Oriented triangles as a set: neither order nor first corner."""
    return sorted(min((a, b, c), (b, c, a), (c, a, b)) for a, b, c in faces.tolist())


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube])
@pytest.mark.parametrize("effort", list(Effort))
def test_rms_and_max_error_are_kept_and_stated(make, effort, rng) -> None:  # type: ignore[no-untyped-def]
    sequence = make(rng)
    for target in (0.5, 0.05):
        encoded = encode(sequence, rms=target, effort=effort)
        rms, largest = errors_of(sequence, decode(encoded.data))
        assert rms <= target
        assert rms > 0.5 * target
        assert encoded.rms == pytest.approx(rms, rel=1e-9)
        assert encoded.max_error == largest
        encoded = encode(sequence, max_error=target, effort=effort)
        assert errors_of(sequence, decode(encoded.data))[1] <= target


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_everything_but_the_positions_comes_back_exactly(dtype, rng) -> None:  # type: ignore[no-untyped-def]
    sequence = lattice_sequence(rng, dtype)
    decoded = decode(encode(sequence, rms=0.1).data)
    assert decoded.vertices.dtype == dtype
    assert np.array_equal(decoded.faces, sequence.faces)
    assert decoded.times is not None
    assert np.array_equal(decoded.times, np.arange(9) / 30.0)
    assert (decoded.unit, decoded.topology, decoded.grid) == ("mm", CYLINDER, (8, 12))


def test_irregular_times_come_back_exactly(rng) -> None:  # type: ignore[no-untyped-def]
    times = np.sort(rng.uniform(size=9))
    sequence = mesh_sequence(wobbling(rng), times=times)
    decoded = decode(encode(sequence, rms=0.1).data)
    assert decoded.times is not None
    assert np.array_equal(decoded.times, times)


def test_the_order_of_faces_is_kept_on_request_and_their_orientation_always(rng) -> None:  # type: ignore[no-untyped-def]
    sequence = mesh_of_tube(rng)
    kept = decode(encode(sequence, rms=0.1, keep_face_order=True).data)
    assert np.array_equal(kept.faces, sequence.faces)
    free = decode(encode(sequence, rms=0.1).data)
    assert triangles(free.faces) == triangles(sequence.faces)


def test_a_stream_keeps_within_the_bytes_it_was_given(rng) -> None:  # type: ignore[no-untyped-def]
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


def test_modes_beat_what_a_coarse_stream_of_numbers_takes(rng) -> None:  # type: ignore[no-untyped-def]
    # Smooth motion at an error of its noise: far below a bit for each coordinate.
    encoded = encode(lattice_sequence(rng), rms=0.1)
    assert encoded.bits_per_vertex_and_frame < 4.0


@pytest.mark.parametrize(
    "asked", [{}, {"rms": 0.1, "n_bytes": 10}, {"rms": -1.0}, {"max_error": float("nan")}]
)
def test_a_target_that_makes_no_sense_is_refused(asked, rng) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ParameterError):
        encode(lattice_sequence(rng), **asked)


def test_an_unknown_effort_is_refused(rng) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ParameterError, match="no effort"):
        encode(lattice_sequence(rng), rms=0.1, effort="heroic")


def test_progress_runs_from_nothing_to_all(rng) -> None:  # type: ignore[no-untyped-def]
    seen: list[float] = []
    encode(lattice_sequence(rng), n_bytes=900, effort="fast", progress=seen.append)
    assert seen[0] == 0.0
    assert seen[-1] == 1.0
    assert seen == sorted(seen)


def test_progress_is_told_inside_a_block(rng) -> None:  # type: ignore[no-untyped-def]
    seen: list[float] = []
    encoded = encode(mesh_of_tube(rng), rms=0.1, progress=seen.append)
    assert len(inspect(encoded.data).block_frames) == 1
    assert len([share for share in seen if 0.0 < share < 1.0]) >= 4
    assert seen == sorted(seen)


def test_long_sequences_are_read_in_part_and_block_by_block(rng) -> None:  # type: ignore[no-untyped-def]
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
    blocks = list(decode_blocks(data))
    assert [first for first, _ in blocks] == [0, 343, 686]
    assert np.array_equal(np.concatenate([b.vertices for _, b in blocks]), whole.vertices)
    # A block that is not asked for is not decoded.
    damaged = bytearray(data)
    damaged[-10] ^= 1
    assert np.array_equal(decode(bytes(damaged), frames=range(2)).vertices, whole.vertices[:2])
    with pytest.raises(MalformedFileError):
        decode(bytes(damaged))
    for bad in (range(5, 5), range(n_frames + 1), range(0, 10, 2), range(-1, 4)):
        with pytest.raises(ParameterError):
            decode(data, frames=bad)


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube])
def test_any_flipped_bit_is_refused(make, rng) -> None:  # type: ignore[no-untyped-def]
    data = encode(make(rng), rms=0.3).data
    for place in range(len(data)):
        damaged = bytearray(data)
        damaged[place] ^= 1 << int(rng.integers(8))
        with pytest.raises((MalformedFileError, LimitError)):
            decode(bytes(damaged))


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube])
def test_any_cut_and_any_addition_are_refused(make, rng) -> None:  # type: ignore[no-untyped-def]
    data = encode(make(rng), rms=0.3).data
    for length in range(len(data)):
        with pytest.raises(MalformedFileError):
            decode(data[:length])
    with pytest.raises(MalformedFileError, match="follow the end"):
        decode(data + b"\x00")


def sections(data: bytes) -> list[bytes]:
    found, position = [], 5
    while position < len(data):
        length, position = read_varint(data, position)
        found.append(data[position : position + length])
        position += length + 4
    return found


def rebuilt(parts: list[bytes]) -> bytes:
    """A stream whose checksums are right whatever it says."""
    data = b"MMSQ\x02"
    for part in parts:
        data += write_varint(len(part)) + part + struct.pack("<I", zlib.crc32(part))
    return data


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube])
def test_damage_behind_right_checksums_never_gives_other_vertices(make, rng) -> None:  # type: ignore[no-untyped-def]
    data = encode(make(rng), max_error=0.3).data
    original = decode(data).vertices
    parts = sections(data)
    limits = ReadLimits(frames=100, vertices=1000, faces=3000, decompressed_bytes=10_000_000)
    for _ in range(300):
        which = int(rng.integers(len(parts)))
        part = bytearray(parts[which])
        if not part:
            continue
        for _ in range(int(rng.integers(1, 4))):
            part[int(rng.integers(len(part)))] = int(rng.integers(256))
        hostile = rebuilt([*parts[:which], bytes(part), *parts[which + 1 :]])
        try:
            found = decode(hostile, limits=limits).vertices
        except (MalformedFileError, LimitError, ValueError):
            continue
        assert np.array_equal(found, original)


def test_headers_that_declare_too_much_are_refused_at_once(rng) -> None:  # type: ignore[no-untyped-def]
    parts = sections(encode(lattice_sequence(rng), rms=0.3).data)
    _, after_frames = read_varint(parts[0], 0)
    _, after_vertices = read_varint(parts[0], after_frames)
    huge = write_varint(9) + write_varint(10**9) + parts[0][after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([huge, *parts[1:]]))
    assert refused.value.limit == "vertices"
    many = write_varint(10_000) + write_varint(1_000_000) + parts[0][after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([many, *parts[1:]]))
    assert refused.value.limit == "decompressed_bytes"


def test_blocks_and_patches_that_cost_too_much_are_refused(rng) -> None:  # type: ignore[no-untyped-def]
    parts = sections(encode(mesh_of_tube(rng), rms=0.3).data)
    header = parts[0]
    # Nine frames in one block: of a mesh that would need 2^27 coordinates and more for them.
    _, after_frames = read_varint(header, 0)
    _, after_vertices = read_varint(header, after_frames)
    many = header[:after_frames] + write_varint(6_000_000) + header[after_vertices:]
    with pytest.raises(LimitError) as refused:
        decode(rebuilt([many, *parts[1:]]), limits=NO_LIMITS)
    assert refused.value.limit == "block"
    with pytest.raises(LimitError) as refused:
        read_modes(b"\x02\x00" + write_varint(5000) + bytes(16), 6000, np.zeros((0, 3), np.int64))
    assert refused.value.limit == "spring_modes"


def test_foreign_and_future_streams_are_refused_by_name(rng) -> None:  # type: ignore[no-untyped-def]
    data = encode(lattice_sequence(rng), rms=0.3).data
    with pytest.raises(MalformedFileError, match="no encoded sequence"):
        decode(b"PK\x03\x04" + data)
    with pytest.raises(MalformedFileError, match="no encoded sequence"):
        decode(b"")
    with pytest.raises(MalformedFileError, match="version 7"):
        decode(data[:4] + b"\x07" + data[5:])


def test_a_basis_that_differs_is_refused(rng, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    from modalmotion.codec.spring_modes import SpringModes

    data = encode(mesh_of_tube(rng), rms=0.3).data
    probe = SpringModes.probe
    monkeypatch.setattr(SpringModes, "probe", lambda modes: -probe(modes))
    with pytest.raises(MalformedFileError, match="spring modes"):
        decode(data)


def test_a_decoder_that_computes_differently_is_refused(rng, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    from modalmotion.codec.block import Block

    data = encode(lattice_sequence(rng), rms=0.3).data
    scaled = Block.scaled
    monkeypatch.setattr(Block, "scaled", lambda block, modes: scaled(block, modes) + 0.5)
    with pytest.raises(MalformedFileError, match="not those that were encoded"):
        decode(data)


@pytest.mark.parametrize("make", [lattice_sequence, mesh_of_tube])
def test_decoding_does_not_hang_on_last_bits(make, rng, monkeypatch) -> None:  # type: ignore[no-untyped-def]
    # Another processor or another number of threads sums in another order.
    from modalmotion.codec.block import Block

    data = encode(make(rng), max_error=0.2).data
    original = decode(data).vertices
    scaled = Block.scaled

    def elsewhere(block: Block, modes: object) -> NDArray[np.float64]:
        exact: NDArray[np.float64] = scaled(block, modes)  # type: ignore[arg-type]
        last_bits: NDArray[np.float64] = rng.uniform(-5e-7, 5e-7, size=exact.shape)
        return exact + last_bits

    monkeypatch.setattr(Block, "scaled", elsewhere)
    for _ in range(5):
        assert np.array_equal(decode(data).vertices, original)


def test_one_thread_and_two_give_the_same_stream_and_vertices(rng) -> None:  # type: ignore[no-untyped-def]
    from threadpoolctl import threadpool_limits

    for make in (lattice_sequence, mesh_of_tube):
        sequence = make(rng)
        with threadpool_limits(1):
            one = encode(sequence, rms=0.1)
        with threadpool_limits(2):
            two = decode(one.data)
        with threadpool_limits(1):
            assert np.array_equal(decode(one.data).vertices, two.vertices)


@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (np.zeros((1, 1, 3)), None),
        (np.ones((4, 5, 3)) * 7.25, None),
        (np.full((2, 3, 3), 1e300), [[0, 1, 2]]),
        (np.full((2, 3, 3), 1e-300), [[0, 1, 2]]),
        (np.arange(18.0).reshape(2, 3, 3) * 1e-310, [[0, 1, 2]]),
        (np.arange(18.0).reshape(2, 3, 3) + 1e9, [[0, 1, 2]]),
        (np.arange(18, dtype=np.float32).reshape(2, 3, 3) * np.float32(1e37), [[0, 1, 2]]),
        (np.arange(27.0).reshape(1, 9, 3), [[0, 1, 2], [0, 1, 2], [3, 3, 4], [2, 1, 0]]),
    ],
)
@pytest.mark.parametrize("target", [1e-320, 1e-9, 0.5, 1e12])
def test_extremes_keep_the_bound(vertices, faces, target) -> None:  # type: ignore[no-untyped-def]
    sequence = mesh_sequence(vertices, faces)
    for asked in ({"rms": target}, {"max_error": target}):
        encoded = encode(sequence, **asked)
        decoded = decode(encoded.data)
        difference = decoded.vertices.astype(np.float64) - sequence.vertices.astype(np.float64)
        assert np.abs(difference).max() <= (target if "max_error" in asked else 4 * target)
        assert triangles(decoded.faces) == triangles(sequence.faces)


def test_a_cup_lattice_uses_its_pole(rng) -> None:  # type: ignore[no-untyped-def]
    vertices = wobbling(rng)
    sequence = mesh_sequence(vertices, grid=(8, 12), topology=CUP)
    encoded = encode(sequence, max_error=0.1)
    assert "cup" in encoded.transform
    assert errors_of(sequence, decode(encoded.data))[1] <= 0.1


def random_sequences(count: int) -> Iterator[tuple[int, MeshSequence]]:
    topologies = ["plane", "cylinder", "torus", "cup", "sphere"]
    for seed in range(count):
        rng = np.random.default_rng(seed)
        n_frames = int(rng.integers(1, 12))
        kind = int(rng.integers(4))
        if kind == 0:
            grid = (int(rng.integers(1, 9)), 2 * int(rng.integers(1, 6)))
            n, faces = grid[0] * grid[1], None
            options = {"grid": grid, "topology": topologies[int(rng.integers(5))]}
        else:
            n = int(rng.integers(1, 60))
            faces = rng.integers(0, n, size=(int(rng.integers(0, 2 * n)), 3)) if kind > 1 else None
            options = {}
        smooth = np.cumsum(rng.normal(size=(n_frames, n, 3)), axis=int(rng.integers(2)))
        vertices = smooth * 10.0 ** rng.uniform(-12, 12) + rng.normal() * 10.0 ** rng.uniform(-9, 6)
        if rng.random() < 0.5:
            vertices = vertices.astype(np.float32)
        yield seed, mesh_sequence(vertices, faces, **options)  # type: ignore[arg-type]


def violations(count: int) -> list[tuple[int, str]]:
    found = []
    for seed, sequence in random_sequences(count):
        rng = np.random.default_rng(seed)
        exact = sequence.vertices.astype(np.float64)
        extent = float(np.ptp(exact)) or 1.0
        target = extent * 10.0 ** rng.uniform(-9, 0)
        for name in ("max_error", "rms"):
            encoded = encode(sequence, effort="fast", **{name: target})
            decoded = decode(encoded.data)
            difference = decoded.vertices.astype(np.float64) - exact
            worst = np.abs(difference).max()
            if name == "rms":
                worst = np.sqrt((difference**2).sum(axis=-1).mean())
            if not worst <= target or triangles(decoded.faces) != triangles(sequence.faces):
                found.append((seed, name))
    return found


def test_no_bound_is_broken_on_random_sequences() -> None:
    assert violations(40) == []


@pytest.mark.soak
def test_no_bound_is_broken_on_a_thousand_random_sequences() -> None:
    assert violations(1000) == []


@pytest.mark.soak
@pytest.mark.parametrize("share", [0.003, 0.0005])
def test_no_bound_is_broken_on_any_data(share) -> None:  # type: ignore[no-untyped-def]
    paths = sorted(DATA.glob("*/*.npz"))
    if not paths:
        pytest.skip("the shared data are not beside the project")
    from modalmotion.formats import read_npz

    for path in paths:
        sequence = read_npz(path.read_bytes()).sequence
        extent = float(
            np.linalg.norm(np.ptp(sequence.vertices.astype(np.float64), axis=1), axis=-1).mean()
        )
        encoded = encode(sequence, max_error=share * extent, effort="fast")
        assert errors_of(sequence, decode(encoded.data))[1] <= share * extent, path


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 2**63 - 1))
def test_varints_come_back(value: int) -> None:
    assert read_varint(write_varint(value), 0) == (value, len(write_varint(value)))


def test_a_topology_may_be_stated_without_a_grid(rng) -> None:  # type: ignore[no-untyped-def]
    sequence = mesh_sequence(
        wobbling(rng)[:, :12], topology=Topology.parse("closed curve"), unit="cm"
    )
    decoded = decode(encode(sequence, rms=0.2).data)
    assert decoded.topology == sequence.topology
    assert decoded.unit == "cm"


@pytest.mark.parametrize("target", [1e-12, 1e-17, 1e-160, 5e-324])
@pytest.mark.parametrize("measure", ["rms", "max_error"])
@pytest.mark.parametrize("size", [1.0, 0.0, 1e150])
def test_an_error_that_no_number_holds_is_kept_by_storing_without_loss(
    measure: str, target: float, size: float, rng: np.random.Generator
) -> None:
    vertices = size * rng.normal(size=(3, 16, 3))
    sequence = mesh_sequence(vertices, grid=(4, 4), topology="cup", unit="mm")
    rms, max_error = (target, None) if measure == "rms" else (None, target)
    encoded = encode(sequence, rms=rms, max_error=max_error)
    assert np.array_equal(decode(encoded.data).vertices, vertices)
