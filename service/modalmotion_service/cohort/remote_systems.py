"""What lies elsewhere, looked at: lists, sizes and stamps, and what an error of it means."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from http import HTTPStatus
from typing import Any, Final
from urllib.parse import urlsplit

from modalmotion.errors import (
    MalformedFileError,
    MissingExtraError,
    ModalMotionError,
    ParameterError,
    install_command,
    needs_extra,
)
from modalmotion_service.cohort.remote import WEB, RemoteFile

# What tells that a file is another one, by the names that file systems give it.
_STAMPS: Final = (
    *("size", "mtime", "LastModified", "last_modified", "updated", "created", "modified"),
    *("ETag", "etag", "checksum", "md5Hash", "generation", "version_id", "VersionId"),
    *("Last-Modified", "Content-MD5", "Digest"),
)
_NO_CREDENTIALS: Final = frozenset(
    {"NoCredentialsError", "PartialCredentialsError", "CredentialRetrievalError", "ProfileNotFound"}
)
# What fsspec imports for a scheme, of those that the extra has.
_PACKAGES: Final = {"s3": "s3fs", **dict.fromkeys(WEB, "aiohttp")}
# Requests under way at once, where each file is looked at by itself.
_TOGETHER: Final = 16


def listed(folder: RemoteFile) -> tuple[RemoteFile, ...]:
    """List the files and folders in a folder, or those that a pattern matches, by name.

    Raises
    ------
    ModalMotionError
        If it cannot be listed.
    """
    with explained(folder):
        system, path = system_of(folder)
        if folder.is_pattern:
            found = system.glob(path)
        else:
            # Of itself, too, if it is a file: a folder has none.
            found = [one for one in system.ls(path, detail=False) if one.rstrip("/") != path]
        return tuple(RemoteFile(system.unstrip_protocol(one)) for one in sorted(found))


def stamps(files: Iterable[RemoteFile]) -> dict[RemoteFile, str]:
    """Digests of sizes, times and tags: of files, or of those in a folder or pattern.

    Files of one folder are looked at together, which takes one request for a thousand of them.

    Returns
    -------
    dict of RemoteFile to str
        Without those that cannot be looked at.
    """
    files = list(files)
    folders: dict[str, list[RemoteFile]] = {}
    for file in files:
        folders.setdefault(file.url.rpartition("/")[0], []).append(file)
    known: dict[str, list[dict[str, Any]]] = {}
    for folder, inside in folders.items():
        if len(inside) > 1 and not inside[0].is_web:
            # Who may read files may not list them, perhaps.
            with contextlib.suppress(ModalMotionError), explained(inside[0]):
                system, path = system_of(RemoteFile(folder))
                for info in system.ls(path, detail=True):
                    if info["type"] == "file":
                        known[system.unstrip_protocol(info["name"])] = [info]

    def stamp(file: RemoteFile) -> str:
        infos = known.get(file.url)
        if infos is None:
            with contextlib.suppress(ModalMotionError), explained(file):
                infos = infos_of(*system_of(file), file)
        if infos is None:
            return ""
        seen = [
            (str(one["name"]), [str(one[key]) for key in _STAMPS if one.get(key) is not None])
            for one in infos
        ]
        return hashlib.sha256(repr(seen).encode()).hexdigest()[:16]

    with ThreadPoolExecutor(_TOGETHER) as pool:
        found = dict(zip(files, pool.map(stamp, files), strict=True))
    return {file: text for file, text in found.items() if text}


def infos_of(system: Any, path: str, file: RemoteFile) -> list[dict[str, Any]]:
    """Look at a file, or at those in a folder or a pattern, by name; a name is its path."""
    if file.is_pattern:
        found = list(system.glob(path, detail=True).values())
    else:
        info = system.info(path)
        if info["type"] != "directory":
            return [{**info, "name": path}]
        found = [one for one in system.ls(path, detail=True) if one["name"].rstrip("/") != path]
    infos = [one for one in found if one["type"] == "file"]
    if not infos:
        raise FileNotFoundError(path)
    return sorted(infos, key=lambda one: str(one["name"]))


def system_of(file: RemoteFile) -> tuple[Any, str]:
    """Give the file system of a URL, and the file's path in it.

    Raises
    ------
    MissingExtraError
        If a package for it is absent.
    ParameterError
        If there is none.
    """
    with needs_extra("remote"):
        import fsspec
    try:
        # What was listed before is looked at again: files come, change and go.
        system, path = fsspec.core.url_to_fs(file.url, use_listings_cache=False)
    except ImportError as error:
        raise _missing(file) from error
    except ValueError as error:
        raise ParameterError(
            f"'{file.shown}' cannot be reached: nothing here knows {urlsplit(file.url).scheme}.",
            remedy="Name s3://bucket/name, https://host/name or the like.",
        ) from error
    return system, path.rstrip("/")


def _missing(file: RemoteFile) -> MissingExtraError:
    """Make the error for a file system whose package is not installed."""
    scheme = urlsplit(file.url).scheme.lower()
    package = _PACKAGES.get(scheme)
    if package is None:
        what = f"a package for {scheme}"
        remedy = f"Install what fsspec needs for {scheme}, or copy the files to s3:// or here."
    else:
        what = f"{package}, the package for {scheme},"
        remedy = (
            f"Install it: {install_command(package)}; or what http, https and s3 need together: "
            "pip install fsspec aiohttp s3fs."
        )
    return MissingExtraError(
        f"'{file.shown}' cannot be reached: {what} is not installed.",
        remedy=remedy,
        details={"extra": "remote", "package": package},
    )


class PassingError(MalformedFileError):
    """A connection broke: it may be there in a moment."""


@contextlib.contextmanager
def explained(file: RemoteFile) -> Iterator[None]:
    """Raise what a file system raises in the block as an error that names the file."""
    try:
        yield
    except ModalMotionError:
        raise
    except Exception as error:
        raise _told(file, error) from error


def _told(file: RemoteFile, error: Exception) -> ModalMotionError:
    # Not what the error says: it may hold the whole URL with its signature.
    if file.is_web and isinstance(error.__cause__, Exception):
        # Whatever a look at a web server meets is given as a file that is not there.
        error = error.__cause__
    kinds = {kind.__name__ for kind in type(error).__mro__}
    status = getattr(error, "status", None)
    if isinstance(error, FileNotFoundError) or status == HTTPStatus.NOT_FOUND:
        return MalformedFileError(
            f"'{file.shown}' is not there: the bucket or host does not know the name, or it has "
            "gone since it was listed.",
            remedy="Check the name, then run the same command again.",
        )
    refused = (HTTPStatus.UNAUTHORIZED, HTTPStatus.FORBIDDEN)
    if isinstance(error, PermissionError) or kinds & _NO_CREDENTIALS or status in refused:
        return MalformedFileError(
            f"'{file.shown}' may not be used with the credentials here, or there are none.",
            remedy="State them where its file system looks, on every machine that reads: for s3 in "
            "AWS_PROFILE, or in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY; for a public bucket "
            "set FSSPEC_S3_ANON=true.",
        )
    if isinstance(error, NotImplementedError):
        return MalformedFileError(
            f"What '{file.shown}' lies in cannot do this.",
            remedy="Copy the files to s3:// or to this machine.",
        )
    reason = getattr(error, "strerror", None) or type(error).__name__
    return PassingError(
        f"The connection to '{file.shown}' failed or broke ({str(reason)[:100]}).",
        remedy="Run the same command again: only unfinished files are processed. If it fails "
        "again, check the network, and for a store of your own AWS_ENDPOINT_URL.",
    )
