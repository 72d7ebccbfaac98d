"""Many sequences that are sent together, and what comes back for each."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Generic, TypeVar

from modalmotion.client.bodies import Body, Source, body_of
from modalmotion.client.connection import Answer
from modalmotion.client.errors import RemoteError, remote_error, understood
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature

T = TypeVar("T")

ZIP: Final = "application/zip"

_RESULTS: Final = "results.json"
# What a form adds to a file.
_HEAD_BYTES: Final = 1000


@shown("name", "value", "error")
@dataclass(frozen=True)
class SentResult(Generic[T]):
    """The result of one of many files, or why there is none.

    Parameters
    ----------
    name : str
        Of the file.
    value : T or None
    error : RemoteError or None
        As a call for this file alone would have raised it.
    """

    name: str
    value: T | None
    error: RemoteError | None

    def require(self) -> T:
        """Return the value.

        Raises
        ------
        RemoteError
            If there is none.
        """
        if self.value is None:
            assert self.error is not None  # noqa: S101 (one of both is there)
            raise self.error
        return self.value


def named_bodies(sources: Mapping[str, Source] | Iterable[Source]) -> list[tuple[str, Body]]:
    """Name sources, those without a name of their own by their numbers."""
    if isinstance(sources, Mapping):
        return [(name, body_of(source)) for name, source in sources.items()]
    return [
        (Path(one).name if isinstance(one, (str, Path)) else str(number), body_of(one))
        for number, one in enumerate(sources)
    ]


def in_requests(
    files: list[tuple[str, Body]], most_files: int, most_bytes: int
) -> Iterator[list[tuple[str, Body]]]:
    """Part files into as few requests as the limits allow; one too large is sent by itself."""
    waiting: list[tuple[str, Body]] = []
    n_bytes = 0
    for file in files:
        size = file[1].n_bytes + _HEAD_BYTES
        if waiting and (len(waiting) == most_files or n_bytes + size > most_bytes):
            yield waiting
            waiting, n_bytes = [], 0
        waiting.append(file)
        n_bytes += size
    if waiting:
        yield waiting


def signatures_in(answer: Answer) -> list[SentResult[ModalSignature]]:
    """Read the signatures of an archive, each the library's own."""
    from modalmotion.store import signature_from_hdf5

    with (
        understood("an archive of signatures"),
        zipfile.ZipFile(io.BytesIO(answer.content)) as archive,
    ):
        return [
            SentResult(
                str(one["name"]),
                None if one["file"] is None else signature_from_hdf5(archive.read(one["file"])),
                _error_of(one["error"]),
            )
            for one in json.loads(archive.read(_RESULTS))["results"]
        ]


def results_in(answer: Answer, member: str, read: Callable[[Any], T]) -> list[SentResult[T]]:
    """Read the results of a list, each by a function of its JSON."""
    with understood("a list of results"):
        return [
            SentResult(
                str(one["name"]),
                None if one[member] is None else read(one[member]),
                _error_of(one["error"]),
            )
            for one in answer.json["results"]
        ]


def _error_of(problem: dict[str, Any] | None) -> RemoteError | None:
    return None if problem is None else remote_error(problem, int(problem["status"]), "")
