"""Records of images: what lists and summaries say of them, without their samples."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from modalmotion.images import ImageSequence, Plane, PlaneSet
from modalmotion.images.sequence import parts_of
from modalmotion.representation import shown
from modalmotion.store.disk.sealed_json import JsonForm

FORM: Final = JsonForm("images-record", 2, "Delete the images, and send them again.")


@shown("kind", "n_frames", "shapes", "spacings", "is_kept", "id")
@dataclass(frozen=True)
class ImagesRecord:
    """All that the store knows of images without reading their samples.

    Parameters
    ----------
    id : str
        sha256 of the content, in hex.
    kind : "volumes" or "planes"
    n_frames : int
    missing : tuple of int
        Frames without an image.
    shapes : tuple of tuple of int
        Samples along each axis: of the volume, or of each plane of a frame.
    spacings : tuple of tuple of float, mm
        Between samples along each axis.
    thicknesses : tuple of float, mm
        Of planes; none of volumes.
    times : tuple of float or None, s
    period : float or None, s
    n_bytes : int
        Of the samples.
    notes : tuple of str
        Of the reader.
    created : str
        When they were put, UTC, ISO 8601 with microseconds.
    is_kept : bool
        Whether they were kept on purpose after tracking.
    tracks : tuple of str
        Ids of the tracks that they are kept for.
    is_label_map : bool
        Whether they are a segmentation.
    apex, base : tuple of ((x, y, z) or None), mm
        Of label maps: what they propose in each frame; empty where they propose none.
    """

    id: str
    kind: str
    n_frames: int
    missing: tuple[int, ...]
    shapes: tuple[tuple[int, ...], ...]
    spacings: tuple[tuple[float, ...], ...]
    thicknesses: tuple[float, ...]
    times: tuple[float, ...] | None
    period: float | None
    n_bytes: int
    notes: tuple[str, ...]
    created: str = ""
    is_kept: bool = False
    tracks: tuple[str, ...] = ()
    is_label_map: bool = False
    apex: tuple[tuple[float, float, float] | None, ...] = ()
    base: tuple[tuple[float, float, float] | None, ...] = ()


def images_record_of(images: ImageSequence) -> ImagesRecord:
    """Record of images that nobody has put yet."""
    seen = [frame for frame in images.frames if frame is not None]
    parts = parts_of(seen[0])
    return ImagesRecord(
        id=images.id,
        kind="planes" if isinstance(seen[0], PlaneSet) else "volumes",
        n_frames=images.n_frames,
        missing=tuple(k for k, frame in enumerate(images.frames) if frame is None),
        shapes=tuple(tuple(map(int, part.values.shape)) for part in parts),
        spacings=tuple(tuple(part.spacing) for part in parts),
        thicknesses=tuple(part.thickness for part in parts if isinstance(part, Plane)),
        times=None if images.times is None else tuple(images.times.tolist()),
        period=images.period,
        n_bytes=sum(part.values.nbytes for frame in seen for part in parts_of(frame)),
        notes=images.notes,
    )


def images_record_to_json(record: ImagesRecord) -> bytes:
    """Write a record as JSON that ends with the sha256 of what stands before."""
    return FORM.write(asdict(record))


def read_images_record(path: Path) -> ImagesRecord:
    """Read a record.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged.
    """
    values = FORM.read(path)
    try:
        return ImagesRecord(**{name: _tupled(value) for name, value in values.items()})
    except TypeError as error:
        raise FORM.damaged(path, str(error)) from error


def _tupled(value: Any) -> Any:
    return tuple(map(_tupled, value)) if isinstance(value, list) else value
