"""Limits on the size of an input, checked on its declared sizes before it is read."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.errors import LimitError
from modalmotion.representation import shown


@shown()
@dataclass(frozen=True)
class ReadLimits:
    """Largest input that a reader accepts.

    Parameters
    ----------
    frames, vertices, faces : int
    decompressed_bytes : int
        Of all arrays together, in memory; of all files in an archive.
    """

    frames: int = 10_000
    vertices: int = 2_000_000
    faces: int = 4_000_000
    decompressed_bytes: int = 2_000_000_000

    def require(self, name: str, value: int) -> None:
        """Refuse a declared size above its limit.

        Parameters
        ----------
        name : {"frames", "vertices", "faces", "decompressed_bytes"}
        value : int

        Raises
        ------
        LimitError
            Names the limit, its value and the declared size.
        """
        most: int = getattr(self, name)
        if value > most:
            words = name.replace("_", " ")
            raise LimitError(
                f"The input declares {value} {words}; at most {most} are accepted.",
                remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
                limit=name,
                details={"value": value, "most": most},
            )


DEFAULT_LIMITS = ReadLimits()
NO_LIMITS = ReadLimits(*(2**62,) * 4)
