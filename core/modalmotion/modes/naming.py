"""Modes by their names: labels as people write them, and the modes with these labels."""

from __future__ import annotations

import re
from typing import Final

from modalmotion.errors import ParameterError
from modalmotion.modes.label import ModeLabel
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.order import require_shape, require_within_zone
from modalmotion.modes.topology import Topology
from modalmotion.numerals import with_article

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
