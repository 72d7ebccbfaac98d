"""HDF5 files in memory: written with the same bytes each time, and read.

The HDF5 library takes 2 ms for the forty objects and attributes of a signature, five times as
long as writing them durably. So it lays out each kind of image once (names, types, shapes,
attributes), and values are put where it left room for them. The result is byte for byte what
the library itself would have written, which the tests check.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.hdf5.sealed import seal, seal_file

Attribute = str | int | tuple[int, ...]

UNKNOWN: Final = "unknown"
"""Unit of lengths whose unit nobody stated."""

# Texts are padded to a multiple of this, so that few layouts serve many results.
_TEXT_STEP: Final = 64
_LONGEST_ATTRIBUTE: Final = 10_000
_JSON: Final = json.JSONEncoder(sort_keys=True)


class Dataset(NamedTuple):
    """One dataset of an image.

    Parameters
    ----------
    name : str
    values : ndarray
    unit : str
        "1" for plain numbers, "none" for text.
    axes : str
        Names of the axes, separated by commas; empty for a single value.
    """

    name: str
    values: NDArray[Any]
    unit: str
    axes: str


@dataclass(frozen=True)
class Layout:
    """All of an image but the values of its datasets and its ids.

    Parameters
    ----------
    attributes : tuple of (name, value)
        Of the root, in order of writing.
    ids : tuple of (name, length)
        Attributes of the root whose text differs from file to file.
    datasets : tuple of (name, shape, dtype, unit, axes)
    """

    attributes: tuple[tuple[str, Attribute], ...]
    ids: tuple[tuple[str, int], ...]
    datasets: tuple[tuple[str, tuple[int, ...], str, str, str], ...]


def json_text(name: str, value: object) -> Dataset:
    """Dataset that contains a value as JSON, in ASCII."""
    text = _JSON.encode(value).encode()
    size = -(-len(text) // _TEXT_STEP) * _TEXT_STEP
    return Dataset(name, np.array(text.ljust(size), dtype=f"S{size}"), "none", "")


def sealed_image(
    attributes: Mapping[str, Attribute], ids: Mapping[str, str], datasets: Sequence[Dataset]
) -> bytes:
    """Build a sealed HDF5 file in memory.

    Parameters
    ----------
    attributes : mapping
        Of the root.
    ids : mapping
        More attributes of the root: ASCII text that differs from file to file.
    datasets : sequence of Dataset

    Raises
    ------
    StoreError
        If an attribute is not a text that HDF5 can contain.
    """
    arrays = [d.values if d.values.flags.c_contiguous else d.values.copy() for d in datasets]
    layout = Layout(
        tuple(attributes.items()),
        tuple((name, len(value)) for name, value in ids.items()),
        tuple(
            (d.name, a.shape, a.dtype.str, d.unit, d.axes)
            for d, a in zip(datasets, arrays, strict=True)
        ),
    )
    # Arrays are joined as they are in memory, without a copy of their own.
    values: list[bytes | memoryview] = [value.encode("ascii") for value in ids.values()]
    values += [array.data for array in arrays]
    return seal([values[p] if isinstance(p, int) else p for p in _skeleton(layout)])


def write_image(layout: Layout, ids: Sequence[str], arrays: Sequence[NDArray[Any]]) -> Any:
    """Let the HDF5 library write an image.

    Returns
    -------
    image : bytes
    offsets : list of int or None
        Where the values of each dataset are; None for those without any.
    """
    import h5py

    file = h5py.File.in_memory(libver=("earliest", "latest"))
    with file:
        for name, value in layout.attributes:
            file.attrs[name] = _as_attribute(value)
        for (name, _), text in zip(layout.ids, ids, strict=True):
            file.attrs[name] = _as_attribute(text)
        offsets = []
        for (name, _, _, unit, axes), array in zip(layout.datasets, arrays, strict=True):
            dataset = file.create_dataset(name, data=array, track_times=False)
            dataset.attrs["unit"] = _as_attribute(unit)
            dataset.attrs["axes"] = _as_attribute(axes)
            offsets.append(dataset.id.get_offset())
        file.flush()
        return file.id.get_file_image(), offsets


class Rows(NamedTuple):
    """One dataset of a file that is written a row at a time.

    Parameters
    ----------
    name : str
    rows : sequence of ndarray
        All of one shape and type.
    unit, axes : str
        As of `Dataset`.
    """

    name: str
    rows: Sequence[NDArray[Any]]
    unit: str
    axes: str


def write_sealed(
    path: Path, attributes: Mapping[str, Attribute], datasets: Sequence[Dataset | Rows]
) -> None:
    """Write a sealed HDF5 file that is too large to be built in memory; may raise OSError.

    Parameters
    ----------
    path : Path
        Written over.
    attributes : mapping
        Of the root.
    datasets : sequence of Dataset or Rows
    """
    import h5py

    for name, value in attributes.items():
        _require_storable(name, value)
    with h5py.File(path, "w", libver=("earliest", "latest")) as file:
        for name, value in attributes.items():
            file.attrs[name] = _as_attribute(value)
        for one in datasets:
            if isinstance(one, Dataset):
                dataset = file.create_dataset(one.name, data=one.values, track_times=False)
            else:
                shape = (len(one.rows), *one.rows[0].shape)
                dataset = file.create_dataset(one.name, shape, one.rows[0].dtype, track_times=False)
                for k, row in enumerate(one.rows):
                    dataset[k] = row
            dataset.attrs["unit"] = _as_attribute(one.unit)
            dataset.attrs["axes"] = _as_attribute(one.axes)
    seal_file(path)


@lru_cache(maxsize=256)
def _skeleton(layout: Layout) -> tuple[bytes | int, ...]:
    """Pieces of an image: bytes as they are, and the number of the value to put in."""
    for name, value in layout.attributes:
        _require_storable(name, value)
    marks = _marks(layout)
    zeros = [np.zeros(shape, dtype) for _, shape, dtype, _, _ in layout.datasets]
    image, offsets = write_image(layout, marks, zeros)
    places = []
    for number, mark in enumerate(marks):
        places.append((image.index(mark.encode()), len(mark), number))
    for number, (offset, array) in enumerate(zip(offsets, zeros, strict=True), len(marks)):
        if array.size:
            places.append((offset, array.nbytes, number))
    pieces: list[bytes | int] = []
    end = 0
    for start, length, number in sorted(places):
        pieces += [image[end:start], number]
        end = start + length
    return (*pieces, image[end:])


def _marks(layout: Layout) -> list[str]:
    # Text that occurs nowhere else in the image, for control characters are in no attribute.
    return [
        f"\x01{number:02x}".ljust(length, "\x02")[:length]
        for number, (_, length) in enumerate(layout.ids)
    ]


def _as_attribute(value: Attribute) -> Any:
    import h5py

    if isinstance(value, str):
        text = value.encode()
        return np.array(text, dtype=h5py.string_dtype("utf-8", max(1, len(text))))
    return np.asarray(value, dtype="<i8")


def _require_storable(name: str, value: Attribute) -> None:
    if not isinstance(value, str):
        return
    if len(value) > _LONGEST_ATTRIBUTE or not value.isprintable():
        raise StoreError(
            f"The {name.replace('_', ' ')} {value[:40]!r} cannot be kept as an attribute.",
            remedy="Use a short text that can be printed.",
        )


INTENDED_USE: Final = (
    "Description of surface motion for research and tool development. Not a medical device; "
    "not for diagnosis."
)


T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Contents:
    """Attributes of the root and all datasets.

    Parameters
    ----------
    name : str
        Name of the file in errors.
    attributes : dict
        Text and numbers.
    arrays : dict of ndarray
    """

    name: str
    attributes: dict[str, Any]
    arrays: dict[str, NDArray[Any]]

    def text(self, name: str) -> str:
        """Attribute that contains text."""
        value = self.attributes[name]
        if not isinstance(value, str):
            raise TypeError(f"attribute {name} is not text")
        return value

    def optional_text(self, name: str) -> str | None:
        """Attribute that contains text, None if there is no such attribute."""
        return self.text(name) if name in self.attributes else None

    @property
    def unit(self) -> str | None:
        """Unit of lengths, None if nobody stated it."""
        unit = self.text("unit")
        return None if unit == UNKNOWN else unit

    def json(self, name: str, kind: type[T]) -> T:
        """Value of a dataset that contains JSON of type `kind`."""
        value = json.loads(bytes(self.arrays[name][()]))
        if not isinstance(value, kind):
            raise TypeError(f"dataset {name} does not contain a {kind.__name__}")
        return value

    def number(self, name: str) -> Any:
        """Value of a dataset that contains one number."""
        return self.array(name, ()).item()

    def array(self, name: str, shape: tuple[int | None, ...]) -> NDArray[Any]:
        """Dataset of numbers of that shape, None for an open length."""
        array = self.arrays[name]
        fits = len(shape) == array.ndim and all(
            n is None or n == m for n, m in zip(shape, array.shape, strict=True)
        )
        if not fits or array.dtype.kind not in "fiu":
            raise ValueError(f"dataset {name} has the shape {array.shape}, type {array.dtype}")
        return array


def contents_of(name: str, data: bytes) -> Contents:
    """Read all of an HDF5 file, and nothing that is outside of it or takes more than its size.

    Raises
    ------
    KeyError, TypeError, ValueError, OSError, RuntimeError
        If it is not made of plain datasets.
    """
    # The library's lower level, which takes half the time on many small datasets.
    from h5py import h5f, h5g, h5s

    root = h5g.open(h5f.open_file_image(data), b"/")
    arrays: dict[str, NDArray[Any]] = {}
    for key, dataset in _datasets(root, len(data)):
        array = np.empty(dataset.shape, dataset.dtype)
        if array.size:
            dataset.read(h5s.ALL, h5s.ALL, array)
        arrays[key] = array
    return Contents(name, _attributes(root), arrays)


def contents_in(path: Path) -> Contents:
    """Read a file whose datasets stay where they are, as maps of the file: see `contents_of`."""
    from h5py import h5f, h5g

    root = h5g.open(h5f.open(str(path).encode(), h5f.ACC_RDONLY), b"/")
    arrays: dict[str, NDArray[Any]] = {}
    for key, dataset in _datasets(root, path.stat().st_size):
        kind, shape, offset = dataset.dtype, dataset.shape, dataset.get_offset()
        if offset is None:
            arrays[key] = np.empty(shape, kind)
        else:
            arrays[key] = np.asarray(np.memmap(path, kind, "r", offset, shape))
    return Contents(f"'{path.name}'", _attributes(root), arrays)


def _datasets(root: Any, most_bytes: int) -> Iterator[tuple[str, Any]]:
    from h5py import h5d, h5l

    n_bytes = 0
    for number in range(root.get_num_objs()):
        key = root.get_objname_by_idx(number)
        # Other links lead out of the file, to others on this machine.
        if root.links.get_info(key).type != h5l.TYPE_HARD:
            raise ValueError(f"{key!r} is a link out of the file")
        dataset = h5d.open(root, key)
        _require_in_file(key, dataset)
        # Many names of one dataset, or datasets on the same bytes, would fill the memory.
        n_bytes += dataset.get_storage_size()
        if n_bytes > most_bytes:
            raise ValueError("its datasets are on one another")
        yield key.decode(), dataset


def header_of(name: str, data: bytes) -> Contents:
    """Read the attributes of the root alone; see `contents_of`."""
    from h5py import h5f, h5g

    return Contents(name, _attributes(h5g.open(h5f.open_file_image(data), b"/")), {})


def _attributes(root: Any) -> dict[str, Any]:
    from h5py import h5a

    attributes = {}
    for number in range(h5a.get_num_attrs(root)):
        attribute = h5a.open(root, index=number)
        if attribute.dtype.kind not in "iuS":
            raise ValueError(f"the attribute {attribute.name!r} contains {attribute.dtype}")
        value = np.empty(attribute.shape, attribute.dtype)
        attribute.read(value)
        attributes[attribute.name.decode()] = _plain(value)
    return attributes


def _require_in_file(name: bytes, dataset: Any) -> None:
    # Contiguous and as large as its shape says: no external file, no bomb of fill values.
    from h5py import h5d

    plan = dataset.get_create_plist()
    if not (
        plan.get_layout() == h5d.CONTIGUOUS
        and plan.get_external_count() == 0
        and dataset.dtype.kind in "fiuS"
        and dataset.get_storage_size() == math.prod(dataset.shape) * dataset.dtype.itemsize
    ):
        raise ValueError(f"{name!r} is not a plain dataset")


def _plain(value: NDArray[Any]) -> Any:
    content = value.tolist()
    if isinstance(content, bytes):
        return content.decode()
    return tuple(content) if isinstance(content, list) else content


def require_match(path: Path, contents: Contents, **ids: str | int | None) -> None:
    """Refuse a file whose ids are not those that it was looked up by.

    Raises
    ------
    CorruptFileError
    """
    for name, expected in ids.items():
        if contents.attributes.get(name) != expected:
            raise CorruptFileError(
                f"'{path.name}' contains another {name.replace('_', ' ')} than its name says.",
                remedy="Restore it from a copy, or delete it and make the result again.",
            )
