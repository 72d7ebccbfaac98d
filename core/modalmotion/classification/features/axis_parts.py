"""Where the parts of a motion about an axis lie in the amplitudes."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.columns import Column
from modalmotion.errors import ModeCountError, ParameterError, ShapeError, TopologyError
from modalmotion.modes import Modes
from modalmotion.modes.topology import CLOSED
from modalmotion.signature.making import ModalSignature
from modalmotion.template.body_frame import Components


class Parts(NamedTuple):
    """Where the parts of a motion lie in the amplitudes of a set of modes.

    Parameters
    ----------
    unpaired : (n,) int64
        Modes (p, 0), from p = 1 on.
    cosines, sines : (m,) int64
        Modes (p, p'), p' > 0.
    first, others : (k,) int64
        Pairs with p' = 1, and pairs with more.
    signed, sized : tuple of Column
        Names and modes of the parts with a sign and of those without.
    """

    unpaired: NDArray[np.int64]
    cosines: NDArray[np.int64]
    sines: NDArray[np.int64]
    first: NDArray[np.int64]
    others: NDArray[np.int64]
    signed: tuple[Column, ...]
    sized: tuple[Column, ...]


@lru_cache(maxsize=32)
def parts_of(modes: Modes) -> Parts:
    """Find the parts in a set of modes of a surface with an axis."""
    rows = list(zip(modes.wavenumbers.tolist(), modes.is_sine.tolist(), strict=True))
    index = {(p, turns, sine): i for i, ((p, turns), sine) in enumerate(rows)}
    flat = [(p, i) for (p, turns, _), i in sorted(index.items()) if turns == 0 and p > 0]
    pairs = [
        (turns, p, i, index[p, turns, True])
        for (p, turns, sine), i in index.items()
        if turns > 0 and not sine and (p, turns, True) in index
    ]
    pairs.sort()
    rings = [(p, (c, s)) for turns, p, c, s in pairs if turns == 1]
    signed = [Column(f"radial {p}", both) for p, both in rings]
    signed += [Column(f"turning {p}", both) for p, both in rings]
    signed += [Column(f"axial {p}", (i,)) for p, i in flat]
    sized = [Column(f"across {p}", (i,)) for p, i in flat]
    for first, general in (("oval", "lobe"), ("tilt", "wave")):
        sized += [
            Column(f"{first} {p}" if turns == 1 else f"{general} ({p}, {turns})", (c, s))
            for turns, p, c, s in pairs
        ]
    sized += [Column(f"side ({p}, {turns})", (c, s)) for turns, p, c, s in pairs if turns > 1]
    return Parts(
        unpaired=np.array([i for _, i in flat], dtype=np.int64),
        cosines=np.array([c for _, _, c, _ in pairs], dtype=np.int64),
        sines=np.array([s for _, _, _, s in pairs], dtype=np.int64),
        first=np.arange(len(rings)),
        others=np.arange(len(rings), len(pairs)),
        signed=tuple(signed),
        sized=tuple(sized),
    )


@lru_cache(maxsize=64)
def first(modes: Modes, n: int) -> Modes:
    """Return the first modes; `first_modes` of signatures has their amplitudes, too."""
    return modes if n == len(modes) else modes.take(np.arange(n))


def has_axis(signature: ModalSignature) -> bool:
    """Whether `axis_features` can be read: modes and components say so."""
    try:
        readable_modes(signature)
    except (TopologyError, ModeCountError, ParameterError, ShapeError):
        return False
    return True


def readable_modes(signature: ModalSignature, n_modes: int = 0) -> Modes:
    """Modes of a signature from which a motion about an axis can be read; see `axis_features`.

    The first ones, or all for 0.
    """
    modes = signature.modes
    if n_modes:
        modes = first(modes, n_modes)
    has_parts = _about_axis(modes, signature.parameters.components)
    if not min(signature.lengths) > 0:
        raise TopologyError(
            f"The surface has the lengths {signature.lengths}, so no size to compare with.",
            remedy="Choose a reference frame in which the surface is not collapsed.",
        )
    if signature.n_frames < 2:
        raise ShapeError(
            "One frame has no motion to read.", remedy="Send at least two frames of a beat."
        )
    if not has_parts:
        raise ModeCountError(
            f"{len(modes)} modes are too few to read a motion from.",
            remedy="Fit 7 modes or more.",
            details={"least": 7},
        )
    return modes


# Kept, for an answer asks several times, and the modes and components are those of all.
@lru_cache(maxsize=64)
def _about_axis(modes: Modes, components: Components) -> bool:
    """Check that the modes are of a surface with an axis, and tell whether they have parts.

    See `readable_modes`.
    """
    topology = modes.topology
    if topology is None:
        raise TopologyError(
            "The motion is given in the spring modes of one mesh, which say nothing of others.",
            remedy="Send a cup, a cylinder or a sphere.",
        )
    if components != Components.CARTESIAN:
        raise ParameterError(
            "The amplitudes are radial, tangential and axial; features are read from Cartesian "
            "ones, and find these directions themselves.",
            remedy="Fit with components = cartesian.",
        )
    if topology.n_axes != 2 or topology.ends[1] != CLOSED or topology.ends[0] == CLOSED:
        raise TopologyError(
            f"The motion of a {topology} has no axis to be read about.",
            remedy="Send a cup, a cylinder or a sphere.",
        )
    parts = parts_of(modes)
    return len(parts.unpaired) > 0 and len(parts.first) > 0
