"""Images from files: where they lie, when they were taken, and what cannot be read."""

from __future__ import annotations

import gzip
import io
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dicom_samples import compressed, enhanced_file, slice_file
from image_files import metaimage

from modalmotion.errors import LimitError, MalformedFileError, ShapeError
from modalmotion.formats import ParserHere
from modalmotion.formats.volumes import read_images, write_nifti_zip
from modalmotion.formats.volumes.one_file import write_nifti
from modalmotion.formats.volumes.stack import scaled
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.limits import DEFAULT_LIMITS

nibabel = pytest.importorskip("nibabel")
nrrd = pytest.importorskip("nrrd")
pytest.importorskip("pydicom")

HERE = ParserHere(DEFAULT_LIMITS)
AFFINE = np.array([[1.5, 0.4, 0.0, 3.0], [0.0, -2.0, 0.1, -7.0], [0.2, 0.0, 3.0, 11.0]])
VALUES = np.random.default_rng(0).integers(-100, 900, (2, 5, 6, 4)).astype(np.int16)
BEAT = ImageSequence(
    tuple(Volume(values, AFFINE) for values in VALUES), np.array([0.0, 0.04]), period=0.9
)


def read(data: bytes) -> ImageSequence:
    return read_images(data, parser=HERE)


def zipped(**files: bytes) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, data in files.items():
            archive.writestr(name.replace("__", "."), data)
    return out.getvalue()


def first_volume(images: ImageSequence) -> Volume:
    frame = images.frames[0]
    assert isinstance(frame, Volume)
    return frame


def test_nifti_comes_back_as_it_was_written() -> None:
    again = read(write_nifti(BEAT))
    assert again.n_frames == 2
    assert again.times == pytest.approx([0.0, 0.04])
    for one, other in zip(BEAT.frames, again.frames, strict=True):
        assert isinstance(one, Volume)
        assert isinstance(other, Volume)
        assert (one.values == other.values).all()
        assert other.values.dtype == np.int16
        assert one.affine == pytest.approx(other.affine, abs=1e-5)


def nifti(**header: Any) -> bytes:
    image = nibabel.Nifti1Image(VALUES[0], np.diag([2.0, 2.0, 2.0, 1.0]))
    for name, value in header.items():
        image.header[name] = value
    return bytes(image.to_bytes())


def test_the_sform_goes_over_the_qform_and_ras_is_turned_once() -> None:
    image = nibabel.Nifti1Image(VALUES[0], None)
    image.set_qform(np.diag([1.0, 1.0, 1.0, 1.0]), code=1)
    sform = np.array([[0.0, -2, 0, 5], [3, 0, 0, 6], [0, 0, 4, 7], [0, 0, 0, 1]])
    image.set_sform(sform, code=2)
    own = first_volume(read(bytes(image.to_bytes())))
    assert own.affine == pytest.approx(np.diag([-1.0, -1, 1]) @ sform[:3])
    image.set_sform(None, code=0)
    assert first_volume(read(bytes(image.to_bytes()))).affine == pytest.approx(
        np.column_stack([np.diag([-1.0, -1, 1]), np.zeros(3)])
    )


def test_units_slope_and_intercept_of_nifti_are_read() -> None:
    plain = first_volume(read(nifti()))
    metres = nibabel.Nifti1Image(VALUES[0], np.diag([0.002, 0.002, 0.002, 1.0]))
    metres.header.set_xyzt_units("meter")
    assert first_volume(read(bytes(metres.to_bytes()))).spacing == pytest.approx(plain.spacing)
    image = nibabel.Nifti1Image(VALUES[0], np.eye(4))
    image.header.set_slope_inter(2.0, -5.0)
    data = bytearray(image.to_bytes())
    own = nibabel.Nifti1Image.from_bytes(bytes(data))
    assert first_volume(read(bytes(data))).values == pytest.approx(own.get_fdata())
    assert scaled(VALUES, 1.0, 0.0) is VALUES
    nowhere = nibabel.Nifti1Image(VALUES[0], None)
    assert (
        read(bytes(nowhere.to_bytes()))
        .notes[0]
        .text.startswith("The NIfTI file states no position")
    )


