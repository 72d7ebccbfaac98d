"""Mesh sequences as NumPy .npz archives.

Arrays: ``vertices`` (frames, vertices, 3); optional ``faces`` (faces, 3), ``grid`` (axes),
``topology`` (text), ``times`` (frames) in s or ``times_ms``, ``unit`` (text); and facts:
``tracking``, ``handedness``, ``coordinates``, ``cavity``, ``modality`` (text), ``period`` (s),
``landmarks`` and ``covariates`` (JSON text). Others are ignored and named. Nothing is ever
unpickled.
"""

import io
import json
import lzma
import struct
import zipfile
import zlib
from collections.abc import Iterable
from functools import partial
from itertools import islice
from math import prod
from typing import Any, Final, cast

import numpy as np
from numpy.lib import format as npy

from modalmotion import errors, mesh
from modalmotion.formats import frame, named_arrays, result
from modalmotion.formats.frame import misread
from modalmotion.limits import NO_LIMITS, ReadLimits
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.unpacking import PIECE, filled
from modalmotion.representation import Array, Bytes

UNREADABLE: Final = (
    *(zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, OSError, EOFError),
    *(ValueError, OverflowError, NotImplementedError, RuntimeError),
)
"""Errors that zipfile and zlib raise on malformed bytes."""


def member_content(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Bytes:
    """Read a member of the size that it declares; may raise `UNREADABLE`.

    Raises
    ------
    MalformedFileError
        If it holds more or less.
    """
    with archive.open(info) as stream:
        pieces = iter(partial(stream.read, PIECE), b"")
        return filled(pieces, info.file_size, info.compress_size)


_ARRAYS: Final = ("vertices", "faces", "grid", "topology", "times", "times_ms", "unit")
_KNOWN: Final = (*_ARRAYS, *mesh.NAMES)
# Which axis of which array is limited.
_LIMITS: Final = (("vertices", 0, "frames"), ("vertices", 1, "vertices"), ("faces", 0, "faces"))
_TEXTS: Final = ("topology", "unit", *(name for name in mesh.NAMES if name != "period"))

_malformed: Final = partial(
    errors.MalformedFileError, remedy="Write the file with numpy.savez, with at least 'vertices'."
)


def read_npz(data: bytes, limits: ReadLimits = NO_LIMITS) -> result.Reading:
    """Read a mesh sequence from the bytes of an .npz archive.

    Declared sizes are checked before any array is read.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits, optional

    Raises
    ------
    MalformedFileError
        If the bytes are not such an archive, are cut or damaged, or hold pickled objects.
    LimitError
        If it declares more than `limits` accept.
    InputError
        If the arrays do not form a sequence.
    """
    limits, aliases = limits.of_file(len(data)), dict[str, str]()
    try:
        arrays, names = read_arrays(data, _KNOWN, ("vertices",), limits)
    except errors.MalformedFileError as error:
        listed = cast("list[str]", error.details.get("arrays", []))
        aliases = named_arrays.aliases_in(listed) or aliases
        if not aliases:
            if "points" in listed:
                error.remedy = f"Clouds of points are for {frame.TRACK}."
            raise
        arrays, names = read_arrays(data, (*_KNOWN, *aliases.values()), aliases.values(), limits)
        arrays |= {ours: arrays.pop(theirs) for ours, theirs in aliases.items()}
        arrays["vertices"] = named_arrays.positions_in(arrays["vertices"], is_matlab=False)
    if "times" in arrays and "times_ms" in arrays:
        raise errors.ShapeError(
            "The archive contains both 'times' and 'times_ms'.", remedy="Keep one of them."
        )
    times = arrays.get("times")
    if "times_ms" in arrays:
        milliseconds = arrays["times_ms"]
        times = milliseconds / 1e3 if milliseconds.dtype.kind in "fiu" else milliseconds
    return result.reading_of(
        arrays["vertices"],
        arrays.get("faces"),
        format="npz",
        grid=arrays.get("grid"),
        topology=text_in(arrays, "topology"),
        times=times,
        unit=text_in(arrays, "unit"),
        facts=mesh.facts_from_texts({name: text_in(arrays, name) for name in mesh.NAMES}),
        notes=named_arrays.note_on(aliases),
        ignored=tuple(name for name in names if name not in (*_KNOWN, *aliases.values())),
    )


def read_arrays(
    data: bytes, known: Iterable[str], needed: Iterable[str], limits: ReadLimits = NO_LIMITS
) -> tuple[dict[str, Array], tuple[str, ...]]:
    """Read arrays of an .npz archive, their sizes checked before any of them is read.

    Parameters
    ----------
    data : bytes
    known : iterable of str
        Names of the arrays that are read.
    needed : iterable of str
        Those of them that must be there.
    limits : ReadLimits, optional

    Returns
    -------
    dict of str to array, tuple of str
        Those that are there, and the names of all.

    Raises
    ------
    MalformedFileError, LimitError
        As in `read_npz`.
    """
    if not data:
        raise _malformed("The file is empty.")
    try:
        archive = zipfile.ZipFile(io.BytesIO(data))
    except UNREADABLE as error:
        raise _malformed(
            f"These {len(data)} bytes are not a readable .npz archive (the file may be cut short)."
        ) from error
    with archive:
        members: dict[str, zipfile.ZipInfo] = {}
        for info in archive.infolist():
            name = info.filename.removesuffix(".npy")
            if name in members:
                raise _malformed(f"The archive contains {name[:40]!r} twice.")
            members[name] = info
        for name in needed:
            if name not in members:
                raise _malformed(
                    f"The archive contains {_some(members)} but no {name!r}.",
                    details={"arrays": [own[:40] for own in list(members)[:20]]},
                )
        wanted = [members[name] for name in known if name in members]
        limits.require(decompressed_bytes=sum(info.file_size for info in wanted))
        arrays = {info.filename.removesuffix(".npy"): _array(archive, info) for info in wanted}
    for name, axis, limit in _LIMITS:
        if name in arrays:
            limits.require(**{limit: (*arrays[name].shape, 0, 0)[axis]})
    return arrays, tuple(members)


def write_npz(sequence: MeshSequence) -> bytes:
    """Write a mesh sequence as an .npz archive.

    Returns
    -------
    bytes
        `read_npz` reads it back with the same id and the same facts.
    """
    stated = mesh.facts_as_json(sequence.facts)
    facts = {name: stated[name] for name in sequence.facts.stated}
    optional = {
        "grid": sequence.grid,
        "topology": None if sequence.topology is None else sequence.topology.name,
        "times": sequence.times,
        "unit": sequence.unit,
        **{
            k: json.dumps(value) if isinstance(value, dict) else value for k, value in facts.items()
        },
    }
    arrays: dict[str, Any] = {"vertices": sequence.vertices, "faces": sequence.faces}
    arrays |= {name: np.array(value) for name, value in optional.items() if value is not None}
    buffer = io.BytesIO()
    np.savez(buffer, **arrays)
    return buffer.getvalue()


# NumPy reads headers of 10,000 letters at most, after twelve bytes of their own.
_LONGEST_HEADER: Final = 10_012


def _array(archive: zipfile.ZipFile, info: zipfile.ZipInfo) -> Array:
    name = info.filename.removesuffix(".npy")
    # NumPy reads the header as Python writes it, and raises what Python does.
    with misread(_malformed, f"The array {name[:40]!r} cannot be read", (Exception,)):
        with archive.open(info) as packed:
            # NumPy would read as much as the header says that it is long.
            stream = io.BytesIO(packed.read(_LONGEST_HEADER))
        read_magic: Any = npy.read_magic
        is_first = read_magic(stream) == (1, 0)
        read: Any = npy.read_array_header_1_0 if is_first else npy.read_array_header_2_0
        try:
            shape, is_fortran, dtype = read(stream)
        except MemoryError:
            # Of Python's parser, however much memory there is.
            raise ValueError("nested too deeply") from None
    if dtype.kind not in ("fiuU" if name in _TEXTS else "fiu"):
        raise (errors.MalformedFileError if dtype.hasobject else errors.ShapeError)(
            f"The array {name[:40]!r} contains {dtype.str[:20]}, which is not understood there; "
            "pickled objects are never loaded.",
            remedy="Store plain numbers (float32, float64, int32, int64), and text only for "
            f"{', '.join(_TEXTS)}.",
        )
    n_bytes, left = prod(shape) * dtype.itemsize, info.file_size - stream.tell()
    if min(shape, default=0) < 0 or n_bytes != left:
        raise _malformed(
            f"The array {name[:40]!r} declares the shape {shape} of {dtype}, {n_bytes} bytes, but "
            f"{left} are there."
        )
    try:
        data = member_content(archive, info)
    except UNREADABLE as error:
        raise _malformed(f"The array {name[:40]!r} is damaged ({str(error)[:120]}).") from error
    array: Array = np.frombuffer(data, dtype, offset=stream.tell())
    return array.reshape(shape, order="F" if is_fortran else "C")


def text_in(arrays: dict[str, Array], name: str) -> Any:
    """Read an array that is one text, or the number of a period; None if empty or not there.

    Raises
    ------
    ShapeError
        If it is not one.
    """
    if name not in arrays:
        return None
    array, is_number = arrays[name], name == "period"
    if (array.dtype.kind != "U" and not is_number) or array.size != 1:
        what, example = ("number", "0.8), in s") if is_number else ("text", "'...')")
        raise errors.ShapeError(
            f"The array {name!r} has the shape {array.shape} of {array.dtype}, not one {what}.",
            remedy=f"Store it as numpy.array({example}, or leave {name!r} out.",
        )
    # Numbers beyond Unicode are no letters.
    with misread(_malformed, f"The array {name!r} cannot be read", (SystemError, ValueError)):
        value = array.item()
    return None if value == "" else value


def _some(names: Iterable[str]) -> str:
    first = [repr(name[:40]) for name in islice(names, 9)]
    return ", ".join(first[:8]) + " and more" * (len(first) > 8) or "nothing"
