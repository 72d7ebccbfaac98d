"""Results in files: written wholly or not at all, indexed, checked."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.classification.answer import (
        classification_from_hdf5 as classification_from_hdf5,
    )
    from modalmotion.classification.answer import classification_key as classification_key
    from modalmotion.classification.answer import (
        classification_to_hdf5 as classification_to_hdf5,
    )
    from modalmotion.classification.card import NAME_PATTERN as NAME_PATTERN
    from modalmotion.classification.card import VERSION_PATTERN as VERSION_PATTERN
    from modalmotion.classification.card import ModelRecord as ModelRecord
    from modalmotion.classification.card import ModelReference as ModelReference
    from modalmotion.classification.card import parse_reference as parse_reference
    from modalmotion.classification.card import require_model_name as require_model_name
    from modalmotion.classification.model_files import KeptModel as KeptModel
    from modalmotion.classification.model_files import kept_model as kept_model
    from modalmotion.classification.model_files import model_from_hdf5 as model_from_hdf5
    from modalmotion.classification.model_files import model_to_hdf5 as model_to_hdf5
    from modalmotion.mesh.sequence import sequence_from_hdf5 as sequence_from_hdf5
    from modalmotion.mesh.sequence import sequence_to_hdf5 as sequence_to_hdf5
    from modalmotion.signature.hdf5 import signature_from_hdf5 as signature_from_hdf5
    from modalmotion.signature.hdf5 import signature_to_hdf5 as signature_to_hdf5
    from modalmotion.store.backups import backup as backup
    from modalmotion.store.backups import backup_time as backup_time
    from modalmotion.store.backups import restore as restore
    from modalmotion.store.disk import write_atomic as write_atomic
    from modalmotion.store.folders import UNSET as UNSET
    from modalmotion.store.folders import SequenceRecord as SequenceRecord
    from modalmotion.store.folders import record_of as record_of
    from modalmotion.store.folders import record_to_json as record_to_json
    from modalmotion.store.images import ImagesRecord as ImagesRecord
    from modalmotion.store.images import images_record_of as images_record_of
    from modalmotion.store.index import SequencePage as SequencePage
    from modalmotion.store.recovery import VerifyReport as VerifyReport
    from modalmotion.store.recovery import rebuild as rebuild
    from modalmotion.store.recovery import verify as verify
    from modalmotion.store.results import ResultStore as ResultStore
    from modalmotion.store.results import signature_image as signature_image
    from modalmotion.store.results import track_image as track_image
    from modalmotion.store.sequences import upload_image as upload_image
    from modalmotion.template.template import template_from_hdf5 as template_from_hdf5
    from modalmotion.template.template import template_to_hdf5 as template_to_hdf5
    from modalmotion.tracking.hdf5 import track_from_hdf5 as track_from_hdf5
    from modalmotion.tracking.hdf5 import track_to_hdf5 as track_to_hdf5

__all__, __getattr__, __dir__ = public_list(globals())
