"""Limits on the size of an input, checked on its declared sizes before it is read."""

from dataclasses import dataclass, replace
from typing import Final

from modalmotion.errors import LimitError
from modalmotion.representation import shown

UNFOLDING: Final = 50
"""Bytes in memory for each byte of a file: packed motion of a mesh needs five at most."""

TEXT_UNFOLDING: Final = 25
"""Bytes of text for each byte of an archive: packed text needs ten at most."""

SMALLEST_UNFOLDING: Final = 32_000_000
"""Bytes in memory that a file of any size may unfold to."""

_UNLIMITED: Final = 2**62


@shown()
@dataclass(frozen=True)
class ReadLimits:
    """Largest input that a reader accepts.

    Parameters
    ----------
    frames, vertices, faces : int
    decompressed_bytes : int
        Of all arrays together, in memory; of all files in an archive.
    unfolded_bytes : int
        The same for this one file, in proportion to its size: see `of_file`.
    """

    frames: int = 10_000
    vertices: int = 2_000_000
    faces: int = 4_000_000
    decompressed_bytes: int = 2_000_000_000
    unfolded_bytes: int = _UNLIMITED

    def of_file(
        self, n_bytes: int, ratio: int = UNFOLDING, least: int = SMALLEST_UNFOLDING
    ) -> "ReadLimits":
        """Limits on a file of that size, so that a small one is never much work.

        Parameters
        ----------
        n_bytes : int
        ratio : int
            Bytes in memory for each byte of the file.
        least : int
            Bytes in memory that are accepted of any file.
        """
        if self.decompressed_bytes >= _UNLIMITED:
            return self
        return replace(self, unfolded_bytes=max(least, ratio * n_bytes))

    def require(self, **declared: int) -> None:
        """Refuse declared sizes above their limits.

        Parameters
        ----------
        **declared : int
            By the names of limits: frames, vertices, faces, decompressed_bytes.

        Raises
        ------
        LimitError
            Names the limit, its value and the declared size.
        """
        for name, value in declared.items():
            most: int = getattr(self, name)
            if name == "decompressed_bytes" and self.unfolded_bytes < min(value, most):
                raise LimitError(
                    f"The file unfolds to {value} bytes; one of its size may unfold to "
                    f"{self.unfolded_bytes}.",
                    remedy="Send it uncompressed (npz of numpy.savez, say), or fewer frames.",
                    limit="unfolded_bytes",
                    details={"value": value, "most": self.unfolded_bytes},
                )
            if value > most:
                words = name.replace("_", " ")
                raise LimitError(
                    f"The input declares {value} {words}; at most {most} are accepted.",
                    remedy="Send fewer frames or a coarser mesh, or have the limit raised.",
                    limit=name,
                    details={"value": value, "most": most},
                )


DEFAULT_LIMITS = ReadLimits()
NO_LIMITS = ReadLimits(*(_UNLIMITED,) * 4)
