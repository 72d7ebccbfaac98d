"""Arrays as the viewer receives them, and frames of images for placing landmarks.

::

    8 bytes      b"MMVIEW1" and a line feed
    4 bytes      length of the header, little-endian
    header       JSON, padded with spaces; its "arrays" name dtype, shape and place of each
    arrays       raw, little-endian, each at a multiple of 8 bytes from the start

A browser reads an array in place, without a copy: hence the alignment.
"""

import json
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume, volume
from modalmotion.representation import Array, Bytes, Floats
from modalmotion.tracking.result import Track

MAGIC: Final = b"MMVIEW1\n"
_ALIGNMENT: Final = 8
_LENGTH: Final = 4
_TYPES: Final = ("<f8", "<f4", "<f2", "<u4", "<u2", "|u1")


def write_container(header: Mapping[str, Any], arrays: Mapping[str, Array]) -> bytes:
    """Write a header and arrays.

    Parameters
    ----------
    header : mapping
        Ready for JSON; it has no "arrays" of its own.
    arrays : mapping of str to array
        float64, float32, float16, uint32, uint16 or uint8.
    """
    pieces, table, place = [], {}, 0
    for name, array in arrays.items():
        plain = np.ascontiguousarray(array)
        plain = plain.astype(plain.dtype.newbyteorder("<"), copy=False)
        if plain.dtype.str not in _TYPES:
            raise TypeError(f"{name} is {plain.dtype}, which the viewer does not read")
        table[name] = {"dtype": plain.dtype.str, "shape": list(array.shape), "place": place}
        padded = -(-plain.nbytes // _ALIGNMENT) * _ALIGNMENT
        pieces.append(plain.tobytes().ljust(padded, b"\0"))
        place += padded
    text = json.dumps({**header, "arrays": table}, separators=(",", ":"), allow_nan=False).encode()
    before = len(MAGIC) + _LENGTH
    text = text.ljust(-(-(before + len(text)) // _ALIGNMENT) * _ALIGNMENT - before)
    return b"".join([MAGIC, len(text).to_bytes(_LENGTH, "little"), text, *pieces])


def read_container(data: bytes) -> tuple[dict[str, Any], dict[str, Array]]:
    """Read a header and its arrays, as the viewer does.

    Raises
    ------
    MalformedFileError
        If the bytes are something else, or cut.
    """
    before = len(MAGIC) + _LENGTH
    try:
        start = before + int.from_bytes(data[len(MAGIC) : before], "little")
        header = json.loads(data[before:start] if data.startswith(MAGIC) else b"")
        arrays = {}
        for name, entry in header.pop("arrays").items():
            count = int(np.prod(entry["shape"], dtype=np.int64))
            flat = np.frombuffer(data, entry["dtype"], count, start + entry["place"])
            arrays[name] = flat.reshape(entry["shape"])
    except (ValueError, KeyError, TypeError) as error:
        raise MalformedFileError(
            "The bytes are not what a viewer reads.",
            remedy="Use what `view_payload` or GET /v1/sequences/{id}/view gives.",
        ) from error
    return header, arrays


# Pixels along a plane's side, and voxels of a volume: a landmark need not be placed more finely.
_MOST_SIDE: Final = 384
_MOST_VOXELS: Final = 2_000_000

# Shares of the samples below black and above white, and how many samples are used.
_WINDOW: Final = (1.0, 99.5)
_ENOUGH_SAMPLES: Final = 200_000

# Planes with normals this near to one another are a stack.
_PARALLEL: Final = 0.98


def slices_payload(images: ImageSequence, frame: int = 0, track: Track | None = None) -> bytes:
    """Write one frame's slices in 256 shades, in the viewer's form.

    Parameters
    ----------
    images : ImageSequence
    frame : int
    track : Track, optional
        Made of these images: its surface is sent too, for the page to cut with the slices.

    Returns
    -------
    bytes
        As of `write_container`. The header names of each part its `shape`, `affine` (3, axes
        + 1; mm, LPS), `thickness` (mm) and the `stack` of parallel planes that it is in; `pixels`
        has one part after the other, the first index fastest; 0 where nothing is known. Of a track
        each part has the `shift` (3; mm) by which it shows everything aside, and `vertices` (n, 3;
        mm) and `faces` are those of the surface in that frame.

    Raises
    ------
    ParameterError
        If there is no such frame, or no image of it, or the track has not that many frames.
    """
    sliced = images.sliced()
    present = [k for k, image in enumerate(sliced.frames) if image is not None]
    image = sliced.frames[frame] if 0 <= frame < sliced.n_frames else None
    if image is None:
        raise ParameterError(
            f"There is no image of frame {frame}.",
            remedy=f"Ask for one of {len(present)} frames, from {present[0]} to {present[-1]}.",
            details={"frame": frame, "frames": sliced.n_frames},
        )
    if track is not None and track.n_frames != sliced.n_frames:
        raise ParameterError(
            f"The track has {track.n_frames} frames, and the images have {sliced.n_frames}.",
            remedy="Name a track that was made of these images.",
        )
    parts = volume.parts_of(image)
    shifts = () if track is None or track.images is None else track.images.shifts
    if len(shifts) != len(parts):
        shifts = ((0.0, 0.0, 0.0),) * len(parts)
    low, high = _window(parts)
    coarse = [_thinned(part) for part in parts]
    header = {
        "kind": "planes" if isinstance(image, PlaneSet) else "volume",
        "frame": frame,
        "n_frames": sliced.n_frames,
        "missing": sorted(set(range(sliced.n_frames)) - set(present)),
        "times": None if sliced.times is None else sliced.times.tolist(),
        "parts": [
            {
                "shape": list(values.shape),
                "affine": affine.tolist(),
                "thickness": part.thickness if isinstance(part, Plane) else min(part.spacing),
                "stack": stack,
                "shift": list(shift),
            }
            for part, (values, affine), stack, shift in zip(
                parts, coarse, _stacks(parts), shifts, strict=True
            )
        ],
    }
    pixels = [_shades(values, low, high).ravel(order="F") for values, _ in coarse]
    arrays: dict[str, Array] = {"pixels": np.concatenate(pixels)}
    if track is not None:
        arrays["vertices"] = track.sequence.vertices[frame].astype(np.float32)
        arrays["faces"] = track.template.faces.astype(np.uint32)
    return write_container(header, arrays)


def _window(parts: tuple[Volume | Plane, ...]) -> tuple[float, float]:
    """Give the samples that are black and white: the same in all planes of a frame."""
    rng, total = np.random.default_rng(0), sum(part.values.size for part in parts)
    samples = [
        part.values.flat[
            rng.integers(part.values.size, size=-(-_ENOUGH_SAMPLES * part.values.size // total))
        ]
        for part in parts
    ]
    sampled = np.concatenate(samples).astype(np.float64)
    known = sampled[np.isfinite(sampled)]
    if not len(known):
        return 0.0, 1.0
    low, high = np.percentile(known, _WINDOW).tolist()
    return (low, high) if high > low else (low, low + 1.0)


def _thinned(part: Volume | Plane) -> tuple[Array, Floats]:
    """Leave out pixels of large parts; gives samples and the affine of those that are left."""
    values = part.values
    if isinstance(part, Plane):
        steps = [max(1, -(-n // _MOST_SIDE)) for n in values.shape]
    else:
        # As many along each axis as give nearly cubes.
        size, steps = np.array(part.spacing), [1, 1, 1]
        while np.prod(np.ceil(np.array(values.shape) / steps)) > _MOST_VOXELS:
            steps[int(np.argmin(size * steps))] += 1
    affine = np.array(part.affine[:3])
    affine[:, : len(steps)] *= steps
    return values[tuple(slice(None, None, step) for step in steps)], affine


def _shades(values: Array, low: float, high: float) -> Bytes:
    """Turn samples to 1 (black) to 255 (white); 0 where nothing is known."""
    share = (np.asarray(values, dtype=np.float32) - np.float32(low)) / np.float32(high - low)
    shades = 1.0 + 254.0 * np.clip(share, 0.0, 1.0)
    return np.where(np.isfinite(shades), np.rint(shades), 0.0).astype(np.uint8)


def _stacks(parts: tuple[Volume | Plane, ...]) -> list[int]:
    """Give the number of the stack of parallel planes that each part is in."""
    normals: list[Floats] = []
    stacks = []
    for part in parts:
        if isinstance(part, Volume):
            stacks.append(0)
            continue
        along = [k for k, normal in enumerate(normals) if abs(normal @ part.normal) > _PARALLEL]
        if not along:
            normals.append(part.normal)
        stacks.append(along[0] if along else len(normals) - 1)
    return stacks
