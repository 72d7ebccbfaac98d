"""Arrays of a glTF file: accessors over views of its one buffer (glTF 2.0, chapter 3.6)."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import MalformedFileError
from modalmotion.formats.gltf.container import Container, malformed
from modalmotion.limits import ReadLimits

_TYPES: Final[dict[object, str]] = {
    5120: "i1",
    5121: "u1",
    5122: "<i2",
    5123: "<u2",
    5125: "<u4",
    5126: "<f4",
}
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
    dtype = np.dtype(code)
    values: NDArray[Any]
    if "bufferView" in accessor:
        view = _view(container, accessor["bufferView"])
        step = view.stride or n_components * dtype.itemsize
        offset = _count(accessor, "byteOffset", 0)
        values = _strided(view.data, offset, (count, n_components), step, dtype)
    else:
        values = np.zeros((count, n_components), dtype)
    if "sparse" in accessor:
        values = _with_sparse(container, accessor["sparse"], values)
    if dtype.kind == "f":
        return values.astype(np.float64)
    if accessor.get("normalized") is True:
        # c / (2^(b-1) - 1), not below -1, for signed; c / (2^b - 1) for unsigned integers.
        return np.maximum(values / np.iinfo(dtype).max, -1.0)
    return values


class _View:
    def __init__(self, data: memoryview, stride: int | None) -> None:
        self.data = data
        self.stride = stride


def _view(container: Container, index: object) -> _View:
    view = container.item("bufferViews", index)
    buffer = container.item("buffers", view.get("buffer"))
    if "uri" in buffer or view["buffer"] != 0:
        raise MalformedFileError(
            f"The GLB file names data elsewhere ({str(buffer.get('uri'))[:60]!r}), which is never "
            "opened.",
            remedy="Export one .glb file that contains its own data.",
        )
    start = _count(view, "byteOffset", 0)
    end = start + _count(view, "byteLength")
    if end > len(container.binary):
        raise malformed(
            f"bufferViews[{index}] of the GLB file ends at byte {end}; {len(container.binary)} "
            "are there."
        )
    stride = _count(view, "byteStride") if "byteStride" in view else None
    return _View(container.binary[start:end], stride)


def _strided(
    data: memoryview, offset: int, shape: tuple[int, int], step: int, dtype: np.dtype[Any]
) -> NDArray[Any]:
    count, n_components = shape
    item = n_components * dtype.itemsize
    end = offset + step * (count - 1) + item if count else offset
    if step < item or end > len(data):
        raise malformed(f"An accessor of the GLB file ends at byte {end} of a view of {len(data)}.")
    if not count:
        return np.zeros(shape, dtype)
    return np.ndarray(shape, dtype, data, offset, (step, dtype.itemsize)).copy()


def _with_sparse(container: Container, sparse: Any, values: NDArray[Any]) -> NDArray[Any]:
    count = _count(sparse, "count")
    code = _TYPES.get(sparse["indices"].get("componentType"))
    if code is None or np.dtype(code).kind != "u":
        raise malformed("A sparse accessor's indices are not unsigned integers.")
    where, what = sparse["indices"], sparse["values"]
    kind = np.dtype(code)
    view = _view(container, where.get("bufferView"))
    offset = _count(where, "byteOffset", 0)
    indices = _strided(view.data, offset, (count, 1), kind.itemsize, kind)[:, 0]
    view = _view(container, what.get("bufferView"))
    offset = _count(what, "byteOffset", 0)
    shape = (count, values.shape[1])
    step = shape[1] * values.dtype.itemsize
    replaced = _strided(view.data, offset, shape, step, values.dtype)
    if count and int(indices.max()) >= len(values):
        raise malformed(
            f"A sparse accessor of the GLB file names item {indices.max()} of {len(values)}."
        )
    values[indices] = replaced
    return values


def _count(owner: Any, name: str, default: int | None = None) -> int:
    value = owner.get(name, default)
    # JSON has one kind of number; 2.0 counts as 2.
    if isinstance(value, float) and math.isfinite(value) and value == int(value):
        value = int(value)
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value < 2**62:
        raise malformed(f"The GLB file states {name} as {str(value)[:20]!r}.")
    return value
