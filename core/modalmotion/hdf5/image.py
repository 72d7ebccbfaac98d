"""HDF5 files of results: their header and contents, written to the same bytes, and read."""

import json
import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple, TypeVar

import numpy as np

from modalmotion.errors import CorruptFileError, ModalMotionError, StoreError
from modalmotion.hdf5.sealed import load_sealed, require_sealed, seal, seal_file
from modalmotion.representation import Array

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
    values : ndarray or list of ndarray
        Rows of one shape and type that are written one at a time.
    unit : str
        "1" for plain numbers, "none" for text.
    axes : str
        Names of the axes, separated by commas; empty for a single value.
    """

    name: str
    values: Any
    unit: str
    axes: str


Ids = Mapping[str, object]
"""Attributes of the root that a file must have, such as the id that it was looked up by."""
ANY_IDS: Final[Ids] = MappingProxyType({})

Table = Mapping[str, tuple[str, str]]
"""Arrays of a value by the names of its fields: unit, {u} for that of its lengths, and axes."""


def datasets_of(
    value: object, table: Table, unit: str | None = None, *, prefix: str = ""
) -> list[Dataset]:
    """Datasets of the arrays in a table that a value has; whole numbers have eight bytes."""
    made = []
    for name, (unit_of, axes) in table.items():
        if (one := getattr(value, name)) is not None:
            array = np.asarray(one)
            kind = "<i8" if array.dtype.kind == "i" else array.dtype.newbyteorder("<")
            units = unit_of.format(u=unit or UNKNOWN)
            made.append(Dataset(prefix + name, array.astype(kind, copy=False), units, axes))
    return made


def json_text(name: str, value: object) -> Dataset:
    """Dataset that contains a value as JSON, in ASCII; dataclasses as objects."""
    text = json.dumps(value, sort_keys=True, default=asdict)
    return Dataset(name, np.array(text.encode()), "none", "")


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
    path: Path, attributes: Mapping[str, Attribute], datasets: Sequence[Dataset]
) -> None:
    """Write a sealed HDF5 file that is too large to be built in memory; may raise OSError.

    Parameters
    ----------
    path : Path
        Written over.
    attributes : mapping
        Of the root.
    datasets : sequence of Dataset
    """
    import h5py

    _require_storable(attributes)
    with h5py.File(path, "w", libver=_LIBVER) as file:
        _write(file, attributes, datasets)
    seal_file(path)


def _write(file: Any, attributes: Mapping[str, Attribute], datasets: Sequence[Dataset]) -> None:
    for name, value in attributes.items():
        file.attrs[name] = _as_attribute(value)
    for one in datasets:
        rows = one.values if isinstance(one.values, list) else []
        values = one.values if not isinstance(one.values, list) else None
        shape = (len(rows), *rows[0].shape) if rows else None
        kind = rows[0].dtype if rows else None
        dataset = file.create_dataset(one.name, shape, kind, values, track_times=False)
        for k, row in enumerate(rows):
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
    arrays: dict[str, Array]

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

    def array(self, name: str, shape: tuple[int | None, ...]) -> Array:
        """Dataset of numbers of that shape, None for an open length."""
        array = self.arrays[name]
        fits = len(shape) == array.ndim and all(
            n is None or n == m for n, m in zip(shape, array.shape, strict=True)
        )
        if not fits or array.dtype.kind not in "fiub":
            raise ValueError(f"dataset {name} has the shape {array.shape}, type {array.dtype}")
        return array

    def table(
        self,
        table: Table,
        sizes: dict[str, int],
        *,
        prefix: str = "",
        optional: Collection[str] = (),
    ) -> dict[str, Any]:
        """Arrays that `datasets_of` has written; axes of one name have one length.

        Parameters
        ----------
        table : Table
        sizes : dict of str to int
            Lengths of axes that are known; those of the others are added.
        prefix : str
        optional : collection of str
            Those that may be missing; they are None then.
        """
        found: dict[str, Any] = dict.fromkeys(optional)
        for name, (_, axes) in table.items():
            if name in optional and prefix + name not in self.arrays:
                continue
            names = axes.split(", ") if axes else []
            array = self.array(prefix + name, tuple(map(sizes.get, names)))
            sizes.update(zip(names, array.shape, strict=True))
            # Two axes of one array may have one name.
            self.array(prefix + name, tuple(map(sizes.get, names)))
            found[name] = array if names else array.item()
        return found


def contents_of(name: str, source: bytes | Path, *, has_arrays: bool = True) -> Contents:
    """Read an HDF5 file, and nothing that is outside of it or takes more than its size.

    The datasets of a path stay where they are, as maps of the file.

    Parameters
    ----------
    name : str
    source : bytes or Path
    has_arrays : bool
        False for the attributes of the root alone.

    Raises
    ------
    KeyError, TypeError, ValueError, OSError, RuntimeError
        If it is not made of plain datasets.
    """
    import h5py

    is_image = isinstance(source, bytes)
    most_bytes = len(source) if isinstance(source, bytes) else source.stat().st_size
    arrays: dict[str, Array] = {}
    n_bytes = 0
    with h5py.File(h5py.h5f.open_file_image(source) if is_image else source, "r") as file:
        for key in file if has_arrays else ():
            # Other links lead out of the file, to others on this machine.
            if not isinstance(file.get(key, getlink=True), h5py.HardLink):
                raise TypeError(f"{key!r} is a link out of the file")
            dataset = file[key]
            shape, kind, n_stored = dataset.shape, dataset.dtype, dataset.id.get_storage_size()
            is_simple = dataset.chunks is None and not (dataset.external or dataset.is_virtual)
            # As large as its shape says: no external file, no bomb of fill values.
            is_whole = kind.kind in "fiubS" and n_stored == math.prod(shape) * kind.itemsize
            if not (is_simple and is_whole):
                raise ValueError(f"{key!r} is not a plain dataset")
            # Many names of one dataset, or datasets on the same bytes, would fill the memory.
            n_bytes += n_stored
            if n_bytes > most_bytes:
                raise ValueError("its datasets are on one another")
            offset = None if is_image else dataset.id.get_offset()
            if offset is None:
                arrays[key] = np.asarray(dataset[()])
            else:
                arrays[key] = np.asarray(np.memmap(source, kind, "r", offset, shape))
        for key in file.attrs:
            # Before it is read: text of any length may be at one place, many times.
            if (kind := file.attrs.get_id(key).dtype).kind not in "iuS":
                raise ValueError(f"the attribute {key!r} contains {kind}")
        attributes = {key: np.asarray(value) for key, value in file.attrs.items()}
    return Contents(name, {key: _plain(value) for key, value in attributes.items()}, arrays)


def _plain(value: Array) -> Any:
    content = value.tolist()
    if isinstance(content, bytes):
        return content.decode()
    return tuple(content) if isinstance(content, list) else content


@dataclass(frozen=True)
class Form:
    """A kind of file and the version of its schema: the only one that is written and read.

    Parameters
    ----------
    kind : str
        "signature", "sequence", "classification", "track", "images", "model", "template" or
        "export".
    version : int
        Raised when what is written changes.
    """

    kind: str
    version: int

    def header(self, **more: Attribute | None) -> dict[str, Attribute]:
        """Attributes of the root: kind and version, and those of `more` that are not None."""
        return {
            "schema": f"modalmotion.{self.kind}",
            "schema_version": self.version,
            "kind": self.kind,
            "intended_use": INTENDED_USE,
            **{name: value for name, value in more.items() if value is not None},
        }

    def image(
        self, ids: Mapping[str, str], datasets: Sequence[Dataset], **more: Attribute | None
    ) -> bytes:
        """Write a sealed file in memory, the same bytes for the same contents.

        Parameters
        ----------
        ids : mapping
            Attributes of the root, such as ids.
        datasets : sequence of Dataset
        **more : text, int, tuple of int or None
            Further attributes of the root; see `header`.

        Raises
        ------
        StoreError
            If an attribute is not a text that HDF5 can contain.
        """
        return sealed_image({**self.header(**more), **ids}, datasets)

    @contextmanager
    def read(
        self,
        source: bytes | Path,
        ids: Ids = ANY_IDS,
        *,
        is_mapped: bool = False,
    ) -> Iterator[Contents]:
        """Read a sealed file; what is wrong with it inside the block becomes a CorruptFileError.

        Parameters
        ----------
        source : bytes or Path
        ids : mapping
            Attributes of the root that it was looked up by.
        is_mapped : bool
            Whether datasets stay where they are, as maps of a file too large for memory.

        Raises
        ------
        NotFoundError
            If there is no such file.
        CorruptFileError
            If it is damaged, foreign, of another kind, written by another version, or has other
            ids.
        """
        data: bytes | Path
        if is_mapped and isinstance(source, Path):
            require_sealed(source)
            name, data = f"'{source.name}'", source
        else:
            name, data = load_sealed(source)
        with _explained(name, self.kind):
            contents = contents_of(name, data)
            form = _form(contents)
            if form.kind != self.kind:
                raise CorruptFileError(
                    f"{name} contains {form.kind[:80]!r}, not a {self.kind} of modalmotion.",
                    remedy=f"Name a file that contains a {self.kind}.",
                )
            if form.version != self.version:
                raise CorruptFileError(
                    f"{name} has version {form.version} of its schema; this program reads "
                    f"{self.version}.",
                    remedy="Read it with the modalmotion that wrote it, or make it again.",
                    details={"schema_version": form.version, "known": self.version},
                )
            for key, expected in ids.items():
                if contents.attributes.get(key) != expected:
                    raise CorruptFileError(
                        f"{name} contains another {key.replace('_', ' ')} than its name.",
                        remedy="Restore it from a copy, or delete it and make the result again.",
                    )
            yield contents


def form_of(path: Path) -> Form:
    """Form of a sealed file of any kind.

    Raises
    ------
    NotFoundError
        If there is no such file.
    CorruptFileError
        If it is damaged, or is not a file of modalmotion's.
    """
    name, data = load_sealed(path)
    with _explained(name, "result"):
        return _form(contents_of(name, data, has_arrays=False))


def _form(contents: Contents) -> Form:
    version = contents.attributes["schema_version"]
    if not isinstance(version, int):
        raise TypeError("the version of the schema is not a number")
    return Form(contents.text("schema").removeprefix("modalmotion."), version)


@contextmanager
def _explained(name: str, kind: str) -> Iterator[None]:
    try:
        yield
    except (StoreError, MemoryError):
        raise
    except Exception as error:
        # The seal is right, so the file was not damaged: it was written like this.
        reason = error.message if isinstance(error, ModalMotionError) else str(error)
        raise CorruptFileError(
            f"{name} does not contain a {kind} as modalmotion writes it ({reason[:200]}).",
            remedy="Name an HDF5 file written by modalmotion.",
        ) from error
