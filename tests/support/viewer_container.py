"""Reads what the viewer is sent, as the viewer does."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.viewer.container import MAGIC


def read_container(data: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Give the header and the arrays by name."""
    assert data.startswith(MAGIC)
    before = len(MAGIC) + 4
    start = before + int.from_bytes(data[len(MAGIC) : before], "little")
    header = json.loads(data[before:start])
    arrays = {}
    for name, entry in header.pop("arrays").items():
        count = int(np.prod(entry["shape"], dtype=np.int64))
        flat = np.frombuffer(data, entry["dtype"], count, start + entry["place"])
        arrays[name] = flat.reshape(entry["shape"])
    return header, arrays
