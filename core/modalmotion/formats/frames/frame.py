"""One frame of a sequence, as a reader of single meshes returns it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.checks import FloatArray

TRACK: Final = "`modalmotion track`"
"""What takes frames that do not correspond, as remedies name it; a service has its own name."""

SIGNATURE: Final = "`modalmotion signature`"
"""What takes a sequence of one mesh, as remedies name it; a service has its own name."""

NOTHING_TO_TRACK: Final = (
    "The vertices of a sequence of one mesh correspond, so that it needs no tracking: it is for "
    f"{SIGNATURE}."
)
"""Remedy where such a sequence came to be tracked."""

ONE_MESH: Final = (
    "Send one mesh that moves, with the same vertices and faces in every frame; or track the "
    f"frames as they are: {TRACK}."
)
"""Remedy where frames are not of one mesh."""

# 3D Slicer and Mimics write this into headers and comments.
_SPACE: Final = re.compile(rb"SPACE=(RAS|LPS)")


@dataclass(frozen=True, eq=False)
class Frame:
    """Vertices and triangles in the order of the file.

    Parameters
    ----------
    positions : (vertices, 3) float32 or float64
    faces : (faces, 3) int64
        Not checked yet: indices may be out of range.
    is_soup : bool
        Whether each face has three vertices of its own, as in STL.
    notes : tuple of str
        Changes to the polygons.
    ignored : tuple of str
        Unused content of the file.
    statements : tuple of (str, str)
        What the file states, by name: "coordinate_system", "unit", "topology", "grid"
        and "time" (numbers as text).
    """

    positions: FloatArray
    faces: NDArray[np.int64]
    is_soup: bool = False
    notes: tuple[str, ...] = ()
    ignored: tuple[str, ...] = ()
    statements: tuple[tuple[str, str], ...] = ()

    def stated(self, name: str) -> str | None:
        """Return the file's statement of that name."""
        return dict(self.statements).get(name)


def space_in(text: bytes) -> tuple[tuple[str, str], ...]:
    """Find the statement of a coordinate system in a header or comment.

    Returns
    -------
    tuple of (str, str)
        Empty or one statement, for `Frame.statements`.
    """
    match = _SPACE.search(text)
    return () if match is None else (("coordinate_system", match[1].decode()),)
