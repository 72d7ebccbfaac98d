"""Files in which mesh sequences are kept."""

from modalmotion.formats.limits import NO_LIMITS, ReadLimits
from modalmotion.formats.npz import ReadResult, read_npz, write_npz

__all__ = ["NO_LIMITS", "ReadLimits", "ReadResult", "read_npz", "write_npz"]
