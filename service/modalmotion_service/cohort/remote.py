"""Files that lie elsewhere: on S3, behind a web server, or in what else fsspec reaches.

Recordings and manifests are read from there, and packs written to there. Results, their index and
the list of finished work are files and a database of this machine: neither SQLite nor HDF5 can be
written into an object store.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final
from urllib.parse import urlsplit

from modalmotion.errors import ParameterError

WEB: Final = ("http", "https")

_URL: Final = re.compile(r"[A-Za-z][A-Za-z0-9+.-]*://")
_WILD: Final = frozenset("*?[")


@dataclass(frozen=True)
class RemoteFile:
    """A file, a folder of frames or a pattern of their names that lies elsewhere.

    Parameters
    ----------
    url : str
    """

    url: str

    def __str__(self) -> str:
        return self.url

    @property
    def name(self) -> str:
        """Last part of its path."""
        return PurePosixPath(self.shown).name

    @property
    def shown(self) -> str:
        """The URL for messages, without the query, which may be signed."""
        return self.url.partition("?")[0] if self.is_web else self.url

    @property
    def is_pattern(self) -> bool:
        """Whether it has signs that stand for others; those of a query do not."""
        return bool(_WILD & set(self.shown))

    def beside(self, name: str) -> RemoteFile:
        """Name a file from this one's folder."""
        return RemoteFile(f"{self.shown.rpartition('/')[0]}/{name}")

    @property
    def is_web(self) -> bool:
        """Whether a web server has it, whose folders are pages."""
        return urlsplit(self.url).scheme.lower() in WEB


Source = Path | RemoteFile


def is_url(text: str) -> bool:
    """Tell whether a text is a URL, and not a path of this machine."""
    return _URL.match(text) is not None


def source_of(text: str) -> Source:
    """Give a path of this machine, or a file that lies elsewhere.

    Raises
    ------
    ParameterError
        If it is a URL that cannot be used.
    """
    if not is_url(text):
        return Path(text)
    parts = urlsplit(text)
    if "@" in parts.netloc and parts.scheme.lower() not in ("abfs", "abfss"):
        raise ParameterError(
            "A URL with a name or a password in it would be kept in the cohort's table.",
            remedy="Leave them out of the URL, and state them where its file system looks: for s3 "
            "in AWS_PROFILE, or in AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY.",
        )
    if "::" in text or "\0" in text or parts.scheme.lower() in ("file", "local"):
        raise ParameterError(
            f"'{text[:80]}' is not a URL of a file that lies elsewhere.",
            remedy="Name s3://bucket/name, https://host/name or the like; files of this machine by "
            "their paths.",
        )
    return RemoteFile(text)
