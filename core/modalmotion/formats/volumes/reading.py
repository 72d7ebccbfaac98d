"""Images from files: one file, or a folder or zip of them."""

import io
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Final

import numpy as np

from modalmotion.errors import InputError, MalformedFileError, ShapeError, needs_extra
from modalmotion.formats import detect, npz, result
from modalmotion.formats.frame_files import is_hidden, natural_key, opened
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.volumes.stack import Slice, grouped
from modalmotion.images import ImageSequence, Plane, PlaneSet, Volume
from modalmotion.images.volume import Image, slices_of
from modalmotion.limits import DEFAULT_LIMITS, ReadLimits
from modalmotion.notes import Note, notes_from_json
from modalmotion.progress import Reporter, reported
from modalmotion.representation import counted

_malformed: Final = partial(
    MalformedFileError,
    remedy="Use NIfTI, NRRD, MetaImage, or a folder or zip of DICOM slices or of such files.",
)

# What parsers need, in a process whose missing packages nobody sees.
_PACKAGES: Final = {"nifti": "nibabel", "nrrd": "nrrd", "dicom": "pydicom"}

# Of the files of an examination: more that cannot be read are an error.
_MOST_DAMAGED: Final = 0.2

_HEAD: Final = 512

# A scanner writes little besides images.
_PRIVATE: Final = (".txt", ".xml", ".json", ".csv", ".html", ".md", ".jpg", ".png")


def kind_of_image(data: bytes) -> str | None:
    """Recognise a file of images by its first bytes: the name of its parser, or None."""
    if data[:2] == b"\x1f\x8b" or data[344:348] in (b"n+1\0", b"n+2\0") or data[4:7] == b"n+2":
        return "nifti"
    if data[:4] == b"NRRD":
        return "nrrd"
    if data[128:132] == b"DICM":
        return "dicom"
    return "metaimage" if data[:400].lstrip().startswith((b"ObjectType", b"NDims")) else None


def holds_images(source: bytes | Path) -> bool:
    """Return whether a file, or the first of a zip or folder that is no text, contains images."""
    is_folder = isinstance(source, Path) and source.is_dir()
    if isinstance(source, Path) and is_folder:
        inside = [path for path in source.rglob("*") if path.is_file() and _counts(path.name)]
        if not inside:
            return False
        source = min(inside)
    # What is wrong with it is said by its reader.
    with (
        suppress(*npz.UNREADABLE),
        source.open("rb") if isinstance(source, Path) else io.BytesIO(source) as file,
    ):
        head = file.read(_HEAD)
        if is_folder or not head.startswith(b"PK\x03\x04"):
            return kind_of_image(head) is not None
        with zipfile.ZipFile(file) as archive:
            name = min(filter(_counts, archive.namelist()), default=None)
            if name is not None:
                with archive.open(name) as member:
                    return kind_of_image(member.read(_HEAD)) is not None
    return False


def _counts(name: str) -> bool:
    return not (name.endswith("/") or is_hidden(name) or name.lower().endswith(_PRIVATE))


def read_images(
    source: bytes | Path,
    *,
    limits: ReadLimits | None = None,
    parser: result.Parser | None = None,
    progress: Reporter | None = None,
) -> ImageSequence:
    """Read volumes over time, or sets of planes, in LPS mm.

    Parameters
    ----------
    source : bytes or Path
        A NIfTI, NRRD or MetaImage file; a zip or folder of DICOM slices; or one of several such
        files, which are frames in the natural order of their names where each has one frame, and
        planes of the same frames where each has as many.
    limits : ReadLimits, optional
    parser : Parser, optional
        Parser to reuse for many files; its own limits then apply.
    progress : callable, optional
        Called with the files read and all of them.

    Raises
    ------
    InputError
        Naming the file that cannot be read, and never its contents.
    MissingExtraError
        If the package for the format is absent.
    """
    if parser is None:
        with ParserProcess(DEFAULT_LIMITS if limits is None else limits) as own:
            return _read(source, own, progress)
    return _read(source, parser, progress)


def _read(source: bytes | Path, parser: result.Parser, progress: Reporter | None) -> ImageSequence:
    if isinstance(source, Path) and source.is_dir():
        paths = (path for path in source.rglob("*") if path.is_file())
        files = {str(path.relative_to(source)): path.read_bytes for path in paths}
        return _of_files(files, parser, progress)
    try:
        data = source.read_bytes() if isinstance(source, Path) else source
    except OSError as error:
        raise _malformed(f"It cannot be read: {error.strerror}.") from error
    kind = kind_of_image(data)
    if kind is None and detect.detect_format(data) is detect.Format.ZIP:
        with opened(data, parser) as archive:
            return _of_files(archive.files, archive, progress)
    if kind is None:
        what = "contains no images of a known format" if data else "is empty"
        raise _malformed(f"The file {what}.")
    answer = _parsed(kind, data, parser)
    return grouped(_slices(answer)) if kind == "dicom" else _sequence(answer)


