"""Files that are checked before HDF5 opens them: structure, limits and seal.

A digest inside the file would be read by the HDF5 library, which is not made to survive
damaged files. Behind the end of the HDF5 image it is checked first, covers every byte, and
disturbs no reader: HDF5 files may be followed by anything.

The HDF5 library follows external storage, external links and virtual layouts to any file of
the machine by itself, and allocates what a shape declares. So a file is walked first, from
memory, and let through only if everything in it is in it.
"""

import hashlib
import io
import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Final

from modalmotion import errors
from modalmotion.limits import ReadLimits
from modalmotion.numeric.unpacking import unpacked

SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file."""

MOST_OBJECTS: Final = 2_000
"""Groups and datasets in one file, each counted by every name that it has."""

MOST_ATTRIBUTE_BYTES: Final = 1 << 15
"""Of one attribute."""

MOST_ATTRIBUTES: Final = 5_000
"""Of all groups and datasets together."""

MOST_MEMBERS: Final = 100
"""Of a compound type."""

_CHECKSUM_BYTES: Final = 4
# Bytes that one of a deflated stream unpacks to, and what any chunk may: it is gone at once.
_MOST_DEFLATED: Final = 1032
_LITTLE: Final = 1 << 25

_REMEDY: Final = (
    "Write plain datasets (contiguous or chunked, gzip, shuffle, fletcher32) into one file, "
    "without links to others."
)


@contextmanager
def open_gated(data: bytes, limits: ReadLimits) -> Iterator[Any]:
    """Open an HDF5 file after the gate; what the library cannot read becomes an error of ours.

    Parameters
    ----------
    data : bytes
    limits : ReadLimits
        `decompressed_bytes` applies to all datasets together.

    Yields
    ------
    h5py.File

    Raises
    ------
    MalformedFileError
        If the file cannot be read, or contains anything but plain datasets.
    LimitError
        If it declares more than is accepted.
    """
    import h5py

    try:
        with h5py.File(h5py.h5f.open_file_image(data)) as file:
            _walk(h5py, file, limits)
            yield file
    except (errors.InputError, MemoryError):
        raise
    except Exception as error:
        raise errors.MalformedFileError(
            f"The HDF5 file cannot be read ({_first_line(error)}).",
            remedy="The file may be cut short: send it again, or write it anew.",
        ) from error


def _walk(h5py: Any, file: Any, limits: ReadLimits) -> None:
    n_bytes = n_names = 0
    seen: set[object] = set()
    waiting = [("", file.id)]
    n_attributes = _require_small_attributes(h5py, "/", h5py.h5o.open(file.id, b"/"), 0)
    while waiting:
        path, group = waiting.pop()
        n_names += group.get_num_objs()
        if n_names > MOST_OBJECTS:
            raise _too_many("objects", n_names, MOST_OBJECTS)
        # One after the other: each place in the list is looked for from its beginning.
        keys: list[bytes] = []
        group.links.iterate(keys.append)
        for key in keys:
            name = f"{path}/{key.decode('utf-8', 'replace')}"[:200]
            if group.links.get_info(key).type != h5py.h5l.TYPE_HARD:
                raise _refused(name, "a link to another place or file")
            # Opened only now: opening a link would follow it.
            member = h5py.h5o.open(group, key)
            info = h5py.h5o.get_info(member)
            # Hard links may form cycles.
            if (place := (info.fileno, info.addr)) in seen:
                continue
            seen.add(place)
            n_attributes = _require_small_attributes(h5py, name, member, n_attributes)
            if isinstance(member, h5py.h5g.GroupID):
                waiting.append((name, member))
            elif isinstance(member, h5py.h5d.DatasetID):
                n_bytes += _declared_bytes(h5py, name, member, limits)
                limits.require(decompressed_bytes=n_bytes)


def _declared_bytes(h5py: Any, name: str, dataset: Any, limits: ReadLimits) -> int:
    plan = dataset.get_create_plist()
    if plan.get_external_count():
        raise _refused(name, "data in another file")
    _require_plain_type(h5py, name, dataset.get_type())
    n_bytes = math.prod(dataset.shape or ()) * int(dataset.dtype.itemsize)
    layout = plan.get_layout()
    if layout == h5py.h5d.CHUNKED:
        # Read at once, however small the dataset.
        chunk_bytes = math.prod(plan.get_chunk()) * int(dataset.dtype.itemsize)
        limits.require(decompressed_bytes=chunk_bytes)
        _require_chunks(h5py, name, dataset, chunk_bytes)
    elif layout not in (h5py.h5d.CONTIGUOUS, h5py.h5d.COMPACT):
        raise _refused(name, "a virtual layout")
    elif dataset.dtype.kind != "O" and dataset.get_storage_size() not in (0, n_bytes):
        raise _refused(name, f"{dataset.get_storage_size()} bytes in place of {n_bytes}")
    return n_bytes


def _require_chunks(h5py: Any, name: str, dataset: Any, chunk_bytes: int) -> None:
    """Unpack chunks to their size first: the library's own filter unpacks to any size."""
    plan = dataset.get_create_plist()
    deflate, checksum = h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_FLETCHER32
    codes = [plan.get_filter(index)[0] for index in range(plan.get_nfilters())]
    for code in codes:
        if code not in (deflate, checksum, h5py.h5z.FILTER_SHUFFLE):
            raise _refused(name, f"the filter {code}")
    if deflate not in codes:
        return
    place = codes.index(deflate)
    if any(code != checksum for code in codes[place + 1 :]):
        raise _refused(name, "filters behind gzip")
    n_bytes = chunk_bytes + _CHECKSUM_BYTES * codes[:place].count(checksum)
    large: list[Any] = []

    def pick(chunk: Any) -> None:
        is_packed = not chunk.filter_mask & 1 << place
        if is_packed and _MOST_DEFLATED * chunk.size > max(n_bytes, _LITTLE):
            large.append(chunk.chunk_offset)

    dataset.chunk_iter(pick)
    for offset in large:
        unpacked(bytes(dataset.read_direct_chunk(offset)[1]), "zlib", n_bytes)


