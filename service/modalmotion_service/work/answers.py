"""What a worker answers, as bytes of a known form: nothing in them can run code.

A worker reads files that strangers send, so its answers are read as a stranger's too: they are
never unpickled. The reader knows of what type an answer must be (the task's own annotation says
so), and takes nothing else: plain values, arrays of numbers, and the dataclasses, models and
enumerations that the type names. An error is the name of a class of ours and its data.

The form: the length of a JSON text (8 bytes, little-endian), the text, then the bytes of all
arrays and byte strings, which the text refers to by their place and length.
"""

from __future__ import annotations

import json
import math
import types
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np
from pydantic import BaseModel

from modalmotion import errors as core_errors
from modalmotion.errors import ModalMotionError
from modalmotion_service import errors as service_errors

_PREFIX: Final = 8

# Attributes that every error of ours has.
_OF_ERRORS: Final = ("message", "remedy", "frame", "vertex", "limit", "details")

# Errors of Python that mean something to whoever asked; all others are faults of ours.
_PLAIN: Final = (MemoryError, RecursionError)


# What reading bytes that are not an answer may meet.
_FAULTS: Final = (
    *(ValueError, TypeError, KeyError, IndexError, AttributeError),
    *(RecursionError, OverflowError),
)


class AnswerError(Exception):
    """The bytes are not an answer of the type that was expected."""


class TaskError(Exception):
    """A task failed in a way that nobody foresaw; the text is its traceback."""


def answer_of(function: Callable[..., Any], args: Any, kwargs: Any) -> bytes:
    """Run a task, and write its result or its error."""
    try:
        return to_bytes(function(*args, **kwargs))
    except BaseException as error:  # noqa: BLE001 (whatever it is, whoever waits is told)
        return error_to_bytes(error)


def to_bytes(value: object) -> bytes:
    """Write a result.

    Raises
    ------
    AnswerError
        If it holds what has no form here.
    """
    pieces: list[bytes | memoryview] = []
    tree = _written(value, pieces)
    return _joined({"result": tree}, pieces)


def error_to_bytes(error: BaseException) -> bytes:
    """Write an error: its class and data if it is one of ours, else its traceback."""
    if isinstance(error, ModalMotionError):
        state = {name: getattr(error, name) for name in _OF_ERRORS}
        state["details"] = json.loads(json.dumps(state["details"], default=str))
        return _joined({"error": type(error).__name__, "state": state}, [])
    if isinstance(error, OSError):
        state = {"errno": error.errno, "text": error.strerror, "file": _name(error.filename)}
        return _joined({"error": "OSError", "state": state}, [])
    if isinstance(error, _PLAIN):
        return _joined({"error": type(error).__name__, "state": {"text": str(error)[:1000]}}, [])
    # Here, for a worker whose memory is full can import little.
    import traceback

    text = "".join(traceback.format_exception(error))[-20_000:]
    return _joined({"error": "TaskError", "state": {"text": text}}, [])


def from_bytes(data: bytes, expected: object) -> Any:
    """Read a result, or raise the error that came in its place.

    Parameters
    ----------
    data : bytes
    expected : type
        What the result must be.

    Raises
    ------
    AnswerError
        If the bytes are of another form or type.
    BaseException
        The error of the task.
    """
    try:
        length = int.from_bytes(data[:_PREFIX], "little")
        body = memoryview(data)[_PREFIX + length :]
        head = json.loads(data[_PREFIX : _PREFIX + length])
        if "error" not in head:
            return _read(head["result"], expected, body)
        error = _read_error(str(head["error"]), dict(head["state"]))
    except AnswerError:
        raise
    except (
        ValueError,
        TypeError,
        KeyError,
        AttributeError,
        RecursionError,
        OverflowError,
    ) as fault:
        raise AnswerError(f"a worker's answer cannot be read: {type(fault).__name__}") from fault
    raise error


@lru_cache(maxsize=256)
def result_type(function: Callable[..., Any]) -> object:
    """Give the type of a task's result, from its annotation; plain values where there is none."""
    # Of the result alone: types of arguments may be there for type checkers only.
    stated = {"return": getattr(function, "__annotations__", {}).get("return", Any)}
    task = types.SimpleNamespace(__annotations__=stated)
    try:
        return get_type_hints(task, getattr(function, "__globals__", {}))["return"]
    except (NameError, TypeError):
        return Any


def _joined(head: Mapping[str, object], pieces: Sequence[bytes | memoryview]) -> bytes:
    text = json.dumps(head).encode()
    return b"".join((len(text).to_bytes(_PREFIX, "little"), text, *pieces))


def _name(file: object) -> str | None:
    return None if file is None else str(file)


def _placed(piece: bytes | memoryview, pieces: list[bytes | memoryview]) -> list[int]:
    place = sum(len(other) for other in pieces)
    pieces.append(piece)
    return [place, len(piece)]


