"""How far long work is, as functions that it calls meanwhile."""

from __future__ import annotations

from collections.abc import Callable

Progress = Callable[[int, int], None]
"""Called with the number of things done and of all things."""

ShareReport = Callable[[float], None]
"""Called with the share that is done, 0 to 1."""