def _require_plain_type(h5py: Any, name: str, kind: Any) -> None:
    # Before h5py describes it, member by member, to NumPy.
    if kind.get_class() == h5py.h5t.COMPOUND:
        n_members = kind.get_nmembers()
        if n_members > MOST_MEMBERS:
            raise _too_many("members of one type", n_members, MOST_MEMBERS)
        if any(kind.get_member_class(i) == h5py.h5t.COMPOUND for i in range(n_members)):
            raise _refused(name, "a type within a type")


def _require_small_attributes(h5py: Any, name: str, owner: Any, n_before: int) -> int:
    n_attributes = n_before + int(h5py.h5a.get_num_attrs(owner))
    if n_attributes > MOST_ATTRIBUTES:
        raise _too_many("attributes", n_attributes, MOST_ATTRIBUTES)
    keys: list[bytes] = []
    h5py.h5a.iterate(owner, keys.append)
    for key in keys:
        attribute = h5py.h5a.open(owner, key)
        _require_plain_type(h5py, name, attribute.get_type())
        n_bytes = math.prod(attribute.shape or ()) * int(attribute.dtype.itemsize)
        if max(n_bytes, attribute.get_storage_size()) > MOST_ATTRIBUTE_BYTES:
            raise _refused(name, f"an attribute of {n_bytes} bytes")
    return n_attributes


def _refused(name: str, what: str) -> errors.MalformedFileError:
    return errors.MalformedFileError(
        f"The HDF5 file's {name!r} is or has {what}, which is never followed or read.",
        remedy=_REMEDY,
        details={"object": name},
    )


def _too_many(what: str, value: int, most: int) -> errors.LimitError:
    return errors.LimitError(
        f"The HDF5 file contains {value} {what}; at most {most} are accepted.",
        remedy=_REMEDY,
        limit="hdf5_objects",
        details={"value": value, "most": most},
    )


