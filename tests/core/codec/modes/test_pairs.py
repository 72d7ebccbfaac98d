"""Modes of pairs: a transform and its inverse, nearly orthonormal, without any solver."""

from __future__ import annotations

import numpy as np
import pytest
from codec_from_the_text import decode_from_the_text
from codec_sequences import errors_of, mesh_of_tube, random_sequence
from numpy.typing import NDArray

from modalmotion.codec import decode, encode
from modalmotion.codec.modes import pairs
from modalmotion.codec.modes.modes_section import read_modes
from modalmotion.codec.modes.pairs import fitted_pairs
from modalmotion.errors import MalformedFileError
from modalmotion.mesh.sequence import mesh_sequence

Ints = NDArray[np.int64]


def star(n: int) -> Ints:
    """Triangles that share one vertex."""
    rim = np.arange(1, n)
    return np.stack([np.zeros(n - 1, np.int64), rim, np.roll(rim, -1)], axis=1)


def shapes(rng: np.random.Generator) -> list[tuple[Ints, int]]:
    return [
        (mesh_of_tube(rng).faces, 96),
        (rng.integers(0, 90, size=(60, 3)), 93),
        (star(70), 70),
        (np.array([[0, 1, 2]]), 3),
        (np.array([[1, 1, 1]]), 4),
    ]


def test_it_is_a_transform_and_its_inverse(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pairs, "AT_ONCE", 64)
    for faces, n in shapes(rng):
        values = rng.normal(size=(7, n))
        modes = fitted_pairs(faces, values)
        coefficients = modes.analyse(values)
        assert np.abs(modes.synthesise(coefficients) - values).max() < 1e-12
        again = read_modes(modes.write(), n, faces)
        assert np.array_equal(again.synthesise(coefficients), modes.synthesise(coefficients))
        for wrong in (modes.write() + b"\0", b"\x04" if len(modes.levels) else b"\x04\0"):
            with pytest.raises(MalformedFileError):
                read_modes(wrong, n, faces)


def test_a_smooth_motion_is_expected_and_errors_hardly_grow(rng: np.random.Generator) -> None:
    sequence = mesh_of_tube(rng, (20, 24), 3)
    n = sequence.n_vertices
    values = sequence.vertices[0].T.astype(np.float64)
    modes = fitted_pairs(sequence.faces, values - values.mean())
    assert modes.expected[:4].min() > 40
    errors = modes.synthesise(np.eye(n))
    assert 1.0 <= (errors**2).sum() / n < 1.1
    fine = modes.analyse(values)[:, n // 2 :]
    plain = pairs.PairModes(modes.levels, modes.roots, np.zeros_like(modes.expected))
    assert (fine**2).sum() < 0.5 * (plain.analyse(values)[:, n // 2 :] ** 2).sum()


def test_a_mesh_where_few_find_a_mate_has_few_levels() -> None:
    """A hub has one mate: hostile streams cannot ask for a level for each vertex."""
    n = 3000
    hub = np.stack([np.zeros(n - 1, np.int64), np.arange(1, n), np.arange(1, n)], axis=1)
    assert not fitted_pairs(hub, np.zeros((1, n))).levels
    assert 1 < len(fitted_pairs(star(n), np.zeros((1, n))).levels) < 20


def test_a_stream_decodes_without_a_solver(
    rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = mesh_of_tube(rng)
    for asked in ({"rms": 0.05}, {"max_error": 0.1}):
        encoded = encode(sequence, effort="realtime", **asked)  # type: ignore[arg-type]
        for name in ("eigh", "eig", "svd", "solve", "inv", "qr", "lstsq", "cholesky"):
            monkeypatch.setattr(np.linalg, name, None)
        decoded = decode(encoded.data)
        monkeypatch.undo()
        rms, largest = errors_of(sequence, decoded)
        assert (rms if "rms" in asked else largest) <= next(iter(asked.values())) * (1 + 1e-12)
        vertices, faces = decode_from_the_text(encoded.data)
        assert np.array_equal(vertices, decoded.vertices)
        assert np.array_equal(np.array(faces), decoded.faces)
    scattered = mesh_sequence(rng.normal(size=(2, 93, 3)), shapes(rng)[1][0])
    data = encode(scattered, rms=0.2, effort="realtime").data
    assert np.array_equal(decode_from_the_text(data)[0], decode(data).vertices)


@pytest.mark.soak
@pytest.mark.parametrize("seed", range(200))
def test_the_bound_is_kept_on_random_sequences(seed: int) -> None:
    rng = np.random.default_rng(seed)
    sequence = random_sequence(rng)
    bound = 10.0 ** rng.uniform(-4.0, -0.5) * float(np.ptp(sequence.vertices, axis=(0, 1)).max())
    kind = "rms" if seed % 2 else "max_error"
    decoded = decode(encode(sequence, effort="realtime", **{kind: bound}).data)
    assert errors_of(sequence, decoded)[kind == "max_error"] <= bound * (1 + 1e-12)
