"""The fixed order of modes, and the counts that split no pair.

The order is by physical wavenumber on a reference surface whose axis is 0.55 of its
circumference, computed in integers. It depends on the topology alone, never on the number of
nodes or on the eigenvalues of the surface at hand, so a label keeps its place everywhere.
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import whole
from modalmotion.errors import LimitError, ModeCountError, ParameterError, ShapeError
from modalmotion.modes.mode_set import Modes, ModeSet
from modalmotion.modes.topology import CLOSED, End, ModeLabel, Topology, half_periods
from modalmotion.representation import with_article

# Squared reciprocal reference lengths times 121, as integers: axis 11/20, circumference 1,
# and 1/10 for a third axis (the thickness of a wall).
_INVERSE_SQUARED_LENGTHS: Final = (400, 121, 12_100)

_LARGEST_COUNT: Final = 10_000_000

# The order is a fixed table: its beginnings are worked out once.
_KEPT_COUNT: Final = 1024

# 8 N parts of a turn, and twice as many half periods, stay below 2^60.
_MOST_NODES_ALONG_AXIS: Final = 2**56


def lowest_modes(topology: Topology, n_modes: int, shape: tuple[int, ...] | None = None) -> ModeSet:
    """First modes in the fixed order, chosen without building all of them.

    Parameters
    ----------
    topology : Topology
    n_modes : int
        How many. Taken literally: see `whole_count` for counts that split no pair.
    shape : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its Nyquist
        wavenumber; without it the surface is a continuum and has any number of modes.

    Raises
    ------
    ModeCountError
        If `n_modes` is below 1, above ten million, or above the number of modes of the
        lattice.
    """
    n_modes = whole("n_modes", n_modes)
    n_total = None if shape is None else _n_modes_of(topology, shape)
    if n_modes < 1 or n_modes > _LARGEST_COUNT or (n_total is not None and n_modes > n_total):
        most = _LARGEST_COUNT if n_total is None else min(n_total, _LARGEST_COUNT)
        raise ModeCountError(
            f"{n_modes} modes were requested; a {topology} "
            f"{'' if shape is None else f'of {shape} nodes '}has 1 to {most}.",
            remedy=f"Ask for 1 to {most} modes.",
            details={"modes": n_modes, "most": most},
        )
    if n_modes <= _KEPT_COUNT:
        return _lowest_kept(topology, n_modes, shape)
    return _lowest(topology, n_modes, shape)


def whole_count(topology: Topology, n_modes: int, shape: tuple[int, ...] | None = None) -> int:
    """Smallest count from `n_modes` on that splits no cosine-sine pair.

    A split pair would make a signature depend on where the angle starts.
    """
    modes = lowest_modes(topology, n_modes, shape)
    if modes.is_sine[-1] or len(modes) == (shape is not None and _n_modes_of(topology, shape)):
        return n_modes
    more = lowest_modes(topology, n_modes + 1, shape)
    return n_modes + int(more.is_sine[-1])


def common_count(modes: Modes) -> int:
    """Count the first modes that every surface of the topology has, whatever its nodes.

    A lattice of few nodes has no modes beyond its Nyquist wavenumbers: from there on its order
    names others. Of one mesh, whose modes belong to no other, it is all.
    """
    if modes.topology is None:
        return len(modes)
    usual = lowest_modes(modes.topology, len(modes))
    is_same = (usual.wavenumbers == modes.wavenumbers).all(axis=1) & (
        usual.is_sine == modes.is_sine
    )
    if is_same.all():
        return len(modes)
    n = int(is_same.argmin())
    # No cosine without its sine.
    return n - int(usual.is_sine[n])


def all_modes(topology: Topology, shape: tuple[int, ...]) -> ModeSet:
    """Every mode of a lattice, in the fixed order: as many as it has nodes."""
    return lowest_modes(topology, _n_modes_of(topology, shape), shape)


def require_shape(topology: Topology, shape: tuple[int, ...]) -> None:
    """Refuse a lattice shape without a closed form on the topology.

    Raises
    ------
    ShapeError
        If the number of axes differs, an axis has no node, or the closed axis around a pole
        has an odd number of nodes.
    LimitError
        If an axis has more nodes than phases of 64 bits can resolve.
    """
    if len(shape) != topology.n_axes or min(shape, default=0) < 1:
        raise ShapeError(
            f"A {topology} lattice has {topology.n_axes} axes of at least one node, "
            f"not the shape {tuple(shape)}.",
            remedy="Give the number of nodes along each axis.",
        )
    if max(shape) > _MOST_NODES_ALONG_AXIS:
        raise LimitError(
            f"An axis of {max(shape)} nodes is longer than 2^56.",
            remedy="Use fewer nodes.",
            limit="nodes along an axis",
            details={"nodes": max(shape), "most": _MOST_NODES_ALONG_AXIS},
        )
    for axis, ends in enumerate(topology.ends):
        if End.POLE in ends and shape[axis + 1] % 2 == 1:
            raise ShapeError(
                f"Axis {axis + 1} runs around a pole and has {shape[axis + 1]} nodes: with an "
                "odd number no node is opposite another, and there is no closed form.",
                remedy="Use an even number of nodes, or the cylinder.",
                details={"axis": axis + 1, "nodes": shape[axis + 1]},
            )


def require_within_zone(modes: ModeSet, shape: tuple[int, ...]) -> None:
    """Refuse modes beyond the lattice's Nyquist wavenumber: they would alias into low ones.

    Raises
    ------
    ParameterError
        Naming the first label at fault and the largest wavenumber the axis resolves, or the
        sine of a wave vector that is its own opposite.
    """
    has_zeros = False
    for axis, (ends, n) in enumerate(zip(modes.topology.ends, shape, strict=True)):
        least, most = (-((n - 1) // 2), n // 2) if ends == CLOSED else (0, n - 1)
        lowest, highest = modes.extents[axis]
        if lowest < least or highest > most:
            p = modes.wavenumbers[:, axis]
            beyond = np.flatnonzero((p < least) | (p > most))
            raise ParameterError(
                f"Mode {modes.labels[beyond[0]]} is beyond what {n} nodes along axis {axis} "
                f"resolve ({least} to {most}) and would alias into a lower mode.",
                remedy="Ask for lower wavenumbers, or use more nodes.",
                details={"axis": axis, "least": least, "most": most},
            )
        has_zeros |= ends == CLOSED and (2 * highest == n or lowest == 0)
    if has_zeros:
        _require_nonzero(modes, shape)


def squared_keys(topology: Topology, wavenumbers: NDArray[np.int64]) -> NDArray[np.int64]:
    """Squared wavenumbers on the reference surface, times 484 / pi^2: integers, no ties lost.

    Raises
    ------
    LimitError
        If 64 bits do not contain them.
    """
    h = half_periods(topology, wavenumbers)
    key = np.zeros(len(h), dtype=np.int64)
    most = 0
    for axis, weight in enumerate(_weights(topology)):
        most += weight * int(np.abs(h[:, axis]).max(initial=0)) ** 2
        key += weight * h[:, axis] ** 2
    if most >= 2**63:
        raise LimitError(
            "The squared wavenumbers of these modes exceed integers of 64 bits.",
            remedy="Ask for lower modes.",
            limit="squared wavenumber",
        )
    return key


def _weights(topology: Topology) -> list[int]:
    """Weigh a squared half period (closed: period) along each axis in the key."""
    # k = pi h / 2L on non-closed axes, 2 pi p / L on closed ones.
    return [
        w * (16 if ends == CLOSED else 1)
        for w, ends in zip(_INVERSE_SQUARED_LENGTHS, topology.ends, strict=False)
    ]


def _require_nonzero(modes: ModeSet, shape: tuple[int, ...]) -> None:
    """Refuse sines that are zero at every node."""
    closed = list(modes.topology.closed_axes)
    n = np.array([shape[axis] for axis in closed], dtype=np.int64)
    zero = np.flatnonzero(modes.is_sine & (2 * modes.wavenumbers[:, closed] % n == 0).all(axis=1))
    if zero.size:
        raise ParameterError(
            f"Mode {modes.labels[zero[0]]} is zero at every node of a lattice of {shape} nodes.",
            remedy="Ask for its cosine alone.",
        )


def _n_modes_of(topology: Topology, shape: tuple[int, ...]) -> int:
    require_shape(topology, shape)
    product = 1
    for n in shape:
        product *= int(n)
    return product


@lru_cache(maxsize=64)
def _lowest_kept(topology: Topology, n_modes: int, shape: tuple[int, ...] | None) -> ModeSet:
    return _lowest(topology, n_modes, shape)


def _lowest(topology: Topology, n_modes: int, shape: tuple[int, ...] | None) -> ModeSet:
    bound = 4.0 * max(_INVERSE_SQUARED_LENGTHS)
    if shape is not None and n_modes == _n_modes_of(topology, shape):
        bound = sum(w * (2.0 * n) ** 2 for w, n in zip(_weights(topology), shape, strict=True))
    while True:
        modes, keys = _modes_within(topology, bound, shape)
        # A whole level is needed so that ties are broken among all of its members.
        if len(modes) >= n_modes:
            return modes.take(np.lexsort(keys)[:n_modes])
        bound *= 2.0 if len(modes) > 1000 else 4.0


def _modes_within(
    topology: Topology, bound: float, shape: tuple[int, ...] | None
) -> tuple[ModeSet, tuple[NDArray[np.int64] | NDArray[np.bool_], ...]]:
    """All modes whose squared key is at most `bound`, with the keys that sort them."""
    axes = []
    for axis, (ends, weight) in enumerate(zip(topology.ends, _weights(topology), strict=True)):
        # h = 2 p at least on non-closed axes
        most = int((bound / weight) ** 0.5 / (1 if ends == CLOSED else 2))
        n = None if shape is None else shape[axis]
        if ends == CLOSED:
            high = most if n is None else min(most, n // 2)
            low = most if n is None else min(most, (n - 1) // 2)
            axes.append(np.arange(-low, high + 1, dtype=np.int64))
        else:
            high = most if n is None else min(most, n - 1)
            axes.append(np.arange(high + 1, dtype=np.int64))
    p = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, topology.n_axes)
    p = p[squared_keys(topology, p) <= bound]

    # Of a wave vector and its opposite, keep the one whose first entry that differs from
    # its own opposite is positive. Where none differs the sine is zero and not a mode.
    sign = np.zeros(len(p), dtype=np.int8)
    for axis in topology.closed_axes:
        entry = np.sign(p[:, axis]).astype(np.int8)
        if shape is not None:
            entry[2 * p[:, axis] == shape[axis]] = 0
        sign = np.where(sign == 0, entry, sign)
    p, is_pair = p[sign >= 0], sign[sign >= 0] > 0

    wavenumbers = np.concatenate([p, p[is_pair]])
    is_sine = np.concatenate([np.zeros(len(p), bool), np.ones(int(is_pair.sum()), bool)])
    key = squared_keys(topology, wavenumbers)
    ties = [column for q in wavenumbers.T[::-1] for column in (q < 0, np.abs(q))]
    return ModeSet(topology, wavenumbers, is_sine), (is_sine, *ties, key)


_SPRING: Final = re.compile(r"\s*\(?\s*spring[\s,]*([0-9]{1,9})\s*\)?\s*")
_LABEL: Final = re.compile(r"\s*\(?\s*((?:-?[0-9]{1,9}\s*,\s*){1,3})(cos|sin)\s*\)?\s*")


def parse_label(text: str) -> ModeLabel:
    """Read a label such as "1,1,cos" or "spring 3", or as it is printed: "(1, 1, cos)".

    Raises
    ------
    ParameterError
        If the text is not a label.
    """
    if rank := _SPRING.fullmatch(text):
        return ModeLabel((int(rank[1]),), "spring")
    parts = _LABEL.fullmatch(text)
    if parts is None:
        raise ParameterError(
            f"{text[:40]!r} is not the label of a mode.",
            remedy="Write one wavenumber for each axis, then cos or sin: 1,1,cos; or, on a mesh "
            "without natural coordinates, spring and a rank: spring 3.",
        )
    wavenumbers = tuple(int(p) for p in parts[1].split(",") if p.strip())
    return ModeLabel(wavenumbers, "sin" if parts[2] == "sin" else "cos")


def modes_named(
    topology: Topology, labels: list[ModeLabel], shape: tuple[int, ...] | None = None
) -> ModeSet:
    """Modes with these labels, each checked to be a mode of the topology.

    Parameters
    ----------
    topology : Topology
    labels : list of ModeLabel
    shape : tuple of int, optional
        Nodes along each axis of a lattice, which has no modes beyond its Nyquist wavenumber.

    Raises
    ------
    ParameterError
        Naming the first label that no mode of the topology has, and the intended one if
        there is one.
    """
    for label in labels:
        _require_mode(topology, label)
    modes = ModeSet.of(topology, labels)
    if shape is not None:
        require_shape(topology, shape)
        require_within_zone(modes, shape)
    return modes


def _require_mode(topology: Topology, label: ModeLabel) -> None:
    p = label.wavenumbers
    if label.part == "spring":
        raise ParameterError(
            f"{label} names a spring mode, but {with_article(topology.name)} has modes in closed "
            "form.",
            remedy="Write one wavenumber for each axis, then cos or sin: 1,1,cos.",
            details={"label": str(label)},
        )
    if len(p) != topology.n_axes:
        raise ParameterError(
            f"{label} has {len(p)} wavenumbers; {with_article(topology.name)} has "
            f"{topology.n_axes} axes.",
            remedy="Give one wavenumber for each axis.",
            details={"label": str(label)},
        )
    closed = topology.closed_axes
    if any(k < 0 for axis, k in enumerate(p) if axis not in closed):
        raise ParameterError(
            f"{label} counts backwards along an axis that is not closed.",
            remedy="Use wavenumbers from 0 on.",
            details={"label": str(label)},
        )
    first = next((p[axis] for axis in closed if p[axis]), 0)
    if first == 0 and label.part == "sin":
        raise ParameterError(
            f"{label} is not a mode of {with_article(topology.name)}: the sine of a wave without "
            "any period around a closed axis is zero everywhere.",
            remedy="Use its cosine.",
            details={"label": str(label)},
        )
    if first < 0:
        meant = tuple(-k if axis in closed else k for axis, k in enumerate(p))
        raise ParameterError(
            f"{label} runs against the sense in which waves are counted.",
            remedy=f"Use {ModeLabel(meant, label.part)}; a sine changes its sign.",
            details={"label": str(label)},
        )
