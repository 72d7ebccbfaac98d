"""Features of a motion: numbers that do not depend on pose, size, start angle or sampling.

The amplitudes of the modes (p, 0) and (p, 1) are read in a body frame that the motion itself
gives. Over one period each is a mean, which is dropped, and harmonics.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.body_frame import Components
from modalmotion.errors import ModeCountError, ParameterError, ShapeError, TopologyError
from modalmotion.modes import ModeSet
from modalmotion.signature import ModalSignature
from modalmotion.spring_modes import SpringSpectrum
from modalmotion.topology import CLOSED

# Harmonics that are read: of parts that have a sign, and of those that have only a size.
_N_SIGNED: Final = 2
_N_SIZES: Final = 1

# Harmonics that a periodic motion may hold, for telling it from noise.
_N_PERIODIC: Final = 3

# Singular values of the harmonics below this share are not determined by the frames.
_RANK_TOLERANCE: Final = 1e-8

Complex = NDArray[np.complex128]


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


@dataclass(frozen=True, eq=False)
class MotionFeatures:
    """Features of one sequence.

    Parameters
    ----------
    names : tuple of str
    values : (features,) float64
        In percent of the surface's size; square roots of that for parts without a sign.
    motion : float
        RMS of the deformation (all modes but the translation) about its mean over time, as a
        share of the surface's size.
    periodic_share : float
        Share of the motion that the first harmonics hold beyond what they would hold of white
        noise: 1 for a smooth motion, 0 for noise; 1 where there are too few frames to tell.
    """

    names: tuple[str, ...]
    values: NDArray[np.float64]
    motion: float
    periodic_share: float


def motion_features(signature: ModalSignature, reading: Reading = READINGS[0]) -> MotionFeatures:
    """Read the features of a motion from its signature.

    Parameters
    ----------
    signature : ModalSignature
        Of a cup, cylinder or sphere. Its frames cover one period: the frame after the last
        would be the first again.
    reading : Reading

    Returns
    -------
    MotionFeatures

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

    - radial p and turning p, (w(c) - i w(s)) / 2: contraction, and a level turning against
      the others (twist), where (0, 1) is radial on the whole;
    - axial p and across p, e3 and w of (p, 0): shortening, and bending of the axis;
    - oval p, (w(c) + i w(s)) / 2: rings becoming ellipses;
    - tilt p, e3.c - i e3.s: rings tilting.

    (0, 0), the translation of the whole, is left out. Phases count from the first harmonic of
    the contraction, so the start of the recording does not matter. Radial, turning and axial
    parts have a sign: the cosine and sine of each harmonic are given. The direction of the
    others is arbitrary: their lengths in phase and out of phase are. A rotation of the world
    turns e1, e2 and e3; another start angle turns c and s into one another; neither changes a
    feature.
    """
    modes = _readable_modes(signature)
    # Percent of the size; the roots are taken apart so that no product overflows.
    along, around = signature.lengths
    amplitudes = 100.0 * (signature.amplitudes / np.sqrt(along) / np.sqrt(around))
    amplitudes = amplitudes - amplitudes.mean(axis=0)
    signed, sizes = _parts(modes, amplitudes, reading)

    angle = _phase_angle(signature)
    signals = [*signed.values(), *(part for z in sizes.values() for part in (z.real, z.imag))]
    harmonics = _harmonics(angle, np.stack(signals, axis=1), _N_SIGNED)
    # At phase 0 the contraction, which is the opposite of "radial 0", is at its height.
    clock = np.angle(-harmonics[0, 0])
    harmonics *= np.exp(-1j * clock * np.arange(1, _N_SIGNED + 1))[:, None]

    named: dict[str, float] = {}
    for k, name in enumerate(signed):
        for h in range(_N_SIGNED):
            named[f"{name} cos {h + 1}"] = harmonics[h, k].real
            named[f"{name} sin {h + 1}"] = harmonics[h, k].imag
    del named["radial 0 sin 1"]  # zero by the choice of the clock
    for k, name in enumerate(sizes):
        x, y = harmonics[:, len(signed) + 2 * k], harmonics[:, len(signed) + 2 * k + 1]
        for h in range(_N_SIZES):
            named[f"{name} cos {h + 1}"] = float(np.sqrt(np.hypot(x[h].real, y[h].real)))
            named[f"{name} sin {h + 1}"] = float(np.sqrt(np.hypot(x[h].imag, y[h].imag)))
    is_deformation = modes.wavenumbers.any(axis=1)
    deformation = amplitudes[:, is_deformation].reshape(len(angle), -1)
    return MotionFeatures(
        names=tuple(named),
        values=np.array(list(named.values())),
        motion=float(np.sqrt((deformation**2).sum(axis=1).mean())) / 100.0,
        periodic_share=_periodic_share(angle, deformation),
    )


def _parts(
    modes: ModeSet, amplitudes: NDArray[np.float64], reading: Reading
) -> tuple[dict[str, NDArray[np.float64]], dict[str, Complex]]:
    """Signals over time of the parts with a sign and of those without."""
    pairs, axials = _pairs(modes, amplitudes, reading.is_mirrored), _unpaired(modes, amplitudes)
    e3 = _direction(sum(np.cross(c, s).sum(axis=0) for c, s in pairs.values()))
    e1 = _direction(np.cross(np.eye(3)[np.argmin(np.abs(e3))], e3))
    plane: Complex = np.asarray(e1 + 1j * np.cross(e3, e1))

    turned = {p: (c @ plane - 1j * (s @ plane)) / 2 for p, (c, s) in pairs.items()}
    # The line in the complex plane along which (0, 1) moves most is the radial one.
    gauge = np.exp(-0.5j * np.angle((turned[0] ** 2).sum()))
    # A ring narrows while the axis shortens: (1, 0) is positive at the apex end.
    is_outward = float((turned[0] * gauge).real @ (axials[1] @ e3)) > 0
    if is_outward != reading.is_inverted:
        gauge = -gauge
    signed: dict[str, NDArray[np.float64]] = {}
    signed |= {f"radial {p}": (z * gauge).real for p, z in turned.items()}
    signed |= {f"turning {p}": (z * gauge).imag for p, z in turned.items()}
    signed |= {f"axial {p}": a @ e3 for p, a in axials.items()}
    sizes: dict[str, Complex] = {}
    for p, a in axials.items():
        sizes[f"across {p}"] = np.asarray(a @ plane)
    for p, (c, s) in pairs.items():
        sizes[f"oval {p}"] = np.asarray((c @ plane + 1j * (s @ plane)) / 2)
        sizes[f"tilt {p}"] = np.asarray(c @ e3 - 1j * (s @ e3))
    return signed, sizes


def _pairs(
    modes: ModeSet, amplitudes: NDArray[np.float64], is_mirrored: bool
) -> dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]:
    """Cosine and sine amplitudes, (frames, 3) each, of the modes (p, 1) by p."""
    sign = -1.0 if is_mirrored else 1.0
    index = {
        (int(p), bool(sine)): i
        for i, ((p, turns), sine) in enumerate(zip(modes.wavenumbers, modes.is_sine, strict=True))
        if turns == 1
    }
    return {
        p: (amplitudes[:, i], sign * amplitudes[:, index[p, True]])
        for (p, sine), i in sorted(index.items())
        if not sine and (p, True) in index
    }


def _unpaired(modes: ModeSet, amplitudes: NDArray[np.float64]) -> dict[int, NDArray[np.float64]]:
    """Amplitudes, (frames, 3), of the modes (p, 0) by p, from 1 on."""
    index = {int(p): i for i, (p, turns) in enumerate(modes.wavenumbers) if turns == 0 and p > 0}
    return {p: amplitudes[:, i] for p, i in sorted(index.items())}


def _direction(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Give the unit vector along `vector`; any one where nothing moves."""
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        return np.array([0.0, 0.0, 1.0])
    unit: NDArray[np.float64] = vector / length
    return unit


