"""Files of images made in memory, as other programs write them."""

from __future__ import annotations

import numpy as np


def metaimage(values: np.ndarray | None = None, spacing: str = "2 2 2 0.1") -> bytes:
    """Write a .mha of whole numbers along i, j, k and time; a small one by default."""
    if values is None:
        values = np.arange(4 * 3 * 2 * 2, dtype=np.uint8).reshape(4, 3, 2, 2)
    kind = {"u1": "MET_UCHAR", "i2": "MET_SHORT"}[values.dtype.str[1:]]
    head = (
        "ObjectType = Image\n"
        f"NDims = {values.ndim}\n"
        f"DimSize = {' '.join(map(str, values.shape))}\n"
        f"ElementSpacing = {' '.join(spacing.split()[: values.ndim])}\n"
        f"ElementType = {kind}\n"
        "ElementDataFile = LOCAL\n"
    )
    return head.encode() + values.tobytes(order="F")
