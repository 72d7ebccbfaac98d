"""A queue in which owners take turns, by what their work costs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, Generic, TypeVar

T = TypeVar("T")

# A task costs a turn however short it is, and no more than the longest that there may be.
_LEAST: Final = 1e-3
_MOST: Final = 300.0


class FairQueue(Generic[T]):
    """First come, first served for each owner; between owners, whoever has had least.

    Each owner has a clock, which their tasks advance by their prices as they are taken, and the
    owner whose clock is furthest behind is next (start-time fair queueing: Goyal, Vin and Cheng,
    1996). With equal prices this is round robin. Whoever was away starts with the others' time:
    nobody saves turns up.

    Parameters
    ----------
    is_wanted : callable
        Of an item whose turn has come: one that is not is dropped, and costs its owner nothing.
    """

    def __init__(self, is_wanted: Callable[[T], bool]) -> None:
        self._is_wanted = is_wanted
        self._waiting: dict[str, deque[tuple[float, T]]] = {}
        self._clocks: dict[str, float] = {}
        self._now = 0.0
        self._length = 0

    def put(self, item: T, owner: str, price: float) -> None:
        """Append an item to those of its owner; `price` in s."""
        if owner not in self._waiting:
            self._waiting[owner] = deque()
            self._clocks[owner] = max(self._clocks.get(owner, 0.0), self._now)
        self._waiting[owner].append((min(max(price, _LEAST), _MOST), item))
        self._length += 1

    def take(self) -> T | None:
        """Take the next item that is wanted; None if there is none."""
        while self._waiting:
            owner = min(self._waiting, key=self._clocks.__getitem__)
            price, item = self._waiting[owner].popleft()
            self._length -= 1
            is_wanted = self._is_wanted(item)
            if is_wanted:
                self._now = self._clocks[owner]
                self._clocks[owner] += price
            if not self._waiting[owner]:
                del self._waiting[owner]
                self._forget()
            if is_wanted:
                return item
        return None

    def clear(self) -> list[T]:
        """Take all that is left, wanted or not."""
        left = [item for queue in self._waiting.values() for _, item in queue]
        self._waiting.clear()
        self._length = 0
        return left

    def __len__(self) -> int:
        return self._length

    def _forget(self) -> None:
        # Those who have nothing here and are not ahead start anew as anybody does.
        self._clocks = {
            owner: clock
            for owner, clock in self._clocks.items()
            if owner in self._waiting or clock > self._now
        }