def _phase_angle(signature: ModalSignature) -> NDArray[np.float64]:
    """Phase of each frame, (frames,) float64, rad; evenly spaced where there are no times."""
    n = signature.n_frames
    times = np.arange(float(n)) if signature.times is None else signature.times
    elapsed = times - times[0]
    # The period ends one mean step after the last frame.
    angle: NDArray[np.float64] = 2 * np.pi * elapsed / elapsed[-1] * ((n - 1) / n)
    return angle


def _harmonics(angle: NDArray[np.float64], signals: NDArray[np.float64], count: int) -> Complex:
    """First harmonics c_h of signals = mean + sum Re(c_h exp(-i h angle)), by least squares.

    Parameters
    ----------
    angle : (frames,) float64, rad
        Of any spacing.
    signals : (frames, signals) float64
    count : int

    Returns
    -------
    (count, signals) complex128
        Zero where there are too few frames.
    """
    found = min(count, max(1, (len(angle) - 1) // 2))
    h = np.arange(1, found + 1) * angle[:, None]
    design = np.concatenate([np.ones((len(angle), 1)), np.cos(h), np.sin(h)], axis=1)
    solution = np.linalg.lstsq(design, signals, rcond=_RANK_TOLERANCE)[0]
    harmonics = np.zeros((count, signals.shape[1]), dtype=np.complex128)
    harmonics[:found] = solution[1 : 1 + found] + 1j * solution[1 + found :]
    return harmonics


def _periodic_share(angle: NDArray[np.float64], signals: NDArray[np.float64]) -> float:
    n = len(angle)
    free = n - 1 - 2 * _N_PERIODIC
    total = float((signals**2).sum())
    if free < 2 or total == 0.0:
        return 1.0
    c = _harmonics(angle, signals, _N_PERIODIC)
    h = np.arange(1, _N_PERIODIC + 1) * angle[:, None]
    rest = signals - np.cos(h) @ c.real - np.sin(h) @ c.imag
    rest -= rest.mean(axis=0)
    # Of white noise n - 1 - 2 H of n - 1 parts remain.
    return max(0.0, 1.0 - float((rest**2).sum()) / free * (n - 1) / total)


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
    labels = {(int(p), int(turns)) for p, turns in modes.wavenumbers}
    if not {(1, 0), (0, 1)} <= labels or 0 not in _pairs(modes, signature.amplitudes, False):
        raise ModeCountError(
            f"{len(signature.modes)} modes are too few to read a motion from.",
            remedy="Fit 7 modes or more.",
            details={"least": 7},
        )
    return modes
