"""Headers that are legal and rare: read right, or refused by name."""

from __future__ import annotations

import gzip
import io
from typing import Any

import numpy as np
import pytest
from dicom_samples import slice_file, study_instance
from image_files import deflated
from image_files import metaimage as beat_metaimage

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.formats import ParserHere
from modalmotion.formats.volumes import read_images
from modalmotion.images import ImageSequence, PlaneSet, Volume
from modalmotion.limits import DEFAULT_LIMITS

nibabel = pytest.importorskip("nibabel")
pytest.importorskip("nrrd")
pydicom = pytest.importorskip("pydicom")

HERE = ParserHere(DEFAULT_LIMITS)
VALUES = np.random.default_rng(0).integers(0, 200, (5, 6, 4)).astype(np.int16)
TWICE = np.stack([VALUES, VALUES + 1], axis=-1)
DIAGONAL = np.column_stack([np.diag([1.0, 2.0, 3.0]), np.zeros(3)])


def read(data: bytes) -> ImageSequence:
    return read_images(data, parser=HERE)


def first(data: bytes) -> Volume:
    frame = read(data).frames[0]
    assert isinstance(frame, Volume)
    return frame


def nrrd(values: np.ndarray, *lines: str, encoding: str = "raw") -> bytes:
    head = (
        "NRRD0005",
        f"type: short\ndimension: {values.ndim}\nsizes: {' '.join(map(str, values.shape))}",
        *lines,
        f"endian: little\nencoding: {encoding}\n\n",
    )
    return "\n".join(head).encode() + values.astype("<i2").tobytes(order="F")


def metaimage(line: str, body: bytes, kind: str = "MET_SHORT") -> bytes:
    head = f"NDims = 3\nDimSize = 5 6 4\n{line}ElementType = {kind}\nElementDataFile = LOCAL\n"
    return f"ObjectType = Image\n{head}".encode() + body


def dicom(pixels: np.ndarray, **changes: Any) -> bytes:
    own = pydicom.dcmread(io.BytesIO(slice_file(pixels, z=0.0, trigger=0.0)))
    for name, value in changes.items():
        setattr(own, name, value)
    out = io.BytesIO()
    own.save_as(out, enforce_file_format=True)
    return out.getvalue()


@pytest.mark.parametrize("type_", ["u1", "i1", ">i2", "<u2", ">i4", "u4", "i8", ">f4", "f8"])
def test_numbers_of_every_type_and_order_of_bytes_are_read(type_: str) -> None:
    kind = np.dtype(type_)
    header = nibabel.Nifti1Header(endianness=">" if type_[0] == ">" else "<")
    header.set_data_dtype(kind)
    values = VALUES.clip(0, 100).astype(kind)
    data = bytes(nibabel.Nifti1Image(values, np.eye(4), header, dtype=kind).to_bytes())
    assert (first(data).values == values).all()


@pytest.mark.parametrize("n_axes", [1, 2])
def test_an_image_of_fewer_axes_than_space_is_read(n_axes: int) -> None:
    values = VALUES[:, 0, 0] if n_axes == 1 else VALUES[:, :, 0]
    data = bytes(nibabel.Nifti1Image(values, np.eye(4)).to_bytes())
    assert (first(data).values.squeeze() == values).all()


def test_gzip_of_several_members_is_read_whole() -> None:
    plain = bytes(nibabel.Nifti1Image(VALUES, np.eye(4)).to_bytes())
    packed = gzip.compress(plain[:400]) + gzip.compress(plain[400:])
    assert (first(packed).values == VALUES).all()
    assert (first(gzip.compress(plain) + bytes(100)).values == VALUES).all()


DIRECTIONS = "space directions: (1,0,0) (0,2,0) (0,0,3)"
SPACE = "space: left-posterior-superior"


@pytest.mark.parametrize(
    "lines",
    [
        (
            SPACE,
            "space directions: (.1,0,0) (0,2,0) (0,0,.003)",
            'space units: "cm" "mm" "m"',
        ),
        ("spacings: 1 2 3",),
    ],
    ids=["units", "spacings alone"],
)
def test_places_in_nrrd_are_in_mm(lines: tuple[str, ...]) -> None:
    own = first(nrrd(VALUES, *lines))
    assert own.affine == pytest.approx(DIAGONAL)
    assert (own.values == VALUES).all()


@pytest.mark.parametrize(
    "lines",
    [
        (
            "space: right-anterior-superior-time",
            "space directions: (-1,0,0,0) (0,-2,0,0) (0,0,3,0) (0,0,0,100)",
            "space origin: (0,0,0,0)",
            'space units: "mm" "mm" "mm" "ms"',
        ),
        (
            "spacings: 1 2 3 100",
            "kinds: domain domain domain time",
            'units: "mm" "mm" "mm" "ms"',
        ),
        (SPACE, f"{DIRECTIONS} none", "spacings: nan nan nan 100", 'units: "" "" "" "ms"'),
    ],
    ids=["as a direction", "as a kind", "without direction"],
)
def test_time_is_found_wherever_nrrd_states_it(lines: tuple[str, ...]) -> None:
    images = read(nrrd(TWICE, *lines))
    assert images.times == pytest.approx([0.0, 0.1])
    # 100 of something: seconds would make rates a thousandth of what they are.
    unsaid = [line.replace('"ms"', '""') for line in lines]
    images = read(nrrd(TWICE, *unsaid))
    assert images.times is None
    assert any("no unit for its interval of 100 between" in note for note in images.notes)
    for k, frame in enumerate(images.frames):
        assert isinstance(frame, Volume)
        assert (frame.values == TWICE[..., k]).all()
        assert frame.affine == pytest.approx(DIAGONAL)


