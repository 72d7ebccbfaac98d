"""The error that was asked for is kept, whatever the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from codec_sequences import errors_of, triangles
from numpy.typing import NDArray
from project import DATA

from modalmotion.codec import decode, encode
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.numeric.scales import lengths


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("vertices", "faces"),
    [
        (np.zeros((1, 1, 3)), None),
        (np.ones((4, 5, 3)) * 7.25, None),
        (np.full((2, 3, 3), 1e300), [[0, 1, 2]]),
        (np.full((2, 3, 3), 1e-300), [[0, 1, 2]]),
        (np.arange(18.0).reshape(2, 3, 3) * 1e-300, [[0, 1, 2]]),
        (np.arange(18.0).reshape(2, 3, 3) + 1e9, [[0, 1, 2]]),
        (np.arange(18, dtype=np.float32).reshape(2, 3, 3) * np.float32(1e37), [[0, 1, 2]]),
        (np.arange(27.0).reshape(1, 9, 3), [[0, 1, 2], [0, 1, 2], [3, 3, 4], [2, 1, 0]]),
    ],
)
@pytest.mark.parametrize("target", [1e-320, 1e-9, 0.5, 1e12])
def test_extremes_keep_the_bound(
    vertices: NDArray[Any], faces: list[list[int]] | None, target: float
) -> None:
    sequence = mesh_sequence(vertices, faces)
    asks: list[dict[str, Any]] = [{"rms": target}, {"max_error": target}]
    for asked in asks:
        encoded = encode(sequence, **asked)
        decoded = decode(encoded.data)
        difference = decoded.vertices.astype(np.float64) - sequence.vertices.astype(np.float64)
        worst = lengths(difference).max()
        assert worst <= (target if "max_error" in asked else 4 * target)
        assert triangles(decoded.faces) == triangles(sequence.faces)


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
            worst = np.linalg.norm(difference, axis=-1).max()
            if name == "rms":
                worst = np.sqrt((difference**2).sum(axis=-1).mean())
            if not worst <= target or triangles(decoded.faces) != triangles(sequence.faces):
                found.append((seed, name))
    return found


def test_no_bound_is_broken_on_random_sequences() -> None:
    assert violations(5) == []


@pytest.mark.soak
def test_no_bound_is_broken_on_a_thousand_random_sequences() -> None:
    assert violations(1000) == []


@pytest.mark.soak
@pytest.mark.parametrize("share", [0.003, 0.0005])
def test_no_bound_is_broken_on_any_data(share: float) -> None:
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
