"""A task as bytes: how it is handed on through machines that need not understand it."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

from modalmotion_service.work.answers import to_bytes
from modalmotion_service.work.owner import attributed


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
