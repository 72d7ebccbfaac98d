"""Sequences in arrays of other programs: named ones of npz, MATLAB and HDF5, XDMF, raw numbers."""

import io
from collections.abc import Callable, Iterable, Mapping
from functools import cache, partial
from math import prod
from typing import Any, Final
from xml.etree.ElementTree import Element

import numpy as np

from modalmotion import errors
from modalmotion.formats import detect, frames, vtk_xml
from modalmotion.formats.frame import Frame, misread
from modalmotion.formats.result import Parsed, Parser, Reading
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.mesh.checks import single_precision
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.notes import Note, notes_as_json
from modalmotion.representation import Array, Ints

_NAMES: Final = {
    "vertices": ("vertices", "points", "verts", "positions", "nodes", "v", "p"),
    "faces": ("faces", "triangles", "tris", "tri", "cells", "elements", "f", "t"),
    "times": ("times", "time"),
}
_NEEDED: Final = ("vertices", "faces")
_DIRECTIONS: Final = 3
_MOST_WHOLE: Final = 2.0**53
# Of one number in memory, at most.
_BYTES: Final = 8

_malformed: Final = partial(
    errors.MalformedFileError,
    remedy="Save vertices (n, 3, frames) and faces (m, 3) under these names, from MATLAB by "
    "save('beat.mat', 'vertices', 'faces'); or send VTKHDF or npz.",
)


def aliases_in(names: Iterable[str]) -> dict[str, str] | None:
    """Find which arrays are the vertices, faces and times; None without vertices and faces.

    Parameters
    ----------
    names : iterable of str

    Returns
    -------
    dict of str to str
        Our name to theirs.
    """
    by_word = {name.lower(): name for name in reversed([*names])}
    found = {
        ours: by_word[word]
        for ours, words in _NAMES.items()
        if (word := next((w for w in words if w in by_word), None)) is not None
    }
    return found if all(name in found for name in _NEEDED) else None


def note_on(aliases: Mapping[str, str]) -> tuple[Note, ...]:
    """Note which arrays were read under other names."""
    other = [f"{theirs!r} as {ours}" for ours, theirs in aliases.items() if ours != theirs]
    return (Note.of("arrays_renamed", arrays=", ".join(other)),) if other else ()


def parse_matlab(data: bytes, limits: ReadLimits) -> Parsed:
    """Read a MATLAB file up to version 7 by SciPy, in this process."""
    from scipy.io import loadmat, whosmat

    # SciPy's reader raises what NumPy, zlib and struct do.
    with misread(_malformed, "The MATLAB file cannot be read", (Exception,)):
        shapes = {name: shape for name, shape, _ in whosmat(io.BytesIO(data))}
        aliases = _required(shapes, "MATLAB file")
        wanted = [*aliases.values()]
        limits.require(decompressed_bytes=sum(_BYTES * prod(shapes[name]) for name in wanted))
        arrays = loadmat(io.BytesIO(data), variable_names=wanted)
    own = {ours: arrays[theirs] for ours, theirs in aliases.items()}
    return _parsed(own, aliases, shapes, "mat", limits, is_matlab=True)


def parse_datasets(file: Any, limits: ReadLimits) -> Parsed:
    """Read the datasets of an open HDF5 file, or MATLAB's of version 7.3, that passed the gate."""
    names = [name for name in file if hasattr(file[name], "shape")]
    aliases = _required(names, "HDF5 file", [*file])
    is_matlab = "MATLAB_class" in file[aliases["vertices"]].attrs
    # MATLAB's axes run the other way.
    own = {
        ours: np.asarray(file[theirs][()]).T if is_matlab else np.asarray(file[theirs][()])
        for ours, theirs in aliases.items()
    }
    return _parsed(own, aliases, names, "mat" if is_matlab else "hdf5", limits, is_matlab=is_matlab)


def _required(names: Iterable[str], what: str, listed: list[str] | None = None) -> dict[str, str]:
    aliases = aliases_in(names)
    if aliases is None:
        inside = [*names] if listed is None else listed
        shown = ", ".join(repr(name[:40]) for name in inside[:8]) or "nothing"
        raise _malformed(f"The {what} contains {shown}: no vertices with faces.")
    return aliases


def _parsed(
    own: dict[str, Array],
    aliases: Mapping[str, str],
    names: Iterable[str],
    kind: str,
    limits: ReadLimits,
    *,
    is_matlab: bool,
) -> Parsed:
    for name, array in own.items():
        if array.dtype.kind not in "biuf":
            raise _malformed(f"The {name} are {array.dtype.str[:20]}, not real numbers.")
    vertices = positions_in(own["vertices"], is_matlab=is_matlab)
    faces, notes = faces_in(own["faces"], vertices.shape[1])
    limits.require(frames=len(vertices), vertices=vertices.shape[1], faces=len(faces))
    arrays = {"vertices": vertices, "faces": faces}
    if "times" in own:
        arrays["times"] = np.ravel(own["times"]).astype(np.float64)
    info = {
        "format": kind,
        "ignored": [name for name in names if name not in aliases.values()],
        "notes": notes_as_json([*note_on(aliases), *notes]),
    }
    return info, arrays


