"""DICOM slices made in memory."""

from __future__ import annotations

import io

import numpy as np

from modalmotion.formats.volumes.stack import unheard


def slice_file(
    pixels: np.ndarray,
    *,
    z: float,
    trigger: float | None,
    number: int = 1,
    patient: str = "nobody",
    compressed: bool = False,
    frames: int = 1,
    orientation: bool = True,
    cut: int = 0,
) -> bytes:
    """Make a slice across z: 2 mm from row to row along y, 3 mm from column to column along x."""
    import pydicom
    from pydicom.dataset import FileDataset, FileMetaDataset
    from pydicom.uid import ExplicitVRLittleEndian, RLELossless

    meta = FileMetaDataset()
    meta.MediaStorageSOPClassUID = pydicom.uid.MRImageStorage
    meta.MediaStorageSOPInstanceUID = f"1.2.3.{number}"
    meta.TransferSyntaxUID = RLELossless if compressed else ExplicitVRLittleEndian
    own = FileDataset("", {}, file_meta=meta, preamble=b"\0" * 128)
    own.PatientID, own.PatientName = patient, patient
    own.SeriesInstanceUID, own.FrameOfReferenceUID = "1.2.4", "1.2.5"
    own.InstanceNumber, own.SliceThickness = number, 6.0
    own.Rows, own.Columns = pixels.shape
    own.PixelSpacing = [2.0, 3.0]
    if orientation:
        own.ImageOrientationPatient = [1, 0, 0, 0, 1, 0]
        own.ImagePositionPatient = [10.0, 20.0, z]
    if trigger is not None:
        own.TriggerTime = trigger
    if frames > 1:
        own.NumberOfFrames = frames
    own.SamplesPerPixel, own.PhotometricInterpretation = 1, "MONOCHROME2"
    own.BitsAllocated, own.BitsStored, own.HighBit, own.PixelRepresentation = 16, 16, 15, 0
    data = np.repeat(pixels[None].astype("<u2"), frames, axis=0).tobytes()
    own.PixelData = pydicom.encaps.encapsulate([data]) if compressed else data
    if compressed:
        own["PixelData"].is_undefined_length = True
    out = io.BytesIO()
    own.save_as(out, enforce_file_format=True)
    whole = out.getvalue()
    return whole[: len(whole) - cut]


def study_instance(**changes: str | None) -> bytes:
    """Make an instance of a patient's study, as an archive has it; None leaves an element out."""
    import pydicom

    with io.BytesIO(slice_file(np.zeros((4, 5), int), z=0.0, trigger=0.0)) as file:
        own = pydicom.dcmread(file)
    stated = {
        "SpecificCharacterSet": "ISO_IR 100",
        "SOPClassUID": pydicom.uid.MRImageStorage,
        "SOPInstanceUID": "1.2.3.1",
        "StudyInstanceUID": "1.2.3.4.5",
        "StudyID": "77",
        "StudyDate": "20260102",
        "StudyTime": "101112",
        "AccessionNumber": "A 9",
        "PatientName": "Müller^Jörg",
        "PatientID": "P 7",
        "PatientBirthDate": "19600131",
        "PatientSex": "M",
        **changes,
    }
    out = io.BytesIO()
    # Wrong values are written as they are.
    with unheard("pydicom"):
        for name, value in stated.items():
            if value is None:
                own.pop(name, None)
            else:
                setattr(own, name, value)
        own.save_as(out, enforce_file_format=True)
    return out.getvalue()


def compressed(data: bytes, syntax: str) -> bytes:
    """Compress the pixels of a file: RLE by pydicom, JPEG 2000 by Pillow."""
    import pydicom
    from PIL import Image

    own = pydicom.dcmread(io.BytesIO(data))
    if syntax == pydicom.uid.RLELossless:
        own.compress(syntax)
    else:
        out = io.BytesIO()
        Image.fromarray(own.pixel_array).save(out, "JPEG2000", irreversible=False, no_jp2=True)
        own.PixelData = pydicom.encaps.encapsulate([out.getvalue()])
        own["PixelData"].VR = "OB"
        own["PixelData"].is_undefined_length = True
        own.file_meta.TransferSyntaxUID = syntax
    file = io.BytesIO()
    own.save_as(file, enforce_file_format=True)
    return file.getvalue()


def enhanced_file(pixels: np.ndarray, heights: np.ndarray, triggers: np.ndarray) -> bytes:
    """Make an enhanced object of slices (n, i, j) at heights and triggers, as `slice_file` does."""
    import pydicom
    from pydicom.dataset import Dataset

    own = pydicom.dcmread(io.BytesIO(slice_file(pixels[0], z=0.0, trigger=None)))
    for name in (
        *("ImageOrientationPatient", "ImagePositionPatient", "PixelSpacing", "SliceThickness"),
        "InstanceNumber",
    ):
        delattr(own, name)
    own.file_meta.MediaStorageSOPClassUID = pydicom.uid.EnhancedMRImageStorage

    def item(**elements: object) -> pydicom.Sequence:
        one = Dataset()
        for name, value in elements.items():
            setattr(one, name, value)
        return pydicom.Sequence([one])

    shared = Dataset()
    shared.PlaneOrientationSequence = item(ImageOrientationPatient=[1, 0, 0, 0, 1, 0])
    shared.PixelMeasuresSequence = item(PixelSpacing=[2.0, 3.0], SliceThickness=6.0)
    own.SharedFunctionalGroupsSequence = pydicom.Sequence([shared])
    frames = []
    for z, trigger in zip(heights, triggers, strict=True):
        one = Dataset()
        one.PlanePositionSequence = item(ImagePositionPatient=[10.0, 20.0, float(z)])
        one.CardiacSynchronizationSequence = item(NominalCardiacTriggerDelayTime=float(trigger))
        frames.append(one)
    own.PerFrameFunctionalGroupsSequence = pydicom.Sequence(frames)
    own.NumberOfFrames = len(pixels)
    own.PixelData = pixels.astype("<u2").tobytes()
    file = io.BytesIO()
    own.save_as(file, enforce_file_format=True)
    return file.getvalue()
