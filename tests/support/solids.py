"""The volume that a surface encloses, summed without rounding of its terms."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


def exact_volume(vertices: Floats, faces: Ints) -> float:
    """Sum without rounding of its terms, each opening closed by a fan, loop by loop."""
    directed = {(int(f[i]), int(f[(i + 1) % 3])) for f in faces for i in range(3)}
    following = {a: b for a, b in directed if (b, a) not in directed}
    origin = vertices[faces.ravel()].mean(axis=0)
    triangles = [tuple(vertices[i] - origin for i in face) for face in faces]
    while following:
        loop = [next(iter(following))]
        while (after := following.pop(loop[-1])) != loop[0]:
            loop.append(after)
        centre = (vertices[loop] - origin).mean(axis=0)
        around = zip(loop, loop[1:] + loop[:1], strict=True)
        triangles += [(centre, vertices[b] - origin, vertices[a] - origin) for a, b in around]
    terms = []
    for a, b, c in triangles:
        terms += [a[i] * b[(i + 1) % 3] * c[(i + 2) % 3] for i in range(3)]
        terms += [-a[i] * b[(i + 2) % 3] * c[(i + 1) % 3] for i in range(3)]
    return math.fsum(map(float, terms)) / 6
