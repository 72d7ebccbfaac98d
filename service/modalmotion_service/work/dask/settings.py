"""What the process between the service and a scheduler is told at its start."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ClusterSettings:
    """A scheduler, and how its workers are to work.

    Parameters
    ----------
    scheduler : str
    mark : str
        Path of the file by which workers see that they share the data folder.
    version : str
        Of this package.
    task_seconds : float
    memory_bytes : int
    attempts : int
    connect_seconds : float
    patience_seconds : float
        How long work waits while there is no worker.
    silent_seconds : float
        After this a worker that says nothing counts as gone.
    look_seconds : float
        Between two looks at the scheduler and its workers.
    """

    scheduler: str
    mark: str
    version: str
    task_seconds: float
    memory_bytes: int
    attempts: int
    connect_seconds: float
    patience_seconds: float
    silent_seconds: float
    look_seconds: float
