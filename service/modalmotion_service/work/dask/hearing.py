"""Which workers of a scheduler are heard of: a stopped one stays in its list for minutes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

# Workers tell the scheduler twice a second that they are there; of more than two hundred each does
# it every n/200 + 1 seconds (`distributed.scheduler.heartbeat_interval`).
SILENT_SECONDS: Final = 10.0


class Hearing:
    """Workers by the time at which the scheduler last heard of them.

    That time is of the scheduler's clock, so it is only looked at whether it changes.

    Parameters
    ----------
    silent_seconds : float
        After this a worker that says nothing counts as gone.
    """

    def __init__(self, silent_seconds: float = SILENT_SECONDS) -> None:
        self._silent_seconds = silent_seconds
        self._changed: dict[str, tuple[float, float]] = {}
        self._heard: tuple[str, ...] = ()

    def note(self, workers: Mapping[str, Mapping[str, Any]], time: float) -> None:
        """Take up what the scheduler says of its workers.

        Parameters
        ----------
        workers : mapping
            By address, with `last_seen`.
        time : float
            Seconds, of a clock that only goes forward.
        """
        changed = {}
        for address, worker in workers.items():
            seen, since = self._changed.get(address, (None, time))
            changed[address] = (worker["last_seen"], since if worker["last_seen"] == seen else time)
        self._changed = changed
        silent_after = max(self._silent_seconds, 4 * (len(workers) / 200 + 0.5))
        self._heard = tuple(
            address for address, (_, since) in changed.items() if time - since < silent_after
        )

    @property
    def heard(self) -> tuple[str, ...]:
        """Addresses of workers that are there."""
        return self._heard

    @property
    def silent(self) -> tuple[str, ...]:
        """Addresses of workers that the scheduler knows and has not heard of for long."""
        return tuple(address for address in self._changed if address not in self._heard)