def _of_files(
    files: Mapping[str, Callable[[], bytes]], parser: result.Parser, progress: Reporter | None
) -> ImageSequence:
    names = sorted((name for name in files if _counts(name)), key=natural_key)
    slices: list[Slice] = []
    parts: list[ImageSequence] = []
    skipped, damaged, total = 0, 0, 0
    for name in reported(names, progress):
        data = files[name]()
        kind = kind_of_image(data)
        if kind is None:
            skipped += 1
            continue
        try:
            answer = _parsed(kind, data, parser)
        except InputError as error:
            # Exports hold reports and cut files; images of a few planes do without them.
            damaged += isinstance(error, MalformedFileError)
            is_spared = isinstance(error, MalformedFileError) and kind == "dicom"
            if is_spared and damaged <= _MOST_DAMAGED * len(names):
                continue
            error.message = f"{Path(name).name[-60:]!r}: {error.message}"
            raise
        total += sum(array.nbytes for array in answer.arrays.values())
        parser.limits.require(decompressed_bytes=total)
        if kind == "dicom":
            slices += _slices(answer)
        else:
            parts.append(_sequence(answer))
    if slices and parts:
        raise _malformed("The files are DICOM slices and other images together.")
    if not slices and not parts:
        raise _malformed(f"No images of a known format in {counted(len(names), 'file')}.")
    found = grouped(slices) if slices else _joined(parts)
    left_out = ((skipped, "no images"), (damaged, "damaged or not slices"))
    notes = [
        Note.of("files_not_used", reason=what, files=counted(n, "file"))
        for n, what in left_out
        if n
    ]
    return replace(found, notes=(*found.notes, *notes))


def _parsed(kind: str, data: bytes, parser: result.Parser) -> result.Answer:
    with needs_extra("images"):
        if kind in _PACKAGES and find_spec(_PACKAGES[kind]) is None:
            raise ModuleNotFoundError(name=_PACKAGES[kind])
    return parser.parse(kind, data)


def _sequence(answer: result.Answer) -> ImageSequence:
    affine = answer.arrays["affine"]
    frames = tuple(Volume(values, affine) for values in answer.arrays["values"])
    times = answer.info["times"]
    at = None if times is None else np.array(times, dtype=np.float64)
    return ImageSequence(frames, at, notes=notes_from_json(answer.info["notes"]))


def _slices(answer: result.Answer) -> list[Slice]:
    values, affines = answer.arrays["values"], answer.arrays["affine"]
    shared = {name: answer.info[name] for name in ("series", "patient", "space")}
    rows = zip(values, affines, answer.info["slices"], strict=True)
    return [Slice(own, affine, {**shared, **info}) for own, affine, info in rows]


def _joined(parts: list[ImageSequence]) -> ImageSequence:
    """Frames of files with one each, or planes of files with as many frames each."""
    if len(parts) == 1:
        return parts[0]
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    counts = {part.n_frames for part in parts}
    if counts == {1} and not _are_planes(parts):
        return ImageSequence(tuple(part.frames[0] for part in parts), notes=notes)
    if len(counts) > 1:
        raise ShapeError(
            f"The files have {min(counts)} to {max(counts)} frames.",
            remedy="Send one file for each frame, or files of planes with the same frames.",
        )
    frames = (
        PlaneSet(tuple(plane for part in parts for plane in _planes(part.frames[k])))
        for k in range(parts[0].n_frames)
    )
    return ImageSequence(tuple(frames), parts[0].times, notes=notes)


def _are_planes(parts: list[ImageSequence]) -> bool:
    """Whether each file is one slice, of different places."""
    volumes = [frame for part in parts for frame in part.frames if isinstance(frame, Volume)]
    places = {tuple(np.round(volume.affine, 3).ravel()) for volume in volumes}
    return all(1 in volume.shape for volume in volumes) and len(places) > 1


def _planes(frame: Image | None) -> tuple[Plane, ...]:
    if frame is None:
        return ()
    return (slices_of(frame) if isinstance(frame, Volume) else frame).planes
