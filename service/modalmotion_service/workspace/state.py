"""The state of a running service."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.store import ResultStore
from modalmotion_service.settings import Settings
from modalmotion_service.work.engine import Engine
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import JobRunner
from modalmotion_service.workspace.jobs import IdempotencyKeys, Jobs
from modalmotion_service.workspace.operation import Performance
from modalmotion_service.workspace.spool import Spool


@dataclass(frozen=True)
class State:
    """Everything open for one owner while the service runs.

    Parameters
    ----------
    settings : Settings
    store : ResultStore
    spool : Spool
    analysis : Analysis
    training_engine : Engine
        Where models are trained, apart from the short work of other requests.
    jobs : Jobs
    runner : JobRunner
    performance : Performance
    idempotency : IdempotencyKeys
    """

    settings: Settings
    store: ResultStore
    spool: Spool
    analysis: Analysis
    training_engine: Engine
    jobs: Jobs
    runner: JobRunner
    performance: Performance
    idempotency: IdempotencyKeys
