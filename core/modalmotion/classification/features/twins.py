"""Twins of a motion: its mirror image, and itself backwards or inside out, as signs of features.

A feature keeps its value in a twin or becomes its opposite, so a twin costs no second reading.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.classification.features.columns import Columns

TWINS: Final = ("mirrored", "reversed", "inverted")
"""The image in a mirror; frames in the opposite order; motion about its mean in the opposite
direction."""

# First words of features that are areas between the paths of two modes, or of cosine and sine.
_LEADS: Final = ("ahead", "runs")


@lru_cache(maxsize=32)
def twin_signs(columns: Columns, *, mirror_turns_theta: bool) -> NDArray[np.float64]:
    """Signs by which the features of each of `TWINS` differ from those of the motion.

    Parameters
    ----------
    columns : Columns
        Of a reader without a typical motion.
    mirror_turns_theta : bool
        Whether theta runs the other way round on the image in a mirror, as it does where the
        shape gives it its sense.

    Returns
    -------
    (twins, features) float64

    Notes
    -----
    About an axis, with phases from the height of the contraction: a mirror turns twist round, and
    what is across the zero of theta; the opposite order of frames turns each sine; the opposite
    motion, whose contraction is half a period later, turns every second harmonic. Of modes as
    they are only what leads changes with the order, and products that name a sense of theta
    with the mirror.
    """
    names = [column.name for column in columns]
    signs = np.ones((len(TWINS), len(names)))
    for k, name in enumerate(names):
        words = name.split()
        about_axis = len(words) > 2 and words[-2] in ("cos", "sin")
        if about_axis:
            harmonic = int(words[-1])
            is_signed = words[0] in ("radial", "turning", "axial")
            has_sign = is_signed or words[-3] == "zero"
            if words[0] == "turning" or (len(words) > 4 and words[-4] == "across"):
                signs[0, k] = -1.0
            if has_sign and words[-2] == "sin":
                signs[1, k] = -1.0
            if has_sign and harmonic % 2 == 0:
                signs[2, k] = -1.0
        else:
            # Where each mode stands alone, products of a sine with a cosine.
            turned = words[0] == "runs" or "beside" in words[:2] or name.count("sin") == 1
            if mirror_turns_theta and turned and words[0] != "size":
                signs[0, k] = -1.0
            if words[0] in _LEADS:
                signs[1, k] = -1.0
            if words[0] == "term" and "with" in words and (int(words[1]) + int(words[3])) % 2:
                signs[1, k] = -1.0
    signs.setflags(write=False)
    return signs


def of_kinds(signs: NDArray[np.float64]) -> NDArray[np.float64]:
    """Signs of kinds (`kind_of`), whose last column, the amount of motion, a twin keeps."""
    return np.concatenate([signs, np.ones((len(signs), 1))], axis=1)
