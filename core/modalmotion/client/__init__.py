"""A client of the HTTP service; needs the extra `client`."""

from modalmotion.client.calls import Job, JobStatus
from modalmotion.client.client import Client
from modalmotion.client.connection import Answer, Retries
from modalmotion.client.errors import (
    BrokenAnswerError,
    JobCancelledError,
    JobUnfinishedError,
    RemoteError,
    UnreachableError,
)
from modalmotion.client.values import CompressedSequence, Info, SignatureArrays, TemplateModes

__all__ = [
    "Answer",
    "BrokenAnswerError",
    "Client",
    "CompressedSequence",
    "Info",
    "Job",
    "JobCancelledError",
    "JobStatus",
    "JobUnfinishedError",
    "RemoteError",
    "Retries",
    "SignatureArrays",
    "TemplateModes",
    "UnreachableError",
]
