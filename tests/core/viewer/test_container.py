"""The form in which numbers travel to the viewer."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from clouds import breathing_spheroid
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.tracking import track
from modalmotion.tracking.result import ImageAnswer
from modalmotion.viewer.container import MAGIC, read_container, slices_payload, write_container

ARRAYS: dict[str, NDArray[Any]] = {
    "a": np.arange(5, dtype=np.uint16),
    "b": np.linspace(0.0, 1.0, 7).reshape(7, 1),
    "c": np.zeros((0, 3), dtype=np.float32),
    "d": np.array([[1.5, -2.0]], dtype=np.float16),
}


def test_what_is_read_is_what_was_written() -> None:
    header, arrays = read_container(write_container({"title": "ä beat"}, ARRAYS))
    assert header == {"title": "ä beat"}
    assert list(arrays) == list(ARRAYS)
    for name, array in ARRAYS.items():
        assert arrays[name].dtype == array.dtype
        np.testing.assert_array_equal(arrays[name], array)


@pytest.mark.parametrize("title", ["", "a", "abc", "abcdefg"])
def test_every_array_begins_at_a_multiple_of_eight(title: str) -> None:
    data = write_container({"title": title}, ARRAYS)
    start = len(MAGIC) + 4 + int.from_bytes(data[8:12], "little")
    assert start % 8 == 0
    # The second array follows ten bytes of the first, padded.
    assert data[start + 16 : start + 16 + 56] == ARRAYS["b"].tobytes()


@pytest.mark.parametrize("data", [b"", b"MMVIEW1\n", b"x" * 40, None])
def test_other_bytes_are_refused(data: bytes | None) -> None:
    cut = write_container({}, ARRAYS)[:-60] if data is None else data
    with pytest.raises(MalformedFileError):
        read_container(cut)


def test_a_type_that_no_page_reads_is_a_fault_of_the_writer() -> None:
    with pytest.raises(TypeError, match="wide"):
        write_container({}, {"wide": np.zeros(2, dtype=np.int64)})


TILTED = np.array([[0.0, 0.0, 2.0, 5.0], [1.0, 0.0, 0.0, -3.0], [0.0, 1.5, 0.0, 7.0]])


def read(images: ImageSequence, frame: int = 0) -> tuple[dict[str, Any], list[NDArray[np.uint8]]]:
    """Read a payload as the page does: the header, and the pixels of each part."""
    header, arrays = read_container(slices_payload(images, frame))
    pixels, place = [], 0
    for part in header["parts"]:
        size = int(np.prod(part["shape"]))
        pixels.append(arrays["pixels"][place : place + size].reshape(part["shape"], order="F"))
        place += size
    assert place == arrays["pixels"].size
    return header, pixels


def test_a_volume_has_its_places_and_shades_in_order(rng: np.random.Generator) -> None:
    values = rng.normal(100.0, 20.0, (9, 8, 7))
    values[0, 0, 0] = np.nan
    header, (pixels,) = read(ImageSequence((Volume(values, TILTED), None), np.array([0.0, 0.5])))
    (part,) = header["parts"]
    assert (header["kind"], header["n_frames"], header["missing"]) == ("volume", 2, [1])
    assert header["times"] == [0.0, 0.5]
    assert np.array_equal(part["affine"], TILTED)
    assert pixels[0, 0, 0] == 0
    known = np.isfinite(values)
    assert pixels[known].min() == 1
    assert pixels.max() == 255
    # What is brighter never becomes darker.
    order = np.argsort(values[known])
    assert (np.diff(pixels[known][order].astype(int)) >= 0).all()


def test_a_large_volume_is_thinned_and_its_pixels_keep_their_places() -> None:
    i, j, k = np.meshgrid(*map(np.arange, (260, 130, 90)), indexing="ij")
    values = (i + 10.0 * j + 100.0 * k).astype(np.float32)
    affine = np.column_stack([np.diag([0.5, 1.0, 1.0]), [1.0, 2.0, 3.0]])
    header, (pixels,) = read(ImageSequence((Volume(values, affine),)))
    (part,) = header["parts"]
    assert pixels.size <= 2_000_000
    new = np.array(part["affine"])
    # The finest axis was thinned, and a pixel shows the sample at its place.
    steps = np.rint(np.diag(new[:, :3]) / np.diag(affine[:, :3])).astype(int)
    assert steps.tolist() == [2, 1, 1]
    assert np.array_equal(new[:, 3], affine[:, 3])
    low, high = np.percentile(values, [1.0, 99.5])
    expected = 1 + 254 * np.clip((values[::2] - low) / (high - low), 0, 1)
    assert np.abs(pixels - expected).max() < 2.0


def test_planes_are_stacked_by_direction_and_share_their_window() -> None:
    def plane(value: float, origin: float, *, across: bool = False) -> Plane:
        columns = [[0, 1, 0], [0, 0, 1]] if across else [[1, 0, 0], [0, 1, 0]]
        affine = np.array([*columns, [0.0, 0.0, origin]]).T
        return Plane(np.full((500, 4), value), affine, thickness=8.0)

    planes = (plane(0.0, 0.0), plane(5.0, 1.0, across=True), plane(10.0, 9.0))
    header, pixels = read(ImageSequence((PlaneSet(planes),)))
    assert [part["stack"] for part in header["parts"]] == [0, 1, 0]
    assert [part["thickness"] for part in header["parts"]] == [8.0] * 3
    # Of 500 pixels every second is sent, twice as far apart.
    assert header["parts"][0]["shape"] == [250, 4]
    assert header["parts"][0]["affine"] == [[2.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert [int(part[0, 0]) for part in pixels] == [1, 128, 255]


def test_thick_slices_of_a_volume_are_planes() -> None:
    affine = np.column_stack([np.diag([1.0, 1.0, 8.0]), np.zeros(3)])
    header, pixels = read(ImageSequence((Volume(np.zeros((6, 5, 4)), affine),)))
    assert header["kind"] == "planes"
    assert [part.shape for part in pixels] == [(6, 5)] * 4


def test_of_a_track_the_surface_is_sent_in_that_frame_and_each_slice_s_shift() -> None:
    n_planes = 3
    shift = tuple((0.5 * k, 0.0, 0.0) for k in range(n_planes))
    affine = np.array([[1, 0, 0], [0, 1, 0], [0.0, 0.0, 0.0]])
    planes = PlaneSet(tuple(Plane(np.zeros((4, 4)), affine) for _ in range(n_planes)))
    images = ImageSequence((planes, planes))
    beat = breathing_spheroid(2)
    clouds = [x[::4].astype(np.float64) for x in beat.vertices]
    plain = track(clouds, modes=4, unit="mm")
    answer = ImageAnswer(
        *("pool", 0.0, 1.0, 0.0, 0.1, (0.0, 0.0, 0.0), shift, 0.1, (1.0, 1.0), 0.0, 0.0)
    )
    made = replace(plain, images=answer)
    header, arrays = read_container(slices_payload(images, 1, made))
    assert [tuple(part["shift"]) for part in header["parts"]] == list(shift)
    assert np.array_equal(arrays["vertices"], made.sequence.vertices[1].astype(np.float32))
    assert np.array_equal(arrays["faces"], made.template.faces)
    header, _ = read_container(slices_payload(images, 1, plain))
    assert all(part["shift"] == [0.0, 0.0, 0.0] for part in header["parts"])
    with pytest.raises(ParameterError, match="track has 2 frames, and the images have 1"):
        slices_payload(ImageSequence((planes,)), 0, plain)


@pytest.mark.parametrize("frame", [-1, 1, 2])
def test_a_frame_without_an_image_is_refused_with_those_that_have_one(frame: int) -> None:
    images = ImageSequence((Volume(np.zeros((4, 4, 4)), TILTED), None))
    with pytest.raises(ParameterError, match=f"no image of frame {frame}") as refused:
        slices_payload(images, frame)
    assert "from 0 to 0" in (refused.value.remedy or "")
    assert refused.value.details == {"frame": frame, "frames": 2}