def _written(value: object, pieces: list[bytes | memoryview]) -> object:
    if isinstance(value, Enum):
        return _written(value.value, pieces)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return _written(value.item(), pieces)
    if isinstance(value, bytes):
        return _placed(value, pieces)
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        plain = np.ascontiguousarray(value)
        if plain.dtype.kind not in "fiub":
            raise AnswerError(f"an array of {plain.dtype} has no form here")
        place = _placed(memoryview(plain.reshape(-1).view(np.uint8).data), pieces)
        return {"dtype": plain.dtype.str, "shape": value.shape, "place": place}
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _written(getattr(value, f.name), pieces) for f in fields(value) if f.init}
    if isinstance(value, Mapping):
        return {str(name): _written(inner, pieces) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_written(inner, pieces) for inner in value]
    raise AnswerError(f"{type(value).__name__} has no form here")


def _read(tree: Any, expected: Any, body: memoryview) -> Any:
    if expected is None or expected is type(None):
        return _require(tree, tree is None)
    if expected is Any or expected is object:
        return tree
    origin, inner = get_origin(expected), get_args(expected)
    if origin is Literal:
        return _require(tree, tree in inner)
    if origin in (Union, types.UnionType):
        return _read_union(tree, inner, body)
    if isinstance(expected, type) and origin is None:
        return _read_plain(tree, expected, body)
    if isinstance(origin, type) and issubclass(origin, np.ndarray):
        return _array(tree, body)
    if origin is tuple:
        return tuple(_items(tree, inner, body))
    if isinstance(origin, type) and issubclass(origin, Mapping):
        key, item = inner
        return {_read(name, key, body): _read(value, item, body) for name, value in tree.items()}
    if isinstance(origin, type) and issubclass(origin, Sequence):
        return [_read(value, inner[0], body) for value in _require(tree, isinstance(tree, list))]
    # An alias: what it represents.
    if (meant := getattr(expected, "__value__", None)) is not None:
        return _read(tree, meant, body)
    raise AnswerError(f"no answer can be {expected}")


def _read_plain(tree: Any, expected: type, body: memoryview) -> Any:
    if expected is float:
        return float(_require(tree, isinstance(tree, int | float) and not isinstance(tree, bool)))
    if expected is bytes:
        return bytes(_piece(tree, body))
    if expected in (bool, int, str):
        return _require(tree, type(tree) is expected)
    if expected is np.ndarray:
        return _array(tree, body)
    if issubclass(expected, Enum):
        return expected(tree)
    if issubclass(expected, Path):
        return Path(_require(tree, isinstance(tree, str)))
    if issubclass(expected, BaseModel):
        return expected.model_validate(tree)
    if is_dataclass(expected):
        hints = _hints(expected)
        names = {f.name for f in fields(expected) if f.init}
        _require(tree, isinstance(tree, dict) and tree.keys() <= names)
        return expected(**{name: _read(value, hints[name], body) for name, value in tree.items()})
    if issubclass(expected, Mapping | list | tuple):
        return expected(tree)  # type: ignore[call-arg]
    raise AnswerError(f"no answer can be {expected}")


def _read_union(tree: Any, choices: tuple[Any, ...], body: memoryview) -> Any:
    if tree is None and type(None) in choices:
        return None
    for choice in choices:
        if choice is not type(None):
            try:
                return _read(tree, choice, body)
            except (AnswerError, *_FAULTS):
                continue
    raise AnswerError("an answer is none of what it may be")


def _items(tree: Any, inner: tuple[Any, ...], body: memoryview) -> Iterator[Any]:
    _require(tree, isinstance(tree, list))
    if len(inner) == 2 and inner[1] is Ellipsis:
        inner = (inner[0],) * len(tree)
    for value, expected in zip(tree, inner, strict=True):
        yield _read(value, expected, body)


def _array(tree: Any, body: memoryview) -> Any:
    kind = np.dtype(str(tree["dtype"]))
    shape = tuple(int(n) for n in tree["shape"])
    piece = _piece(tree["place"], body)
    if kind.kind not in "fiub" or min(shape, default=0) < 0:
        raise AnswerError("an array of a worker's answer is not one of numbers")
    if math.prod(shape) * kind.itemsize != len(piece):
        raise AnswerError("an array of a worker's answer is not as long as it says")
    return np.frombuffer(piece, kind).reshape(shape).copy()


def _piece(tree: Any, body: memoryview) -> memoryview:
    place, length = (int(n) for n in tree)
    _require(tree, place >= 0 and length >= 0 and place + length <= len(body))
    return body[place : place + length]


def _require(tree: Any, holds: bool) -> Any:
    if not holds:
        raise AnswerError("a value of a worker's answer is of another type than its task's")
    return tree


@lru_cache(maxsize=256)
def _hints(kind: type) -> dict[str, Any]:
    return get_type_hints(kind)


def _read_error(name: str, state: dict[str, Any]) -> BaseException:
    if name == "OSError":
        return OSError(state["errno"], state["text"], state["file"])
    for plain in _PLAIN:
        if name == plain.__name__:
            return plain(str(state["text"]))
    kind = getattr(core_errors, name, None) or getattr(service_errors, name, None)
    if isinstance(kind, type) and issubclass(kind, ModalMotionError):
        error = kind(str(state.pop("message")), remedy=str(state.pop("remedy")))
        for attribute in ("frame", "vertex"):
            value = state[attribute]
            setattr(error, attribute, None if value is None else int(value))
        error.limit = None if state["limit"] is None else str(state["limit"])
        error.details = dict(state["details"])
        return error
    return TaskError(str(state.get("text", name)))
