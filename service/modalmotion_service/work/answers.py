"""What a worker answers, as bytes of a known form: nothing in them can run code.

A worker reads files that strangers send, so its answers are read as a stranger's too: they are
never unpickled. The reader knows of what type an answer must be (the task's own annotation says
so), and pydantic makes nothing else of it: plain values, arrays of numbers, and the dataclasses,
models and enumerations that the type names. An error is the name of a class of ours and its data.

The form: the length of a JSON text (8 bytes, little-endian), the text, then the bytes of all
arrays and byte strings, which the text refers to by their place and length.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, get_type_hints

import numpy as np
from pydantic import BaseModel, ConfigDict, TypeAdapter

from modalmotion import errors as core_errors
from modalmotion.errors import ModalMotionError
from modalmotion_service import errors as service_errors

_PREFIX: Final = 8

# Attributes that every error of ours has.
_OF_ERRORS: Final = ("message", "remedy", "frame", "vertex", "limit", "details")

# Errors of Python that mean something to whoever asked; all others are faults of ours.
_PLAIN: Final = (MemoryError, RecursionError)

# In place of byte strings and arrays; nothing else is called so.
_BYTES: Final = "\0bytes"
_ARRAY: Final = "\0array"


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
            return _reader(expected).validate_python([_placed(head["result"], body)])[0]
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


def _written(value: object, pieces: list[bytes | memoryview]) -> object:
    if isinstance(value, Enum):
        return _written(value.value, pieces)
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.generic):
        return _written(value.item(), pieces)
    if isinstance(value, bytes):
        return {_BYTES: _place_of(value, pieces)}
    if isinstance(value, Path):
        return str(value)
    if isinstance(value, np.ndarray):
        plain = np.ascontiguousarray(value)
        if plain.dtype.kind not in "fiub":
            raise AnswerError(f"an array of {plain.dtype} has no form here")
        place = _place_of(memoryview(plain.reshape(-1).view(np.uint8).data), pieces)
        return {"dtype": plain.dtype.str, "shape": value.shape, _ARRAY: place}
    if isinstance(value, BaseModel):
        return value.model_dump(mode="json")
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: _written(getattr(value, f.name), pieces) for f in fields(value) if f.init}
    if isinstance(value, Mapping):
        return {str(name): _written(inner, pieces) for name, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_written(inner, pieces) for inner in value]
    raise AnswerError(f"{type(value).__name__} has no form here")


def _place_of(piece: bytes | memoryview, pieces: list[bytes | memoryview]) -> list[int]:
    place = sum(len(other) for other in pieces)
    pieces.append(piece)
    return [place, len(piece)]


@lru_cache(maxsize=256)
def _reader(expected: Any) -> TypeAdapter[Any]:
    # In a tuple, for what has a configuration of its own takes none.
    return TypeAdapter(tuple[expected], config=ConfigDict(arbitrary_types_allowed=True))


def _placed(tree: Any, body: memoryview) -> Any:
    """Put byte strings and arrays where the text refers to them."""
    if isinstance(tree, list):
        return [_placed(one, body) for one in tree]
    if not isinstance(tree, dict):
        return tree
    if _BYTES in tree:
        return bytes(_piece(tree[_BYTES], body))
    if _ARRAY not in tree:
        return {name: _placed(one, body) for name, one in tree.items()}
    kind, shape = np.dtype(str(tree["dtype"])), tuple(int(n) for n in tree["shape"])
    if kind.kind not in "fiub" or min(shape, default=0) < 0:
        raise AnswerError("an array of a worker's answer is not one of numbers")
    # As long as it says, or there is an error.
    return np.frombuffer(_piece(tree[_ARRAY], body), kind).reshape(shape).copy()


def _piece(tree: Any, body: memoryview) -> memoryview:
    place, length = (int(n) for n in tree)
    if not 0 <= place <= place + length <= len(body):
        raise AnswerError("a piece of a worker's answer is not in it")
    return body[place : place + length]


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