def positions_in(array: Array, *, is_matlab: bool) -> Array:
    """Order axes as (frames, vertices, 3).

    Parameters
    ----------
    array : (frames, vertices, 3), (vertices, 3, frames) or (vertices, 3)
    is_matlab : bool
        Which of the first two it is where both fit.

    Raises
    ------
    ShapeError
        If none fits.
    """
    shape = array.shape
    if array.ndim == 2 and _DIRECTIONS in shape:
        return (array if shape[1] == _DIRECTIONS else array.T)[None]
    last, middle = shape[-1:] == (_DIRECTIONS,), shape[1:2] == (_DIRECTIONS,)
    if array.ndim == 3 and (middle if is_matlab else middle and not last):
        return array.transpose(2, 0, 1)
    if array.ndim == 3 and last:
        return array
    raise errors.ShapeError(
        f"The vertices have the shape {shape}.",
        remedy="Give (frames, vertices, 3), or in MATLAB (vertices, 3, frames).",
    )


def faces_in(array: Array, n_vertices: int) -> tuple[Ints, tuple[Note, ...]]:
    """Give triangles as rows that count vertices from 0, with a note where they counted from 1.

    Raises
    ------
    ShapeError
        If they are not whole numbers in threes.
    """
    whole = np.asarray(array)
    fits = whole.ndim == 2 and _DIRECTIONS in whole.shape
    # Beyond them, as of infinity, there are no whole numbers.
    if not fits or not ((np.abs(whole) < _MOST_WHOLE) & (whole == np.rint(whole))).all():
        raise errors.ShapeError(
            f"The faces have the shape {whole.shape} of {whole.dtype}.",
            remedy="Give triangles as (faces, 3) whole numbers.",
        )
    rows = (whole if whole.shape[1] == _DIRECTIONS else whole.T).astype(np.int64)
    if len(rows) and rows.min() == 1 and rows.max() == n_vertices:
        return rows - 1, (Note.of("faces_from_1"),)
    return rows, ()


RAW_TYPES: Final = {"float32": "<f4", "float64": "<f8"}
"""Types of raw numbers."""


def read_raw(
    data: bytes,
    n_vertices: int | None = None,
    *,
    grid: tuple[int, ...] | None = None,
    dtype: str = "float32",
    limits: ReadLimits = DEFAULT_LIMITS,
) -> Reading:
    """Read positions from raw numbers.

    Parameters
    ----------
    data : bytes
    n_vertices : int, optional
        Vertices a frame; the product of `grid` by default.
    grid : tuple of int, optional
        Nodes along each axis of a lattice.
    dtype : {"float32", "float64"}
    limits : ReadLimits, optional

    Raises
    ------
    ParameterError
        If the number of vertices is missing or below 1, or the type is unknown.
    MalformedFileError
        If the bytes are not a whole number of frames.
    LimitError
        If it holds more frames or vertices than `limits` accept.
    InputError
        If a number is not finite.
    """
    if n_vertices is None and grid is not None:
        n_vertices = prod(grid)
    if n_vertices is None or n_vertices < 1:
        raise errors.ParameterError(
            f"Raw numbers state no shape, and the number of vertices is {n_vertices}.",
            remedy="State the number of vertices per frame, or the grid.",
        )
    _require_type(dtype)
    kind = np.dtype(RAW_TYPES[dtype])
    frame_bytes = n_vertices * 3 * kind.itemsize
    n_frames, rest = divmod(len(data), frame_bytes)
    if rest or not n_frames:
        raise errors.MalformedFileError(
            f"{len(data)} bytes are not a whole number of frames of {n_vertices} vertices as "
            f"{dtype} ({frame_bytes} bytes each).",
            remedy="Check the number of vertices and the type; the file may be cut short.",
        )
    limits.require(frames=n_frames, vertices=n_vertices)
    vertices = np.frombuffer(data, kind).reshape(n_frames, n_vertices, 3)
    try:
        sequence = mesh_sequence(vertices, grid=grid)
    except errors.NonFiniteError as error:
        # The first sign of numbers of another type or byte order.
        error.remedy = (
            f"Check that the numbers are little-endian {dtype}, and repair or leave out the "
            "frame if they are."
        )
        raise
    return Reading(sequence, format="raw")


