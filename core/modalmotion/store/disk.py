"""Files on disk: written wholly or not at all, locked, and JSON with a seal."""

import contextlib
import errno
import fcntl
import hashlib
import json
import os
import re
import secrets
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Final, Self

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.hdf5.sealed import read_file

_TEMPORARY: Final = re.compile(r"\.modalmotion-[0-9]+-[0-9a-f]{16}\.tmp")

_REMEDIES: Final = {
    errno.ENOSPC: "Free space on the disk, or delete sequences, and try again.",
    errno.EDQUOT: "Free space within the quota and try again.",
    errno.EACCES: "Give this user write permission there.",
    errno.ENOENT: "Create the folder first, or name another.",
    errno.ENOTDIR: "Name a folder, not a file, to write in.",
    errno.EISDIR: "That is a folder; add the name of the file.",
    errno.EROFS: "Mount the file system for writing.",
}


def write_atomic(path: Path, data: bytes | memoryview) -> None:
    """Write a file so that it is there as a whole, and durably, or not at all.

    A temporary file in the same folder is written, synchronised and renamed; then the folder
    is synchronised, for until then the name itself may be lost with the power.

    Parameters
    ----------
    path : Path
        Replaced if it exists.
    data : bytes

    Raises
    ------
    StoreError
        If any step fails. No temporary file remains, and `path` has its previous content.
    """
    previous = content_of(path) if path.exists() else None
    try:
        with replacing(path) as temporary:
            _write_durably(temporary, data)
        try:
            sync_paths([path.parent])
        except BaseException:
            put_back(path, previous)
            raise
    except OSError as error:
        raise cannot_write(path, error) from error