@pytest.mark.parametrize(
    ("unit", "interval", "times"),
    [
        ("sec", 0.04, [0.0, 0.04]),
        ("msec", 40.0, [0.0, 0.04]),
        ("usec", 4e4, [0.0, 0.04]),
        # 40 of something: seconds would make rates a thousandth of what they are.
        (None, 40.0, None),
        ("hz", 40.0, None),
        (None, 0.0, None),
    ],
)
def test_an_interval_without_a_unit_of_time_is_no_time(
    unit: str | None, interval: float, times: list[float] | None
) -> None:
    image = nibabel.Nifti1Image(np.moveaxis(VALUES, 0, 3), np.eye(4))
    image.header.set_xyzt_units("mm", unit)
    image.header["pixdim"][4] = interval
    images = read(bytes(image.to_bytes()))
    assert images.n_frames == 2
    assert (None if images.times is None else images.times.tolist()) == pytest.approx(times)
    notes = [note for note in images.notes if "no unit for its interval of 40" in note]
    assert len(notes) == (times is None and interval > 0)


def nrrd_bytes(values: np.ndarray, header: dict[str, Any]) -> bytes:
    out = io.BytesIO()
    nrrd.write(out, values, header)
    return out.getvalue()


def test_nrrd_and_sequences_of_slicer_are_read() -> None:
    header = {
        "space": "right-anterior-superior",
        "space directions": AFFINE[:, :3].T,
        "space origin": AFFINE[:, 3],
    }
    own = first_volume(read(nrrd_bytes(VALUES[0], header)))
    assert own.affine == pytest.approx(np.diag([-1.0, -1, 1]) @ AFFINE)
    assert (own.values == VALUES[0]).all()
    # Time is first, and has no direction in space.
    header |= {
        "space": "left-posterior-superior",
        "space directions": np.vstack([[np.nan] * 3, AFFINE[:, :3].T]),
        "kinds": ["list", "domain", "domain", "domain"],
        "axis 0 index values": "0 40",
        "axis 0 index unit": "ms",
    }
    again = read(nrrd_bytes(VALUES, header))
    assert again.times == pytest.approx([0.0, 0.04])
    assert first_volume(again).affine == pytest.approx(AFFINE)
    assert (first_volume(again).values == VALUES[0]).all()


@pytest.mark.parametrize("is_compressed", [False, True])
def test_metaimage_is_as_itk_writes_it(is_compressed: bool, tmp_path: Path) -> None:
    itk = pytest.importorskip("SimpleITK")
    image = itk.GetImageFromArray(VALUES[0].transpose(2, 1, 0))
    steps = np.linalg.norm(AFFINE[:, :3], axis=0)
    q, _ = np.linalg.qr(AFFINE[:, :3])
    image.SetSpacing(steps.tolist())
    image.SetOrigin(AFFINE[:, 3].tolist())
    image.SetDirection(q.ravel().tolist())
    itk.WriteImage(image, str(tmp_path / "a.mha"), is_compressed)
    own = first_volume(read((tmp_path / "a.mha").read_bytes()))
    assert (own.values == VALUES[0]).all()
    for index in ((0, 0, 0), (3, 2, 1)):
        place = own.affine[:, :3] @ index + own.affine[:, 3]
        assert place == pytest.approx(image.TransformIndexToPhysicalPoint(index), abs=1e-4)


