"""What the process between the service and a scheduler is told at its start."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class BridgeSettings:
    """What the bridge is told at its start.

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
    log_level : str
    """

    scheduler: str
    mark: str
    version: str
    task_seconds: float
    memory_bytes: int
    attempts: int
    connect_seconds: float
    patience_seconds: float
    log_level: str
