"""Request bodies, sent in pieces, and again for a retry."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from modalmotion.errors import MalformedFileError
from modalmotion.formats.npz import write_npz
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress

Source = str | Path | bytes | bytearray | memoryview | MeshSequence
"""Source of an upload: a file by its path, the bytes of a file, or a sequence."""

# Large enough that Python's overhead is small, small enough that copies do not matter.
_PIECE: Final = 1 << 18


@dataclass(frozen=True)
class Body:
    """The body of a request.

    Parameters
    ----------
    pieces : function
        Yields the body from its beginning, at each call.
    n_bytes : int
        Total that progress counts up to.
    length : int or None
        Bytes sent over the wire; None if known only at the end.
    media_type : str
    """

    pieces: Callable[[], Iterator[bytes]]
    n_bytes: int
    length: int | None
    media_type: str = "application/octet-stream"

    def sent(self, progress: Progress | None) -> Iterator[bytes]:
        """Yield the pieces, and report progress after each."""
        done = 0
        for piece in self.pieces():
            yield piece
            done += len(piece)
            if progress is not None:
                progress(min(done, self.n_bytes), self.n_bytes)


def body_of(source: Source) -> Body:
    """Make the body of a source: a file is read as it is sent, a sequence written beforehand.

    Raises
    ------
    MalformedFileError
        If the file cannot be read.
    """
    if isinstance(source, MeshSequence):
        source = write_npz(source)
    if isinstance(source, (bytes, bytearray, memoryview)):
        view = memoryview(source).cast("B")
        return Body(lambda: _slices(view), len(view), len(view))
    path = Path(source)
    try:
        n_bytes = path.stat().st_size
    except OSError as error:
        raise _unreadable(path, error) from error
    return Body(lambda: _file_pieces(path), n_bytes, n_bytes)


def json_body(value: object) -> Body:
    """Make the body of a JSON value."""
    text = json.dumps(value).encode()
    return Body(lambda: iter([text]), len(text), len(text), "application/json")


def _slices(view: memoryview) -> Iterator[bytes]:
    for start in range(0, len(view), _PIECE):
        yield bytes(view[start : start + _PIECE])


def _file_pieces(path: Path) -> Iterator[bytes]:
    try:
        with path.open("rb") as file:
            while piece := file.read(_PIECE):
                yield piece
    except OSError as error:
        raise _unreadable(path, error) from error


def _unreadable(path: Path, error: OSError) -> MalformedFileError:
    return MalformedFileError(
        f"'{path.name}' cannot be read: {error.strerror}.", remedy="Name a file to send."
    )
