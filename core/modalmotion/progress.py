"""Progress of long work, as functions that it calls meanwhile."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with the number of items done and of all items."""

ShareReport = Callable[[float], None]
"""Called with the share that is done, 0 to 1."""