def write_raw(sequence: MeshSequence, dtype: str = "float32") -> bytes:
    """Write the positions as raw little-endian numbers, and nothing else.

    Raises
    ------
    ParameterError
        If the type is neither "float32" nor "float64", or a position is beyond it.
    """
    _require_type(dtype)
    if dtype == "float32":
        return single_precision(sequence.vertices, "A position").tobytes()
    return sequence.vertices.astype(RAW_TYPES[dtype]).tobytes()


def _require_type(dtype: str) -> None:
    if dtype not in RAW_TYPES:
        raise errors.ParameterError(
            f"The type {dtype[:20]!r} is not understood.",
            remedy="Use little-endian float32 or float64.",
        )


XDMF_SUFFIXES: Final = (".xdmf", ".xmf")
"""Ends of the names of such files."""

_DISPLACEMENT: Final = ("displacement", "displacements", "u", "disp")
_MOST_ELEMENTS: Final = 200_000

_bad_xdmf: Final = partial(
    errors.MalformedFileError,
    remedy="Save triangles over time from ParaView (Xdmf3), or VTKHDF; see docs/formats.",
)


def read_xdmf(data: bytes, beside: Callable[[str], bytes], parser: Parser) -> Reading:
    """Read a triangle mesh over time.

    Parameters
    ----------
    data : bytes
        The XML.
    beside : callable
        Gives the bytes of a file that it names, of its own folder or archive.
    parser : Parser
        Its limits apply.

    Raises
    ------
    MalformedFileError
        If it is not readable, or contains no triangles.
    InputError
        If the frames do not form a sequence.
    """
    domain = vtk_xml.xml_tree(data, "XDMF", _bad_xdmf, _MOST_ELEMENTS, has_type=True)
    grids = [g for g in domain.iter("Grid") if g.get("GridType", "Uniform") == "Uniform"]
    if not grids:
        raise _bad_xdmf("The XDMF file contains no grid.")
    steps = [grid for grid in grids if grid.find("Time") is not None] or grids
    numbers = _numbers_of(beside, parser)

    def read(grid: Element) -> tuple[Frame, detect.Format]:
        with misread(_bad_xdmf, "The XDMF file has numbers that cannot be read"):
            return _frame(grid, domain, numbers), detect.Format.XDMF

    return frames.read_frames(steps, read, parser.limits)


def _frame(grid: Element, domain: Element, numbers: Callable[[Element], Array]) -> Frame:
    # A grid that repeats another's mesh (xi:include) has none of its own.
    topology, geometry = (
        next(domain.iter(tag), None) if (own := grid.find(tag)) is None else own
        for tag in ("Topology", "Geometry")
    )
    if topology is None or geometry is None:
        raise _bad_xdmf("A grid of the XDMF file has no mesh.")
    kind = topology.get("TopologyType", topology.get("Type", ""))
    if kind.lower() != "triangle":
        raise _bad_xdmf(f"The cells of the XDMF file are {kind[:40]!r}, not 'Triangle'.")
    positions = numbers(geometry).reshape(-1, 3)
    faces, _ = faces_in(numbers(topology).reshape(-1, 3), -1)
    notes: tuple[Note, ...] = ()
    others = grid.findall("Attribute")
    moved = [one for one in others if one.get("Name", "").lower() in _DISPLACEMENT][:1]
    for one in moved:
        u = numbers(one).reshape(-1, 3)
        if u.shape != positions.shape:
            raise errors.ShapeError(
                f"There are {len(u)} displacements of {len(positions)} vertices.",
                remedy="Save a displacement for each vertex.",
            )
        positions = positions + u
        notes = (Note.of("displacement_added", array=one.get("Name")),)
    if positions.dtype != np.float32:
        positions = positions.astype(np.float64)
    ignored = tuple(one.get("Name", "")[:40] for one in others if one not in moved)
    time = grid.find("Time")
    stated = () if time is None else (("time", repr(float(time.get("Value", "nan")))),)
    return Frame(positions, faces, notes=notes, ignored=ignored, statements=stated)


def _numbers_of(beside: Callable[[str], bytes], parser: Parser) -> Callable[[Element], Array]:
    """Give the reader of an element's numbers, which reads each file once."""

    @cache
    def datasets(name: str) -> dict[str, Array]:
        return parser.parse("datasets", beside(name)).arrays

    def numbers(element: Element) -> Array:
        item = element.find("DataItem")
        if item is None:
            raise _bad_xdmf(f"An element {element.tag!r} of the XDMF file has no numbers.")
        text = item.text or ""
        if item.get("Format", "XML").upper() == "XML":
            return np.array(text.split(), dtype=np.float64)
        name, _, place = text.strip().rpartition(":")
        if place.strip("/") not in datasets(name):
            raise _bad_xdmf(f"{name[-60:]!r} contains no dataset {place[:60]!r}.")
        return datasets(name)[place.strip("/")]

    return numbers
