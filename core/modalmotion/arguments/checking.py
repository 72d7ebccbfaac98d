"""Public functions check what they are given, once, by their own annotations.

The functions within trust what reaches them. The error says what came, what is meant and how to
make it.
"""

import builtins
import functools
import inspect
import types
import typing
from collections.abc import Callable, Iterable, Sequence
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from enum import Enum, StrEnum
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, TypeVar

import numpy as np

import modalmotion as mm
from modalmotion.errors import InputError, ParameterError, ShapeError, not_to_be_called
from modalmotion.representation import with_article

# How what is meant is made, by the name of its class.
_MADE: Final = {
    "MeshSequence": "Make one: mesh_sequence(vertices, faces) of arrays, read(path) of a file.",
    "ModalSignature": "Make one: modal_signature(sequence), or sequence.signature().",
    "ImageSequence": "Read one: read_images(path).",
    "Template": "Make one: make_template(sequence).",
    "Model": "Load one: load_model(name or path).",
    "TrainingCase": "Name a table: train('cases.csv', 'mine'), with the columns path, label and "
    "subject; or give [TrainingCase(sequence, label), ...].",
    "Track": "Make one: track(path) of images, clouds or contours, or load(path).",
    "Path": "Name a file, a folder of frames, or a pattern such as 'frames/*.vtk'.",
    "bytes": "Give bytes, what encode made, or the path of a file that is there.",
}
# Of an array of positions: frames, vertices, directions.
_AXES: Final = 3
# Elements of a sequence that are looked at.
_FEW: Final = 10


def check_arguments(public: dict[str, Any]) -> None:
    """Replace the functions of a package's public list by ones that check what they are given.

    Parameters
    ----------
    public : dict
        The package's `globals()`.
    """
    not_to_be_called(public["__name__"])
    for name in public["__all__"]:
        if name in public:
            public[name] = checked(public[name], public["__name__"])


def checked(value: Any, package: str) -> Any:
    """Make the function of that name in a package that checks what it is given; see `_bound`.

    What is no function, or checks already, stays what it is.
    """
    if not isinstance(value, types.FunctionType) or hasattr(value, "__wrapped__"):
        return value
    function = value

    @functools.wraps(function)
    def wrapper(*args: Any, **kwargs: Any) -> Any:
        bound = _bound(function, args, kwargs)
        return function(*bound.args, **bound.kwargs)

    # It is pickled by its name here.
    wrapper.__module__, wrapper.__qualname__ = package, function.__name__
    return wrapper


@functools.cache
def _hints(function: Callable[..., Any]) -> tuple[inspect.Signature, dict[str, Any]]:
    names = _Names(function.__globals__)
    taken = {k: v for k, v in function.__annotations__.items() if k != "return"}
    holder = types.SimpleNamespace(__annotations__=taken)
    return inspect.signature(function), typing.get_type_hints(holder, names, names)


class _Names(dict[str, Any]):
    """Names of a module; what it imports for type checkers alone may be anything."""

    def __missing__(self, name: str) -> Any:
        return getattr(builtins, name, Any)


def _bound(
    function: types.FunctionType, args: tuple[Any, ...], kwargs: dict[str, Any]
) -> inspect.BoundArguments:
    """Bind arguments to a function, and turn what is clear into what is meant.

    A file's path, an array (frames, vertices, 3), a `Reading` or a track represent a sequence, a
    sequence for its signature, and keywords that the function has not, or a number of modes, for
    its parameters: modal_signature(sequence, modes=7).

    Raises
    ------
    ParameterError
        If they do not fit; it says how to make what does.
    """
    signature, hints = _hints(function)
    name = function.__name__
    unknown = {key: kwargs[key] for key in kwargs if key not in signature.parameters}
    if unknown and not any(p.kind is p.VAR_KEYWORD for p in signature.parameters.values()):
        holder = next((key for key, hint in hints.items() if _has_fields(hint, unknown)), None)
        if holder is not None and holder not in kwargs:
            made = _class_of(hints[holder])(**unknown)
            kwargs = {k: v for k, v in kwargs.items() if k not in unknown} | {holder: made}
    try:
        bound = signature.bind(*args, **kwargs)
    except TypeError as error:
        raise ParameterError(
            f"{name}() cannot be called so: {error}.",
            remedy=f"Write {name}{_shown(signature)}.{_nearest(unknown, hints)}",
        ) from None
    for key, value in bound.arguments.items():
        hint, is_variable = hints.get(key, Any), "VAR" in signature.parameters[key].kind.name
        if is_variable or _fits(value, hint) or _is_told_within(value, hint):
            continue
        meant = _meant(value, hint)
        if meant is None or not _fits(meant, hint):
            raise _unfit(name, key, value, hint)
        bound.arguments[key] = meant
    return bound


