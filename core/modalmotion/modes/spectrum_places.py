"""Places of the modes of a lattice in the spectrum of its fast transforms: labels, no values."""

from __future__ import annotations

from itertools import product
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.separable import expand
from modalmotion.modes.topology import CLOSED, Topology
from modalmotion.representation import shown


@shown("sines", "mode")
class Places(NamedTuple):
    """Where one term of each of some modes stands in the spectrum.

    Parameters
    ----------
    sines : tuple of bool
        For each closed axis whether the term is a multiple of its sine.
    mode : (terms,) int32
        No mode twice.
    place : (terms,) int32
        Row by row over the axes' wavenumbers; no place twice.
    sign : (terms,) int8
    halvings : (terms,) int8
        Number of axes along which the term has mean square 1/2.
    """

    sines: tuple[bool, ...]
    mode: NDArray[np.int32]
    place: NDArray[np.int32]
    sign: NDArray[np.int8]
    halvings: NDArray[np.int8]


def spectrum_shape(topology: Topology, shape: tuple[int, ...]) -> tuple[int, ...]:
    """Wavenumbers along each axis of the spectrum: N // 2 + 1 on closed axes, N on others."""
    return tuple(
        n // 2 + 1 if ends == CLOSED else n for ends, n in zip(topology.ends, shape, strict=True)
    )


def places(modes: ModeSet, shape: tuple[int, ...]) -> tuple[Places, ...]:
    """Find the terms of modes in the spectrum of a lattice.

    Parameters
    ----------
    modes : ModeSet
        Each at most once.
    shape : tuple of int
        Nodes along each axis.
    """
    places = []
    topology, closed = modes.topology, modes.topology.closed_axes
    for term in expand(topology, modes.half_periods, modes.is_odd_at_pole, modes.is_sine):
        halvings = np.zeros(len(term.mode), dtype=np.int8)
        place = np.zeros(len(term.mode), dtype=np.int64)
        for axis, n in enumerate(spectrum_shape(topology, shape)):
            p = np.abs(modes.wavenumbers[term.mode, axis])
            place = place * n + p
            period = shape[axis] if topology.ends[axis] == CLOSED else 4 * shape[axis]
            # A constant and a wave that alternates from node to node have mean square 1.
            h = modes.half_periods[term.mode, axis]
            halvings += 2 * h % period != 0
        # (p, p') and (p, -p') have the same products: apart.
        negative = modes.wavenumbers[term.mode][:, list(closed)] < 0
        for signs in product((False, True), repeat=len(closed)):
            part = np.flatnonzero((negative == signs).all(axis=1))
            if part.size:
                places.append(
                    Places(
                        term.sines,
                        term.mode[part].astype(np.int32),
                        place[part].astype(np.int32),
                        term.sign[part],
                        halvings[part],
                    )
                )
    return tuple(places)
