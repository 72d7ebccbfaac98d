"""Images in files larger than memory: read as they were written, refused when damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from ellipsoid_images import planes, volume

from modalmotion.errors import CorruptFileError, NotFoundError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.hdf5 import read_images_file, write_images
from modalmotion.images.volume import parts_of
from modalmotion.notes import Note

TINY = (7, 6, 5)
CASES = {
    "volumes": ImageSequence(
        (volume(shape=TINY), None, volume(18.0, shape=TINY)),
        np.array([0, 0.1, 0.3]),
        0.5,
        (Note("n", "n"),),
    ),
    "planes": ImageSequence((planes(), planes(18.0))),
    "other shapes and types": ImageSequence(
        (
            PlaneSet((Plane(np.ones((3, 4), np.int16), np.eye(4)[:, [0, 1, 3]], 2.0),)),
            PlaneSet((Plane(np.ones((4, 3), np.uint8), np.eye(4)[:, [1, 2, 3]]),)),
        )
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_images_are_read_as_they_were_written(tmp_path: Path, name: str) -> None:
    images, path = CASES[name], tmp_path / "images.h5"
    write_images(path, images)
    again = read_images_file(path)
    assert again.id == images.id
    assert (again.period, again.notes) == (images.period, images.notes)
    for ours, theirs in zip(images.frames, again.frames, strict=True):
        assert (ours is None) == (theirs is None)
        if ours is None or theirs is None:
            continue
        for k, a in enumerate(parts_of(ours)):
            b = parts_of(theirs)[k]
            assert (a.values.dtype, a.affine.tolist()) == (b.values.dtype, b.affine.tolist())
            assert np.array_equal(a.values, b.values)
    # The samples stay in the file; the same images make the same bytes.
    assert not any(part.values.flags.owndata for part in parts_of(again.frames[0]))  # type: ignore[arg-type]
    write_images(tmp_path / "again.h5", again)
    assert (tmp_path / "again.h5").read_bytes() == path.read_bytes()


def test_what_differs_has_another_id() -> None:
    values, affine = np.arange(8).reshape(2, 2, 2), np.eye(4)
    ids = [
        ImageSequence((Volume(values, affine),)).id,
        ImageSequence((Volume(values + 1, affine),)).id,
        ImageSequence((Volume(values.astype(np.int16), affine),)).id,
        ImageSequence((Volume(values, 2 * affine),)).id,
        ImageSequence((Volume(values, affine), None)).id,
        ImageSequence((Volume(values, affine),), np.array([1.0])).id,
        ImageSequence((Volume(values, affine),), period=1.0).id,
    ]
    assert len(set(ids)) == len(ids)
    assert (
        ImageSequence((Volume(values[::1], affine),), notes=(Note("other", "other"),)).id == ids[0]
    )


@pytest.mark.parametrize("at", [600, -200, -10])
def test_damage_is_found_before_the_file_is_opened(tmp_path: Path, at: int) -> None:
    path = tmp_path / "images.h5"
    write_images(path, CASES["volumes"])
    data = bytearray(path.read_bytes())
    data[at] ^= 1
    path.write_bytes(data)
    # Of one in the seal itself nothing more is known than that it is none.
    with pytest.raises(CorruptFileError, match=r"sha256|seal"):
        read_images_file(path)
    path.write_bytes(data[:40])
    with pytest.raises(CorruptFileError, match="cut short"):
        read_images_file(path)
    with pytest.raises(NotFoundError):
        read_images_file(tmp_path / "none.h5")
