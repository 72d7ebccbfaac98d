"""Features of a surface with an axis: contraction, twist, shortening, and what is one-sided.

The amplitudes are read in a body frame that the motion itself gives. Over one period each is a
mean, which is dropped, and harmonics.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.body_frame import Components
from modalmotion.errors import ModeCountError, ParameterError, ShapeError, TopologyError
from modalmotion.features.columns import Column, MotionFeatures
from modalmotion.features.temporal import (
    cycle_angle,
    elapsed_share,
    harmonics,
    one_turn,
    smooth_share,
)
from modalmotion.modes import ModeSet
from modalmotion.signature import ModalSignature
from modalmotion.spring_modes import SpringSpectrum
from modalmotion.topology import CLOSED

Vectors = NDArray[np.float64]


class Reading(NamedTuple):
    """What the amplitudes cannot say by themselves.

    Parameters
    ----------
    is_mirrored : bool
        Whether theta runs left-handed about the axis, as columns of a lattice may.
    is_inverted : bool
        Whether inward is opposite to what shortening suggests.
    """

    is_mirrored: bool = False
    is_inverted: bool = False


READINGS: Final = tuple(Reading(m, i) for m in (False, True) for i in (False, True))
"""All readings; which of them holds is decided by what a model knows."""


class _Parts(NamedTuple):
    """Where the parts of a motion are found in the amplitudes of a set of modes.

    Parameters
    ----------
    unpaired : (n,) int64
        Modes (p, 0), from p = 1 on.
    cosines, sines : (m,) int64
        Modes (p, p'), p' > 0.
    first, others : (k,) int64
        Which of the pairs have p' = 1, and which have more.
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


def axis_features(
    signature: ModalSignature, n_signed: int = 2, n_sized: int = 1, *, walls: bool = False
) -> MotionFeatures:
    """Read the features of a motion about an axis from its signature.

    Parameters
    ----------
    signature : ModalSignature
        Of a cup, cylinder or sphere. Its frames cover one period: the frame after the last
        would be the first again, or the last is (see `one_turn`).
    n_signed, n_sized : int
        Harmonics of the parts with a sign, and of those without.
    walls : bool
        Whether the zero of theta is a known place on the body: parts without a sign then have
        components towards it and across, so that walls are told apart.

    Returns
    -------
    MotionFeatures
        In percent of the surface's size; square roots of that for parts without a sign. One
        row for each of `READINGS`.

    Raises
    ------
    TopologyError
        If the surface is none of these, or has no extent.
    ModeCountError
        If the modes (1, 0) and (0, 1) are not in the signature.
    ShapeError
        If there are fewer than two frames.
    ParameterError
        If the amplitudes are not Cartesian.

    Notes
    -----
    e3 is the direction of the sum of c x s over time and p, for the cosine and sine amplitudes
    of (p, 1): the axis about which theta is right-handed, since a wall that moves along its
    radius has c = u e1, s = u e2. With w(v) = v.e1 + i v.e2 the parts are

    - radial p and turning p, (w(c) - i w(s)) / 2 of (p, 1): contraction, and a level turning
      against the others (twist), where (0, 1) is radial on the whole;
    - axial p and across p, e3 and w of (p, 0): shortening, and bending of the axis;
    - oval p, (w(c) + i w(s)) / 2 of (p, 1): rings becoming ellipses;
    - tilt p, e3.c - i e3.s of (p, 1): rings tilting;
    - side, lobe and wave (p, p'), the same three of p' > 1: what p' - 1, p' + 1 and p' walls do.

    (0, 0), the translation of the whole, is left out. Phases count from the first harmonic of
    the contraction, so the start of the recording does not matter. Radial, turning and axial
    parts have a sign: the cosine and sine of each harmonic are given. The direction of the
    others is arbitrary: their lengths in phase and out of phase are. A rotation of the world
    turns e1, e2 and e3; another start angle turns c and s into one another; neither changes a
    feature.
    """
    modes = _readable_modes(signature)
    signature = one_turn(signature)
    parts = _parts_of(modes)
    # Percent of the size; the roots are taken apart so that no product overflows.
    along, around = signature.lengths
    a = 100.0 * (signature.amplitudes / np.sqrt(along) / np.sqrt(around))
    a = a - a.mean(axis=0)
    share = elapsed_share(signature)
    angle = cycle_angle(share)
    n = len(modes)
    flat = a.reshape(len(a), 3 * n)
    spectrum = harmonics(angle, flat, max(n_signed, n_sized)).reshape(-1, n, 3)

    first = parts.first
    turning = _cross(a[:, parts.cosines[first]], a[:, parts.sines[first]]).sum(axis=(0, 1))
    towards = None if not walls else _theta_zero(signature)
    rows = []
    for is_mirrored in (False, True):
        sign = -1.0 if is_mirrored else 1.0
        plane, e3 = _plane(sign * turning, towards)
        whole = _whole_ring(a, parts, plane, sign)
        # The line in the complex plane along which (0, 1) moves most is the radial one.
        gauge = np.exp(-0.5j * np.angle((whole**2).sum()))
        # A ring narrows while the axis shortens: (1, 0) is positive at the apex end.
        if float((whole * gauge).real @ (a[:, parts.unpaired[0]] @ e3)) > 0:
            gauge = -gauge
        # (harmonics, parts) of what has a sign, and two of each of what has none.
        signed, sized = _read(spectrum, parts, plane, e3, sign, gauge)
        n_rings = len(first)
        for is_inverted in (False, True):
            turned = signed.copy()
            if is_inverted:
                turned[:, : 2 * n_rings] *= -1.0
            rows.append(_values(turned, sized, n_signed, n_sized, walls))
    is_deformation = modes.wavenumbers.any(axis=1)
    deformation = a[:, is_deformation].reshape(len(a), -1)
    return MotionFeatures(
        columns=_columns(parts, n_signed, n_sized, walls),
        values=np.stack(rows),
        motion=float(np.sqrt((deformation**2).sum(axis=1).mean())) / 100.0,
        smooth_share=smooth_share(share, deformation, is_cycle=True),
    )


def _read(
    spectrum: NDArray[np.complex128],
    parts: _Parts,
    plane: NDArray[np.complex128],
    e3: Vectors,
    sign: float,
    gauge: complex,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Harmonics of the parts with a sign, and of both components of those without."""
    c, s = spectrum[:, parts.cosines], sign * spectrum[:, parts.sines]
    e1, e2 = plane.real, plane.imag
    c1, c2, c3 = c @ e1, c @ e2, c @ e3
    s1, s2, s3 = s @ e1, s @ e2, s @ e3
    flat = spectrum[:, parts.unpaired]
    first = parts.first
    # (w(c) - i w(s)) / 2 = ((c1 + s2) + i (c2 - s1)) / 2, turned by the gauge where p' = 1.
    x, y = (c1 + s2) / 2, (c2 - s1) / 2
    g, k = gauge.real, gauge.imag
    radial = x[:, first] * g - y[:, first] * k
    turning = x[:, first] * k + y[:, first] * g
    signed = np.concatenate([radial, turning, flat @ e3], axis=1)
    # (w(c) + i w(s)) / 2 = ((c1 - s2) + i (c2 + s1)) / 2 and e3.c - i e3.s
    real = [flat @ e1, (c1 - s2) / 2, c3, x[:, parts.others]]
    imaginary = [flat @ e2, (c2 + s1) / 2, -s3, y[:, parts.others]]
    sized = np.stack([np.concatenate(real, axis=1), np.concatenate(imaginary, axis=1)], axis=2)
    return signed, sized


def _values(
    signed: NDArray[np.complex128],
    sized: NDArray[np.complex128],
    n_signed: int,
    n_sized: int,
    walls: bool,
) -> Vectors:
    """Real features, phases counted from the height of the contraction."""
    # At phase 0 the contraction, which is the opposite of "radial 0", is at its height.
    clock = np.angle(-signed[0, 0])
    turns = np.exp(-1j * clock * np.arange(1, len(signed) + 1))
    z = signed[:n_signed] * turns[:n_signed, None]
    v = sized[:n_sized] * turns[:n_sized, None, None]
    # Columns by part, then harmonic, then cosine and sine.
    with_sign = np.stack([z.real, z.imag], axis=2).transpose(1, 0, 2).ravel()
    # "radial 0 sin 1" is zero by the choice of the clock.
    with_sign = np.delete(with_sign, 1)
    if walls:
        without = np.stack([v.real, v.imag], axis=3).transpose(1, 2, 0, 3).ravel()
    else:
        lengths = np.stack([np.hypot(*v.real.T), np.hypot(*v.imag.T)], axis=2)
        without = np.sqrt(lengths).ravel()
    return np.concatenate([with_sign, without])


def _columns(parts: _Parts, n_signed: int, n_sized: int, walls: bool) -> tuple[Column, ...]:
    found = [
        Column(f"{part.name} {phase} {h}", part.modes)
        for part in parts.signed
        for h in range(1, n_signed + 1)
        for phase in ("cos", "sin")
    ]
    del found[1]
    sides = (" towards zero", " across zero") if walls else ("",)
    found += [
        Column(f"{part.name}{side} {phase} {h}", part.modes, power=1.0 if walls else 0.5)
        for part in parts.sized
        for side in sides
        for h in range(1, n_sized + 1)
        for phase in ("cos", "sin")
    ]
    return tuple(found)


def _plane(turning: Vectors, towards: Vectors | None) -> tuple[NDArray[np.complex128], Vectors]:
    """Return e1 + i e2 across the axis, and the axis e3."""
    e3 = _direction(turning)
    start = np.eye(3)[np.argmin(np.abs(e3))] if towards is None else _cross(e3, towards)
    across = _direction(_cross(start, e3))
    plane: NDArray[np.complex128] = np.asarray(across + 1j * _cross(e3, across))
    return plane, e3


def _whole_ring(
    a: Vectors, parts: _Parts, plane: NDArray[np.complex128], sign: float
) -> NDArray[np.complex128]:
    """(w(c) - i w(s)) / 2 of the mode (0, 1), (frames,) complex128."""
    k = parts.first[0]
    c, s = a[:, parts.cosines[k]], sign * a[:, parts.sines[k]]
    turned: NDArray[np.complex128] = (c @ plane - 1j * (s @ plane)) / 2
    return turned


def _theta_zero(signature: ModalSignature) -> Vectors:
    if signature.landmarks is None:
        raise ParameterError(
            "The surface has no zero of theta, so walls cannot be told apart.",
            remedy="State the landmark theta_zero.",
        )
    return signature.landmarks.theta_zero


def _cross(a: Vectors, b: Vectors) -> Vectors:
    """Vector product along the last axis; numpy's own costs ten times as much on few vectors."""
    x, y, z = a[..., 0], a[..., 1], a[..., 2]
    u, v, w = b[..., 0], b[..., 1], b[..., 2]
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _direction(vector: Vectors) -> Vectors:
    """Give the unit vector along `vector`; any one where nothing moves."""
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        return np.array([0.0, 0.0, 1.0])
    unit: Vectors = vector / length
    return unit


@lru_cache(maxsize=32)
def _parts_of(modes: ModeSet) -> _Parts:
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
    return _Parts(
        unpaired=np.array([i for _, i in flat], dtype=np.int64),
        cosines=np.array([c for _, _, c, _ in pairs], dtype=np.int64),
        sines=np.array([s for _, _, _, s in pairs], dtype=np.int64),
        first=np.arange(len(rings)),
        others=np.arange(len(rings), len(pairs)),
        signed=tuple(signed),
        sized=tuple(sized),
    )


def has_axis(signature: ModalSignature) -> bool:
    """Whether `axis_features` can be read: modes and components say so."""
    try:
        _readable_modes(signature)
    except (TopologyError, ModeCountError, ParameterError, ShapeError):
        return False
    return True


def _readable_modes(signature: ModalSignature) -> ModeSet:
    modes = signature.modes
    if isinstance(modes, SpringSpectrum):
        raise TopologyError(
            "The motion is given in the spring modes of one mesh, which say nothing of others.",
            remedy="Send a cup, a cylinder or a sphere.",
        )
    if signature.parameters.components != Components.CARTESIAN:
        raise ParameterError(
            "The amplitudes are radial, tangential and axial; features are read from Cartesian "
            "ones, and find these directions themselves.",
            remedy="Fit with components = cartesian.",
        )
    topology = modes.topology
    if topology.n_axes != 2 or topology.ends[1] != CLOSED or topology.ends[0] == CLOSED:
        raise TopologyError(
            f"The motion of a {topology} has no axis to be read about.",
            remedy="Send a cup, a cylinder or a sphere.",
        )
    if not min(signature.lengths) > 0:
        raise TopologyError(
            f"The surface has the lengths {signature.lengths}, so no size to compare with.",
            remedy="Choose a reference frame in which the surface is not collapsed.",
        )
    if signature.n_frames < 2:
        raise ShapeError(
            "One frame has no motion to read.", remedy="Send at least two frames of a beat."
        )
    parts = _parts_of(modes)
    if not len(parts.unpaired) or not len(parts.first):
        raise ModeCountError(
            f"{len(signature.modes)} modes are too few to read a motion from.",
            remedy="Fit 7 modes or more.",
            details={"least": 7},
        )
    return modes
