"""Results in files: written wholly or not at all, indexed, checked."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.classification.answer_hdf5 import (
    classification_from_hdf5,
    classification_key,
    classification_to_hdf5,
)
from modalmotion.classification.model_files import (
    KeptModel,
    kept_model,
    model_from_hdf5,
    model_to_hdf5,
)
from modalmotion.classification.record import (
    NAME_PATTERN,
    VERSION_PATTERN,
    ModelRecord,
    ModelReference,
    parse_reference,
    require_model_name,
)
from modalmotion.mesh.hdf5 import sequence_from_hdf5, sequence_to_hdf5
from modalmotion.signature.hdf5 import signature_from_hdf5, signature_to_hdf5
from modalmotion.store.care.backup import BackupReport, backup, backup_time
from modalmotion.store.care.maintenance import rebuild
from modalmotion.store.care.recovery import Reconciliation
from modalmotion.store.care.restoration import RestoreReport, restore
from modalmotion.store.care.verification import Fault, VerifyReport, verify
from modalmotion.store.disk.atomic import write_atomic
from modalmotion.store.images import ImagesPage
from modalmotion.store.images_record import ImagesRecord, images_record_of
from modalmotion.store.index.index import SequencePage
from modalmotion.store.record import UNSET, SequenceRecord, Unset, record_of, record_to_json
from modalmotion.store.results import ResultStore, signature_image
from modalmotion.store.sequences import upload_image
from modalmotion.store.staging import StagedSignature
from modalmotion.store.tracks import track_image
from modalmotion.template.hdf5 import template_from_hdf5, template_to_hdf5
from modalmotion.tracking.hdf5 import track_from_hdf5, track_to_hdf5

__all__ = [
    "NAME_PATTERN",
    "UNSET",
    "VERSION_PATTERN",
    "BackupReport",
    "Fault",
    "ImagesPage",
    "ImagesRecord",
    "KeptModel",
    "ModelRecord",
    "ModelReference",
    "Reconciliation",
    "RestoreReport",
    "ResultStore",
    "SequencePage",
    "SequenceRecord",
    "StagedSignature",
    "Unset",
    "VerifyReport",
    "backup",
    "backup_time",
    "classification_from_hdf5",
    "classification_key",
    "classification_to_hdf5",
    "images_record_of",
    "kept_model",
    "model_from_hdf5",
    "model_to_hdf5",
    "parse_reference",
    "rebuild",
    "record_of",
    "record_to_json",
    "require_model_name",
    "restore",
    "sequence_from_hdf5",
    "sequence_to_hdf5",
    "signature_from_hdf5",
    "signature_image",
    "signature_to_hdf5",
    "template_from_hdf5",
    "template_to_hdf5",
    "track_from_hdf5",
    "track_image",
    "track_to_hdf5",
    "upload_image",
    "verify",
    "write_atomic",
]

check_arguments(globals())
