"""Common parts of all groups of calls."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, TypeVar

from modalmotion.client.bodies import Source, form_body
from modalmotion.client.connection import Answer, Call, Connection
from modalmotion.client.errors import BrokenAnswerError, understood
from modalmotion.client.jobs import Job, JobStatus, awaited
from modalmotion.client.many_files import SentResult, in_requests, named_bodies
from modalmotion.client.query import Option, segment
from modalmotion.errors import ParameterError, StoreError
from modalmotion.formats.npz import read_npz
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress

T = TypeVar("T")

JSON: Final = "application/json"
HDF5: Final = "application/x-hdf5"
NPZ: Final = "application/x-npz"
PNG: Final = "image/png"
CSV: Final = "text/csv"
MARKDOWN: Final = "text/markdown"
STREAM: Final = "application/vnd.modalmotion.stream"


class Calls:
    """A group of calls to one service.

    Parameters
    ----------
    connection : Connection
    """

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def _get(
        self, path: str, query: Mapping[str, Option] | None = None, accept: str = JSON
    ) -> Answer:
        return self._awaited(Call("GET", path, query, accept), lambda answer: answer)

    def _sent(self, call: Call, read: Callable[[Answer], T], progress: Progress | None) -> T:
        """Send a file along, and wait for what is made of it."""
        return awaited(self._connection, self._connection.send(call, progress), read, call.accept)

    def _awaited(
        self,
        call: Call,
        read: Callable[[Answer], T],
        progress: Callable[[float], None] | None = None,
    ) -> T:
        return awaited(self._connection, self._connection.send(call), read, call.accept, progress)

    def _started(
        self, call: Call, read: Callable[[Answer], T], progress: Progress | None = None
    ) -> Job[T]:
        """Start a call as a job of the service.

        Raises
        ------
        BrokenAnswerError
            If it answers with the result at once.
        """
        answer = self._connection.send(call.with_headers(Prefer="respond-async"), progress)
        if answer.status != 202:
            raise BrokenAnswerError(
                f"The service answered {answer.status} and started no job.",
                remedy="Make the call that waits for its result.",
            )
        return Job(self._connection, JobStatus.of(answer.json), read, call.accept)

    def _of_many(
        self,
        asked: tuple[str, str],
        sources: Mapping[str, Source] | Iterable[Source],
        manifest: str | None,
        read: Callable[[Answer], list[SentResult[T]]],
        progress: Progress | None,
        options: Mapping[str, Option],
    ) -> list[SentResult[T]]:
        """Send many files to a path for an answer of a type, in as few requests as are allowed."""
        files = named_bodies(sources)
        with understood("a list of limits"):
            limits = self._get("/v1/limits").json
            most = int(limits["batch_files"]), int(limits["body_bytes"])
        requests = list(in_requests(files, *most))
        if manifest is not None and len(requests) > 1:
            raise ParameterError(
                f"{len(files)} files with a manifest do not fit into one request.",
                remedy="Send them in parts, each with a manifest of its own files.",
            )
        path, accept = asked
        results: list[SentResult[T]] = []
        for part in requests:
            body = form_body(part, manifest)
            call = Call("POST", path, options, accept, body, is_repeatable=True)
            answers = self._awaited(call, read)
            with understood("as many results as files"):
                # By the names that they have here: a form's may be written otherwise.
                results += [
                    replace(one, name=name) for (name, _), one in zip(part, answers, strict=True)
                ]
            if progress is not None:
                progress(len(results), len(files))
        return results

    def _pages(self, path: str, member: str, **query: Option) -> Iterator[dict[str, Any]]:
        """Yield the members of a list, page by page."""
        cursor: str | None = None
        while True:
            page = self._get(path, {**query, "cursor": cursor}).json
            with understood(f"a page of {member}"):
                members, following = list(page[member]), page["cursor"]
            yield from members
            if following is None:
                return
            if following == cursor:
                raise BrokenAnswerError(
                    f"The service gives the same page of {member} again and again.",
                    remedy="Check the version of the service.",
                )
            cursor = following


def sequence_path(sequence_id: str, *parts: str) -> str:
    """Path of a stored sequence, or of something that belongs to it."""
    return "/".join(("/v1/sequences", segment(sequence_id), *parts))


def sequence_of(answer: Answer) -> MeshSequence:
    """Read a sequence from an .npz answer."""
    return read_npz(answer.content).sequence


def save(content: bytes, path: Path) -> None:
    """Write a file, all of it or none.

    Raises
    ------
    StoreError
        If it cannot be written.
    """
    part = path.with_name(f"{path.name}.part")
    try:
        part.write_bytes(content)
        part.replace(path)
    except OSError as error:
        part.unlink(missing_ok=True)
        raise StoreError(
            f"'{path.name}' cannot be written: {error.strerror}.",
            remedy="Check its folder, and the room on its disk.",
        ) from error


def require_place(path: Path) -> None:
    """Check that a file can be written there, before anything is asked for.

    Raises
    ------
    StoreError
        If there is no such folder, or a folder of that name.
    """
    reason = None
    if not path.parent.is_dir():
        reason = f"there is no folder '{path.parent}'"
    elif path.is_dir():
        reason = "it is a folder"
    elif not os.access(path.parent, os.W_OK):
        reason = f"the folder '{path.parent}' may not be written to"
    if reason is not None:
        raise StoreError(
            f"'{path.name}' cannot be written: {reason}.",
            remedy="Make the folder, or name a file in another one.",
        )


def require_suffix(path: Path, known: dict[str, str]) -> str:
    """Media type that a file's suffix stands for.

    Raises
    ------
    ParameterError
        If the suffix is unknown.
    StoreError
        If the file cannot be written there.
    """
    require_place(path)
    media_type = known.get(path.suffix.lower())
    if media_type is None:
        raise ParameterError(
            f"'{path.name}' has an unknown suffix.", remedy=f"Use one of {', '.join(known)}."
        )
    return media_type
