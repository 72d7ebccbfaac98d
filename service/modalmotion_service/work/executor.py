"""Work behind the standard `Executor`: on one machine or on many, callers see no difference."""

from __future__ import annotations

from abc import abstractmethod
from concurrent.futures import Executor


class Engine(Executor):
    """An executor of tasks that says how much it does at once, and whether it can.

    Tasks are functions of a module, carry paths and small values, and may run twice.
    """

    @property
    @abstractmethod
    def n_workers(self) -> int:
        """Tasks that run at the same time."""

    @abstractmethod
    def require_ready(self) -> None:
        """Raise ClusterError if a task could not be run now."""
