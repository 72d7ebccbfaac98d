"""Files fetched from elsewhere for as long as they are read, and packs sent there: whole or not."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, Final
from urllib.parse import urlsplit

from modalmotion.errors import LimitError, MalformedFileError, ParameterError, StoreError
from modalmotion.exports.signature_pack import is_pack
from modalmotion_service.cohort.remote import RemoteFile, Source
from modalmotion_service.cohort.remote_systems import (
    PassingError,
    explained,
    infos_of,
    system_of,
)

_TRIES: Final = 3
_PIECE: Final = 1 << 20


@contextlib.contextmanager
def fetched(source: Source, folder: Path, most_bytes: int) -> Iterator[Path]:
    """Give a path of this machine for as long as the block lasts.

    Parameters
    ----------
    source : Path or RemoteFile
        A path is given as it is.
    folder : Path
        Where a copy lies meanwhile.
    most_bytes : int
        Of a file, or of all in a folder, looked at before and while they are read.

    Raises
    ------
    LimitError
        If it is larger.
    MalformedFileError
        If it is not there, may not be read, or its connection breaks; names it.
    """
    if isinstance(source, Path):
        yield source
        return
    place = Path(tempfile.mkdtemp(prefix="fetched-", dir=folder))
    try:
        yield _fetch(source, place, most_bytes)
    finally:
        shutil.rmtree(place, ignore_errors=True)


def send(path: Path, target: RemoteFile) -> None:
    """Write a file to where a URL says: it is there whole, or as it was.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    try:
        with explained(target):
            system, place = system_of(target)
            with system.transaction, path.open("rb") as here, system.open(place, "wb") as there:
                shutil.copyfileobj(here, there, _PIECE)
            size = system.info(place)["size"]
    except MalformedFileError as error:
        raise StoreError(
            f"'{target.shown}' could not be written: {error.message}", remedy=error.remedy
        ) from error
    if size != path.stat().st_size:
        raise StoreError(
            f"'{target.shown}' has {size} bytes of {path.stat().st_size}.",
            remedy="Run the same command again.",
        )


def require_target(target: RemoteFile) -> None:
    """Find out, before any work, whether a pack may be written to where a URL says.

    Raises
    ------
    MissingExtraError
        If a package for it is absent.
    ParameterError
        If another file is there, or nothing can be written there.
    MalformedFileError
        If it cannot be reached.
    """
    if target.is_web:
        raise ParameterError(
            f"'{target.shown}' cannot be written to: a web server only gives.",
            remedy="Name s3://bucket/name or the like, or a file of this machine.",
        )
    with explained(target):
        system, place = system_of(target)
        if not system.exists(place):
            return
        with system.open(place, "rb") as file:
            is_one = is_pack(file)
    if not is_one:
        raise ParameterError(
            f"'{target.shown}' exists already and is not a pack of signatures.",
            remedy="Choose another name, or remove it first.",
        )


def _fetch(file: RemoteFile, place: Path, most_bytes: int) -> Path:
    for number in range(_TRIES):
        try:
            with explained(file):
                system, path = system_of(file)
                infos = infos_of(system, path, file)
                _copy(system, infos, place, most_bytes, file)
                break
        except PassingError:
            if number == _TRIES - 1:
                raise
            time.sleep(0.5 * 2**number)
    if file.is_pattern:
        return place / file.name
    return place / _name_of(path) if infos[0]["name"] == path else place


def _copy(
    system: Any, infos: list[dict[str, Any]], place: Path, most_bytes: int, file: RemoteFile
) -> None:
    from fsspec.callbacks import Callback

    stated = sum(info.get("size") or 0 for info in infos)
    _require_size(file, stated, most_bytes)
    free = shutil.disk_usage(place).free
    if stated > free:
        raise StoreError(
            f"'{file.shown}' has {stated} bytes, and {free} are free where it is to be read.",
            remedy="Make room on the disk of the results.",
        )

    class _Bounded(Callback):  # type: ignore[misc]
        n_bytes = 0

        def relative_update(self, inc: int = 1) -> None:
            self.n_bytes += inc
            _require_size(file, self.n_bytes, most_bytes)

    bounded = _Bounded()
    for info in infos:
        target = place / _name_of(info["name"])
        system.get_file(info["name"], str(target), callback=bounded)
        size = info.get("size")
        if size is not None and target.stat().st_size != size:
            raise ConnectionError(f"{target.stat().st_size} of {size} bytes came")
        _require_size(file, target.stat().st_size, most_bytes)


def _require_size(file: RemoteFile, n_bytes: int, most_bytes: int) -> None:
    if n_bytes > most_bytes:
        raise LimitError(
            f"'{file.shown}' has {n_bytes} bytes or more; at most {most_bytes} are read.",
            remedy="Set MODALMOTION_MAX_BODY_BYTES higher, or send fewer frames in a file.",
            limit="max_body_bytes",
            details={"value": n_bytes, "most": most_bytes},
        )


def _name_of(path: str) -> str:
    # Of http it is the URL, which may have a query.
    return PurePosixPath(urlsplit(path).path).name or "file"
