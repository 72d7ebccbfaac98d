"""Large meshes with their compiled kernels and without, whatever their size."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from modalmotion.mesh import dissection, machine

with pytest.MonkeyPatch.context() as _patch:
    _patch.setattr(machine, "LARGE", 1)
    _are_there = machine.kernels_for(1) is not None

compiled = pytest.mark.skipif(
    not _are_there, reason="the kernels are not compiled: modalmotion compile-codec"
)


@contextmanager
def large(n_vertices: int = 1, *, kernels: bool = True) -> Iterator[None]:
    """Meshes of so many vertices are large."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(machine, "LARGE", n_vertices)
        patch.setattr(dissection, "LARGE", 10**9)
        if not kernels:
            patch.setattr(machine, "_mapped", [None])
        yield
