"""Vertices that are not there in some frames."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from slow_fits import assert_same, slow_fit
from template_surfaces import Moving, describe, fit_sequence, make_ventricle

from modalmotion.errors import ModeCountError, ParameterError, ShapeError
from modalmotion.fit.basis import make_basis
from modalmotion.fit.fit import Fit
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.template import choose_modes, make_template
from modalmotion.template.body_frame import Components, local_frames


@pytest.fixture(scope="module", name="heart")
def _heart() -> Moving:
    return make_ventricle(600, np.random.default_rng(0))


def fitted(
    moving: Moving,
    present: np.ndarray,
    n_modes: int = 7,
    components: Components = Components.CARTESIAN,
    whole: Moving | None = None,
) -> Fit:
    sequence = mesh_sequence(*moving)
    template = make_template(sequence if whole is None else mesh_sequence(*whole))
    basis = make_basis(template, choose_modes(template, n_modes).modes)
    return fit_sequence(sequence, template, basis, present=present, components=components)


def holes(moving: Moving, share: float, seed: int = 1) -> np.ndarray:
    present: np.ndarray = np.random.default_rng(seed).random(moving[0].shape[:2]) >= share
    present[0] = True
    return present


@pytest.mark.parametrize("components", list(Components))
def test_against_the_slow_twin(heart: Moving, components: Components) -> None:
    present = holes(heart, 0.3)
    present[[3, 4]] = True
    fit = fitted(heart, present, 18, components)
    found = describe(heart, 18)
    basis = make_basis(found.template, choose_modes(found.template, 18).modes)
    frames = local_frames(found.template) if components == Components.CYLINDRICAL else None
    slow = slow_fit(
        heart[0],
        found.template,
        basis.shapes,
        remove_rotation=True,
        frames=frames,
        present=present,
    )
    assert_same(fit, slow)
    assert fit.coverages == pytest.approx(present @ found.template.weights)
    assert fit.conditions[3] == basis.condition
    assert fit.conditions[1] > 1.0


def test_what_is_not_there_is_not_read(heart: Moving) -> None:
    present = holes(heart, 0.2)
    vertices = heart[0].copy()
    vertices[~present] = 1e30
    garbage = fitted((vertices, heart[1]), present, whole=heart)
    elsewhere = np.where(present[:, :, None], heart[0], -7.0)
    other = fitted((elsewhere, heart[1]), present, whole=heart)
    assert garbage.amplitudes == pytest.approx(other.amplitudes, abs=1e-11)
    assert garbage.errors.max == pytest.approx(other.errors.max, abs=1e-11)


def test_all_there_is_as_if_nothing_was_said(heart: Moving) -> None:
    everything = np.ones(heart[0].shape[:2], dtype=np.bool_)
    assert (fitted(heart, everything).amplitudes == describe(heart).fit.amplitudes).all()


@pytest.mark.parametrize(("share", "bound"), [(0.5, 0.05), (0.9, 0.15), (0.95, 0.3)])
def test_random_half_tenth_and_twentieth_of_the_vertices(share: float, bound: float) -> None:
    moving = make_ventricle(1600, np.random.default_rng(0))
    whole = describe(moving).fit.amplitudes
    part = fitted(moving, holes(moving, share)).amplitudes
    change = np.sqrt(((part - whole)[1:] ** 2).sum(axis=(1, 2)).mean())
    size = np.sqrt((whole[1:] ** 2).sum(axis=(1, 2)).mean())
    assert change / size <= bound


def test_a_rigid_motion_stays_one_with_a_side_missing(heart: Moving) -> None:
    start = heart[0][0]
    turn = Rotation.from_rotvec([0.4, -0.9, 0.3]).as_matrix()
    moved = np.stack([start, start @ turn.T + [5.0, -3.0, 8.0]])
    present = np.stack([np.ones(len(start), dtype=bool), start[:, 0] > 0])
    fit = fitted((moved, heart[1]), present)
    assert fit.rotations.matrices[1] == pytest.approx(turn, abs=1e-12)
    assert fit.amplitudes[1, 1:] == pytest.approx(0.0, abs=1e-10)
    whole = describe((moved, heart[1])).fit
    # The translation is that of the whole surface, not of the side that is there.
    assert fit.amplitudes[1] == pytest.approx(whole.amplitudes[1], abs=1e-10)


def test_too_little_names_the_frame(heart: Moving) -> None:
    present = np.ones(heart[0].shape[:2], dtype=np.bool_)
    present[5, 4:] = False
    with pytest.raises(ModeCountError, match="Frame 5") as caught:
        fitted(heart, present)
    assert caught.value.frame == 5
    present[5] = False
    with pytest.raises(ParameterError, match="frame 5") as empty:
        fitted(heart, present)
    assert empty.value.frame == 5


def test_an_incomplete_reference_is_refused(heart: Moving) -> None:
    present = np.ones(heart[0].shape[:2], dtype=np.bool_)
    present[0, 17] = False
    with pytest.raises(ParameterError, match="Vertex 17 is missing") as caught:
        fitted(heart, present)
    assert (caught.value.frame, caught.value.vertex) == (0, 17)


def test_another_shape_is_refused(heart: Moving) -> None:
    with pytest.raises(ShapeError, match="present"):
        fitted(heart, np.ones(heart[0].shape[1], dtype=np.bool_))
    with pytest.raises(ShapeError, match="truth values"):
        fitted(heart, np.ones(heart[0].shape[:2]))
