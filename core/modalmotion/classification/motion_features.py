"""Features of motions: parts about an axis, waves, and the tables of them that models read.

About an axis: contraction, twist, shortening, and what is one-sided. Waves are features of any
topology that depend neither on the start nor, where it is free, on theta.
"""

import cmath
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np

from modalmotion.classification.motion import N_COSINES, N_HARMONICS, Column, Motion
from modalmotion.classification.options import Timing
from modalmotion.mesh import sequence, spring_modes
from modalmotion.modes.topologies import CLOSED
from modalmotion.representation import Array, Complexes, Floats, Ints, shown


class _Places(NamedTuple):
    """Modes of the parts: (p, 0) of p > 0, and the cosine and sine of (p, p'), p' = 1 first."""

    flat: Ints
    cosines: Ints
    sines: Ints
    n_rings: int


def has_axis(modes: spring_modes.Modes) -> bool:
    """Whether motions in these modes have parts about an axis."""
    topology = modes.topology
    if topology is None or [end == CLOSED for end in topology.ends] != [False, True]:
        return False
    places = _places(modes)
    return len(places.flat) > 0 and places.n_rings > 0


def axis_parts(terms: Complexes, modes: spring_modes.Modes, *, walls: bool) -> Floats:
    """Read the parts of a cycle about an axis, (features,) float64; see `axis_columns`.

    Parameters
    ----------
    terms : (harmonics, modes, 3 or 1) complex128
        In the frame of the body: towards the zero of theta, across it, along the axis; of normal
        displacements outwards.
    modes : Modes
    walls : bool
        Whether the zero of theta is a known place on the body, so that parts without a sign have
        components towards it and across.

    Notes
    -----
    With w(v) = v1 + i v2 the parts are, of the cosine c and sine s of (p, p'):

    - radial p and turning p, (w(c) - i w(s)) / 2 of p' = 1: contraction, and a level that turns
      against the others (twist);
    - axial p and across p, along the axis and w of (p, 0): shortening and bending;
    - oval p, (w(c) + i w(s)) / 2 of p' = 1: rings that become ellipses;
    - tilt p, c3 - i s3 of p' = 1: rings that tilt;
    - lobe, wave and side (p, p'): these three of p' > 1.

    Along normals they are radial p, of (p, 0), and side p, oval p and lobe (p, p') of the pairs.
    Phases count from the height of the contraction. What has a sign is given by cosine and sine
    of each harmonic; of the others, whose direction is arbitrary, the roots of the lengths in
    phase and out of phase with it. A start angle turns c and s into one another and changes none.
    """
    flat, c, s, n = _places(modes)
    if terms.shape[2] == 1:
        whole = int(np.flatnonzero(~modes.wavenumbers.any(axis=1))[0])
        signed = [terms[:, [whole, *flat.tolist()], 0]]
        x, y = terms[:, c, 0], terms[:, s, 0]
    else:
        u, v, z = (terms[..., k] for k in range(3))
        signed = [(u[:, c] + v[:, s])[:, :n] / 2, (v[:, c] - u[:, s])[:, :n] / 2, z[:, flat]]
        x = np.concatenate(
            [u[:, flat], (u[:, c] - v[:, s]) / 2, z[:, c], (u[:, c] + v[:, s])[:, n:] / 2], axis=1
        )
        y = np.concatenate(
            [v[:, flat], (v[:, c] + u[:, s]) / 2, -z[:, s], (v[:, c] - u[:, s])[:, n:] / 2], axis=1
        )
    parts = np.concatenate(signed, axis=1)
    clock = cmath.phase(-complex(parts[0, 0]))
    parts = parts * np.exp(-1j * np.arange(1, len(terms) + 1) * clock)[:, None]
    x, y = (value[0] * cmath.exp(-1j * clock) for value in (x, y))
    values = np.stack([parts.real, parts.imag], axis=2).transpose(1, 0, 2).ravel()
    if walls:
        across = np.stack([x.real, x.imag, y.real, y.imag], axis=1)
    else:
        across = np.sqrt(np.stack([np.hypot(x.real, y.real), np.hypot(x.imag, y.imag)], axis=1))
    # "radial 0 sin 1" is 0 by the choice of the phase.
    return np.concatenate([values[:1], values[2:], across.ravel()])


