"""HDF5 files of results: written, the same bytes for the same contents, and read."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import CorruptFileError, StoreError
from modalmotion.hdf5.sealed import seal, seal_file

Attribute = str | int | tuple[int, ...]

UNKNOWN: Final = "unknown"
"""Unit of lengths whose unit nobody stated."""

_LONGEST_ATTRIBUTE: Final = 10_000
_LIBVER: Final = ("earliest", "latest")


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


def json_text(name: str, value: object) -> Dataset:
    """Dataset that contains a value as JSON, in ASCII."""
    return Dataset(name, np.array(json.dumps(value, sort_keys=True).encode()), "none", "")


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


def sealed_image(attributes: Mapping[str, Attribute], datasets: Sequence[Dataset]) -> bytes:
    """Build a sealed HDF5 file in memory.

    Parameters
    ----------
    attributes : mapping
        Of the root.
    datasets : sequence of Dataset

    Raises
    ------
    StoreError
        If an attribute is not a text that HDF5 can contain.
    """
    import h5py

    _require_storable(attributes)
    with h5py.File.in_memory(libver=_LIBVER) as file:
        _write(file, attributes, datasets)
        file.flush()
        return seal(file.id.get_file_image())


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

    _require_storable(attributes)
    with h5py.File(path, "w", libver=_LIBVER) as file:
        _write(file, attributes, datasets)
    seal_file(path)


def _write(
    file: Any, attributes: Mapping[str, Attribute], datasets: Sequence[Dataset | Rows]
) -> None:
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


def _as_attribute(value: Attribute) -> Any:
    import h5py

    if isinstance(value, str):
        text = value.encode()
        return np.array(text, dtype=h5py.string_dtype("utf-8", max(1, len(text))))
    return np.asarray(value, dtype="<i8")


def _require_storable(attributes: Mapping[str, Attribute]) -> None:
    for name, value in attributes.items():
        if isinstance(value, str) and (len(value) > _LONGEST_ATTRIBUTE or not value.isprintable()):
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


def contents_of(name: str, source: bytes | Path) -> Contents:
    """Read all of an HDF5 file, and nothing that is outside of it or takes more than its size.

    The datasets of a path stay where they are, as maps of the file.

    Raises
    ------
    KeyError, TypeError, ValueError, OSError, RuntimeError
        If it is not made of plain datasets.
    """
    # The library's lower level, which takes half the time on many small datasets.
    from h5py import h5s

    root = _root(source)
    size = len(source) if isinstance(source, bytes) else source.stat().st_size
    arrays: dict[str, NDArray[Any]] = {}
    for key, dataset in _datasets(root, size):
        kind, shape, offset = dataset.dtype, dataset.shape, dataset.get_offset()
        if isinstance(source, bytes) or offset is None:
            array = np.empty(shape, kind)
            if array.size:
                dataset.read(h5s.ALL, h5s.ALL, array)
        else:
            array = np.asarray(np.memmap(source, kind, "r", offset, shape))
        arrays[key] = array
    return Contents(name, _attributes(root), arrays)


def _root(source: bytes | Path) -> Any:
    from h5py import h5f, h5g

    if isinstance(source, bytes):
        return h5g.open(h5f.open_file_image(source), b"/")
    return h5g.open(h5f.open(str(source).encode(), h5f.ACC_RDONLY), b"/")


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
    return Contents(name, _attributes(_root(data)), {})


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
