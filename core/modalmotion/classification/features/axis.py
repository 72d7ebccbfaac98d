"""Features of a surface with an axis: contraction, twist, shortening, and what is one-sided.

The amplitudes are read in a body frame that the motion itself gives. Over one period each is a
mean, which is dropped, and harmonics.
"""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.axis_parts import Parts, parts_of, readable_modes
from modalmotion.classification.features.centred import CentredMotions
from modalmotion.classification.features.columns import Column, Columns, MotionFeatures
from modalmotion.classification.features.phases import by_part, from_phase, read_parts
from modalmotion.errors import ParameterError
from modalmotion.modes import Modes
from modalmotion.signature.making import ModalSignature

Vectors = NDArray[np.float64]
Direction = tuple[float, float, float]

_COORDINATES: Final[tuple[Direction, ...]] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class AxisReading(NamedTuple):
    """Handedness and inward side, which the amplitudes leave open.

    Parameters
    ----------
    is_mirrored : bool
        Whether theta runs left-handed about the axis, as columns of a lattice may.
    is_inverted : bool
        Whether inward is opposite to what shortening suggests.
    """

    is_mirrored: bool = False
    is_inverted: bool = False


READINGS: Final = tuple(AxisReading(m, i) for m in (False, True) for i in (False, True))
"""All readings; which of them holds is decided by what a model knows."""


class _Layout(NamedTuple):
    """Layout of the features, common to all motions in the same modes.

    Parameters
    ----------
    columns : Columns
    signs : (readings, features) float64
        Changes of sign in each reading against the first.
    deforming : (3 modes,) float64
        1 for amplitudes of modes that do not translate the whole.
    rings : two of (6 * rings,) int64
        Amplitudes of cosine and sine of (p, 1) whose products make their vector product: for each
        direction the product that is added, and the one that is taken off.
    line : (9, 1) and (1, 9) int64
        Amplitudes that tell the radial line, with each other: see `_radial_line`.
    mixing : (directions * modes, parts) float64
        Makes parts of harmonics along the directions of `_directions`: those with a sign, first
        and second components of those without.
    order : (values,) int64
        Places of the features' values: see `read_parts`.
    n_signed, n_sized : int
        Numbers of features with and without a sign.
    """

    columns: Columns
    signs: Vectors
    deforming: Vectors
    rings: tuple[NDArray[np.int64], NDArray[np.int64]]
    line: tuple[NDArray[np.int64], ...]
    mixing: Vectors
    order: NDArray[np.int64]
    n_signed: int
    n_sized: int