def _nearest(unknown: Iterable[str], hints: dict[str, Any]) -> str:
    """Name the options that a mistyped keyword is near to, if there are any."""
    kinds = [_class_of(hint) for hint in hints.values() if _has_fields(hint, ())]
    known = [one.name for kind in kinds if is_dataclass(kind) for one in fields(kind)]
    near = [match for name in unknown for match in get_close_matches(name, known, n=1)]
    return f" Did you mean {' and '.join(near)}?" if near else ""


def _is_told_within(value: Any, hint: Any) -> bool:
    """Whether the function itself has the better words: of numbers, and of one of few words."""
    kinds = [typing.get_origin(one) or one for one in _alternatives(hint)]
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        return any(kind in (int, float) for kind in kinds)
    of_words = (
        kind is typing.Literal or (isinstance(kind, type) and issubclass(kind, Enum))
        for kind in kinds
    )
    return isinstance(value, str) and any(of_words)


def _meant(value: Any, hint: Any) -> Any:
    """Give what a value represents where that is clear; None if nothing."""
    if isinstance(value, str) and _fits(Path(value), hint):
        return Path(value)
    if isinstance(value, (list, tuple)) and value:
        try:
            return np.array(value)
        except ValueError:
            return None
    inner = getattr(value, "sequence", None)
    if inner is not None and _fits(inner, hint):
        return inner
    if "TrainingCase" in str(hint) and isinstance(value, (str, Path)):
        return mm.read_cases(Path(value))
    # A function that takes sequences too chooses the parameters of their signatures itself.
    kinds = sorted(
        _alternatives(hint), key=lambda of: getattr(of, "__name__", "") == "ModalSignature"
    )
    made = (_made(value, one) for one in kinds)
    return next((one for one in made if one is not None), None)


def _made(value: Any, kind: Any) -> Any:
    """Make a value of a kind of what it is usually made of; None of anything else."""
    name, is_path = getattr(kind, "__name__", ""), isinstance(value, (str, Path))
    if name == "MeshSequence" and is_path:
        return mm.read(value)
    if name == "MeshSequence" and isinstance(value, np.ndarray) and value.ndim == _AXES:
        return mm.mesh_sequence(value)
    if name == "ModalSignature":
        sequence = value if isinstance(value, mm.MeshSequence) else _made(value, mm.MeshSequence)
        return None if sequence is None else mm.modal_signature(sequence)
    if name == "Model" and is_path:
        return mm.load_model(value)
    if name == "Template" and isinstance(value, mm.MeshSequence):
        return mm.make_template(value)
    if name == "bytes":
        if is_path:
            return Path(value).read_bytes() if Path(value).is_file() else None
        data = getattr(value, "data", None)
        return data if isinstance(data, bytes) else None
    whole = isinstance(value, Integral) and not isinstance(value, bool)
    if whole and is_dataclass(kind) and fields(kind)[0].name == "modes":
        return typing.cast(type, kind)(modes=int(value))
    return None


def _fits(value: Any, hint: Any) -> bool:
    """Whether a value is of a kind; elements of a list are looked at, of what is read once none."""
    if hint is Any or hint is object or isinstance(hint, (typing.TypeVar, str)):
        return True
    if hint is None or hint is types.NoneType:
        return value is None
    origin, inner = typing.get_origin(hint), typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return any(_fits(value, one) for one in inner)
    if origin is typing.Literal:
        return value in inner
    kind = hint if origin is None else origin
    if not isinstance(kind, type):
        return True
    if getattr(kind, "_is_protocol", False):
        return all(hasattr(value, name) for name in vars(kind) if name[0] != "_")
    if kind.__module__ == "numpy" and kind.__name__ == "ndarray":
        return _is_array(value, inner)
    kind = {float: Real, int: Integral}.get(kind, kind)
    if not isinstance(value, kind) or (isinstance(value, str) and inner not in ((), (str,))):
        return False
    if isinstance(value, Sequence) or hasattr(value, "dtype"):
        value = [] if isinstance(value, (str, bytes)) or not inner else value
        each = inner if kind is tuple and inner[-1] is not Ellipsis else inner[:1] * len(value)
        return len(each) == len(value) and all(
            _fits(one, of) for one, of in list(zip(value, each, strict=True))[:_FEW]
        )
    return True


