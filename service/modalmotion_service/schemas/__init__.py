"""Requests and answers, as pydantic models."""

from modalmotion_service.schemas.distances import DistanceAnswer
from modalmotion_service.schemas.facts import FactsAnswer
from modalmotion_service.schemas.features import FeaturesAnswer, FeaturesRequest
from modalmotion_service.schemas.fields import (
    GRID,
    JobId,
    SequenceId,
    parse_times,
)
from modalmotion_service.schemas.general import (
    Health,
    Problem,
    Readiness,
)
from modalmotion_service.schemas.jobs import JobAnswer, JobPageAnswer, JobState
from modalmotion_service.schemas.models import (
    LabelledSequence,
    ModelAnswer,
    ModelName,
    ModelPageAnswer,
    ModelSummary,
    ModelVersion,
    TrainingRequest,
)
from modalmotion_service.schemas.readouts import ReadoutsAnswer
from modalmotion_service.schemas.results import (
    ClassificationAnswer,
    ClassificationList,
    ClassificationRequest,
    EncodedAnswer,
    EncodingTarget,
    UploadClassificationAnswer,
)
from modalmotion_service.schemas.sequences import (
    ReadingAnswer,
    ReadingQuery,
    SequenceNames,
    SequencePageAnswer,
    SequenceSummary,
    UploadQuery,
)
from modalmotion_service.schemas.signatures import (
    FrameErrors,
    Label,
    ManySignatures,
    SignatureAnswer,
    SignatureQuery,
)
from modalmotion_service.schemas.templates import (
    ModesAnswer,
    ModesQuery,
    TemplateAnswer,
    TemplateList,
)
from modalmotion_service.schemas.tradeoff import TradeoffAnswer

__all__ = [
    "GRID",
    "ClassificationAnswer",
    "ClassificationList",
    "ClassificationRequest",
    "DistanceAnswer",
    "EncodedAnswer",
    "EncodingTarget",
    "FactsAnswer",
    "FeaturesAnswer",
    "FeaturesRequest",
    "FrameErrors",
    "Health",
    "JobAnswer",
    "JobId",
    "JobPageAnswer",
    "JobState",
    "Label",
    "LabelledSequence",
    "ManySignatures",
    "ModelAnswer",
    "ModelName",
    "ModelPageAnswer",
    "ModelSummary",
    "ModelVersion",
    "ModesAnswer",
    "ModesQuery",
    "Problem",
    "Readiness",
    "ReadingAnswer",
    "ReadingQuery",
    "ReadoutsAnswer",
    "SequenceId",
    "SequenceNames",
    "SequencePageAnswer",
    "SequenceSummary",
    "SignatureAnswer",
    "SignatureQuery",
    "TemplateAnswer",
    "TemplateList",
    "TradeoffAnswer",
    "TrainingRequest",
    "UploadClassificationAnswer",
    "UploadQuery",
    "parse_times",
]
