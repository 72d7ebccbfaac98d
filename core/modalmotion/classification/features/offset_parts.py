"""Features of a surface with an axis from its offsets: narrowing, and what is one-sided.

Offsets are numbers along the reference's normals, positive outward, so neither the frame of the
body nor the hand of theta is to be found; twist and other motion within the surface is not there.
"""

from __future__ import annotations

import cmath
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.axis import READINGS
from modalmotion.classification.features.axis_parts import parts_of, readable_modes
from modalmotion.classification.features.centred import CentredMotions
from modalmotion.classification.features.columns import Column, Columns, MotionFeatures
from modalmotion.classification.features.phases import by_part, from_phase, read_parts
from modalmotion.modes import Modes
from modalmotion.signature.making import ModalSignature


class _Layout(NamedTuple):
    """Where the parts lie in the amplitudes, and the features' names.

    Parameters
    ----------
    whole : int
        Mode (0, 0).
    every : (modes,) float64
        1 for each.
    columns : Columns
    signs : (readings, features) float64
        Changes of sign in each reading against the first: a theta of the other hand turns
        features across its zero round.
    order : (values,) int64
        Places of the features' values: see `read_parts`.
    n_signed, n_sized : int
        Numbers of features with and without a sign.
    """

    whole: int
    every: NDArray[np.float64]
    columns: Columns
    signs: NDArray[np.float64]
    order: NDArray[np.int64]
    n_signed: int
    n_sized: int


def offset_features(
    signature: ModalSignature,
    n_signed: int = 2,
    n_sized: int = 1,
    *,
    walls: bool = False,
    n_modes: int = 0,
    motions: CentredMotions | None = None,
) -> MotionFeatures:
    """Read the features of offsets about an axis from their signature.

    Parameters
    ----------
    signature : ModalSignature
        Of a cup, cylinder or sphere, of the kind offset; one period, as of `axis_features`.
    n_signed, n_sized : int
        Harmonics of the parts with a sign, and of those without.
    walls : bool
        Whether the zero of theta is a known place on the body.
    n_modes : int
        First modes that are read; 0 for all.
    motions : CentredMotions, optional
        Of the signature, for others to read too.

    Returns
    -------
    MotionFeatures
        In percent of the surface's size; square roots of that for parts without a sign. One row
        for each of `READINGS`, which differ in the walls across the zero of theta alone.

    Raises
    ------
    TopologyError, ModeCountError, ShapeError
        As `axis_features` does.

    Notes
    -----
    The parts are radial p, the amplitude of (p, 0), with its sign; side p, oval p and lobe
    (p, p'), the pairs of p' = 1, 2 and more: their lengths in phase and out of phase with the
    narrowing of (0, 0), or, with walls, their cosines and sines.
    """
    modes = readable_modes(signature, n_modes)
    layout = _layout(modes, n_signed, n_sized, walls)
    motion = (motions or CentredMotions(signature)).of_first(len(modes))
    count = max(n_signed, n_sized)
    rows = motion.harmonic_rows(count)[:, : len(modes)]
    # At phase 0 the narrowing, which is the opposite of "radial 0", is at its height.
    clock = cmath.phase(-complex(rows[0, layout.whole], rows[count, layout.whole]))
    values = read_parts(from_phase(rows, clock), layout.order, layout.n_signed, layout.n_sized)
    size, smooth_share = motion.amount(layout.every)
    return MotionFeatures(layout.columns, values * layout.signs, size, smooth_share)


def offset_columns(modes: Modes, n_signed: int, n_sized: int, *, walls: bool) -> Columns:
    """Columns of the values of `offset_features`."""
    return _layout(modes, n_signed, n_sized, walls).columns


@lru_cache(maxsize=64)
def _layout(modes: Modes, n_signed: int, n_sized: int, walls: bool) -> _Layout:
    parts = parts_of(modes)
    whole = int(np.flatnonzero(~modes.wavenumbers.any(axis=1))[0])
    levels = np.array([whole, *parts.unpaired.tolist()])
    columns = [
        Column(f"radial {p} {phase} {h}", (int(mode),))
        for mode in levels
        for p in modes.wavenumbers[mode, :1]
        for h in range(1, n_signed + 1)
        for phase in ("cos", "sin")
    ]
    del columns[1]
    n_with_sign, across = len(columns), []
    for c, s in zip(parts.cosines.tolist(), parts.sines.tolist(), strict=True):
        p, turns = modes.wavenumbers[c].tolist()
        name = {1: f"side {p}", 2: f"oval {p}"}.get(turns, f"lobe ({p}, {turns})")
        for side in (" towards zero", " across zero") if walls else ("",):
            for h in range(1, n_sized + 1):
                for phase in ("cos", "sin"):
                    power = 1.0 if walls else 0.5
                    columns.append(Column(f"{name}{side} {phase} {h}", (c, s), power))
                    across.append(side == " across zero")
    turned = np.where([False] * n_with_sign + across, -1.0, 1.0)
    signs = np.stack([turned if reading.is_mirrored else np.abs(turned) for reading in READINGS])
    signed = by_part(levels, n_signed, len(modes))
    x, y = (by_part(pair, n_sized, len(modes)) for pair in (parts.cosines, parts.sines))
    # "radial 0 sin 1" is zero by the choice of the clock.
    in_order = [np.delete(signed, 1)]
    in_order += [np.concatenate([x, y], axis=1).ravel()] if walls else [x.ravel(), y.ravel()]
    order = np.concatenate(in_order)
    return _Layout(
        whole=whole,
        every=np.ones(len(modes)),
        columns=Columns(columns),
        signs=signs,
        order=order,
        n_signed=len(order) if walls else n_with_sign,
        n_sized=0 if walls else x.size,
    )
