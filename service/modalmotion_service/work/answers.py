"""What a worker answers, as bytes of a known form: nothing in them can run code.

A worker reads files that strangers send, so its answers are read as a stranger's too: they are
never unpickled. The reader knows of what type an answer must be (the task's own annotation says
so), and pydantic makes nothing else of it: plain values, byte strings, and the dataclasses, models
and enumerations that the type names. An error is the name of a class of ours and its data.

The form: the length of a JSON text (8 bytes, little-endian), the text, then all byte strings, which
the text refers to by their place and length.
"""

from __future__ import annotations

import json
import types
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import lru_cache, partial
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

# In place of byte strings; nothing else is called so.
_BYTES: Final = "\0bytes"


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
    return _joined(result=value)


def error_to_bytes(error: BaseException) -> bytes:
    """Write an error: its class and data if it is one of ours, else its traceback."""
    if isinstance(error, ModalMotionError):
        state = {name: getattr(error, name) for name in _OF_ERRORS}
        state["details"] = json.loads(json.dumps(state["details"], default=str))
        return _joined(error=type(error).__name__, state=state)
    if isinstance(error, OSError):
        file = None if error.filename is None else str(error.filename)
        state = {"errno": error.errno, "text": error.strerror, "file": file}
        return _joined(error="OSError", state=state)
    if isinstance(error, _PLAIN):
        return _joined(error=type(error).__name__, state={"text": str(error)[:1000]})
    # Here, for a worker whose memory is full can import little.
    import traceback

    text = "".join(traceback.format_exception(error))[-20_000:]
    return _joined(error="TaskError", state={"text": text})


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
        head = json.loads(data[_PREFIX : _PREFIX + length], object_hook=partial(_placed, body))
        if "error" not in head:
            return _reader(expected).validate_python([head["result"]])[0]
        error = _read_error(str(head["error"]), dict(head["state"]))
    except AnswerError:
        raise
    except (
        ValueError,
        TypeError,
        LookupError,
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


def _joined(**head: object) -> bytes:
    pieces: list[bytes] = []

    def plain(value: object) -> object:
        """Give what JSON has a form for."""
        if isinstance(value, bytes):
            pieces.append(value)
            return {_BYTES: [sum(map(len, pieces[:-1])), len(value)]}
        if isinstance(value, Enum):
            return value.value
        if isinstance(value, Path):
            return str(value)
        if isinstance(value, np.generic):
            return value.item()
        if isinstance(value, BaseModel):
            return value.model_dump(mode="json")
        if is_dataclass(value) and not isinstance(value, type):
            return {field.name: getattr(value, field.name) for field in fields(value) if field.init}
        if isinstance(value, Mapping):
            return dict(value)
        raise AnswerError(f"{type(value).__name__} has no form here")

    text = json.dumps(head, default=plain).encode()
    return b"".join((len(text).to_bytes(_PREFIX, "little"), text, *pieces))


@lru_cache(maxsize=256)
def _reader(expected: Any) -> TypeAdapter[Any]:
    # In a tuple, for what has a configuration of its own takes none.
    return TypeAdapter(tuple[expected], config=ConfigDict(arbitrary_types_allowed=True))


def _placed(body: memoryview, tree: dict[str, Any]) -> Any:
    """Put a byte string where the text refers to it."""
    if _BYTES not in tree:
        return tree
    place, size = (int(n) for n in tree[_BYTES])
    if not 0 <= place <= place + size <= len(body):
        raise AnswerError("a piece of a worker's answer is not in it")
    return bytes(body[place : place + size])


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
