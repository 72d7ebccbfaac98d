"""GLB: a JSON document and one block of bytes in one file (glTF 2.0, chapter 4)."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

from modalmotion.errors import LimitError, MalformedFileError

_MAGIC: Final = b"glTF"
_VERSION: Final = 2
_JSON: Final = b"JSON"
_BINARY: Final = b"BIN\x00"

_MOST: Final = {"nodes": 10_000, "mesh nodes": 200, "parts of meshes": 1_000, "arrays": 20_000}

malformed: Final = partial(
    MalformedFileError, remedy="Export the animation again as binary glTF (.glb)."
)
"""Error for a file that cannot be read."""


@dataclass(frozen=True, eq=False)
class Container:
    """The two parts of a GLB file.

    Parameters
    ----------
    document : dict
        As in the file, unchecked.
    binary : memoryview
    """

    document: dict[str, Any]
    binary: memoryview
    _counts: Counter[str] = field(default_factory=Counter)

    def count(self, what: str) -> None:
        """Count one more use of the file's parts: a few bytes may name the same one again.

        Parameters
        ----------
        what : {"nodes", "mesh nodes", "parts of meshes", "arrays"}

        Raises
        ------
        LimitError
            If these are more than an animation of one surface needs.
        """
        self._counts[what] += 1
        if self._counts[what] > (most := _MOST[what]):
            raise too_much(f"uses more than {most} {what}", most)

    def item(self, kind: str, index: Any) -> dict[str, Any]:
        """Object of the document by its list and place in it.

        Raises
        ------
        MalformedFileError
            If it does not exist.
        """
        listed = self.document.get(kind)
        is_place = isinstance(index, int) and not isinstance(index, bool)
        if not (is_place and isinstance(listed, list) and 0 <= index < len(listed)):
            raise malformed(f"The GLB file names {kind}[{str(index)[:20]}], which is not there.")
        member = listed[index]
        if not isinstance(member, dict):
            raise malformed(f"The GLB file's {kind}[{index}] is not an object.")
        return member


def read_container(data: bytes) -> Container:
    """Split a GLB file into its parts.

    Raises
    ------
    MalformedFileError
        If it is cut, of another version, or its document cannot be read.
    """
    if data[:4] != _MAGIC or len(data) < 20:
        raise malformed(f"These {len(data)} bytes are not a GLB file.")
    version = int.from_bytes(data[4:8], "little")
    length = int.from_bytes(data[8:12], "little")
    if version != _VERSION or length != len(data):
        raise malformed(
            f"The GLB file declares version {version} and {length} bytes; {len(data)} are there "
            f"(version {_VERSION} is read)."
        )
    view = memoryview(data)
    parts: dict[bytes, memoryview] = {}
    at = 12
    while at < len(data):
        size = int.from_bytes(data[at : at + 4], "little")
        kind = data[at + 4 : at + 8]
        if len(kind) != 4 or at + 8 + size > len(data):
            raise malformed("A part of the GLB file is cut short.")
        parts.setdefault(kind, view[at + 8 : at + 8 + size])
        at += 8 + size
    try:
        document = json.loads(bytes(parts[_JSON]), parse_constant=_no_constant)
    except (KeyError, ValueError, RecursionError) as error:
        raise malformed(f"The GLB file's document cannot be read ({str(error)[:80]}).") from error
    if not isinstance(document, dict):
        raise malformed("The GLB file's document is not an object.")
    return Container(document, parts.get(_BINARY, memoryview(b"")))


def write_container(document: dict[str, Any], binary: bytes) -> bytes:
    """Join the parts of a GLB file; `binary` is a whole number of 4 bytes."""
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    length = 12 + 8 + len(text) + 8 + len(binary)
    header = _MAGIC + _VERSION.to_bytes(4, "little") + length.to_bytes(4, "little")
    return b"".join(
        (
            header,
            len(text).to_bytes(4, "little") + _JSON,
            text,
            len(binary).to_bytes(4, "little") + _BINARY,
            binary,
        )
    )


def too_much(what: str, most: int) -> LimitError:
    """Make the error for a scene that is larger than an animation of one surface."""
    return LimitError(
        f"The GLB file {what}.",
        remedy="Export the moving surface alone, as one mesh without bones, cameras or lights.",
        limit="gltf_nodes",
        details={"most": most},
    )


def _no_constant(name: str) -> float:
    raise ValueError(f"{name} is not a number in JSON")
