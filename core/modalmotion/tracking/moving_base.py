"""The base of a cup in a beat: where it is in frames that do not state it, and what lies beyond."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.topology import CUP
from modalmotion.template import Template
from modalmotion.tracking.image_view import Sight, Valve
from modalmotion.tracking.observation import Frame, Observation

Floats = NDArray[np.float64]

# Of the length of a ventricle: how far its base is towards the apex in frames other than the
# reference, and the deviation of that. Valves descend by up to a fifth of it.
_DESCENT: Final = 0.1
_SPREAD: Final = 0.06

# mm that a surface may leave such a place by: edges say nothing along it, and where it is held
# softly they draw it up the atrium. How far the place is off is added to what is stated.
_HELD: Final = 1.0

# mm beyond the base that an edge may be seen at: its rim is no plane across the axis.
_BEYOND: Final = 3.0


def with_base(
    marks: Sequence[Frame], stated: Sequence[Frame], template: Template, reference: int
) -> tuple[tuple[Frame, ...], Floats]:
    """Place the base in frames that state none.

    Parameters
    ----------
    marks, stated : sequence of Frame
        All landmarks of each frame, those that are stated first; and these.
    template : Template
        Of the reference frame's shape.
    reference : int

    Returns
    -------
    marks : tuple of Frame
    variances : (frames,) float64, mm^2
        Of the places along the axis; zero where they are stated.
    """
    variances = np.zeros(len(marks))
    if template.surface != CUP:
        return tuple(marks), variances
    tip, base = _ends(template)
    usual = base + _DESCENT * (tip - base), _SPREAD * float(np.linalg.norm(base - tip))
    full: list[Frame] = []
    for k, (frame, known) in enumerate(zip(marks, stated, strict=True)):
        if k == reference or _base_of(known) is not None:
            full.append(frame)
            continue
        place, sd = _base_of(frame) or usual
        variances[k] = sd**2
        others = (part for part in frame if "base" not in (part.places or ()))
        full.append((*others, Observation(place[None], sd=_HELD, places=("base",))))
    return tuple(full), variances


def below_base(sight: Sight, marks: Frame, template: Template) -> Sight:
    """Sight of one frame, to which edges beyond the base do not count."""
    known = _base_of(marks)
    if template.surface != CUP or known is None:
        return sight
    tip, base = _ends(template)
    axis = (base - tip) / np.linalg.norm(base - tip)
    return replace(sight, valve=Valve(axis, float(known[0] @ axis) + _BEYOND))


def _ends(template: Template) -> tuple[Floats, Floats]:
    x, s = template.vertices, template.coordinates[:, 0]
    return x[s <= s.min() + 1e-9].mean(axis=0), x[s >= s.max() - 1e-9].mean(axis=0)


def _base_of(frame: Frame) -> tuple[Floats, float] | None:
    """Place of the base in a frame, and its deviation; None where it states none."""
    for part in frame:
        for row, name in enumerate(part.places or ()):
            if name == "base" and part.normals is None:
                sd = part.sd if part.sd is not None else np.zeros(len(part))
                return part.points[row], float(np.broadcast_to(sd, len(part))[row])
    return None