@lru_cache(maxsize=64)
def axis_columns(
    modes: spring_modes.Modes, n_harmonics: int, *, along_normal: bool, walls: bool
) -> tuple[Column, ...]:
    """Columns of the values of `axis_parts`."""
    flat, c, s, n = _places(modes)
    pairs = list(zip(c.tolist(), s.tolist(), strict=True))
    levels: list[tuple[int, tuple[int, ...]]] = [
        (p, (k,)) for k, p in zip(flat.tolist(), modes.wavenumbers[flat, 0].tolist(), strict=True)
    ]

    def named(names: dict[int, str], more: str) -> list[tuple[str, tuple[int, ...]]]:
        """Name pairs by how often they turn."""
        return [
            (f"{names[turns]} {p}" if turns in names else f"{more} ({p}, {turns})", pair)
            for (p, turns), pair in zip(modes.wavenumbers[c].tolist(), pairs, strict=True)
        ]

    if along_normal:
        whole = int(np.flatnonzero(~modes.wavenumbers.any(axis=1))[0])
        signed = [(f"radial {p}", of) for p, of in [(0, (whole,)), *levels]]
        others = named({1: "side", 2: "oval"}, "lobe")
    else:
        signed = named({1: "radial"}, "")[:n] + named({1: "turning"}, "")[:n]
        signed += [(f"axial {p}", of) for p, of in levels]
        others = [(f"across {p}", of) for p, of in levels]
        others += named({1: "oval"}, "lobe") + named({1: "tilt"}, "wave") + named({}, "side")[n:]
    columns = [
        Column(f"{name} {phase} {h}", of)
        for name, of in signed
        for h in range(1, n_harmonics + 1)
        for phase in ("cos", "sin")
    ]
    del columns[1]
    columns += [
        Column(f"{name}{side} {phase} 1", of)
        for name, of in others
        for side in ((" towards zero", " across zero") if walls else ("",))
        for phase in ("cos", "sin")
    ]
    return tuple(columns)


@lru_cache(maxsize=64)
def _places(modes: spring_modes.Modes) -> _Places:
    cosines, sines = spring_modes.wave_pairs(modes)
    p, turns = modes.wavenumbers[cosines].T
    order = np.lexsort((p, turns))
    flat, paired = order[(turns[order] == 0) & (p[order] > 0)], order[sines[order] >= 0]
    return _Places(cosines[flat], cosines[paired], sines[paired], int((turns[paired] == 1).sum()))


class Waves(NamedTuple):
    """Modes taken together where a start angle would mix them: each alone, or pairs.

    Parameters
    ----------
    names : tuple of str
    modes : tuple of tuple of int
        Cosine and, where theta is free, sine of each.
    i, j : (pairs,) int64
        Waves whose products a start angle keeps: those of the same turns.
    """

    names: tuple[str, ...]
    modes: tuple[tuple[int, ...], ...]
    i: Ints
    j: Ints


@lru_cache(maxsize=64)
def waves_of(modes: spring_modes.Modes, *, walls: bool) -> Waves:
    """Group modes into waves."""
    topology = modes.topology
    members: tuple[tuple[int, ...], ...]
    turns: list[tuple[int, ...]]
    if topology is None or not topology.closed_axes or walls:
        names, turns = tuple(map(str, modes.labels)), [()] * len(modes)
        members = tuple((k,) for k in range(len(modes)))
    else:
        cosines, sines = spring_modes.wave_pairs(modes)
        numbers = modes.wavenumbers[cosines]
        names = tuple(f"({', '.join(map(str, p))})" for p in numbers.tolist())
        members = tuple(
            (c, s) if s >= 0 else (c,)
            for c, s in zip(cosines.tolist(), sines.tolist(), strict=True)
        )
        turns = list(map(tuple, numbers[:, list(topology.closed_axes)].tolist()))
    n = len(names)
    pairs = [(i, j) for i in range(n) for j in range(i + 1, n) if turns[i] == turns[j]]
    i, j = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
    return Waves(names, members, i, j)


