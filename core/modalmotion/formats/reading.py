"""Reading a sequence from a file of any known format."""

from pathlib import Path

from modalmotion import errors, mesh, notes
from modalmotion.formats import detect, frame_files, frames, glb, named_arrays, npz
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.result import Answer, Parser, Reading, ReadOptions, reading_of
from modalmotion.progress import Reporter


def _result(answer: Answer) -> Reading:
    info, arrays = answer.info, answer.arrays
    return reading_of(
        arrays["vertices"],
        arrays["faces"],
        format=str(info["format"]),
        grid=info.get("grid"),
        topology=info.get("topology"),
        times=arrays.get("times"),
        unit=info.get("unit"),
        facts=mesh.facts_from_json(info.get("facts", {})),
        notes=notes.notes_from_json(info["notes"]),
        ignored=tuple(info["ignored"]),
    )


def read_sequence(
    source: bytes | str | Path,
    options: ReadOptions | None = None,
    *,
    progress: Reporter | None = None,
    parser: Parser | None = None,
) -> Reading:
    """Read a mesh sequence, recognising its format by content.

    Parameters
    ----------
    source : bytes, str or Path
        Bytes may come from anywhere, and are read without opening a file. A path is local:
        a file, a folder of frames, or a pattern of their names (scan_*.ply).
    options : ReadOptions, optional
    progress : callable, optional
        Called with (frames read, frames in all) where frames are files of their own.
    parser : Parser, optional
        Parser to reuse for many files; its own limits then apply.

    Returns
    -------
    Reading

    Raises
    ------
    InputError
        The subclass names the problem; frame and vertex are named where known.
    """
    options = ReadOptions() if options is None else options
    source = Path(source) if isinstance(source, str) else source
    if parser is None:
        with ParserProcess(options.limits) as own:
            return options.apply(_read(source, options, own, progress))
    return options.apply(_read(source, options, parser, progress))


def _read(
    source: bytes | Path, options: ReadOptions, parser: Parser, progress: Reporter | None
) -> Reading:
    if isinstance(source, bytes):
        return _read_bytes(source, options, parser, progress)
    is_list = source.suffix.lower() in frame_files.LISTS and source.is_file()
    if is_list or source.is_dir() or ({*"*?["} & {*source.name} and not source.exists()):
        return frame_files.read_folder(source, parser, progress)
    try:
        data = source.read_bytes()
    except OSError as error:
        raise errors.MalformedFileError(
            f"'{source.name}' cannot be read: {error.strerror}.",
            remedy="Name a file, a folder of frames, or a pattern such as 'scan_*.ply'.",
        ) from error
    return _read_bytes(data, options, parser, progress)


def _nothing_beside(name: str) -> bytes:
    raise errors.MalformedFileError(
        f"The XDMF file has its numbers in {name[-60:]!r}.",
        remedy="Pack both as .zip, or name the .xdmf in its folder.",
    )


def _read_bytes(
    data: bytes, options: ReadOptions, parser: Parser, progress: Reporter | None
) -> Reading:
    limits = parser.limits
    kind = options.format or detect.detect_format(data)
    if kind is None and options.n_vertices is not None:
        # Only raw numbers need the number of vertices.
        kind = detect.Format.RAW
    if kind is None or not data:
        raise detect.unknown_format(data)
    if kind is detect.Format.RAW:
        return named_arrays.read_raw(
            data, options.n_vertices, grid=options.grid, dtype=options.dtype, limits=limits
        )
    try:
        if kind is detect.Format.NPZ:
            return npz.read_npz(data, limits)
        if kind is detect.Format.ZIP:
            return frame_files.read_zip(data, parser, progress)
        if kind in (detect.Format.HDF5, detect.Format.MAT):
            return _result(parser.parse(kind.value, data))
        if kind is detect.Format.XDMF:
            return named_arrays.read_xdmf(data, _nothing_beside, parser)
        if kind is detect.Format.GLB:
            return glb.read_glb(data, limits, animation=options.animation)
        return frames.FrameStack(*frames.read_mesh(data, kind, limits), 1, limits).result(None)
    except errors.InputError as error:
        error.details.setdefault("format", kind.value)
        raise
