"""Parts of a motion about an axis: contraction, twist, shortening, and what is one-sided."""

from __future__ import annotations

import cmath
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.motion import Column
from modalmotion.modes import Modes
from modalmotion.modes.topology import CLOSED

Array = NDArray[np.float64]
Index = NDArray[np.int64]


class _Places(NamedTuple):
    """Modes of the parts: (p, 0) of p > 0, and the cosine and sine of (p, p'), p' = 1 first."""

    flat: Index
    cosines: Index
    sines: Index
    n_rings: int


def has_axis(modes: Modes) -> bool:
    """Whether motions in these modes have parts about an axis."""
    topology = modes.topology
    if topology is None or topology.n_axes != 2:
        return False
    if topology.ends[1] != CLOSED or topology.ends[0] == CLOSED:
        return False
    places = _places(modes)
    return len(places.flat) > 0 and places.n_rings > 0


def axis_parts(terms: NDArray[np.complex128], modes: Modes, *, walls: bool) -> Array:
    """Read the parts of a cycle about an axis, (features,) float64; see `axis_columns`.

    Parameters
    ----------
    terms : (harmonics, modes, 3 or 1) complex128
        In the frame of the body: towards the zero of theta, across it, along the axis; of offsets
        outwards.
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

    Of offsets they are radial p, of (p, 0), and side p, oval p and lobe (p, p') of the pairs.
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
        u, v, z = np.moveaxis(terms, 2, 0)
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
    # "radial 0 sin 1" is 0 by the choice of the phase.
    values = np.delete(values, 1)
    if walls:
        across = np.stack([x.real, x.imag, y.real, y.imag], axis=1)
    else:
        across = np.sqrt(np.stack([np.hypot(x.real, y.real), np.hypot(x.imag, y.imag)], axis=1))
    return np.concatenate([values, across.ravel()])


@lru_cache(maxsize=64)
def axis_columns(
    modes: Modes, n_harmonics: int, *, is_offset: bool, walls: bool
) -> tuple[Column, ...]:
    """Columns of the values of `axis_parts`."""
    flat, c, s, n = _places(modes)
    pairs: list[tuple[int, ...]] = [(i, j) for i, j in zip(c.tolist(), s.tolist(), strict=True)]
    numbers = [tuple(modes.wavenumbers[i].tolist()) for i, _ in pairs]
    levels = [(int(k), int(modes.wavenumbers[k, 0])) for k in flat]
    signed: list[tuple[str, tuple[int, ...]]]
    others: list[tuple[str, tuple[int, ...]]]
    if is_offset:
        whole = int(np.flatnonzero(~modes.wavenumbers.any(axis=1))[0])
        signed = [(f"radial {p}", (k,)) for k, p in [(whole, 0), *levels]]
        names = {1: "side {0}", 2: "oval {0}"}
        others = [
            (names.get(turns, "lobe ({0}, {1})").format(p, turns), pair)
            for (p, turns), pair in zip(numbers, pairs, strict=True)
        ]
    else:
        rings = [(p, pair) for (p, _), pair in zip(numbers[:n], pairs, strict=False)]
        signed = [(f"{what} {p}", pair) for what in ("radial", "turning") for p, pair in rings]
        signed += [(f"axial {p}", (k,)) for k, p in levels]
        others = [(f"across {p}", (k,)) for k, p in levels]
        for first, more in (("oval", "lobe"), ("tilt", "wave")):
            others += [
                (f"{first} {p}" if turns == 1 else f"{more} ({p}, {turns})", pair)
                for (p, turns), pair in zip(numbers, pairs, strict=True)
            ]
        others += [
            (f"side ({p}, {q})", pair) for (p, q), pair in zip(numbers[n:], pairs[n:], strict=True)
        ]
    columns = [
        Column(f"{name} {phase} {h}", of)
        for name, of in signed
        for h in range(1, n_harmonics + 1)
        for phase in ("cos", "sin")
    ]
    del columns[1]
    sides = (" towards zero", " across zero") if walls else ("",)
    columns += [
        Column(f"{name}{side} {phase} 1", of)
        for name, of in others
        for side in sides
        for phase in ("cos", "sin")
    ]
    return tuple(columns)


@lru_cache(maxsize=64)
def _places(modes: Modes) -> _Places:
    index = {
        (p, turns, sine): k
        for k, ((p, turns), sine) in enumerate(
            zip(modes.wavenumbers.tolist(), modes.is_sine.tolist(), strict=True)
        )
    }
    flat = [k for (p, turns, _), k in sorted(index.items()) if turns == 0 and p > 0]
    pairs = sorted(
        (turns, p, k, index[p, turns, True])
        for (p, turns, sine), k in index.items()
        if turns > 0 and not sine and (p, turns, True) in index
    )
    return _Places(
        np.array(flat, dtype=np.int64),
        np.array([k for _, _, k, _ in pairs], dtype=np.int64),
        np.array([k for _, _, _, k in pairs], dtype=np.int64),
        sum(turns == 1 for turns, *_ in pairs),
    )
