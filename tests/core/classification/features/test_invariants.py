"""Features of modes as they are: what they do not depend on, and what they tell apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.classification.features import FeatureReader, motion_of
from modalmotion.classification.features.invariants import (
    Waves,
    invariant_columns,
    invariants,
    still_invariants,
    waves_of,
)
from modalmotion.classification.features.summary import summary, summary_columns
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.modes import lowest_modes
from modalmotion.modes.topology import CUP, CYLINDER, OPEN_CURVE, PLANE, TORUS, Topology
from modalmotion.signature.making import ModalSignature, modal_signature

KINDS = [(invariants, invariant_columns), (summary, summary_columns)]
Terms = NDArray[np.complex128]


def waves_on(topology: Topology, n_modes: int = 7) -> Waves:
    return waves_of(lowest_modes(topology, n_modes), theta_is_free=bool(topology.closed_axes))


def some_terms(seed: int, *, is_cycle: bool, n_modes: int = 7) -> Terms:
    rng = np.random.default_rng(seed)
    shape = (2 if is_cycle else 4, n_modes, 3)
    terms = rng.standard_normal(shape).astype(np.complex128)
    return terms + 1j * rng.standard_normal(shape) if is_cycle else terms


def started_at(terms: Terms, waves: Waves, angle: float, axis: int = 0) -> Terms:
    """The same motion with theta counted from elsewhere."""
    turned = terms.copy()
    for k, sine in enumerate(waves.sines):
        if sine >= 0:
            a = angle * waves.turns[k, axis]
            c, s = terms[:, waves.cosines[k]], terms[:, sine]
            turned[:, waves.cosines[k]] = np.cos(a) * c - np.sin(a) * s
            turned[:, sine] = np.sin(a) * c + np.cos(a) * s
    return turned


@settings(max_examples=40, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    vector=st.lists(st.floats(-3.0, 3.0), min_size=3, max_size=3),
    angle=st.floats(-4.0, 4.0),
    start=st.floats(-4.0, 4.0),
    topology=st.sampled_from([PLANE, CYLINDER, TORUS, OPEN_CURVE]),
    is_cycle=st.booleans(),
    kind=st.sampled_from([0, 1]),
)
def test_pose_start_angle_and_start_of_a_cycle_change_nothing(
    seed: int,
    vector: list[float],
    angle: float,
    start: float,
    topology: Topology,
    is_cycle: bool,
    kind: int,
) -> None:
    waves, (read, _) = waves_on(topology), KINDS[kind]
    terms = some_terms(seed, is_cycle=is_cycle)
    other = started_at(terms, waves, angle) @ Rotation.from_rotvec(vector).as_matrix().T
    if is_cycle:
        other = other * np.exp(1j * np.arange(1, 3) * start)[:, None, None]
    # Roots of products lose half of the digits where these vanish.
    found = read(terms, waves, is_cycle=is_cycle), read(other, waves, is_cycle=is_cycle)
    assert found[0] == pytest.approx(found[1], abs=1e-6)


@pytest.mark.parametrize(("read", "name"), KINDS)
@pytest.mark.parametrize("topology", [PLANE, TORUS])
@pytest.mark.parametrize("is_cycle", [True, False])
def test_every_value_has_a_name_of_its_own(
    read: object, name: object, topology: Topology, is_cycle: bool
) -> None:
    assert callable(read)
    assert callable(name)
    waves = waves_on(topology)
    values = read(some_terms(1, is_cycle=is_cycle), waves, is_cycle=is_cycle)
    columns = name(waves, 2 if is_cycle else 4, 3, is_cycle=is_cycle)
    assert len({column.name for column in columns}) == len(columns) == len(values)
    assert all(0 <= mode < 7 for column in columns for mode in column.modes)


def named(terms: Terms, waves: Waves, *, is_cycle: bool) -> dict[str, float]:
    columns = invariant_columns(waves, len(terms), 3, is_cycle=is_cycle)
    values = invariants(terms, waves, is_cycle=is_cycle)
    return dict(zip((column.name for column in columns), values.tolist(), strict=True))


def test_which_of_two_modes_leads_is_the_area_between_their_paths() -> None:
    terms = some_terms(4, is_cycle=False)
    waves = waves_on(OPEN_CURVE)
    t = np.linspace(0.0, 1.0, 20_001)
    paths = np.einsum("kt,kmd->tmd", np.cos(np.pi * np.arange(1, 5)[:, None] * t), terms.real)
    # However time is stretched.
    for share in (t, t**3):
        a = np.stack([np.interp(share, t, path) for path in paths.reshape(len(t), -1).T], axis=1)
        a = a.reshape(paths.shape)
        middle, step = (a[1:] + a[:-1]) / 2, np.diff(a, axis=0)
        for i, j in ((0, 1), (2, 5)):
            area = (middle[:, i] * step[:, j] - step[:, i] * middle[:, j]).sum()
            found = named(terms, waves, is_cycle=False)[f"ahead {waves.names[i]} {waves.names[j]}"]
            assert found * abs(found) == pytest.approx(area, rel=1e-3)


@pytest.mark.parametrize("is_cycle", [True, False])
def test_the_sense_in_which_a_wave_runs_is_seen_and_a_standing_one_has_none(
    is_cycle: bool,
) -> None:
    waves = waves_on(TORUS)
    k = waves.names.index("(0, 2)")
    found = []
    for sense in (1.0, -1.0, 0.0):
        terms = np.zeros((2, 7, 3), dtype=np.complex128)
        # In a course the cosine part moves before the sine part.
        terms[0, waves.cosines[k], 2] = 1.0
        terms[0 if is_cycle else 1, waves.sines[k], 2] = sense * (1j if is_cycle else 1.0)
        found.append(named(terms, waves, is_cycle=is_cycle)["runs (0, 2)"])
    assert found[0] == pytest.approx(-found[1])
    assert abs(found[0]) > 0.9
    assert found[2] == 0.0


def sheet(n_frames: int = 16, scale: float = 1.0) -> ModalSignature:
    s, u = np.meshgrid(np.linspace(0, 1, 8), np.linspace(0, 1.2, 10), indexing="ij")
    rest = np.stack([s.ravel(), u.ravel(), np.zeros(80)], axis=1)
    t = np.arange(n_frames) / n_frames
    lift = np.outer(np.cos(2 * np.pi * t), 0.1 * np.sin(3 * rest[:, 0]) * rest[:, 1])
    vertices = np.repeat(rest[None], n_frames, axis=0)
    vertices[:, :, 2] += lift
    return modal_signature(mesh_sequence(scale * vertices, grid=(8, 10), topology="plane"))


READERS = [
    FeatureReader(False, True, 2, False),
    FeatureReader(False, True, 2, False, is_brief=True),
    FeatureReader(False, False, 2, False, is_brief=True),
    FeatureReader(False, True, 2, False, typical=some_terms(3, is_cycle=True)),
]


@pytest.mark.parametrize("reader", READERS)
def test_how_much_moves_is_one_feature_and_the_unit_none(reader: FeatureReader) -> None:
    once = reader.read(sheet())
    assert once.names[0] == "motion"
    assert once.values == pytest.approx(reader.read(sheet(scale=1e-3)).values, abs=1e-6)
    signature = sheet()
    more = reader.read(replace(signature, amplitudes=1.5 * signature.amplitudes))
    assert more.values[0, 0] - once.values[0, 0] == pytest.approx(np.log(1.5))
    assert more.values[0, 1:] == pytest.approx(once.values[0, 1:], abs=1e-6)


@pytest.mark.parametrize("reader", READERS)
def test_no_motion_gives_finite_features(reader: FeatureReader) -> None:
    signature = sheet()
    still = reader.read(replace(signature, amplitudes=np.zeros_like(signature.amplitudes)))
    assert np.isfinite(still.values).all()
    assert not still.values[0, 1:].any()


def test_features_without_names_are_the_same() -> None:
    signature = sheet()
    for reader in READERS:
        found = reader.read(signature)
        values = reader.values(reader.waves(signature), motion_of(signature, reader))
        assert np.array_equal(found.values[0], values)
        assert len(found.columns) == found.values.shape[1]


def slow_invariants(motion: NDArray[np.complex128], waves: Waves, *, is_cycle: bool) -> list[float]:
    """Give them one by one, as their definition says."""
    nothing = np.zeros_like(motion[:, 0])
    c = [motion[:, k] for k in waves.cosines.tolist()]
    s = [motion[:, k] if k >= 0 else nothing for k in waves.sines.tolist()]
    n, k = len(c), np.arange(1, len(motion) + 1)

    def together(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> float:
        return float((a.conj() * b).sum().real)

    def ahead(a: NDArray[np.complex128], b: NDArray[np.complex128]) -> float:
        if is_cycle:
            return float((a.conj() * b).sum().imag)
        odd = [(i, j) for i in k.tolist() for j in k.tolist() if (i + j) % 2]
        areas = [2.0 * (i**2 + j**2) / (i**2 - j**2) for i, j in odd]
        pairs = [(a[i - 1] * b[j - 1]).sum().real for i, j in odd]
        return float(np.dot(areas, pairs))

    def root(value: float) -> float:
        return float(np.sign(value) * np.sqrt(abs(value)))

    pairs = [
        (i, j)
        for i in range(n)
        for j in range(i + 1, n)
        if waves.turns[i].tolist() == waves.turns[j].tolist()
    ]
    sizes = [
        float(np.sqrt((np.abs(c[i][h]) ** 2 + np.abs(s[i][h]) ** 2).sum()))
        for i in range(n)
        for h in range(len(motion))
    ]
    rows = motion[:, list(waves.all_modes)].reshape(-1, motion.shape[2])
    spread = np.linalg.svd(np.concatenate([rows.real, rows.imag]), compute_uv=False).tolist()
    values = sizes + [root(together(c[i], c[j]) + together(s[i], s[j])) for i, j in pairs]
    values += spread + [root(ahead(c[i], c[j]) + ahead(s[i], s[j])) for i, j in pairs]
    if not (waves.sines >= 0).any():
        return values
    has_sine = np.flatnonzero(waves.sines >= 0).tolist()
    values += [root(ahead(c[i], s[i])) for i in has_sine]
    both = [(i, j) for i, j in pairs if i in has_sine and j in has_sine]
    for product in (together, ahead):
        values += [root(product(c[i], s[j]) - product(s[i], c[j])) for i, j in both]
    return values


@pytest.mark.parametrize("is_cycle", [True, False])
@pytest.mark.parametrize("topology", [CUP, PLANE, TORUS])
@pytest.mark.parametrize("n_modes", [2, 9])
def test_they_are_those_of_their_definition(
    is_cycle: bool, topology: Topology, n_modes: int, rng: np.random.Generator
) -> None:
    waves = waves_on(topology, n_modes)
    motion = rng.normal(size=(3, n_modes, 3)) + 1j * is_cycle * rng.normal(size=(3, n_modes, 3))
    found = invariants(motion, waves, is_cycle=is_cycle)
    expected = slow_invariants(motion, waves, is_cycle=is_cycle)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    if not is_cycle:
        still = invariants(motion[:1], waves, is_cycle=False)
        alone = still_invariants(motion[0].real, waves)
        np.testing.assert_allclose(alone, still[: len(alone)], rtol=1e-9, atol=1e-9)
