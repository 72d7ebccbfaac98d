"""The one way in which kernels are compiled."""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from typing import Any, Final, ParamSpec, TypeVar

P = ParamSpec("P")
R = TypeVar("R")

OPTIONS: Final[dict[str, Any]] = {
    # Division by zero is excluded by each kernel, and nothing raises in compiled code.
    "error_model": "numpy",
    "fastmath": False,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
}


def kernel(function: Callable[P, R]) -> Callable[P, R]:
    """Compile a function when another compiled one calls it."""
    compiled: Callable[P, R] = import_module("numba").njit(**OPTIONS)(function)
    return compiled
