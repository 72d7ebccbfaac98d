"""A client of the HTTP service; needs the extra `client`."""

from modalmotion.client.calls import Job
from modalmotion.client.client import Client
from modalmotion.client.connection import Answer, Retries
from modalmotion.client.errors import (
    BrokenAnswerError,
    JobCancelledError,
    JobUnfinishedError,
    RemoteError,
    UnreachableError,
)
from modalmotion.client.values import Info

__all__ = [
    "Answer",
    "BrokenAnswerError",
    "Client",
    "Info",
    "Job",
    "JobCancelledError",
    "JobUnfinishedError",
    "RemoteError",
    "Retries",
    "UnreachableError",
]
