"""Reading a sequence from a file of any format that is understood."""

from __future__ import annotations

from pathlib import Path

from modalmotion.errors import InputError, MalformedFileError
from modalmotion.formats.detect import Format, detect_format, unknown_format
from modalmotion.formats.frames.archive import read_zip
from modalmotion.formats.frames.folder import is_pattern, read_folder
from modalmotion.formats.frames.frame_stack import FrameStack
from modalmotion.formats.gltf.reading import read_glb
from modalmotion.formats.hdf5 import read_hdf5
from modalmotion.formats.mesh_file import read_mesh
from modalmotion.formats.npz import read_npz
from modalmotion.formats.options import ReadOptions
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.raw import read_raw
from modalmotion.formats.result import Reading
from modalmotion.progress import Progress


def read_sequence(
    source: bytes | Path,
    options: ReadOptions | None = None,
    *,
    progress: Progress | None = None,
    parser: Parser | None = None,
) -> Reading:
    """Read a mesh sequence, telling its format from its content.

    Parameters
    ----------
    source : bytes or Path
        Bytes are what somebody sent, and are read without touching a file. A path is of this
        machine: a file, a folder of frames, or a pattern of their names (scan_*.ply).
    options : ReadOptions, optional
    progress : callable, optional
        Called with (frames read, frames in all) where frames are files of their own.
    parser : Parser, optional
        One to use again for many files; its own limits then hold.

    Returns
    -------
    Reading

    Raises
    ------
    InputError
        The subclass says what is wrong; frame and vertex are named where there is one.
    """
    asked = ReadOptions() if options is None else options
    if parser is None:
        with ParserProcess(asked.limits) as own:
            return asked.apply(_read(source, asked, own, progress))
    return asked.apply(_read(source, asked, parser, progress))


def _read(
    source: bytes | Path, asked: ReadOptions, parser: Parser, progress: Progress | None
) -> Reading:
    if isinstance(source, bytes):
        return _read_bytes(source, asked, parser, progress)
    if source.is_dir() or (is_pattern(source) and not source.exists()):
        return read_folder(source, parser, progress)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise MalformedFileError(
            f"'{source.name}' cannot be read: {error.strerror}.",
            remedy="Name a file, a folder of frames, or a pattern such as 'scan_*.ply'.",
        ) from error
    return _read_bytes(data, asked, parser, progress)


def _read_bytes(
    data: bytes, asked: ReadOptions, parser: Parser, progress: Progress | None
) -> Reading:
    limits = parser.limits
    found = asked.format or detect_format(data)
    if found is None and asked.n_vertices is not None:
        # Only raw numbers need it said.
        found = Format.RAW
    if found is None or not data:
        raise unknown_format(data)
    if found is Format.RAW:
        return read_raw(data, asked.n_vertices, grid=asked.grid, dtype=asked.dtype, limits=limits)
    try:
        if found is Format.NPZ:
            return read_npz(data, limits)
        if found is Format.ZIP:
            return read_zip(data, parser, progress)
        if found is Format.HDF5:
            return read_hdf5(data, limits, parser)
        if found is Format.GLB:
            return read_glb(data, limits, animation=asked.animation)
        return FrameStack(*read_mesh(data, found, parser), 1, limits).result(None)
    except InputError as error:
        error.details.setdefault("format", found.value)
        raise
