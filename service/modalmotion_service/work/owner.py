"""Whose work a worker does: what it has seen of one owner is nothing to another.

Workers serve all owners, and what is computed once for one would be there sooner for the next: from
the time of an answer one could tell whether another had sent the same surface.
"""

from __future__ import annotations

import inspect
import pickle
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Final

from modalmotion_service.work.answers import to_bytes

# Of the program itself, or by paths, which are in one owner's folder.
_OF_NOBODY: Final = frozenset({"_load_shipped", "_loaded", "_hints", "result_type"})

_owner: ContextVar[str | None] = ContextVar("owner", default=None)
_served: list[str] = []


@contextmanager
def work_of(owner: str) -> Iterator[None]:
    """Have the tasks that are handed on in this block done as the work of an owner.

    Parameters
    ----------
    owner : str
        Folder of their store.
    """
    token = _owner.set(owner)
    try:
        yield
    finally:
        _owner.reset(token)


def attributed(function: Callable[..., Any], args: Any) -> tuple[Callable[..., Any], Any]:
    """Give a task as one that says whose it is, with its arguments."""
    owner = _owner.get()
    return (function, args) if owner is None else (serve, (owner, function, *args))


def serve(owner: str, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
    """Do a task for an owner, in a worker, which first forgets what it knows of others."""
    # All formats, which the processes that only hand tasks on do without.
    from modalmotion_service.work.upload import end_parser

    if _served and _served[-1] != owner:
        for cache in remembering():
            cache.cache_clear()
        end_parser()
    _served[:] = [owner]
    return function(*args, **kwargs)


def remembering() -> list[Any]:
    """List the caches of our modules whose keys a user's data may have a part in."""
    modules = [module for name, module in list(sys.modules.items()) if _is_ours(name)]
    values = [value for module in modules for value in list(vars(module).values())]
    return [value for value in values if hasattr(value, "cache_clear") and _depends(value)]


def _is_ours(module: str) -> bool:
    return module.partition(".")[0] in ("modalmotion", "modalmotion_service")


def _depends(cache: Any) -> bool:
    function = cache.__wrapped__
    return bool(inspect.signature(function).parameters) and function.__name__ not in _OF_NOBODY


def payload_of(function: Callable[..., Any], args: Any, kwargs: Any) -> bytes:
    """Write a task, as the work of whoever it is done for."""
    return pickle.dumps((*attributed(function, args), kwargs))


def run_payload(payload: bytes) -> bytes:
    """Run a task in a disposable process, which imports no more than the task needs.

    Returns
    -------
    bytes
        The result, as `modalmotion_service.work.answers` writes it.
    """
    function, args, kwargs = pickle.loads(payload)  # noqa: S301 (sent by our own service)
    return to_bytes(function(*args, **kwargs))