def _is_array(value: Any, inner: tuple[Any, ...]) -> bool:
    """Whether a value is an array of numbers, whole ones where these are meant."""
    if not isinstance(value, np.ndarray) or value.ndim == 0:
        return False
    (scalar,) = typing.get_args(inner[1]) if inner else (np.generic,)
    is_whole = isinstance(scalar, type) and issubclass(scalar, (np.integer, np.bool_))
    return value.dtype.kind in ("biu" if is_whole else "biufc") or value.size == 0


def _alternatives(hint: Any) -> tuple[Any, ...]:
    is_union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if is_union else (hint,)


def _class_of(hint: Any) -> type:
    """Class among the alternatives of a hint whose fields are options; None's class if none is."""
    found = [one for one in _alternatives(hint) if is_dataclass(one)]
    return typing.cast(type, found[0]) if len(found) == 1 else types.NoneType


def _has_fields(hint: Any, names: Iterable[str]) -> bool:
    kind = _class_of(hint)
    if not is_dataclass(kind) or {*names} - {field.name for field in fields(kind) if field.init}:
        return False
    # Options can be left out, all of them.
    return not any(f.default is f.default_factory is MISSING for f in fields(kind) if f.init)


def _shown(signature: inspect.Signature) -> str:
    """Write the parameters of a function without their types."""
    plain = [p.replace(annotation=p.empty) for p in signature.parameters.values()]
    return str(inspect.Signature(plain))


def _unfit(function: str, key: str, value: Any, hint: Any) -> InputError:
    kinds = [one for one in _alternatives(hint) if one is not types.NoneType]
    names = [getattr(one, "__name__", str(one)) for one in kinds]
    array = "array of whole numbers" if "int" in str(hint) else "array of numbers"
    meant = " or ".join(dict.fromkeys(names)).replace("ndarray", array)
    if "TrainingCase" in str(hint):
        meant, names = "table or several cases", ["TrainingCase"]
    # A path is what most have.
    of = sorted((name for name in names if name in _MADE), key="bytes".__eq__)
    remedy = _MADE[of[0]] if of else f"Give {with_article(meant)}."
    options = _class_of(hint)
    if remedy.startswith("Give") and is_dataclass(options) and isinstance(value, (int, float)):
        first = fields(options)[0].name
        remedy = f"Write {function}(..., {options.__name__}({first}={value}))."
    came = "None" if value is None else with_article(type(value).__name__)
    # As those within call an array of another type than theirs.
    error = ShapeError if hasattr(value, "dtype") and "ndarray" in names else ParameterError
    what = f" of {value.dtype}" if error is ShapeError else ""
    return error(
        f"The argument {key!r} of {function}() is {came}{what}; it should be "
        f"{with_article(meant)}.",
        remedy=remedy,
        details={"option": key},
    )


Word = TypeVar("Word", bound=StrEnum)


def whole(name: str, value: Any) -> int:
    """Take a whole number, and no truth value and no fraction.

    Raises
    ------
    ParameterError
    """
    if not _is_whole(value):
        raise _refusal(name, value, "a whole number", f"{name}=7")
    return int(value)


def whole_numbers(name: str, values: Any) -> tuple[int, ...]:
    """Take whole numbers, one for each axis.

    Raises
    ------
    ParameterError
    """
    numbers = None if isinstance(values, str) or not np.iterable(values) else tuple(values)
    if numbers is None or not all(map(_is_whole, numbers)):
        raise _refusal(name, values, "a tuple of whole numbers", f"{name}=(32, 64)")
    return tuple(map(int, numbers))


def _is_whole(value: Any) -> bool:
    is_truth = isinstance(value, bool | np.bool_)
    return isinstance(value, int | np.integer) and not is_truth


def real(name: str, value: Any) -> float:
    """Take a number, and no truth value and no text.

    Raises
    ------
    ParameterError
    """
    numbers = int | float | np.integer | np.floating
    if isinstance(value, bool | np.bool_) or not isinstance(value, numbers):
        raise _refusal(name, value, "a number", f"{name}=1.5")
    return float(value)