def wave_features(terms: Array, waves: Waves) -> Floats:
    """Roots of products of modes over all terms, (features,) float64; see `wave_columns`.

    Parameters
    ----------
    terms : (terms, modes, n)
        Complex harmonics of a cycle, or real cosine terms of a transient.
    waves : Waves
    """
    is_cycle = np.iscomplexobj(terms)
    parts = np.concatenate([terms.real, terms.imag]) if is_cycle else terms
    sizes = (np.abs(terms) ** 2).sum(axis=2)
    c = np.array([group[0] for group in waves.modes])
    # A wave without a sine has one of zeros, behind the last mode.
    zero = terms.shape[1]
    s = np.array([group[1] if len(group) > 1 else zero for group in waves.modes])
    sizes = np.pad(sizes, ((0, 0), (0, 1)))
    own = _flat(parts)
    spread = np.linalg.svd(parts.reshape(-1, terms.shape[2]), compute_uv=False)
    spread = np.pad(spread, (0, terms.shape[2] - len(spread)))
    both = own @ own.T
    i, j = waves.i, waves.j
    found = [np.sqrt(sizes[:, c] + sizes[:, s]).T.ravel(), spread]
    # Of pairs a start angle keeps c.c' + s.s' and c.s' - s.c'.
    products = [both[c[i], c[j]] + both[s[i], s[j]]]
    paired = s < zero
    turned = paired[i] & paired[j]
    products.append((both[c[i], s[j]] - both[s[i], c[j]])[turned])
    if is_cycle:
        led = own @ _flat(np.concatenate([terms.imag, -terms.real])).T
    else:
        led = own @ _flat(np.tensordot(_areas(len(terms)), terms, axes=1)).T
    products += [
        led[c[i], c[j]] + led[s[i], s[j]],
        led[c, s][paired],
        (led[c[i], s[j]] - led[s[i], c[j]])[turned],
    ]
    flat = np.concatenate(products)
    return np.concatenate([*found, np.copysign(np.sqrt(np.abs(flat)), flat)])


def wave_columns(waves: Waves, n_terms: int, n_directions: int) -> tuple[Column, ...]:
    """Columns of the values of `wave_features`: sizes, what moves together, what moves first."""
    every = tuple(k for group in waves.modes for k in group)
    paired = [len(group) > 1 for group in waves.modes]
    pairs = list(zip(waves.i.tolist(), waves.j.tolist(), strict=True))
    both = [(i, j) for i, j in pairs if paired[i] and paired[j]]

    def of_pairs(what: str, some: list[tuple[int, int]]) -> list[Column]:
        return [
            Column(f"{what} {waves.names[i]} {waves.names[j]}", waves.modes[i] + waves.modes[j])
            for i, j in some
        ]

    named = list(zip(waves.names, waves.modes, strict=True))
    columns = [
        Column(f"size {name} term {h + 1}", of) for name, of in named for h in range(n_terms)
    ]
    columns += [Column(f"spread {k}", every) for k in range(1, n_directions + 1)]
    columns += of_pairs("together", pairs) + of_pairs("beside", both) + of_pairs("ahead", pairs)
    columns += [Column(f"runs {name}", of) for name, of in named if len(of) > 1]
    return (*columns, *of_pairs("ahead beside", both))


def summary(terms: Array, waves: Waves) -> Floats:
    """Few numbers for few cases: how much each wave, each term and each direction moves."""
    squares = (np.abs(terms) ** 2).sum(axis=2)
    by_wave = np.array([squares[:, list(group)].sum() for group in waves.modes])
    is_cycle = np.iscomplexobj(terms)
    parts = np.concatenate([terms.real, terms.imag]) if is_cycle else terms
    spread = np.linalg.svd(parts.reshape(-1, terms.shape[2]), compute_uv=False)
    found = [np.sqrt(by_wave), np.sqrt(squares.sum(axis=1)), spread]
    if not is_cycle:
        # The start of a transient is known, so signs of its terms to each other say when.
        flat = terms.reshape(len(terms), -1)
        pairs = (flat @ flat.T)[np.triu_indices(len(terms), 1)]
        found.append(np.copysign(np.sqrt(np.abs(pairs)), pairs))
    return np.concatenate(found)


