"""The codec without its compiled kernels, and with them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from modalmotion.codec.machine import image as images
from modalmotion.codec.modes import halving, pairs

compiled = pytest.mark.skipif(
    images.image() is None, reason="the codec is not compiled: modalmotion compile-codec"
)


@contextmanager
def pure() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(images, "_mapped", [None])
        for module in (halving, pairs):
            patch.setattr(module, "library", lambda: None)
        yield
