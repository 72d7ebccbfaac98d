"""A client of the HTTP service; needs the extra `client`."""

from modalmotion.client.answers import (
    ClassAnswer,
    CompressedSequence,
    ImagesInfo,
    ModelInfo,
    SequenceInfo,
    SignatureArrays,
    TemplateInfo,
    TemplateModes,
)
from modalmotion.client.client import Client
from modalmotion.client.connection import Answer
from modalmotion.client.errors import (
    BrokenAnswerError,
    JobCancelledError,
    JobUnfinishedError,
    RemoteError,
    UnreachableError,
)
from modalmotion.client.jobs import Job, JobStatus
from modalmotion.client.many_files import SentResult
from modalmotion.client.readouts import Readouts
from modalmotion.client.retries import Retries
from modalmotion.client.sequence_calls import UNCHANGED

__all__ = [
    "UNCHANGED",
    "Answer",
    "BrokenAnswerError",
    "ClassAnswer",
    "Client",
    "CompressedSequence",
    "ImagesInfo",
    "Job",
    "JobCancelledError",
    "JobStatus",
    "JobUnfinishedError",
    "ModelInfo",
    "Readouts",
    "RemoteError",
    "Retries",
    "SentResult",
    "SequenceInfo",
    "SignatureArrays",
    "TemplateInfo",
    "TemplateModes",
    "UnreachableError",
]