def axis_features(
    signature: ModalSignature,
    n_signed: int = 2,
    n_sized: int = 1,
    *,
    walls: bool = False,
    n_modes: int = 0,
    motions: CentredMotions | None = None,
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
    n_modes : int
        First modes that are read; 0 for all.
    motions : CentredMotions, optional
        Of the signature, for others to read too.

    Returns
    -------
    MotionFeatures
        In percent of the surface's size; square roots of that for parts without a sign. One
        row for each of `READINGS`.

    Raises
    ------
    TopologyError
        If the surface is not one of these, or has no extent.
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
    modes = readable_modes(signature, n_modes)
    layout = _layout(modes, n_signed, n_sized, walls)
    motion = (motions or CentredMotions(signature)).of_first(len(modes))
    e1, e2, e3 = _body_frame(motion.products, layout, _theta_zero(signature) if walls else None)
    gauge = _radial_line(motion.products, layout, e1, e2, e3)
    directions = _directions(e1, e2, e3, gauge, walls=walls)
    count = max(n_signed, n_sized)
    rows = motion.harmonic_rows(count)[:, : 3 * len(modes)]
    along = (rows.reshape(-1, 3) @ directions).reshape(2 * count, -1)
    mixed = along @ layout.mixing
    # At phase 0 the contraction, which is the opposite of "radial 0", is at its height.
    clock = cmath.phase(-complex(mixed[0, 0], mixed[count, 0]))
    values = read_parts(from_phase(mixed, clock), layout.order, layout.n_signed, layout.n_sized)
    size, smooth_share = motion.amount(layout.deforming)
    return MotionFeatures(layout.columns, values * layout.signs, size, smooth_share)


def _body_frame(
    products: Vectors, layout: _Layout, towards: Vectors | None
) -> tuple[Direction, Direction, Direction]:
    """Give e1, e2 and e3; e1 is towards the zero of theta where that is known."""
    # The sum of c x s is what is not symmetric in the sum of c s'.
    m = products[layout.rings].tolist()
    e3 = _unit(
        (
            sum(m[0::6]) - sum(m[1::6]),
            sum(m[2::6]) - sum(m[3::6]),
            sum(m[4::6]) - sum(m[5::6]),
        )
    )
    if towards is None:
        sizes = [abs(part) for part in e3]
        start = _COORDINATES[sizes.index(min(sizes))]
    else:
        start = (float(towards[0]), float(towards[1]), float(towards[2]))
        start = _cross(e3, start)
    e1 = _unit(_cross(start, e3))
    return e1, _cross(e3, e1), e3


def _radial_line(
    products: Vectors, layout: _Layout, e1: Direction, e2: Direction, e3: Direction
) -> complex:
    """Give the turn about the axis, of modulus 1, that makes radial motion of (0, 1) real."""
    # (w(c) - i w(s)) / 2 but for the half, of the mode (0, 1), as x + i y: x = c1 + s2,
    # y = c2 - s1; and the axial part of (1, 0). Their products over time, of c, s and the last.
    none = (0.0, 0.0, 0.0)
    rows = (*e1, *e2, *none, *e2, -e1[0], -e1[1], -e1[2], *none, *none, *none, *e3)
    three = np.array(rows).reshape(3, 9)
    nine = products[layout.line]
    (xx, xy, x_axial), (_, yy, y_axial), _ = (three @ nine @ three.T).tolist()
    # The line in the complex plane along which (0, 1) moves most is the radial one.
    gauge = cmath.exp(-0.5j * math.atan2(2.0 * xy, xx - yy))
    # A ring narrows while the axis shortens: (1, 0) is positive at the apex end.
    if gauge.real * x_axial - gauge.imag * y_axial > 0:
        gauge = -gauge
    return gauge


def _directions(
    e1: Direction, e2: Direction, e3: Direction, gauge: complex, *, walls: bool
) -> Vectors:
    """Give the directions that parts are read along, as columns, (3, 3 or 5) float64.

    e1 and e2 turned about the axis by the gauge, which turns w(v) = v.e1 + i v.e2 by as much,
    then e3. Lengths are the same in the turned frame; what walls do is not, and is read
    along e1 and e2 as they are.
    """
    g, k = gauge.real, gauge.imag
    turned = [
        (g * e1[0] - k * e2[0], g * e1[1] - k * e2[1], g * e1[2] - k * e2[2]),
        (k * e1[0] + g * e2[0], k * e1[1] + g * e2[1], k * e1[2] + g * e2[2]),
    ]
    columns = [*turned, e3, e1, e2] if walls else [*turned, e3]
    return np.array([part for column in columns for part in column]).reshape(-1, 3).T


def _mixing(parts: Parts, n_modes: int, *, walls: bool) -> tuple[Vectors, int, int]:
    """Give `mixing` of the layout, and how many parts have a sign and have none."""
    n_directions = 5 if walls else 3
    one = np.eye(n_directions * n_modes).reshape(n_modes, n_directions, -1)
    # Of each mode the components along the directions, as rows that pick them out.
    c, s, flat = (one[k].transpose(1, 0, 2) for k in (parts.cosines, parts.sines, parts.unpaired))
    n_rings = len(parts.first)
    # (w(c) - i w(s)) / 2 = ((c1 + s2) + i (c2 - s1)) / 2 of p' = 1, and e3 of (p, 0)
    rings = [(c[0] + s[1]) / 2, (c[1] - s[0]) / 2]
    signed = [*(part[:n_rings] for part in rings), flat[2]]
    # (w(c) + i w(s)) / 2 = ((c1 - s2) + i (c2 + s1)) / 2 and e3.c - i e3.s; the first of p' > 1
    i, j = (3, 4) if walls else (0, 1)
    x = [flat[i], (c[i] - s[j]) / 2, c[2], (c[i] + s[j])[n_rings:] / 2]
    y = [flat[j], (c[j] + s[i]) / 2, -s[2], (c[j] - s[i])[n_rings:] / 2]
    n_signed, n_sized = sum(map(len, signed)), sum(map(len, x))
    return np.concatenate([*signed, *x, *y]).T.copy(), n_signed, n_sized


def axis_columns(modes: Modes, n_signed: int, n_sized: int, *, walls: bool) -> Columns:
    """Columns of the values of `axis_features`."""
    return _layout(modes, n_signed, n_sized, walls).columns


@lru_cache(maxsize=64)
def _layout(modes: Modes, n_signed: int, n_sized: int, walls: bool) -> _Layout:
    parts = parts_of(modes)
    mixing, with_sign, without = _mixing(parts, len(modes), walls=walls)
    signed, x, y = (
        by_part(np.arange(first, first + n), harmonics, with_sign + 2 * without)
        for first, n, harmonics in (
            (0, with_sign, n_signed),
            (with_sign, without, n_sized),
            (with_sign + without, without, n_sized),
        )
    )
    # "radial 0 sin 1" is zero by the choice of the clock.
    in_order = [np.delete(signed, 1)]
    in_order += [np.concatenate([x, y], axis=1).ravel()] if walls else [x.ravel(), y.ravel()]
    ring, one = parts.first[0], np.arange(3)
    line = [3 * k + one for k in (parts.cosines[ring], parts.sines[ring], parts.unpaired[0])]
    order = np.concatenate(in_order)
    c, s = parts.cosines[parts.first], parts.sines[parts.first]
    i, j = np.array([1, 2, 2, 0, 0, 1]), np.array([2, 1, 0, 2, 1, 0])
    return _Layout(
        columns=_columns(parts, n_signed, n_sized, walls),
        signs=np.stack([_signs(parts, reading, n_signed, n_sized, walls) for reading in READINGS]),
        deforming=np.repeat(modes.wavenumbers.any(axis=1), 3).astype(np.float64),
        rings=((3 * c[:, None] + i).ravel(), (3 * s[:, None] + j).ravel()),
        line=np.ix_(*[np.concatenate(line)] * 2),
        mixing=mixing,
        order=order,
        n_signed=len(order) if walls else signed.size - 1,
        n_sized=0 if walls else x.size,
    )


def _signs(parts: Parts, reading: AxisReading, n_signed: int, n_sized: int, walls: bool) -> Vectors:
    """Signs by which a reading differs from the first one.

    A theta that runs left-handed turns s and e3 round. Where e1 is towards the zero of theta, e2
    goes with them, and w becomes its conjugate; elsewhere e1 does, and w becomes the opposite of
    its conjugate. Both make the radial line its mirror image, radial and axial parts their
    opposite, and keep turning. Inward and outward exchanged turns radial and turning round. Where
    radial parts are turned round the height of the contraction is half a period later.
    """
    n_rings, n_pairs = len(parts.first), len(parts.cosines)
    n_flat, n_others = len(parts.unpaired), len(parts.others)
    mirrored = -1.0 if reading.is_mirrored else 1.0
    inverted = -1.0 if reading.is_inverted else 1.0
    later = mirrored * inverted
    by_part = [mirrored * inverted] * n_rings + [inverted] * n_rings + [mirrored] * n_flat
    signed = np.array(by_part)[:, None] * _of_harmonics(n_signed, later)
    if walls:
        # e1, e2 and, of tilt, e3.c and -e3.s; "towards zero" and "across zero".
        plane, tilt = (1.0, mirrored), (mirrored, 1.0)
        sides = [plane] * (n_flat + n_pairs) + [tilt] * n_pairs + [plane] * n_others
        sized = (np.array(sides)[:, :, None] * _of_harmonics(n_sized, later)).ravel()
    else:
        sized = np.ones(2 * n_sized * (n_flat + 2 * n_pairs + n_others))
    return np.concatenate([np.delete(signed, 1), sized])


def _of_harmonics(count: int, later: float) -> Vectors:
    """Give the sign of cosine and sine of each harmonic half a period later, if `later` is -1."""
    return np.repeat(later ** np.arange(1, count + 1), 2)


def _columns(parts: Parts, n_signed: int, n_sized: int, walls: bool) -> Columns:
    columns = [
        Column(f"{part.name} {phase} {h}", part.modes)
        for part in parts.signed
        for h in range(1, n_signed + 1)
        for phase in ("cos", "sin")
    ]
    del columns[1]
    sides = (" towards zero", " across zero") if walls else ("",)
    columns += [
        Column(f"{part.name}{side} {phase} {h}", part.modes, power=1.0 if walls else 0.5)
        for part in parts.sized
        for side in sides
        for h in range(1, n_sized + 1)
        for phase in ("cos", "sin")
    ]
    return Columns(columns)


def _theta_zero(signature: ModalSignature) -> Vectors:
    if signature.landmarks is None:
        raise ParameterError(
            "The surface has no zero of theta, so walls cannot be told apart.",
            remedy="State the landmark theta_zero.",
        )
    return signature.landmarks.theta_zero


def _cross(a: Direction, b: Direction) -> Direction:
    """Vector product; numpy's own costs twenty times as much on one pair."""
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _unit(vector: Direction) -> Direction:
    """Give the unit vector along `vector`; any one where nothing moves."""
    length = math.hypot(*vector)
    if length == 0.0:
        return (0.0, 0.0, 1.0)
    return (vector[0] / length, vector[1] / length, vector[2] / length)
