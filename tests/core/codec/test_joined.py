"""Modes joined from leaves: complete, orthonormal, nearly the eigenvectors, alike everywhere."""

from __future__ import annotations

import numpy as np
import pytest
import scipy
from numpy.typing import NDArray

from modalmotion.codec import joined_modes as joined
from modalmotion.codec.joined_modes import edges_of, stiffness_of
from modalmotion.codec.spatial_modes import Cut, PatchModes, read_modes
from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topologies import CYLINDER

Floats = NDArray[np.float64]

FACES = lattice_faces(CYLINDER, (9, 14))
N = 9 * 14 + 1
CUTS = (Cut(200, 200), Cut(200, 30, 80), Cut(70, 16, 50), Cut(200, 10, 0), Cut(200, 16, 255))


def modes_of(cut: Cut) -> PatchModes:
    """Modes of a tube, and of one vertex that no triangle has."""
    return PatchModes(edges_of(FACES), N, cut)


def stiffness() -> Floats:
    edges = edges_of(FACES)
    K = np.zeros((N, N))
    K[edges[:, 0], edges[:, 1]] = K[edges[:, 1], edges[:, 0]] = -stiffness_of(edges)
    K -= np.diag(K.sum(axis=1))
    return K


@pytest.mark.parametrize("cut", CUTS)
def test_modes_are_complete_and_orthonormal(cut: Cut, rng: np.random.Generator) -> None:
    modes = modes_of(cut)
    basis = modes.synthesise(np.eye(N))
    assert np.abs(basis @ basis.T - np.eye(N)).max() < 1e-12
    values = rng.normal(size=(4, N))
    assert np.abs(modes.analyse(values) - values @ basis.T).max() < 1e-12
    few = rng.normal(size=(2, 5))
    assert np.allclose(modes.synthesise(few), few @ basis[:5], atol=1e-12)


def test_joined_modes_are_nearly_the_eigenvectors() -> None:
    """Energies of the lowest: joining brings them near, the rotation nearer."""
    K = stiffness()
    exact = np.linalg.eigvalsh(K)[2:10]
    energy = {}
    for cut in (Cut(32, 32), Cut(200, 32, 80)):
        basis = modes_of(cut).synthesise(np.eye(N)[:10])
        energy[cut.patch] = np.diag(basis @ K @ basis.T)[2:]
    assert np.abs(energy[200] / exact - 1.0).max() < 0.05
    assert np.abs(energy[32] / exact - 1.0).max() > 1.0


@pytest.mark.parametrize("cut", CUTS[:3])
def test_what_another_solver_finds_differs_less_than_the_errors_reckoned_with(
    cut: Cut, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    coefficients = rng.normal(size=(6, N))
    modes = modes_of(cut)
    values = modes.synthesise(coefficients)
    shaken = np.abs(modes.shaken.synthesise(coefficients) - values).max()

    def otherwise(K: Floats, _: object) -> tuple[Floats, Floats]:
        # Its vertices from the last to the first, by another algorithm.
        square, Phi = scipy.linalg.eigh(K[::-1, ::-1], driver="evr")
        return square, Phi[::-1]

    monkeypatch.setattr(joined, "_eigenvectors", otherwise)
    other = np.abs(modes_of(cut).synthesise(coefficients) - values).max()
    assert 0.0 < other < 2.0 * shaken < 1e-9


def test_sections_that_make_no_sense_are_refused() -> None:
    good = modes_of(CUTS[1]).write()
    assert np.array_equal(
        read_modes(good, N, FACES).synthesise(np.eye(N)[:3]),
        modes_of(CUTS[1]).synthesise(np.eye(N)[:3]),
    )
    # Kind, patch (two bytes), leaf, share.
    for data in (good[:3] + b"\0" + good[4:], good[:3] + b"\xc9\x01" + good[4:], good + b"\0"):
        with pytest.raises(MalformedFileError):
            read_modes(data, N, FACES)
    # Half of a large patch joined.
    costly = b"\x02\x80\x20\x10\x80"
    with pytest.raises(LimitError):
        read_modes(costly, 2_000_000, FACES)
