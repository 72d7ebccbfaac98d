"""Modes that swing over a surface: laws of the motion, and the files of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from modalmotion.errors import LimitError, ParameterError
from modalmotion.exports.animation import one_by_one, swing
from modalmotion.formats import read_sequence, write_glb
from modalmotion.limits import DEFAULT_LIMITS
from modalmotion.mesh.sequence import standard_surface
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.topologies import CYLINDER, parse_label
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.template import Template, make_template
from modalmotion.template.body_frame import Direction, directions_on
from modalmotion.template.vibration_modes import VibrationModes, surface_modes_named


@pytest.fixture(scope="module")
def tube() -> Template:
    return make_template(standard_surface(Lattice(CYLINDER, (12, 24))))


def modes_of(tube: Template, *labels: str) -> VibrationModes:
    return surface_modes_named(tube, [parse_label(label) for label in labels])


def test_the_first_frame_is_the_superposition_and_each_mode_swings_by_itself(
    tube: Template,
) -> None:
    modes = modes_of(tube, "0,1,cos", "0,2,sin", "0,0,cos")
    a = np.array([0.3, -0.2, 0.1])
    normals = directions_on(tube, Direction.NORMAL)
    moved = swing(tube, modes, a, normals, n_frames=16, seconds=4.0)
    x = np.stack([*moved.positions()])
    assert x[0] == pytest.approx(tube.vertices + (modes.shapes @ a)[:, None] * normals)
    turn = 2 * np.pi * np.arange(16) / 16
    # Twice the wavenumber, twice the frequency; mode 0 does not swing.
    expected = a * np.stack([np.cos(turn), np.cos(2 * turn), 1 + 0 * turn], axis=1)
    assert moved.amplitudes == pytest.approx(expected, abs=1e-14)
    assert moved.times == pytest.approx(np.arange(16) / 4)
    for height, positions in zip(moved.heights(), x, strict=True):
        assert ((positions - tube.vertices) * normals).sum(axis=1) == pytest.approx(height)
    together = swing(tube, modes, a, normals, n_frames=16, together=True)
    assert together.amplitudes[:, 1] == pytest.approx(a[1] * np.cos(turn), abs=1e-14)


def test_damping_takes_energy_away(tube: Template) -> None:
    modes, x = modes_of(tube, "1,0,cos"), np.broadcast_to([1.0, 0, 0], tube.vertices.shape)
    free, slow, critical = (
        swing(tube, modes, np.ones(1), x, n_frames=64, damping=share).amplitudes[:, 0]
        for share in (0.0, 0.1, 1.0)
    )
    t = 2 * np.pi * np.arange(64) / 64
    assert critical == pytest.approx((1 + t) * np.exp(-t))
    assert np.abs(slow[32:]).max() < 0.8 * np.abs(free[32:]).max()


def test_its_signature_gives_the_amplitudes_back(tube: Template) -> None:
    """Modes along z are what the fit finds, measured from frame 0."""
    modes = modes_of(tube, "1,1,cos", "2,0,cos")
    moved = swing(tube, modes, np.array([0.02, 0.01]), directions_on(tube, Direction.Z), n_frames=9)
    sequence = replace(moved.sequence(), grid=(12, 24))
    found = modal_signature(sequence, SignatureParameters(modes=7, remove_rotation=False))
    own = [found.modes.labels.index(label) for label in modes.labels]
    expected = moved.amplitudes - moved.amplitudes[0]
    assert found.amplitudes[:, own, 2] == pytest.approx(expected, abs=1e-15)
    assert np.abs(found.amplitudes).sum() == pytest.approx(np.abs(expected).sum(), abs=1e-12)


def test_a_glb_plays_the_same_positions(tube: Template) -> None:
    modes = modes_of(tube, "0,3,sin", "1,0,cos")
    normals = directions_on(tube, Direction.NORMAL)
    moved = swing(tube, modes, np.array([0.1, 0.2]), normals, n_frames=7, unit="mm")
    read = read_sequence(write_glb(moved.morph_animation())).sequence
    assert read.vertices == pytest.approx(np.stack([*moved.positions()]), abs=1e-6)
    assert (read.unit, read.topology) == ("mm", CYLINDER)
    assert read.times == pytest.approx(moved.times, abs=1e-6)


def test_modes_are_shown_one_after_the_other(tube: Template) -> None:
    modes = modes_of(tube, "0,0,cos", "1,0,cos", "0,1,sin")
    shown = one_by_one(tube, modes, directions_on(tube, Direction.NORMAL))
    assert (np.count_nonzero(shown.amplitudes, axis=1) <= 1).all()
    assert not shown.amplitudes[[0, -1]].any()
    assert (np.diff(shown.times) > 0).all()
    reach = max(float(np.abs(height).max()) for height in shown.heights())
    assert reach == pytest.approx(0.15 * np.ptp(tube.vertices, axis=0).max() / 2, rel=1e-6)


def test_what_cannot_be_shown_is_refused(tube: Template, monkeypatch: pytest.MonkeyPatch) -> None:
    modes, x = modes_of(tube, "1,0,cos"), directions_on(tube, Direction.X)
    for bad in (np.nan, np.inf):
        with pytest.raises(ParameterError, match="amplitude"):
            swing(tube, modes, np.array([bad]), x)
    for options in ({"n_frames": 0}, {"seconds": 0.0}, {"seconds": np.inf}, {"damping": -1.0}):
        with pytest.raises(ParameterError):
            swing(tube, modes, np.ones(1), x, **options)
    with pytest.raises(LimitError) as caught:
        swing(tube, modes, np.ones(1), x, n_frames=10_001)
    assert caught.value.limit == "frames"
    small = replace(DEFAULT_LIMITS, decompressed_bytes=10 * tube.vertices.nbytes)
    monkeypatch.setattr("modalmotion.exports.animation.DEFAULT_LIMITS", small)
    swing(tube, modes, np.ones(1), x, n_frames=10).sequence()
    with pytest.raises(LimitError, match="GLB"):
        swing(tube, modes, np.ones(1), x, n_frames=11).sequence()