def test_metaimage_states_no_unit_of_time() -> None:
    images = read(beat_metaimage())
    assert images.n_frames == 2
    assert images.times is None
    assert any("no unit for its interval of 0.1 between" in note for note in images.notes)


@pytest.mark.parametrize(
    "name", ["signed short int", "ushort", "int", "signed int", "unsigned int", "uint32_t"]
)
def test_every_name_of_a_type_of_nrrd_is_read(name: str) -> None:
    kind = ("<u" if name.startswith("u") else "<i") + ("2" if "short" in name else "4")
    head, _, _ = nrrd(VALUES, SPACE, DIRECTIONS).partition(b"\n\n")
    head = head.replace(b"type: short", f"type: {name}".encode())
    own = first(head + b"\n\n" + VALUES.astype(kind).tobytes(order="F"))
    assert own.values.dtype == np.dtype(kind)
    assert (own.values == VALUES).all()


def test_an_unknown_unit_of_nrrd_is_noted() -> None:
    images = read(nrrd(VALUES, SPACE, DIRECTIONS, 'space units: "inch" "inch" "inch"'))
    assert any("unit of length" in note for note in images.notes)


def test_numbers_of_metaimage_are_as_stated() -> None:
    body = VALUES.tobytes(order="F")
    slope = "ElementToIntensityFunctionSlope = 2\nElementToIntensityFunctionOffset = -3\n"
    assert first(metaimage(slope, body)).values == pytest.approx(2.0 * VALUES - 3.0)
    own = first(metaimage("", VALUES.astype("<i4").tobytes(order="F"), "MET_LONG"))
    assert (own.values == VALUES).all()


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (nrrd(VALUES, SPACE, DIRECTIONS, encoding="hex"), "encoding"),
        (nrrd(TWICE.T, f"kinds: RGB-color{3 * ' domain'}", f"{SPACE}\n{DIRECTIONS}"), "damaged"),
        (nrrd(TWICE.T, f"kinds: vector{3 * ' domain'}", "spacings: nan 1 2 3"), "colours"),
        (metaimage("BinaryData = False\n", b"1 2 3 " * 100), "text"),
        (metaimage("", bytes(1000), "MET_FLOAT_ARRAY"), "not single numbers"),
        (dicom(np.ones((4, 5)), PhotometricInterpretation="PALETTE COLOR"), "colours"),
    ],
    ids=["hex", "too few directions", "vectors", "words", "arrays", "palette"],
)
def test_what_is_not_read_is_refused_by_name(data: bytes, told: str) -> None:
    with pytest.raises(MalformedFileError, match=told) as error:
        read(data)
    assert error.value.remedy


PIXELS = np.arange(20).reshape(4, 5)


def pixels_of(data: bytes) -> np.ndarray:
    (frame,) = read(data).frames
    assert isinstance(frame, PlaneSet)
    return np.asarray(frame.planes[0].values, dtype=np.float64)


@pytest.mark.parametrize(
    ("stored", "changes"),
    [
        (PIXELS.astype("u1"), {"BitsAllocated": 8, "BitsStored": 8, "HighBit": 7}),
        (PIXELS.astype("<u4"), {"BitsAllocated": 32, "BitsStored": 32, "HighBit": 31}),
        ((PIXELS | 0x8000).astype("<u2"), {"BitsStored": 12, "HighBit": 11}),
        (
            ((PIXELS - 9) & 0xFFF).astype("<u2"),
            {"BitsStored": 12, "HighBit": 11, "PixelRepresentation": 1, "RescaleIntercept": 9},
        ),
        (
            (4095 - PIXELS).astype("<u2"),
            {"BitsStored": 12, "HighBit": 11, "PhotometricInterpretation": "MONOCHROME1"},
        ),
        (
            (~PIXELS).astype("<i2"),
            {"PixelRepresentation": 1, "PhotometricInterpretation": "MONOCHROME1"},
        ),
    ],
    ids=["8 bit", "32 bit", "overlay bits", "12 bit signed", "least is white", "signed white"],
)
def test_pixels_of_dicom_are_as_stated(stored: np.ndarray, changes: dict[str, Any]) -> None:
    assert pixels_of(dicom(PIXELS, PixelData=stored.tobytes(), **changes)) == pytest.approx(PIXELS)


def test_directions_of_dicom_have_no_length() -> None:
    own = read(dicom(PIXELS, ImageOrientationPatient=[2, 0, 0, 0, 1, 0])).frames[0]
    assert isinstance(own, PlaneSet)
    assert sorted(own.planes[0].spacing) == pytest.approx([2.0, 3.0])


@pytest.mark.parametrize(
    "line",
    [
        "line skip: 1000000000000",
        "LineSkip: 1000000000000",
        "line skip: -1",
        "byte skip: 1000000000000",
        "byte skip: -2",
        "Data File: elsewhere.raw",
        "DATAFILE: elsewhere.raw",
        "data file: /etc/hostname",
    ],
)
def test_fields_of_nrrd_that_lead_elsewhere_are_refused_in_any_case(line: str) -> None:
    with pytest.raises((MalformedFileError, LimitError)) as error:
        read(nrrd(VALUES, line))
    assert error.value.remedy


def test_deflated_dicom_is_refused_and_its_study_too() -> None:
    for data, read_one in (
        (slice_file(PIXELS, z=0.0, trigger=0.0), read),
        (study_instance(), lambda data: HERE.parse("study", data)),
    ):
        with pytest.raises(MalformedFileError, match="deflated"):
            read_one(deflated(data))
