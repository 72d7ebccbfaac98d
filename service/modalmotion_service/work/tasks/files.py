"""What all tasks do with files: load what a signature was made of, draw, write, tell progress."""

from __future__ import annotations

import asyncio
import contextlib
import io
import json
import secrets
import time
from collections.abc import Awaitable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final, TypeVar

from modalmotion import store
from modalmotion.mesh.facts import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, StageReport, as_share
from modalmotion.signature.making import ModalSignature
from modalmotion.template import Template

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Give a path to write to; what was written is at `path` as a whole or not at all.

    A worker that is thought lost may still be at the same work as the one in its place. One that
    dies leaves a file whose name begins as that of `path`, which the server removes.
    """
    temporary = path.with_name(f"{path.name}.{secrets.token_hex(8)}")
    try:
        yield temporary
        temporary.replace(path)
    except BaseException:
        temporary.unlink(missing_ok=True)
        raise


def write_whole(path: Path, data: bytes) -> None:
    """Write a file as `whole_file` has it."""
    with whole_file(path) as temporary:
        temporary.write_bytes(data)


def png_of(figure: Figure) -> bytes:
    """Draw a figure as PNG."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()


def loaded_sequence(sequence: Path, track: Path | None) -> MeshSequence:
    """Load a kept sequence; with its track, where one made it, it says how far it may be off."""
    loaded = store.sequence_from_hdf5(sequence)
    if track is None:
        return loaded
    return replace(loaded, uncertainty=store.track_from_hdf5(track).sequence.uncertainty)


# One, for it may be as large as an upload, and is held until another owner's work.
@lru_cache(maxsize=1)
def named_template(template: Path | None) -> Template | None:
    """Load the template that parameters name, once for all tasks of this process."""
    # The path ends with the template's id, which represents its content.
    return None if template is None else store.template_from_hdf5(template)


@dataclass(frozen=True)
class Fitted:
    """A signature in a file; a worker reads it and what it was made of.

    Parameters
    ----------
    signature, sequence : Path
    template : Path or None
        That its parameters name.
    track : Path or None
        That made the sequence.
    record : SequenceRecord
    """

    signature: Path
    sequence: Path
    template: Path | None
    track: Path | None
    record: store.SequenceRecord

    @property
    def facts(self) -> Facts:
        """Facts of the sequence, which kept files lack."""
        return self.record.facts

    @property
    def title(self) -> str:
        """What a person calls the sequence; empty if nobody said."""
        return self.record.name or self.record.subject or ""

    def read_signature(self) -> ModalSignature:
        """Read the signature, with the facts."""
        return replace(store.signature_from_hdf5(self.signature), facts=self.facts)

    def read_sequence(self) -> MeshSequence:
        """Read the sequence, with the facts and what its track says of its positions."""
        return loaded_sequence(self.sequence, self.track).with_facts(self.facts)

    def read_template(self) -> Template | None:
        """Read the template that is named; None for one of the sequence's own."""
        return None if self.template is None else store.template_from_hdf5(self.template)


T = TypeVar("T")

_POLL_SECONDS: Final = 0.25

# What is told sooner after the last time is not written.
_LEAST_SECONDS: Final = 0.1


class ProgressFile:
    """A file that a worker adds lines to, and that the server reads on from where it was.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._written = -_LEAST_SECONDS
        self._text = ""
        self._share = 0.0
        self._n_read = 0

    def write(self, share: float, text: str = "") -> None:
        """Write the share that is done, 0 to 1, and what is done now."""
        now = time.monotonic()
        # What is done now is always told: it may last. So is that something is done at all, or
        # quick work would go from nothing to its end.
        is_news = text != self._text or (self._share == 0.0 and share > 0.0)
        if not is_news and now - self._written < _LEAST_SECONDS:
            return
        self._written, self._text, self._share = now, text, share
        # No work fails because nobody can be told how far it is.
        with contextlib.suppress(OSError), self._path.open("a") as file:
            file.write(json.dumps([share, text]) + "\n")

    def of(self, stage: str) -> Progress:
        """Return a callback that writes how much of a stage is done."""
        return as_share(lambda share: self.write(share, stage))

    def news(self) -> list[tuple[float, str]]:
        """Give what was told since the last call, in its order."""
        try:
            with self._path.open("rb") as file:
                file.seek(self._n_read)
                # The last line may be half-written.
                whole = file.read().rpartition(b"\n")[0]
        except OSError:
            return []
        self._n_read += len(whole) + bool(whole)
        told: list[tuple[float, str]] = []
        for line in whole.splitlines():
            # A worker that was killed may have left half a line.
            with contextlib.suppress(ValueError):
                share, text = json.loads(line)
                told.append((min(max(float(share), 0.0), 1.0), str(text)))
        return told


async def followed(work: Awaitable[T], path: Path, report: StageReport) -> T:
    """Wait for work, and report what its worker tells: all of it, however fast the work is.

    Parameters
    ----------
    work : awaitable
        Cancelled with what waits for it.
    path : Path
        Of the `ProgressFile` that the worker writes; what others wrote to it is removed.
    report : callable
        Called now and again with what `ProgressFile.news` gives.
    """
    path.unlink(missing_ok=True)
    task, file = asyncio.ensure_future(work), ProgressFile(path)
    try:
        is_done = False
        while not is_done:
            is_done = bool((await asyncio.wait([task], timeout=_POLL_SECONDS))[0])
            for share, text in file.news():
                report(share, text)
        return await task
    except asyncio.CancelledError:
        task.cancel()
        raise