def test_dicom_is_grouped_by_place_and_ordered_by_trigger_time() -> None:
    rng = np.random.default_rng(1)
    files = []
    for z in (0.0, 18.0):
        for phase in range(3):
            pixels = np.full((4, 5), 100 * z + phase)
            own = slice_file(pixels, z=z, trigger=40.0 * phase, number=9 - phase)
            files.append((f"f{rng.integers(10**9)}", own))
    images = read(zipped(**dict(files), report__txt=b"words"))
    assert images.n_frames == 3
    assert images.times == pytest.approx([0.0, 0.04, 0.08])
    for phase, frame in enumerate(images.frames):
        assert isinstance(frame, PlaneSet)
        assert [plane.values[0, 0] % 100 for plane in frame.planes] == [phase, phase]
        assert {plane.origin[2] for plane in frame.planes} == {0.0, 18.0}


def test_rows_of_dicom_go_down_and_columns_along() -> None:
    pixels = np.arange(20).reshape(4, 5)
    (frame,) = read(slice_file(pixels, z=3.0, trigger=None)).frames
    assert isinstance(frame, PlaneSet)
    # PixelSpacing 2, 3: 2 mm from row to row along y, 3 mm from column to column along x.
    point = np.array([[10.0 + 3.0 * 4, 20.0 + 2.0 * 1, 3.0]])
    assert frame.planes[0].sample(point) == pytest.approx([pixels[1, 4]])


def test_dense_slices_of_one_phase_are_a_volume() -> None:
    files = {
        f"s{k}": slice_file(np.full((4, 5), k), z=2.0 * k, trigger=None) for k in (3, 0, 4, 1, 2)
    }
    own = first_volume(read(zipped(**files)))
    assert own.shape == (4, 5, 5)
    along = np.array([[10.0, 20.0, z] for z in (0.0, 3.0, 8.0)])
    assert own.sample(along) == pytest.approx([0.0, 1.5, 4.0])


def test_dicom_of_two_patients_is_refused_and_names_are_not_told() -> None:
    files = {k: slice_file(np.ones((4, 5)), z=0.0, trigger=0.0, patient=k) for k in ("ann", "bob")}
    with pytest.raises(ShapeError, match="2 patients") as error:
        read(zipped(**files))
    assert "ann" not in str(error.value)


_JPEG_2000 = "1.2.840.10008.1.2.4.90"


@pytest.mark.parametrize("syntax", ["1.2.840.10008.1.2.5", _JPEG_2000], ids=["RLE", "JPEG 2000"])
def test_compressed_pixels_are_those_that_were_packed(syntax: str) -> None:
    pixels = np.random.default_rng(0).integers(0, 900, (40, 51))
    pixels[:20] = 7
    plain = slice_file(pixels, z=0.0, trigger=0.0)
    packed = compressed(plain, syntax)
    (own,) = read(packed).frames
    (other,) = read(plain).frames
    assert isinstance(own, PlaneSet)
    assert isinstance(other, PlaneSet)
    assert (own.planes[0].values == other.planes[0].values).all()
    # 40 rows, as a word behind the head of the element.
    fewer = packed.replace(
        b"\x28\x00\x10\x00US\x02\x00\x28\x00", b"\x28\x00\x10\x00US\x02\x00\x14\x00"
    )
    assert fewer != packed
    with pytest.raises(MalformedFileError, match="20 x 51"):
        read(fewer)


def test_another_compression_is_refused_by_name() -> None:
    packed = compressed(slice_file(np.ones((8, 9), int), z=0.0, trigger=0.0), _JPEG_2000)
    other = packed.replace(_JPEG_2000.encode(), b"1.2.840.10008.1.2.4.80")
    with pytest.raises(MalformedFileError, match="JPEG-LS"):
        read(other)


def test_an_enhanced_object_is_its_slices() -> None:
    rng = np.random.default_rng(1)
    pixels = rng.integers(0, 99, (6, 4, 5))
    heights, triggers = np.repeat([0.0, 9.0, 18.0], 2), np.tile([0.0, 40.0], 3)
    order = rng.permutation(6)
    images = read(enhanced_file(pixels[order], heights[order], triggers[order]))
    files = {
        f"s{k}": slice_file(pixels[k], z=heights[k], trigger=triggers[k], number=k)
        for k in range(6)
    }
    assert images.id == read(zipped(**files)).id
    assert images.times == pytest.approx([0.0, 0.04])