@contextlib.contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Give a file beside a path, which takes its place if the block succeeds."""
    temporary = temporary_beside(path)
    try:
        yield temporary
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def put_back(path: Path, content: bytes | None) -> None:
    """Undo a write as well as a failing disk lets us: the previous content, or no file.

    The content was durable, so its copy need not be synchronised to be read as before.
    """
    with contextlib.suppress(OSError):
        if content is None:
            path.unlink(missing_ok=True)
        else:
            with replacing(path) as temporary:
                temporary.write_bytes(content)


def content_of(path: Path) -> bytes | None:
    """All of a file, None if it cannot be read.

    Only records are ever replaced, which are small: results are immutable.
    """
    try:
        return path.read_bytes()
    except OSError:
        return None


def temporary_beside(path: Path) -> Path:
    """Name for a file that is to be renamed to `path` when it is whole."""
    return path.parent / f".modalmotion-{os.getpid()}-{secrets.token_hex(8)}.tmp"


def remove_durably(*paths: Path) -> None:
    """Remove files that may be missing, and synchronise their folders.

    Raises
    ------
    StoreError
        If a file cannot be removed; the others may be gone.
    """
    folders = dict.fromkeys(path.parent for path in paths)
    try:
        for path in paths:
            path.unlink(missing_ok=True)
        sync_paths(folder for folder in folders if folder.is_dir())
    except OSError as error:
        raise StoreError(
            f"A file could not be removed: {error.strerror}.",
            remedy="Give this user the right to write there, or check the disk.",
            details={"errno": errno.errorcode.get(error.errno or 0, "unknown")},
        ) from error


def make_folder(folder: Path) -> None:
    """Make a folder and those above it, durably, even if it is there already.

    Raises
    ------
    StoreError
        If it cannot be made.
    """
    if not folder.parent.is_dir():
        make_folder(folder.parent)
    try:
        folder.mkdir(exist_ok=True)
        sync_paths([folder.parent])
    except OSError as error:
        raise cannot_write(folder, error) from error


def is_temporary(name: str) -> bool:
    """Return whether a file of that name is one that `write_atomic` did not finish."""
    return _TEMPORARY.fullmatch(name) is not None


def cannot_write(path: Path, error: OSError) -> StoreError:
    """Error for a file that cannot be written, with a remedy where the cause suggests one."""
    number = error.errno or 0
    reason = error.strerror or type(error).__name__
    if number == errno.ENOENT:
        reason = f"there is no folder '{path.parent.name}'"
    return StoreError(
        f"'{path.name}' could not be written ({reason}); the previous content is unchanged.",
        remedy=_REMEDIES.get(number, "Check the disk, then try again."),
        details={"file": path.name, "errno": errno.errorcode.get(number, "unknown")},
    )


def _write_durably(path: Path, data: bytes | memoryview) -> None:
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o666)
    try:
        view = memoryview(data)
        while view:
            view = view[os.write(descriptor, view) :]
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def rename(path: Path, target: Path) -> None:
    """Rename a file durably, or leave it where it was.

    Raises
    ------
    StoreError
        If it cannot be renamed.
    """
    try:
        path.replace(target)
        try:
            sync_paths({path.parent, target.parent})
        except BaseException:
            target.replace(path)
            raise
    except OSError as error:
        raise cannot_write(target, error) from error


def sync_paths(paths: Iterable[Path]) -> None:
    """Make files, or the names in folders, durable; may raise OSError."""
    for path in dict.fromkeys(paths):
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


_OF_THE_MACHINE: Final = frozenset(
    {
        *(errno.ENOSPC, errno.EDQUOT, errno.EROFS, errno.EACCES, errno.EIO),
        *(errno.ESTALE, errno.EMFILE, errno.ENFILE, errno.ENOMEM, errno.ENODEV),
    }
)


def is_of_the_machine(error: BaseException) -> bool:
    """Return whether the same could succeed at another time, with nothing else changed."""
    return isinstance(error, OSError) and error.errno in _OF_THE_MACHINE


_held: "Final[weakref.WeakSet[FolderLock]]" = weakref.WeakSet()


class FolderLock:
    """An exclusive lock on a file, which goes with the process that holds it.

    Parameters
    ----------
    path : Path
        The file; it is made where it is missing and stays there.

    Raises
    ------
    StoreError
        If another process (or another store of this one) holds it, naming its process id.
    """

    def __init__(self, path: Path) -> None:
        _close_in_children()
        try:
            descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
        except OSError as error:
            raise StoreError(
                f"The folder of the store cannot be opened: {error.strerror}.",
                remedy="Give this user write permission there.",
            ) from error
        try:
            # flock rather than POSIX locks, which one process may take twice.
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.pread(descriptor, 20, 0).decode(errors="replace").strip()
            os.close(descriptor)
            raise StoreError(
                f"The store's folder is in use by process {holder or 'unknown'}.",
                remedy="Stop that process, or use another folder: only one process at a time can "
                "use a folder.",
                details={"pid": int(holder)} if holder.isdigit() else {},
            ) from None
        except OSError as error:
            os.close(descriptor)
            raise StoreError(
                f"The store's folder cannot be locked: {error.strerror}.",
                remedy="Put the store on a file system that supports locks, preferably a local "
                "one.",
            ) from error
        self._descriptor: int | None = descriptor
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"{os.getpid()}\n".encode(), 0)
        _held.add(self)

    @property
    def is_held(self) -> bool:
        """Whether this process still holds the lock: a forked child does not."""
        return self._descriptor is not None

    def release(self) -> None:
        """Give the lock back."""
        _held.discard(self)
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()


@cache
def _close_in_children() -> None:
    # A worker forked from a server would otherwise keep the lock when the server is killed.
    os.register_at_fork(after_in_child=_release_all)


def _release_all() -> None:
    for lock in list(_held):
        lock.release()


@dataclass(frozen=True)
class JsonForm:
    """Kind and version of such a file.

    Parameters
    ----------
    kind : str
        "sequence-record" or "deleted-model".
    version : int
        Of its schema.
    remedy : str
        Advice for a damaged one.
    """

    kind: str
    version: int
    remedy: str

    def write(self, record: dict[str, Any]) -> bytes:
        """Write a file in memory, the same bytes for the same record."""
        content = {
            "schema": f"modalmotion.{self.kind}",
            "schema_version": self.version,
            "record": record,
        }
        return json.dumps({**content, "sha256": _digest(content)}, indent=1).encode()

    def read(self, path: Path) -> dict[str, Any]:
        """Read the record in a file.

        Raises
        ------
        NotFoundError
            If there is no such file.
        CorruptFileError
            If it is damaged.
        StoreError
            If it was written by another version.
        """
        try:
            content: dict[str, Any] = json.loads(read_file(path))
            is_whole = content.pop("sha256") == _digest(content)
            schema, version = content["schema"], content["schema_version"]
            record: dict[str, Any] = content["record"]
        except (AttributeError, KeyError, TypeError, ValueError) as error:
            raise self.damaged(path, str(error)) from error
        if not is_whole:
            raise self.damaged(path, "its fields do not match its sha256")
        # Not called damaged from here on, for what is damaged may be written anew.
        own = f"modalmotion.{self.kind}"
        if (schema, version) != (own, self.version):
            raise StoreError(
                f"'{path.name}' has schema {str(schema)[:40]!r}, version {str(version)[:10]}, "
                f"instead of {own!r}, version {self.version}.",
                remedy="Read it with the version of modalmotion that wrote it.",
            )
        return record

    def damaged(self, path: Path, reason: str) -> CorruptFileError:
        """Error for a file that does not contain what it should."""
        return CorruptFileError(
            f"The {self.kind.replace('-', ' ')} '{path.parent.name}/{path.name}' is damaged "
            f"({reason[:100]}).",
            remedy=self.remedy,
        )


def _digest(content: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
