"""The tip of a cup stays near its place: what is known of hearts, where blood leaves the apex.

The apex of a ventricle hardly moves along the axis, its inner side by some mm where the wall
thickens, and the base comes down to it. At end systole blood leaves the tip between trabeculae, and
its edge rises by far more. Edges that rise farther than walls do are not followed, and the tip is
held softly.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from modalmotion.modes.topology import CUP
from modalmotion.template import Template
from modalmotion.tracking.image_view import Tip
from modalmotion.tracking.observation import Frame, Observation

# mm that the tip may rise (in phantoms it does by 10 at most), and more with the share of the way
# to the base, where edges turn inward.
_RISE: Final = 12.0
_MORE: Final = 30.0

# mm: deviation of the tip's place from that in the reference; in phantoms 5.
_DEVIATION: Final = 6.0


def tip_of(template: Template) -> Tip | None:
    """Limit for edges of a cup's shape in the reference frame; None of other topologies."""
    if template.surface != CUP:
        return None
    x, s = template.vertices, template.coordinates[:, 0]
    tip = x[s <= s.min() + 1e-9].mean(axis=0)
    axis = x[s > 0.9].mean(axis=0) - tip
    axis /= np.linalg.norm(axis)
    return Tip(axis, x @ axis + _RISE + _MORE * s)


def held(marks: Sequence[Frame], template: Template, reference: int) -> tuple[Frame, ...]:
    """Hold the tip softly in frames that state no apex.

    Parameters
    ----------
    marks : sequence of Frame
        Landmarks of each frame.
    template : Template
        Of the reference frame's shape.
    reference : int
    """
    if template.surface != CUP:
        return tuple(marks)
    x, s = template.vertices, template.coordinates[:, 0]
    tip = x[s <= s.min() + 1e-9].mean(axis=0)
    own = Observation(tip[None], sd=_DEVIATION, places=("apex",))
    full = []
    for k, frame in enumerate(marks):
        has = any("apex" in (part.places or ()) for part in frame)
        full.append(frame if has or k == reference else (*frame, own))
    return tuple(full)
