"""Files of images: NIfTI, NRRD, MetaImage, DICOM."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.formats.volumes.one_file import write_nifti_zip
from modalmotion.formats.volumes.reading import read_images

__all__ = ["read_images", "write_nifti_zip"]

check_arguments(globals())
