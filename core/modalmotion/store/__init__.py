"""Results kept in files: written wholly or not at all, found again, checked."""

from modalmotion.store.analysis_file import export, is_pack, write_pack
from modalmotion.store.atomic import write_atomic
from modalmotion.store.backup import BackupReport, backup
from modalmotion.store.classification_file import (
    classification_from_hdf5,
    classification_key,
    classification_to_hdf5,
)
from modalmotion.store.idempotency import IdempotencyKeys, IdempotentRequest
from modalmotion.store.index import SequencePage
from modalmotion.store.jobs import UNSET, Job, JobPage, Jobs, JobState, Unset
from modalmotion.store.made import MadeSignature
from modalmotion.store.maintenance import rebuild
from modalmotion.store.model_file import KeptModel, kept_model, model_from_hdf5, model_to_hdf5
from modalmotion.store.model_record import (
    NAME_PATTERN,
    VERSION_PATTERN,
    ModelRecord,
    ModelReference,
    parse_reference,
    require_model_name,
)
from modalmotion.store.record import SequenceRecord, record_of, record_to_json
from modalmotion.store.recovery import Reconciliation
from modalmotion.store.results import ResultStore
from modalmotion.store.sequence_file import sequence_from_hdf5, sequence_to_hdf5
from modalmotion.store.signature_file import signature_from_hdf5, signature_to_hdf5
from modalmotion.store.template_file import template_from_hdf5, template_to_hdf5
from modalmotion.store.verification import Fault, VerifyReport, verify

__all__ = [
    "NAME_PATTERN",
    "UNSET",
    "VERSION_PATTERN",
    "BackupReport",
    "Fault",
    "IdempotencyKeys",
    "IdempotentRequest",
    "Job",
    "JobPage",
    "JobState",
    "Jobs",
    "KeptModel",
    "MadeSignature",
    "ModelRecord",
    "ModelReference",
    "Reconciliation",
    "ResultStore",
    "SequencePage",
    "SequenceRecord",
    "Unset",
    "VerifyReport",
    "backup",
    "classification_from_hdf5",
    "classification_key",
    "classification_to_hdf5",
    "export",
    "is_pack",
    "kept_model",
    "model_from_hdf5",
    "model_to_hdf5",
    "parse_reference",
    "rebuild",
    "record_of",
    "record_to_json",
    "require_model_name",
    "sequence_from_hdf5",
    "sequence_to_hdf5",
    "signature_from_hdf5",
    "signature_to_hdf5",
    "template_from_hdf5",
    "template_to_hdf5",
    "verify",
    "write_atomic",
    "write_pack",
]
