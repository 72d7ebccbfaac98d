"""What a worker answers, as bytes of a known form: nothing in them can run code.

A worker reads files that strangers send, so its answers are read as a stranger's too: they are
never unpickled. The reader knows of what type an answer must be (the task's own annotation says
so), and pydantic makes nothing else of it: plain values, byte strings, and the dataclasses, models
and enumerations that the type names. An error is the name of a class of ours and its data.

The form: a sign that tells results from errors, then JSON as pydantic writes it, byte strings as
base64.
"""

import json
import types
from collections.abc import Callable, Mapping
from functools import lru_cache
from typing import Any, Final, get_type_hints

import numpy as np
from pydantic import ConfigDict, TypeAdapter
from pydantic_core import PydanticSerializationError, to_json

from modalmotion import errors
from modalmotion_service import errors as service_errors

_RESULT: Final = b"="
_ERROR: Final = b"!"

# Attributes that every error of ours has.
_OF_ERRORS: Final = ("message", "remedy", "frame", "vertex", "limit", "details")

# Errors of Python that mean something to whoever asked; all others are faults of ours.
_PLAIN: Final = (MemoryError, RecursionError)


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
    try:
        text = to_json([value], bytes_mode="base64", inf_nan_mode="constants", fallback=_plain)
    except PydanticSerializationError as error:
        raise AnswerError(f"{type(value).__name__} has no form here") from error
    return _RESULT + text


def error_to_bytes(error: BaseException) -> bytes:
    """Write an error: its class and data if it is one of ours, else its traceback."""
    if isinstance(error, errors.ModalMotionError):
        state = {name: getattr(error, name) for name in _OF_ERRORS}
        return _written(type(error).__name__, **state)
    if isinstance(error, OSError):
        file = None if error.filename is None else str(error.filename)
        return _written("OSError", errno=error.errno, text=error.strerror, file=file)
    if isinstance(error, _PLAIN):
        return _written(type(error).__name__, text=str(error)[:1000])
    # Here, for a worker whose memory is full can import little.
    import traceback

    text = "".join(traceback.format_exception(error))[-20_000:]
    return _written("TaskError", text=text)


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
        if data[:1] != _ERROR:
            return _reader(expected).validate_json(data.removeprefix(_RESULT))[0]
        name, state = json.loads(data[1:])
        error = _read_error(str(name), dict(state))
    except Exception as fault:  # whatever a stranger's bytes lead to
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


def _plain(value: object) -> object:
    """Give what JSON has a form for."""
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, Mapping):
        return dict(value)
    raise ValueError


def _written(name: str, **state: object) -> bytes:
    # Names in files may have lone surrogates: escaped, they are plain ASCII.
    return _ERROR + json.dumps([name, state], default=str, skipkeys=True).encode()


@lru_cache(maxsize=256)
def _reader(expected: Any) -> TypeAdapter[Any]:
    # In a tuple, for what has a configuration of its own takes none.
    config = ConfigDict(arbitrary_types_allowed=True, val_json_bytes="base64")
    return TypeAdapter(tuple[expected], config=config)


def _read_error(name: str, state: dict[str, Any]) -> BaseException:
    if name == "OSError":
        return OSError(state["errno"], state["text"], state["file"])
    for plain in _PLAIN:
        if name == plain.__name__:
            return plain(str(state["text"]))
    kind = getattr(errors, name, None) or getattr(service_errors, name, None)
    if isinstance(kind, type) and issubclass(kind, errors.ModalMotionError):
        error = kind(str(state.pop("message")), remedy=str(state.pop("remedy")))
        for attribute in ("frame", "vertex"):
            value = state[attribute]
            setattr(error, attribute, None if value is None else int(value))
        error.limit = None if state["limit"] is None else str(state["limit"])
        error.details = dict(state["details"])
        return error
    return TaskError(str(state.get("text", name)))
