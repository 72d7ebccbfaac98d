"""The picture of a signature shows its numbers, whatever it is of."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from matplotlib.container import BarContainer
from matplotlib.image import imread

import modalmotion as mm
from modalmotion.mesh import lattice_faces
from modalmotion.modes.topologies import CYLINDER
from modalmotion.pictures.signature import main_trajectories, signature_figure

SCALES = {"tiny": 1e-300, "huge": 1e300, "far away": 1.0}


def test_trajectories_are_amplitudes_along_one_direction(rng: np.random.Generator) -> None:
    beat = mm.simulate_ventricle(grid=(12, 16), rng=rng)
    signature = mm.modal_signature(beat)
    found = main_trajectories(signature)
    assert found.shape == signature.amplitudes.shape[:2]
    for mode in range(found.shape[1]):
        of_mode = signature.amplitudes[:, mode]
        # No other direction holds more of the mode's squares, and none less than a third of them.
        squares = (found[:, mode] ** 2).sum()
        directions = rng.normal(size=(200, 3))
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        others = ((of_mode @ directions.T) ** 2).sum(axis=0)
        assert others.max() <= squares * (1 + 1e-12)
        assert squares <= (of_mode**2).sum() * (1 + 1e-12)
        assert found[np.abs(found[:, mode]).argmax(), mode] >= 0.0


def test_the_panels_hold_the_signatures_numbers(rng: np.random.Generator) -> None:
    beat = mm.simulate_ventricle(grid=(12, 16), rng=rng)
    signature = mm.modal_signature(beat)
    _, below = signature_figure(beat, signature).subfigs
    lines, bars, errors = below.axes
    assert signature.times is not None
    heights = sorted(float(np.max(np.asarray(line.get_ydata()))) for line in lines.lines)
    np.testing.assert_allclose(heights, np.sort(main_trajectories(signature).max(axis=0)))
    (container,) = bars.containers
    assert isinstance(container, BarContainer)
    np.testing.assert_array_equal(container.datavalues, signature.deformation_spectrum)
    names = [label.get_text() for label in bars.get_yticklabels()]
    for name, mode in zip(names, signature.modes.labels, strict=True):
        assert name.endswith(str(mode))
    # In words, once for a pair.
    assert len(names[0]) > len(str(signature.modes.labels[0]))
    shown = {line.get_label(): line for line in errors.lines}
    for name, values in (
        ("motion, RMS", signature.motion_rms),
        ("error, largest", signature.max_errors),
        ("error, RMS", signature.rms_errors),
    ):
        np.testing.assert_array_equal(shown[name].get_xdata(), signature.times)
        np.testing.assert_array_equal(shown[name].get_ydata(), values)


@pytest.mark.every(3)
@pytest.mark.parametrize(
    "kind",
    ["one frame", "static", "curve", "mesh", "many modes", "mean", "tiny", "huge", "far away"],
)
def test_every_kind_of_sequence_is_drawn(
    kind: str, tmp_path: Path, rng: np.random.Generator
) -> None:
    beat = mm.simulate_ventricle(grid=(12, 16), rng=rng)
    grid, topology = (12, 16), "cup"
    positions = beat.vertices
    if kind == "one frame":
        sequence = mm.mesh_sequence(positions[:1], grid=grid, topology=topology)
    elif kind == "static":
        sequence = mm.mesh_sequence(positions[[0, 0]], grid=grid, topology=topology)
    elif kind == "curve":
        sequence = mm.mesh_sequence(positions[:, :12], grid=(12,), topology="open_curve")
    elif kind == "mesh":
        faces = lattice_faces(CYLINDER, grid)
        sequence = mm.mesh_sequence(positions, faces=faces)
    elif kind in SCALES:
        scaled = positions * SCALES[kind] + 1e9 * (kind == "far away")
        sequence = mm.mesh_sequence(scaled, grid=grid, topology=topology)
    else:
        sequence = beat
    parameters = mm.SignatureParameters(modes=4)
    if kind == "many modes":
        parameters = mm.SignatureParameters(modes=40)
    if kind == "mean":
        parameters = mm.SignatureParameters(reference="mean")
    path = tmp_path / "picture.png"
    signature = mm.modal_signature(sequence, parameters)
    signature_figure(sequence, signature).savefig(path, dpi=40)
    picture = imread(path)
    assert picture[..., :3].min() < 0.3 < 0.99 < picture[..., :3].max()
