"""The shapes that a track's amplitudes go with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes import ModeSet
from modalmotion.template import Template
from modalmotion.template.affine_motions import affine_shapes
from modalmotion.template.loose_vertices import shapes_of

SHAPES: Final = "shapes"
"""Name in a track's provenance; tracks of before have none."""

EXACT_FOR_AFFINE: Final = "exact for affine motions"


def track_shapes(
    modes: ModeSet, template: Template, provenance: Mapping[str, Any]
) -> NDArray[np.float64]:
    """Evaluate the shapes that a track was made with, (vertices, modes) float64.

    Parameters
    ----------
    modes : ModeSet
    template : Template
    provenance : mapping
        Of the track.
    """
    shapes = shapes_of(modes, template)
    if provenance.get(SHAPES) == EXACT_FOR_AFFINE:
        return affine_shapes(shapes, template)
    return shapes
