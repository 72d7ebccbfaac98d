"""GLB: a JSON document, one block of bytes, and the arrays in it (glTF 2.0, chapters 3.6 and 4)."""

from __future__ import annotations

import json
import math
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.limits import ReadLimits

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
    parts = [
        part
        for kind, data in ((_JSON, text), (_BINARY, binary))
        for part in (len(data).to_bytes(4, "little"), kind, data)
    ]
    length = 12 + sum(map(len, parts))
    return b"".join((_MAGIC, _VERSION.to_bytes(4, "little"), length.to_bytes(4, "little"), *parts))


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


_TYPES: Final[dict[object, str]] = dict(
    zip((5120, 5121, 5122, 5123, 5125, 5126), ("i1", "u1", "<i2", "<u2", "<u4", "<f4"), strict=True)
)
_SIZES: Final[dict[object, int]] = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


def read_accessor(
    container: Container,
    index: object,
    n_components: int,
    limits: ReadLimits,
    limit: str | None = None,
    items_each: int = 1,
) -> NDArray[Any]:
    """Read an accessor.

    Parameters
    ----------
    container : Container
    index : int
        Its place in the document's list.
    n_components : int
        Required numbers of each item.
    limits : ReadLimits
        `decompressed_bytes` applies to it, as numbers of 8 bytes.
    limit : {"frames", "vertices", "faces"}, optional
        Further limit, on the number of its items divided by `items_each`.
    items_each : int

    Returns
    -------
    (count, n_components) ndarray
        float64 for floats and normalised integers, else the integers as they are.

    Raises
    ------
    MalformedFileError
        If it leads out of the file, or is of another type.
    LimitError
        If it declares more than the limits accept.
    """
    container.count("arrays")
    accessor = container.item("accessors", index)
    count = _count(accessor, "count")
    if limit is not None:
        limits.require(limit, count // items_each)
    limits.require("decompressed_bytes", count * n_components * 8)
    code = _TYPES.get(accessor.get("componentType"))
    if code is None or _SIZES.get(accessor.get("type")) != n_components:
        raise malformed(
            f"accessors[{index}] of the GLB file contains {str(accessor.get('type'))[:20]} of "
            f"{str(accessor.get('componentType'))[:20]}, not {n_components} numbers each."
        )
    dtype, shape = np.dtype(code), (count, n_components)
    values: NDArray[Any] = np.zeros(shape, dtype)
    if "bufferView" in accessor:
        values = _items(container, accessor, shape, dtype)
    if "sparse" in accessor:
        sparse = accessor["sparse"]
        of_places = np.dtype(_TYPES[sparse["indices"].get("componentType")])
        n = _count(sparse, "count")
        places = _items(container, sparse["indices"], (n, 1), of_places)[:, 0]
        if of_places.kind != "u" or int(places.max(initial=0)) >= max(count, 1):
            raise malformed(f"A sparse accessor of the GLB file leads out of {count} items.")
        values[places] = _items(container, sparse["values"], (n, n_components), dtype)
    if dtype.kind == "f":
        return values.astype(np.float64)
    if accessor.get("normalized") is True:
        # c / (2^(b-1) - 1), not below -1, for signed; c / (2^b - 1) for unsigned integers.
        return np.maximum(values / np.iinfo(dtype).max, -1.0)
    return values


def _items(
    container: Container, place: dict[str, Any], shape: tuple[int, int], dtype: np.dtype[Any]
) -> NDArray[Any]:
    """Items from a place in a view, (count, components), that lie in the file."""
    index = place.get("bufferView")
    view = container.item("bufferViews", index)
    buffer = container.item("buffers", view.get("buffer"))
    if "uri" in buffer or view["buffer"] != 0:
        raise MalformedFileError(
            f"The GLB file names data elsewhere ({str(buffer.get('uri'))[:60]!r}), which is never "
            "opened.",
            remedy="Export one .glb file that contains its own data.",
        )
    length = _count(view, "byteLength")
    data = container.binary[(start := _count(view, "byteOffset", 0)) : start + length]
    count, item = shape[0], shape[1] * dtype.itemsize
    step = _count(view, "byteStride", 0) or item
    offset = _count(place, "byteOffset", 0)
    end = offset + step * (count - 1) + item if count else offset
    if len(data) < length or step < item or end > length:
        raise malformed(
            f"bufferViews[{index}] of the GLB file ends at byte {start + length} of "
            f"{len(container.binary)}, an accessor of it ends at byte {end} of {length}."
        )
    if not count:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, data, offset, (step, dtype.itemsize)).copy()


def _count(owner: Any, name: str, default: int | None = None) -> int:
    value = owner.get(name, default)
    # JSON has one kind of number; 2.0 counts as 2.
    if isinstance(value, float) and math.isfinite(value) and value == int(value):
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**62:
        raise malformed(f"The GLB file states {name} as {str(value)[:20]!r}.")
    return value