def truth(name: str, value: Any) -> bool:
    """Take True or False alone.

    Raises
    ------
    ParameterError
    """
    if not isinstance(value, bool | np.bool_):
        raise _refusal(name, value, "True or False", f"{name}=True")
    return bool(value)


def one_of(name: str, value: Any, words: type[Word]) -> Word:
    """Take a member of an enumeration, or its word.

    Raises
    ------
    ParameterError
    """
    try:
        return words(value)
    except ValueError:
        choice = ", ".join(words)
        raise _refusal(name, value, f"one of {choice}", f"{name}='{next(iter(words))}'") from None


def _refusal(name: str, value: Any, needed: str, example: str) -> ParameterError:
    return ParameterError(
        f"{name} is {repr(value)[:80]}, not {needed}.",
        remedy=f"Give {needed}, such as {example}.",
        details={"parameter": name},
    )


class FrozenArrays:
    """A value whose arrays are read-only, and stay so in its copies, here and in other processes.

    A pickle and a deep copy forget that an array is read-only.
    """

    def __post_init__(self) -> None:
        for value in vars(self).values():
            for part in value if isinstance(value, tuple) else (value,):
                if isinstance(part, np.ndarray):
                    part.setflags(write=False)

    def __getstate__(self) -> dict[str, Any]:
        # Hashes of texts differ from process to process.
        return {name: value for name, value in vars(self).items() if name != "_hash"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        FrozenArrays.__post_init__(self)


class Saved:
    """A value that `modalmotion.save` writes to a file."""

    def save(self, path: str | Path) -> Path:
        """Write it to a file, in the format of its suffix: see `modalmotion.save`.

        Raises
        ------
        ParameterError
            If there is no such format for it.
        """
        return mm.save(self, path)


class Plotted:
    """A value that `modalmotion.plot` draws."""

    def plot(self, path: str | Path | None = None) -> Any:
        """Draw it, and write the picture where a file is named: see `modalmotion.plot`.

        Returns
        -------
        matplotlib.figure.Figure
        """
        return mm.plot(self, path)


# What is often looked for on a recording, by the method whose answer has it.
OF_ANSWERS: Final = {
    "readouts": ("ejection_fraction", "stroke_volume", "curve"),
    "strain": ("gls", "gcs", "gas", "end_diastole", "end_systole"),
    "signature": ("amplitudes", "modes", "rms_error", "rms_errors"),
    "classify": ("label", "probability", "class_set"),
}


class Recorded(Saved, Plotted):
    """A moving surface: a sequence or a track."""

    if not TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Raise an error that names the method whose result has the figure."""
            told = "".join(
                f" Write .{method}().{name}"
                for method, names in OF_ANSWERS.items()
                if name in names
            )
            kind = type(self).__name__
            raise AttributeError(
                f"{kind!r} object has no attribute {name!r}.{told}", name=name, obj=self
            )

    def signature(self: Any, *parameters: Any, **fields: Any) -> "mm.ModalSignature":
        """Fit modes, `signature(modes=7)`: see `modalmotion.modal_signature`."""
        return mm.modal_signature(self, *parameters, **fields)

    def classify(self: Any, *arguments: Any, **options: Any) -> "mm.Classification":
        """Name the class of its motion: see `modalmotion.classify`."""
        return mm.classify(self, *arguments, **options)

    def strain(self: Any, **options: Any) -> "mm.Strain":
        """Measure GLS, GCS and more: see `modalmotion.strain`."""
        return mm.strain(self, **options)

    def readouts(self: Any, *parameters: Any, **fields: Any) -> "mm.ClinicalReadouts":
        """Read volume and ejection fraction, of its signature: see `clinical_readouts`."""
        return mm.clinical_readouts(self.signature(*parameters, **fields), self)

    def encode(self: Any, **options: Any) -> "mm.Encoded":
        """Compress it, `encode()` or `encode(rms=0.3)`: see `modalmotion.encode`."""
        return mm.encode(self, **options)

    def view(self: Any, **options: Any) -> Any:
        """Show it moving in a notebook: see `modalmotion.view`."""
        return mm.view(self, **options)

    def report(self: Any, path: Any, **options: Any) -> "mm.Report":
        """Write a report, a folder or one file of it: see `modalmotion.report`."""
        return mm.report(self, path, **options)