def summary_columns(
    waves: Waves, n_terms: int, n_directions: int, *, is_cycle: bool
) -> tuple[Column, ...]:
    """Columns of the values of `summary`."""
    every = tuple(k for group in waves.modes for k in group)
    columns = [
        Column(f"size {n}", group) for n, group in zip(waves.names, waves.modes, strict=True)
    ]
    columns += [Column(f"size term {h}", every) for h in range(1, n_terms + 1)]
    columns += [Column(f"spread {k}", every) for k in range(1, n_directions + 1)]
    if not is_cycle:
        pairs = zip(*np.triu_indices(n_terms, 1), strict=True)
        columns += [Column(f"term {i + 1} with {j + 1}", every) for i, j in pairs]
    return tuple(columns)


def _flat(terms: Array) -> Floats:
    """Rows of the modes' terms, and one of zeros: (modes + 1, terms * n)."""
    rows = terms.transpose(1, 0, 2).reshape(terms.shape[1], -1)
    return np.asarray(np.pad(rows, ((0, 1), (0, 0))))


@lru_cache(maxsize=32)
def _areas(n_terms: int) -> Floats:
    """int_0^1 (c_k dc_l - c_l dc_k) of c_k = cos(k pi t), k from 1, (terms, terms).

    int (a db - b da), twice the signed area between the paths of two modes and their chord, says
    which of two moves first, however the time between is stretched (Chen, Integration of paths: a
    faithful representation of paths by noncommutative formal power series, Trans Am Math Soc,
    1958).
    """
    k = np.arange(1, n_terms + 1)
    k, m = k[:, None], k[None, :]
    # int c_k dc_l = -2 l^2 / (l^2 - k^2) where k + l is odd; otherwise the ends are equal.
    is_odd = (k + m) % 2 == 1
    apart = np.where(is_odd, k**2 - m**2, 1)
    return np.where(is_odd, 2.0 * (k**2 + m**2) / apart, 0.0)


AXIS: Final = "axis"
SUMMARY: Final = "summary"
WAVES: Final = "modes"
TERMS: Final = "terms"

VOLUME: Final = "volume"

_IN_WORDS: Final = {
    AXIS: "parts about the axis",
    SUMMARY: "a few numbers of the modes",
    WAVES: "modes and their products",
    TERMS: "modes, their products and terms",
    VOLUME: "volume",
}

# A cycle whose next frame would be the first closes within this many usual steps.
_CLOSED: Final = 2.5
# Percent of the size: less motion than this counts as rest.
_LEAST_TOTAL: Final = 1e-2


