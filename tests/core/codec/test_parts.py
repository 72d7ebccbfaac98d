"""Parts that move as one: found, told, and worth it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from codec_sequences import errors_of, jointed, mesh_of_tube
from numpy.typing import NDArray

from modalmotion.codec import Effort, decode, encode, frames
from modalmotion.codec import parts as segments
from modalmotion.codec.block import (
    CHECKSUM_BYTES,
    N_FUNCTIONS,
    Parts,
    code_labels,
    read_block,
    write_block,
)
from modalmotion.codec.coder import Coder, Guards, read_varints, write_varint
from modalmotion.codec.frames import choose
from modalmotion.codec.parts import Articulated, Trial, segmented
from modalmotion.codec.search import ModalBlock, attempt
from modalmotion.codec.spatial_modes import LatticeModes
from modalmotion.codec.temporal import Temporal
from modalmotion.errors import MalformedFileError
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topologies import CYLINDER

Floats = NDArray[np.float64]


def offsets_of(sequence: MeshSequence) -> Floats:
    return sequence.vertices.transpose(0, 2, 1).astype(np.float64)


def motion_of(sequence: MeshSequence) -> ModalBlock:
    offsets = offsets_of(sequence)
    modes = choose(sequence, Effort.BALANCED).modes
    amplitudes = modes.analyse(offsets.reshape(-1, sequence.n_vertices)).reshape(offsets.shape)
    return ModalBlock(amplitudes, offsets, modes)


def some_parts(rng: np.random.Generator, n: int, count: int) -> Parts:
    pieces = [np.array([v]) for v in range(n)]
    return Parts(1, pieces, rng.permutation(np.arange(n) % count), count)


def test_functions_are_orthonormal_and_span_the_affine_maps(rng: np.random.Generator) -> None:
    parts = some_parts(rng, 40, 3)
    shape = rng.normal(size=(3, 40)) + 1e3
    functions = parts.functions(shape)
    rows = parts.apart(functions)
    assert np.abs(rows @ rows.T - np.eye(12)).max() < 1e-12
    moved = np.empty((3, 40))
    for part in parts.members:
        moved[:, part] = rng.normal(size=(3, 3)) @ shape[:, part] + rng.normal(size=(3, 1))
    numbers = parts.gathered(moved, functions)
    assert np.allclose(numbers, moved @ rows.T)
    assert np.allclose(parts.spread(numbers, functions), moved)


def test_a_flat_part_and_a_lone_vertex_have_fewer_functions(rng: np.random.Generator) -> None:
    flat = rng.normal(size=(3, 20))
    flat[2] = flat[0] - flat[1]
    parts = Parts(20, [np.arange(19), np.array([19])], np.array([0, 1]), 2)
    functions = parts.functions(flat)
    assert np.count_nonzero(functions[:, :19].any(axis=1)) == 3
    assert functions[:, 19].tolist() == [1.0, 0.0, 0.0, 0.0]
    assert not functions[3, :19].any()


def test_labels_come_back(rng: np.random.Generator) -> None:
    for count in (1, 2, 9):
        labels = rng.integers(count, size=30)
        writer = Coder()
        code_labels(writer, 30, count, labels)
        data = writer.finish()
        assert np.array_equal(code_labels(Coder(data), 30, count, None), labels)
    with pytest.raises(MalformedFileError, match="part 8 of 2"):
        code_labels(Coder(data), 30, 2, None)


def test_links_are_found_and_those_that_stay_together_are_one(rng: np.random.Generator) -> None:
    sequence = jointed(rng, n_links=5)
    offsets = offsets_of(sequence)
    # The last two links turn with the third: points on lines through its own.
    turned = offsets[:, :, 24:36]
    offsets[:, :, 36:48] = 2.0 * turned - turned[:, :, ::-1]
    offsets[:, :, 48:60] = 3.0 * turned - 2.0 * turned[:, :, :1]
    modes = choose(sequence, Effort.BALANCED).modes
    parts = segmented(offsets, 3, modes, 0.01, 0.13)
    assert parts is not None
    assert parts.largest == 60
    assert parts.labels.tolist() == [1, 2, 0, 0, 0]


def test_merging_is_as_with_maps_that_are_fitted_anew(rng: np.random.Generator) -> None:
    pieces = [np.arange(6 * i, 6 * i + 6) for i in range(9)]
    shape = rng.normal(0.0, 10.0, (3, 54))
    about = np.concatenate([np.ones((1, 54)), shape])
    # Three motions, and what moves beside them: more of it in some pieces than in others.
    maps = np.repeat(rng.normal(0.0, 1.0, (3, 5, 4)), 3, axis=0)
    features = np.concatenate([m @ about[:, p] for m, p in zip(maps, pieces, strict=True)], axis=1)
    features += rng.normal(0.0, 0.1, (5, 54)) * np.repeat(np.linspace(0.2, 2.0, 9), 6)

    def unexplained(rows: np.ndarray) -> float:
        x, y = about[:, rows].T, features[:, rows].T
        return float(((y - x @ np.linalg.lstsq(x, y)[0]) ** 2).sum())

    def growth(a: np.ndarray, b: np.ndarray) -> float:
        return unexplained(np.concatenate([a, b])) - unexplained(a) - unexplained(b)

    counts = set()
    for worth in (0.05, 0.2, 0.5, 1.0, 2.0, 1e9):
        groups = [piece.copy() for piece in pieces]
        while len(groups) > 1:
            pairs = [
                (growth(a, b), i, j) for j, b in enumerate(groups) for i, a in enumerate(groups[:j])
            ]
            least, i, j = min(pairs)
            if least > worth:
                break
            groups[i] = np.concatenate([groups[i], groups.pop(j)])
        owner = segments._merged(pieces, shape, features, worth)
        expected = {frozenset((group[::6] // 6).tolist()) for group in map(np.sort, groups)}
        assert {frozenset(np.flatnonzero(owner == k).tolist()) for k in set(owner)} == expected
        counts.add(len(groups))
    assert len(counts) > 3


def test_an_articulated_motion_takes_a_fifth_less(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = jointed(rng)
    for asked in ({"rms": 0.05}, {"max_error": 0.05}):
        encoded = encode(sequence, **asked)  # type: ignore[arg-type]
        assert encoded.transform.endswith("parts")
        assert errors_of(sequence, decode(encoded.data))["max_error" in asked] <= 0.05
        with monkeypatch.context() as patch:
            patch.setattr(frames, "_is_promising", lambda *_: False)
            without = encode(sequence, **asked)  # type: ignore[arg-type]
        assert encoded.n_bytes < 0.8 * without.n_bytes


def test_a_soft_motion_is_not_taken_apart(rng: np.random.Generator) -> None:
    motion = motion_of(mesh_of_tube(rng))
    assert not frames._is_promising(motion, 0.1)


def test_what_parts_leave_is_coded_in_modes(rng: np.random.Generator) -> None:
    sequence = jointed(rng)
    vertices = sequence.vertices.astype(np.float64)
    wave = np.sin(np.arange(12) / 2.0)[:, None] * np.linspace(-1.0, 1.0, 48) ** 2
    vertices[:, :, 2] += 2.0 * wave
    bent = mesh_sequence(vertices, sequence.faces)
    trial = attempt(motion_of(bent), Temporal.PARTS, 0.05)
    assert trial is not None
    assert trial.coefficients[3:].any()
    assert trial.maps.shape == (len(trial.basis), N_FUNCTIONS * 4)
    block = trial.block(12, 0, np.zeros(3, np.int64))
    scaled = block.scaled(choose(bent, Effort.BALANCED).modes)
    error = float(((scaled - offsets_of(bent)) ** 2).sum())
    assert error == pytest.approx(trial.squared_error, rel=1e-6)
    assert np.sqrt(error / 12 / 48) < 0.05


def test_numbers_are_quantised_again_for_less(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    trials: list[Trial] = []
    once = Articulated._quantised

    def noted(*given: Any) -> Any:
        found = once(*given)
        assert found is not None
        trials.append(found.trial)
        return found

    monkeypatch.setattr(Articulated, "_quantised", noted)
    trial = attempt(motion_of(jointed(rng)), Temporal.PARTS, 0.05)
    first, second = trials
    assert trial is second
    assert second.cost < first.cost
    assert second.quantiser.shifts != first.quantiser.shifts


def test_many_pieces_and_modes_without_connectivity_are_left_alone(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = jointed(rng)
    offsets = offsets_of(sequence)
    modes = choose(sequence, Effort.BALANCED).modes
    still = np.repeat(offsets[:1], 5, axis=0)
    assert segmented(still, 0, modes, 0.01, 0.13) is None
    monkeypatch.setattr(segments, "MOST_PIECES", 3)
    assert segmented(offsets, 0, modes, 0.01, 0.13) is None


@pytest.mark.parametrize(("largest", "count"), [(0, 1), (48, 0), (48, 13), (48, 300)])
def test_parts_that_make_no_sense_are_refused(
    largest: int, count: int, rng: np.random.Generator
) -> None:
    sequence = jointed(rng)
    motion = motion_of(sequence)
    assert motion.modes is not None
    trial = attempt(motion, Temporal.PARTS, 0.3)
    assert trial is not None
    assert trial.parts is not None
    none = np.zeros(0, dtype=np.int64)
    told = replace(trial.parts, largest=largest)
    block = replace(trial.block(12, 0, np.zeros(3, np.int64)), parts=told)
    shape = np.zeros((12, 48, 3), dtype=np.float32)
    data = write_block(block, Guards(none, none), None, shape)
    # Where both numbers stand: after the hash, kind, step, shifts, eight numbers, and one more.
    at = read_varints(data, CHECKSUM_BYTES + 8, 8)[1] + 1
    assert data[at : at + 2] == bytes([largest, trial.parts.count])
    hostile = data[: at + 1] + write_varint(count) + data[at + 2 :]
    with pytest.raises(MalformedFileError, match="header of a block"):
        read_block(hostile, 12, 48, motion.modes, np.dtype(np.float32))
    lattice = LatticeModes(CYLINDER, (6, 8), (9, 9))
    with pytest.raises(MalformedFileError, match="header of a block"):
        read_block(data, 12, 48, lattice, np.dtype(np.float32))
