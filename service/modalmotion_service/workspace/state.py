"""The state of a running service."""

from __future__ import annotations

from dataclasses import dataclass

from modalmotion.store import ResultStore
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.analysis import Analysis
from modalmotion_service.workspace.job_runner import JobRunner
from modalmotion_service.workspace.jobs import IdempotencyKeys, Jobs
from modalmotion_service.workspace.models import Models
from modalmotion_service.workspace.norms import Norms
from modalmotion_service.workspace.operation import Performance
from modalmotion_service.workspace.spool import Spool
from modalmotion_service.workspace.tracks import Images, Tracks
from modalmotion_service.workspace.training import Trainer


@dataclass(frozen=True)
class State:
    """Everything open for one owner while the service runs.

    Parameters
    ----------
    settings : Settings
    store : ResultStore
    spool : Spool
    analysis : Analysis
    models : Models
    images : Images
    tracks : Tracks
    norms : Norms
    jobs : Jobs
    runner : JobRunner
    trainer : Trainer
    performance : Performance
    idempotency : IdempotencyKeys
    """

    settings: Settings
    store: ResultStore
    spool: Spool
    analysis: Analysis
    models: Models
    images: Images
    tracks: Tracks
    norms: Norms
    jobs: Jobs
    runner: JobRunner
    trainer: Trainer
    performance: Performance
    idempotency: IdempotencyKeys
