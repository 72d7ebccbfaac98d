"""Request bodies, sent in pieces, and again for a retry."""

from __future__ import annotations

import io
import json
import secrets
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.errors import MalformedFileError
from modalmotion.formats.npz import npz_arrays
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
    """Make the body of a source, without copying the whole.

    Raises
    ------
    MalformedFileError
        If the file cannot be read.
    """
    if isinstance(source, MeshSequence):
        arrays = {name: np.asarray(array) for name, array in npz_arrays(source).items()}
        n_bytes = sum(array.nbytes for array in arrays.values())
        return Body(lambda: _npz_pieces(arrays), n_bytes, None)
    if isinstance(source, (bytes, bytearray, memoryview)):
        view = memoryview(source).cast("B")
        return Body(lambda: _slices(view), len(view), len(view))
    path = Path(source)
    try:
        n_bytes = path.stat().st_size
    except OSError as error:
        raise _unreadable(path, error) from error
    return Body(lambda: _file_pieces(path), n_bytes, n_bytes)


def form_body(files: Sequence[tuple[str, Body]], manifest: str | None = None) -> Body:
    """Make the body of a form with many files, each sent in pieces.

    Parameters
    ----------
    files : sequence of (str, Body)
        With their names.
    manifest : str, optional
        CSV that describes them.
    """
    boundary = secrets.token_hex(16)

    def pieces() -> Iterator[bytes]:
        for name, body in files:
            # As browsers write names: percent signs for what would end them.
            plain = name.replace("\r", "%0D").replace("\n", "%0A").replace('"', "%22")
            yield (
                f'--{boundary}\r\nContent-Disposition: form-data; name="files"; '
                f'filename="{plain}"\r\nContent-Type: application/octet-stream\r\n\r\n'
            ).encode()
            yield from body.pieces()
            yield b"\r\n"
        if manifest is not None:
            yield (
                f'--{boundary}\r\nContent-Disposition: form-data; name="manifest"\r\n\r\n'
                f"{manifest}\r\n"
            ).encode()
        yield f"--{boundary}--\r\n".encode()

    n_bytes = sum(body.n_bytes for _, body in files)
    return Body(pieces, n_bytes, None, f"multipart/form-data; boundary={boundary}")


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


def _npz_pieces(arrays: dict[str, np.ndarray[Any, Any]]) -> Iterator[bytes]:
    """Write an .npz archive as it is sent; the same bytes each time."""
    sink = _Sink()
    with zipfile.ZipFile(sink, "w", zipfile.ZIP_STORED) as archive:
        for name, array in arrays.items():
            # A fixed date: a repeated request must be the same bytes.
            info = zipfile.ZipInfo(f"{name}.npy", date_time=(1980, 1, 1, 0, 0, 0))
            with archive.open(info, "w", force_zip64=True) as member:
                whole = np.ascontiguousarray(array)
                member.write(_npy_header(array))
                if whole.size:
                    for piece in _slices(whole.reshape(-1).view(np.uint8).data):
                        member.write(piece)
                        yield sink.take()
    yield sink.take()


def _npy_header(array: np.ndarray[Any, Any]) -> bytes:
    head = io.BytesIO()
    fields = {"descr": array.dtype.str, "fortran_order": False, "shape": array.shape}
    np.lib.format.write_array_header_1_0(head, fields)  # type: ignore[no-untyped-call]
    return head.getvalue()


class _Sink(io.RawIOBase):
    """A stream that cannot be rewound, and hands over the bytes written to it."""

    def __init__(self) -> None:
        self._pieces: list[bytes] = []

    def writable(self) -> bool:
        return True

    def write(self, data: Any) -> int:
        self._pieces.append(bytes(data))
        return len(data)

    def take(self) -> bytes:
        content = b"".join(self._pieces)
        self._pieces.clear()
        return content


def _unreadable(path: Path, error: OSError) -> MalformedFileError:
    return MalformedFileError(
        f"'{path.name}' cannot be read: {error.strerror}.", remedy="Name a file to send."
    )