@shown("description")
@dataclass(frozen=True)
class Extractor:
    """One table of features.

    Parameters
    ----------
    what : str
        AXIS, SUMMARY, WAVES or, of a transient, TERMS of the motion, or VOLUME of a cavity.
    is_cycle : bool
        Whether a recording is one turn of a cycle, which may start anywhere, or a transient.
    n_modes : int
        First modes that are read.
    walls : bool
        Whether the zero of theta is a known place on the body.
    """

    what: str
    is_cycle: bool = True
    n_modes: int = 0
    walls: bool = False

    @property
    def description(self) -> str:
        """The features, in words."""
        time = "a cycle" if self.is_cycle else "a transient"
        of_motion = f"{_IN_WORDS[self.what]} of {self.n_modes} modes over {time}"
        return of_motion if self.reads_motion else self.what

    @property
    def reads_motion(self) -> bool:
        """Whether it reads the motion itself, and not the volume of its cavity."""
        return self.what != VOLUME

    def values(self, motion: Motion) -> Floats:
        """Features of a motion, (features,) float64.

        Of parts about the axis in percent of the size, their roots where they have no sign; else
        the log of how much moves, and what share of it moves how.
        """
        if self.what == VOLUME:
            return _volume(motion)
        return self.values_of(self.terms(motion), motion.modes)

    def values_of(self, terms: Array, modes: spring_modes.Modes) -> Floats:
        """Features of a motion of which only the terms of all or the first modes are known."""
        modes = first(modes, self.n_modes)
        if self.what == AXIS:
            return axis_parts(terms, modes, walls=self.walls)
        total = math.sqrt(float((np.abs(terms) ** 2).sum()))
        shares: Array = terms / total if total > 0.0 else terms
        waves = waves_of(modes, walls=self.walls)
        read = summary if self.what == SUMMARY else wave_features
        found: list[Any] = [[math.log(max(total, _LEAST_TOTAL))], read(shares, waves)]
        return np.concatenate([*found, shares.ravel()] if self.what == TERMS else found)

    def terms(self, motion: Motion) -> Array:
        """Terms over time of the modes that are read, (terms, modes, n)."""
        return (motion.harmonics if self.is_cycle else motion.cosines)[:, : self.n_modes]

    def columns(self, motion: Motion) -> tuple[Column, ...]:
        """Columns of the values of motions in the same modes."""
        modes = first(motion.modes, self.n_modes)
        waves = waves_of(modes, walls=self.walls)
        n_terms = N_HARMONICS if self.is_cycle else N_COSINES
        n = motion.amplitudes.shape[2]
        if self.what == VOLUME:
            return Column("log largest volume / 3"), Column("share of volume lost")
        if self.what == AXIS:
            return axis_columns(modes, n_terms, along_normal=n == 1, walls=self.walls)
        columns = [Column("log motion", tuple(range(self.n_modes)))]
        if self.what == SUMMARY:
            columns += summary_columns(waves, n_terms, n, is_cycle=self.is_cycle)
        else:
            columns += wave_columns(waves, n_terms, n)
        if self.what == TERMS:
            columns += [
                Column(f"term {h + 1} {modes.labels[k]} {'xyz'[i]}", (k,))
                for h, k, i in np.ndindex(n_terms, len(modes), n)
            ]
        return tuple(columns)

    def as_json(self) -> dict[str, Any]:
        """Return it as JSON-able values."""
        return dict(vars(self))

    @staticmethod
    def from_json(values: Mapping[str, Any]) -> "Extractor":
        """Read the output of `as_json`.

        Raises
        ------
        ValueError
            If it reads what there is not.
        """
        if values["what"] not in _IN_WORDS:
            raise ValueError("it reads what no model reads")
        return Extractor(**values)


def first(modes: spring_modes.Modes, n: int) -> spring_modes.Modes:
    """Return the first n modes."""
    return modes if n >= len(modes) else modes.take(np.arange(n))


def kinds_of(
    motions: Sequence[Motion], n_modes: int, *, is_cycle: bool, walls: bool
) -> tuple[str, ...]:
    """Give the kinds of features of the motion that all recordings have, the simplest first."""
    is_about_axis = is_cycle and all(
        motion.signature.landmarks is not None and has_axis(first(motion.modes, n_modes))
        for motion in motions
    )
    # Terms of modes mean nothing where a cycle or theta may start anywhere.
    waves = waves_of(first(motions[0].modes, n_modes), walls=walls)
    has_terms = not is_cycle and all(len(group) == 1 for group in waves.modes)
    return (*((AXIS,) if is_about_axis else ()), SUMMARY, WAVES, *((TERMS,) if has_terms else ()))


def states_walls(motions: Sequence[Motion]) -> bool:
    """Whether every recording states the zero of theta."""
    landmarks = [motion.signature.landmarks for motion in motions]
    return all(one is not None and "theta_zero" in one.given for one in landmarks)


def timings_of(motions: Sequence[Motion], timing: Timing | str) -> tuple[bool, ...]:
    """Give whether recordings may be cycles, and transients: (True, False) where both may be."""
    if timing != Timing.AUTO:
        return (timing == Timing.CYCLE,)
    gaps = [motion.signature.closure_gap for motion in motions]
    return (True, False) if float(np.median(gaps)) < _CLOSED else (False,)


def volume_share(motion: Motion) -> float:
    """Share of the volume of a cavity that is lost, as an ejection fraction; NaN without one."""
    volumes = motion.volumes
    return math.nan if volumes is None else 1.0 - float(volumes.min() / volumes.max())


def _volume(motion: Motion) -> Floats:
    volumes = motion.volumes
    assert volumes is not None  # noqa: S101 (asked for only of motions that have one)
    unit = math.log(sequence.MM_PER_UNIT.get(motion.signature.unit or "", 1.0))
    return np.array([math.log(volumes.max()) / 3.0 + unit, volume_share(motion)])
