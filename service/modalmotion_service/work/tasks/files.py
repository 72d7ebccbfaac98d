"""What all tasks do with files: load what a signature was made of, draw, write, tell progress."""

from __future__ import annotations

import contextlib
import json
import secrets
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Final

from pydantic_core import from_json

from modalmotion import store
from modalmotion.exports.reading import picture_bytes
from modalmotion.mesh.facts import Facts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress
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
    return picture_bytes(figure, "png")


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
        The second is not read where the record says that no vertices are kept.
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
        return named_template(self.template)


# What is told sooner after the last time is not written.
_LEAST_SECONDS: Final = 0.1


class ProgressFile:
    """A file in which a worker states how far it is, and that the server reads now and again.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._stage, self._written = "", -_LEAST_SECONDS

    def write(self, progress: Progress) -> None:
        """Write the share that is done, 0 to 1, and what is done now."""
        now = time.monotonic()
        # A new stage is always told: it may last.
        if progress.stage == self._stage and now - self._written < _LEAST_SECONDS:
            return
        self._stage, self._written = progress.stage, now
        # No work fails because nobody can be told how far it is.
        with contextlib.suppress(OSError):
            self._path.write_text(json.dumps([progress.share, progress.stage]))

    def read(self) -> Progress | None:
        """Give what was told last; None if nothing was, or it is just being written."""
        with contextlib.suppress(OSError, ValueError, TypeError):
            share, stage = from_json(self._path.read_bytes())
            return Progress(min(max(float(share), 0.0), 1.0), stage=str(stage))
        return None