def _first_line(error: Exception) -> str:
    return (str(error).splitlines() or [type(error).__name__])[0][:120]


_MARK: Final = b"\nmodalmotion sha256 "
_SEAL: Final = re.compile(rb"\nmodalmotion sha256 ([0-9a-f]{64})\n")
SEAL_LENGTH: Final = len(_MARK) + 64 + 1

# Of a file, at a time.
_PIECE: Final = 1 << 20

_RESTORE = "Restore it from a copy, or delete it and make the result again."


def seal(image: bytes) -> bytes:
    """Put the seal behind an HDF5 image."""
    return image + _MARK + hashlib.sha256(image).hexdigest().encode() + b"\n"


def seal_file(path: Path) -> None:
    """Put the seal behind an HDF5 file that is too large to be built in memory.

    May raise OSError.
    """
    with path.open("rb+") as file:
        digest = hashlib.file_digest(file, "sha256")
        file.write(_MARK + digest.hexdigest().encode() + b"\n")


def require_sealed(path: Path) -> None:
    """Check the seal of a file a piece at a time, as `load_sealed` does in memory.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it has no seal, or differs from what was sealed.
    """
    try:
        with path.open("rb") as file:
            _require_seal(f"'{path.name}'", file, path.stat().st_size)
    except OSError as error:
        raise _unreadable(path, error) from error


def _require_seal(name: str, file: BinaryIO, size: int) -> None:
    digest, left = hashlib.sha256(), size - SEAL_LENGTH
    while left > 0 and (piece := file.read(min(left, _PIECE))):
        digest.update(piece)
        left -= len(piece)
    match = _SEAL.fullmatch(file.read())
    if match is None:
        raise errors.CorruptFileError(
            f"{name} does not end with the seal that modalmotion writes: it is cut "
            "short, was changed, or comes from another program.",
            remedy=_RESTORE,
        )
    if digest.hexdigest().encode() != match[1]:
        raise errors.CorruptFileError(
            f"{name} is damaged: its bytes do not have the sha256 that its seal states.",
            remedy=_RESTORE,
            details={"stated": match[1].decode(), "found": digest.hexdigest()},
        )


def digest_of(data: bytes) -> str:
    """sha256 in the seal of a file, in hex."""
    return data[-65:-1].decode()


def load_sealed(source: bytes | Path) -> tuple[str, bytes]:
    """Read a sealed HDF5 file and check its seal.

    Parameters
    ----------
    source : bytes or Path

    Returns
    -------
    name : str
        The file's name without its folder, or a word for bytes that have none.
    data : bytes
        All of it, the seal included.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is not an HDF5 file, has no seal, or differs from what was sealed.
    """
    if isinstance(source, bytes):
        name, data = "The HDF5 image", source
    else:
        name = f"'{source.name}'"
        data = read_file(source)
    if not data.startswith(SIGNATURE):
        what = "is empty" if not data else "does not begin as an HDF5 file does"
        raise errors.CorruptFileError(
            f"{name} {what}.",
            remedy=f"Name an HDF5 file written by modalmotion. If this was one: {_RESTORE}",
        )
    _require_seal(name, io.BytesIO(data), len(data))
    return name, data


def is_sound(path: Path) -> bool:
    """Return whether a sealed file is there as it was written."""
    try:
        load_sealed(path)
    except errors.StoreError:
        return False
    return True


def read_file(path: Path) -> bytes:
    """Read all of a file.

    Raises
    ------
    NotFoundError
        If there is none.
    StoreError
        If it cannot be read.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> errors.StoreError:
    if isinstance(error, FileNotFoundError):
        return errors.NotFoundError(
            f"There is no file '{path.name}'.", remedy="Check its name and folder."
        )
    return errors.StoreError(
        f"'{path.name}' could not be read: {error.strerror}.",
        remedy="Check that it is a file, that this user may read it, and the disk.",
    )
