"""What a request contains: bodies sent in pieces, and options as a query or as JSON."""

from __future__ import annotations

import io
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError, ParameterError
from modalmotion.formats.npz import write_npz
from modalmotion.mesh import Facts, facts_as_json
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress, Reporter

Source = str | Path | bytes | bytearray | memoryview | MeshSequence
"""Source of an upload: a file by its path, the bytes of a file, or a sequence."""

# Large enough that Python's overhead is small, small enough that copies do not matter.
_PIECE: Final = 1 << 18


@dataclass(frozen=True)
class Body:
    """The body of a request.

    Parameters
    ----------
    source : bytes or Path
        A file is read a piece at a time, from its beginning at each attempt.
    n_bytes : int
    media_type : str
    """

    source: bytes | Path
    n_bytes: int
    media_type: str = "application/octet-stream"

    def sent(self, progress: Reporter | None) -> Iterator[bytes]:
        """Yield the pieces, and report progress after each."""
        done, source = 0, self.source
        try:
            with io.BytesIO(source) if isinstance(source, bytes) else source.open("rb") as file:
                while piece := file.read(_PIECE):
                    yield piece
                    done += len(piece)
                    if progress is not None:
                        progress(Progress(min(done, self.n_bytes), self.n_bytes))
        except OSError as error:
            if not isinstance(source, Path):
                raise
            raise _unreadable(source, error) from error


def body_of(source: Source) -> Body:
    """Make the body of a source: a file is read as it is sent, a sequence written beforehand.

    Raises
    ------
    MalformedFileError
        If the file cannot be read.
    """
    if isinstance(source, MeshSequence):
        source = write_npz(source)
    if isinstance(source, bytes | bytearray | memoryview):
        return Body(data := bytes(source), len(data))
    path = Path(source)
    try:
        return Body(path, path.stat().st_size)
    except OSError as error:
        raise _unreadable(path, error) from error


def json_body(value: object) -> Body:
    """Make the body of a JSON value."""
    text = json.dumps(value).encode()
    return Body(text, len(text), "application/json")


def _unreadable(path: Path, error: OSError) -> MalformedFileError:
    return MalformedFileError(
        f"'{path.name}' cannot be read: {error.strerror}.", remedy="Name a file to send."
    )


Option = Any
"""Value of an option, as JSON, NumPy or an enumeration has it; None is the default of the
service. Facts are several options at once."""

# Neither a separator, nor the end of a path, nor a name such as "..".
_SEGMENT: Final = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9._@-]{0,199}")


def segment(name: str) -> str:
    """Check an id that becomes part of a path: it names one thing, and leads nowhere else.

    Raises
    ------
    ParameterError
        If it is not a valid id.
    """
    if _SEGMENT.fullmatch(name) is None:
        raise ParameterError(
            f"{name[:80]!r} cannot be an id.", remedy="Use an id from the service."
        )
    return name


def plain(options: Mapping[str, Option]) -> dict[str, Any]:
    """Write options as the members of a JSON body: arrays as lists, NaN as null."""
    members: dict[str, Any] = {}
    for name, value in options.items():
        if isinstance(value, Facts):
            stated = facts_as_json(value)
            members |= {fact: stated[fact] for fact in value.stated}
        elif value is not None:
            members[name] = _plain(value)
    return members


def query_of(options: Mapping[str, Option]) -> dict[str, str]:
    """Write options as a query: 32,64 for a grid, true, false, objects as JSON."""
    return {name: _text(value) for name, value in plain(options).items()}


def _plain(value: Any) -> Any:
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {str(name): _plain(one) for name, one in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, tuple | list):
        parts = [_plain(one) for one in value]
        # A place that is not known, in a list of places.
        is_place = all(part is None or isinstance(part, int | float) for part in parts)
        return None if is_place and None in parts else parts
    return None if isinstance(value, float) and value != value else value


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list) and not any(isinstance(one, list | dict) for one in value):
        return ",".join(str(part) for part in value)
    return json.dumps(value) if isinstance(value, list | dict) else str(value)
