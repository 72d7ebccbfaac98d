"""Images as HDF5, in files that may be larger than memory."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.hdf5.image import Contents, Dataset, Form, json_text, write_sealed
from modalmotion.images.volume import Image, ImageSequence, Plane, PlaneSet, Volume, parts_of
from modalmotion.notes import notes_from_json
from modalmotion.representation import Array, Floats

FORM: Final = Form("images", 2)


def write_images(path: Path, images: ImageSequence) -> None:
    """Write images as a sealed HDF5 file, a volume or plane at a time; may raise OSError.

    Parameters
    ----------
    path : Path
        Written over.
    images : ImageSequence
    """
    alike: dict[tuple[str, tuple[int, ...]], list[Array]] = {}
    # Of each volume or plane its frame, the dataset of all that are alike, and its row there.
    places: list[tuple[int, int, int]] = []
    affines: list[Floats] = []
    thicknesses: list[float] = []
    for k, frame in enumerate(images.frames):
        for part in () if frame is None else parts_of(frame):
            key = (part.values.dtype.str, part.values.shape)
            rows = alike.setdefault(key, [])
            places.append((k, list(alike).index(key), len(rows)))
            rows.append(part.values)
            affines.append(np.column_stack([part.affine, np.zeros((3, 4 - part.affine.shape[1]))]))
            thicknesses.append(part.thickness if isinstance(part, Plane) else 0.0)
    datasets = [
        Dataset(f"values_{number}", rows, "none", "part, i, j, k"[: 10 + 3 * (rows[0].ndim - 2)])
        for number, rows in enumerate(alike.values())
    ]
    datasets += [
        Dataset("places", np.array(places, dtype="<i8"), "1", "part, (frame, dataset, row)"),
        Dataset("affines", np.stack(affines), "mm", "part, direction, axis and origin"),
        Dataset("thicknesses", np.array(thicknesses), "mm", "part"),
        json_text("about", {"n_frames": images.n_frames, "period": images.period}),
        json_text("notes", images.notes),
    ]
    if images.times is not None:
        datasets.append(Dataset("times", images.times, "s", "frame"))
    write_sealed(path, FORM.header(images_id=images.id), datasets)


def read_images_file(path: Path) -> ImageSequence:
    """Read images; their samples stay in the file until they are needed.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged, or no file of images.
    """
    with FORM.read(path, is_mapped=True) as contents:
        return _images_in(contents)


def _images_in(contents: Contents) -> ImageSequence:
    about = contents.json("about", dict)
    places = contents.array("places", (None, 3))
    affines = contents.array("affines", (len(places), 3, 4))
    thicknesses = contents.array("thicknesses", (len(places),))
    parts: list[list[Volume | Plane]] = [[] for _ in range(about["n_frames"])]
    for (frame, dataset, row), affine, thickness in zip(
        places.tolist(), affines, thicknesses.tolist(), strict=True
    ):
        values = contents.arrays[f"values_{dataset}"][row]
        parts[frame].append(
            Plane(values, affine[:, :3], thickness) if values.ndim == 2 else Volume(values, affine)
        )
    times = contents.arrays.get("times")
    return ImageSequence(
        tuple(map(_frame, parts)),
        None if times is None else np.array(times),
        about["period"],
        notes_from_json(contents.json("notes", list)),
    )


def _frame(parts: Sequence[Volume | Plane]) -> Image | None:
    if not parts:
        return None
    if isinstance(parts[0], Volume):
        return parts[0]
    return PlaneSet(tuple(part for part in parts if isinstance(part, Plane)))
