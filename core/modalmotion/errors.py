"""Errors, each with its data and a remedy.

::

    ModalMotionError
    ├── InputError (ValueError)         input that cannot be used as it is
    │   ├── MalformedFileError          bytes that are not a readable file of the format
    │   ├── ShapeError                  arrays of the wrong shape, type or length
    │   ├── NonFiniteError              NaN or infinity; names frame and vertex
    │   ├── ConnectivityError           faces that name vertices that do not exist
    │   ├── TopologyError               a surface without the requested natural coordinates
    │   ├── ModeCountError              more modes than the surface can determine, or none
    │   ├── ParameterError              an option outside its range
    │   │   └── UnlikeCasesError        training cases whose modes do not compare
    │   ├── ToleranceError              an error that no number of modes meets
    │   └── LimitError                  larger than a stated limit
    ├── MissingExtraError (ModuleNotFoundError)  a package that an extra installs is absent
    └── StoreError                      results that cannot be stored or read back
        ├── NotFoundError               nothing is stored under that id
        └── CorruptFileError            a result file that does not read as written
            └── LostFileError           one that is gone, though nobody deleted it
"""

import copy
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType
from typing import ClassVar, Final, NoReturn


class ModalMotionError(Exception):
    """Root of every error this package raises on purpose.

    Parameters
    ----------
    message : str
        What is wrong and why it matters.
    remedy : str
        What to do about it.
    frame, vertex : int, optional
        Zero-based index of the frame and of the vertex (or node) at fault.
    limit : str, optional
        Name of the limit that was exceeded.
    details : dict, optional
        Further numbers and names, ready for JSON.
    """

    code: ClassVar[str] = "error"

    def __init__(
        self,
        message: str,
        *,
        remedy: str = "",
        frame: int | None = None,
        vertex: int | None = None,
        limit: str | None = None,
        details: dict[str, object] | None = None,
    ) -> None:
        super().__init__(message)
        self.message = message
        self.remedy = remedy
        self.frame = frame
        self.vertex = vertex
        self.limit = limit
        self.details = details or {}

    def __str__(self) -> str:
        return f"{self.message} {self.remedy}".strip()

    def __reduce__(self) -> tuple[object, ...]:
        # Errors cross process boundaries; the default forgets keyword arguments.
        return _rebuild, (type(self), self.__dict__.copy())


def _rebuild(kind: type[ModalMotionError], state: dict[str, object]) -> ModalMotionError:
    error = kind(str(state["message"]))
    error.__dict__.update(state)
    return error


def named(error: ModalMotionError, name: str, **details: object) -> ModalMotionError:
    """Copy an error with the name of the file or case that it is about."""
    copied = copy.copy(error)
    if name:
        copied.message = f"{name}: {error.message}"
        copied.args = (copied.message, *error.args[1:])
    copied.details = {**error.details, **details}
    return copied


class InputError(ModalMotionError, ValueError):
    """The input cannot be used as it is."""

    code = "invalid_input"


class MalformedFileError(InputError):
    """The bytes are not a readable file of the stated format."""

    code = "malformed_file"


class ShapeError(InputError):
    """An array has the wrong shape, type or length."""

    code = "wrong_shape"


class NonFiniteError(InputError):
    """An array contains NaN or infinity."""

    code = "non_finite"


class ConnectivityError(InputError):
    """A face names a vertex that does not exist."""

    code = "bad_connectivity"


class TopologyError(InputError):
    """The surface has no natural coordinates of the requested topology."""

    code = "unsupported_topology"


class ModeCountError(InputError):
    """More modes were requested than the surface can determine, or none."""

    code = "bad_mode_count"


class ParameterError(InputError):
    """An option is outside its range."""

    code = "bad_parameter"


class UnlikeCasesError(ParameterError):
    """Training cases do not compare in the modes that they were fitted with."""


class ToleranceError(InputError):
    """No number of modes meets the requested error; the best is in the details."""

    code = "tolerance_unreachable"


class LimitError(InputError):
    """The input is larger than a stated limit."""

    code = "limit_exceeded"


class MissingExtraError(ModalMotionError, ModuleNotFoundError):
    """A package that an extra installs is absent."""

    code = "missing_extra"


# Where the name of what is imported is not the name of what is installed.
_PACKAGES: Final = {
    "jwt": "'PyJWT[crypto]'",
    "nrrd": "pynrrd",
    "opentelemetry": "opentelemetry-sdk opentelemetry-exporter-otlp-proto-http",
}


def install_command(module: str) -> str:
    """Give the command that installs what a module is in.

    The package by itself, not an extra of modalmotion, which no registry knows before its release.
    """
    root = module.partition(".")[0]
    return f"pip install {_PACKAGES.get(root, root)}"


@contextmanager
def needs_extra(extra: str) -> Iterator[None]:
    """Turn a failed import in the block into an error that names the installing command."""
    try:
        yield
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"This needs the package {error.name}, which is not installed.",
            remedy=f"Install it: {install_command(error.name or extra)}.",
            details={"package": error.name, "extra": extra},
        ) from error


class StoreError(ModalMotionError):
    """A result cannot be stored or read back."""

    code = "store_error"


class NotFoundError(StoreError):
    """Nothing is stored under that id."""

    code = "not_found"


class CorruptFileError(StoreError):
    """A result file does not read as it was written."""

    code = "corrupt_file"


class LostFileError(CorruptFileError):
    """A file that was acknowledged is gone, though nobody deleted it."""

    code = "lost_file"


class Package(ModuleType):
    """A package that is called as if it were a function: the error says what to write."""

    def __call__(self, *_: object, **__: object) -> NoReturn:
        """Refuse the call."""
        own = self.__name__.rpartition(".")[2]
        functions = [name for name in self.__all__ if own in name and name.islower()]
        raise TypeError(
            f"{self.__name__} is a package, not a function. Write "
            f"{' or '.join(f'{name}(...)' for name in functions) or self.__name__ + '.name(...)'}."
        )


def not_to_be_called(package: str) -> None:
    """Let calls of a package say what to write instead."""
    if package in sys.modules:
        sys.modules[package].__class__ = Package
