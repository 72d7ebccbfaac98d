"""The form of a file: the header that all our HDF5 files have, written and read here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from modalmotion.errors import CorruptFileError, ModalMotionError, StoreError
from modalmotion.hdf5.image import (
    INTENDED_USE,
    Attribute,
    Contents,
    Dataset,
    contents_of,
    sealed_image,
)
from modalmotion.hdf5.sealed import load_sealed, require_sealed


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
    def read(self, source: bytes | Path, *, is_mapped: bool = False) -> Iterator[Contents]:
        """Read a sealed file; what is wrong with it inside the block becomes a CorruptFileError.

        Parameters
        ----------
        source : bytes or Path
        is_mapped : bool
            Whether datasets stay where they are, as maps of a file too large for memory.

        Raises
        ------
        NotFoundError
            If there is no such file.
        CorruptFileError
            If it is damaged, foreign, of another kind or written by another version.
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