def test_what_is_wrong_names_the_file() -> None:
    good = nifti()
    with pytest.raises(MalformedFileError, match=r"'second\.nii\.gz': "):
        read(zipped(**{"first.nii.gz": good, "second.nii.gz": good[:360]}))


@pytest.mark.parametrize(
    "change",
    [{"compressed": True}, {"frames": 3}, {"orientation": False}, {"cut": 10}],
    ids=["runs that are none", "multi-frame", "secondary capture", "cut"],
)
def test_dicom_that_is_no_slice_is_refused(change: dict[str, Any]) -> None:
    with pytest.raises(MalformedFileError) as error:
        read(slice_file(np.ones((4, 5)), z=0.0, trigger=0.0, **change))
    assert error.value.remedy
    # Among many others it is left out, and noted.
    files = {f"s{k}": slice_file(np.ones((4, 5)), z=9.0 * k, trigger=0.0) for k in range(6)}
    bad = slice_file(np.ones((4, 5)), z=0.0, trigger=0.0, **change)
    assert any("1 file." in note for note in read(zipped(**files, bad=bad)).notes)


def test_what_libraries_say_of_headers_is_not_heard(
    caplog: pytest.LogCaptureFixture, recwarn: pytest.WarningsRecorder
) -> None:
    data = slice_file(np.ones((4, 5)), z=0.0, trigger=0.0, patient="Jane").replace(
        b"1.2.4", b"1.x.4"
    )
    read(data)
    assert not caplog.text
    assert not recwarn.list


def test_planes_come_back_from_a_zip_of_nifti() -> None:
    flat = AFFINE[:, [0, 1, 3]]
    other = flat + np.array([[0.0, 0, 5], [0, 0, 5], [0, 0, 20]])
    frames = tuple(
        PlaneSet((Plane(v[:, :, 0], flat, 8.0), Plane(v[:, :, 1], other, 8.0))) for v in VALUES
    )
    again = read(write_nifti_zip(replace(BEAT, frames=frames)))
    assert again.n_frames == 2
    for one, two in zip(frames, again.frames, strict=True):
        assert isinstance(two, PlaneSet)
        for a, b in zip(one.planes, two.planes, strict=True):
            assert (a.values == b.values).all()
            assert a.affine == pytest.approx(b.affine, abs=1e-4)
            assert b.thickness == pytest.approx(8.0, rel=1e-4)


def test_files_of_one_volume_each_are_frames_in_the_order_of_their_names() -> None:
    one, two = (write_nifti(replace(BEAT, frames=(f,), times=None)) for f in BEAT.frames)
    images = read(zipped(f10__nii__gz=two, f9__nii__gz=one))
    assert (first_volume(images).values == VALUES[0]).all()
    assert images.n_frames == 2
    with pytest.raises(ShapeError, match="frames"):
        read(zipped(a__nii__gz=one, b__nii__gz=write_nifti(BEAT)))


@pytest.mark.parametrize(
    "data",
    [
        *(b"", b"abc" * 200, gzip.compress(b"x" * 500), nifti()[:300]),
        gzip.compress(nifti()[:300]),
        metaimage(spacing="nan 1 1 1"),
    ],
    ids=["empty", "text", "packed", "cut", "cut and packed", "no spacing"],
)
def test_other_files_are_refused(data: bytes) -> None:
    with pytest.raises(MalformedFileError) as error:
        read(data)
    assert error.value.remedy


def test_a_file_that_unfolds_to_much_is_refused_before() -> None:
    huge = bytearray(nifti())
    huge[40:56] = np.array([3, 30000, 30000, 30000, 1, 1, 1, 1], dtype="<i2").tobytes()
    for data in (bytes(huge), gzip.compress(huge)):
        with pytest.raises(LimitError):
            read_images(data, parser=HERE)
