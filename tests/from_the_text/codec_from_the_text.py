"""A decoder made from docs/format.md alone: slow, plain, and without the project's codec."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
from text_of_faces import cells, walk
from text_of_modes import dct2, fourier, lattice_modes, pair_modes, spring_modes
from text_of_numbers import Array, Bytes, Coded, matrix, mixed_matrix, number_list


def block(data: bytes, f: int, N: int, modes: Array, form: str) -> Any:
    """Section 11."""
    source = Bytes(data)
    digest = source.take(8)
    kind, step = source.unpack("Bf")
    shifts = (0, *source.unpack("3b"))
    exponent = source.zigzag()
    origin = np.array([source.zigzag() for _ in range(3)])
    width, rows, n_modes, n_components = (source.varint() for _ in range(4))
    read_matrix = mixed_matrix if source.byte() else matrix
    coded = Coded(source.data[source.at :])
    components = read_matrix(coded, n_components, (3 * f if kind == 3 else f) if kind > 1 else 0)
    coefficients = read_matrix(coded, rows, n_modes)

    def values(q: Array) -> Array:
        shift = np.array([shifts[min(abs(int(n)), 3)] for n in q.ravel()]).reshape(q.shape)
        found: Array = np.sign(q) * (np.abs(q) - shift / 256) * step
        return found

    over_space = values(coefficients) @ modes[:n_modes]
    positions = np.zeros((f, 3, N))
    fixed = (dct2 if kind != 1 else fourier)(f)[: rows // 3 if kind < 2 else 1]
    for c, component in enumerate(fixed):
        positions += component[:, None, None] * over_space[3 * c : 3 * c + 3]
    learned = values(components)
    for c, component in enumerate(learned):
        norm = math.sqrt((component**2).sum())
        component = component / (norm or 1.0)
        turned = dct2(f).T @ component.reshape(f, -1)
        if kind == 2:
            positions += turned[:, :, None] * over_space[3 + 3 * c : 6 + 3 * c]
        else:
            positions += turned[:, :, None] * over_space[3 + c]
    n_values = positions.size
    whole = np.rint(positions).astype(np.int64).ravel()
    n_guards = number_list(coded, 1)[0]
    places = [coded.bits(max(1, n_values.bit_length())) for _ in range(n_guards)]
    for place in places:
        whole[place] = math.floor(positions.ravel()[place]) + coded.bits(1)
    if width:
        n = number_list(coded, 1)[0]
        place, gaps = -1, number_list(coded, n)
        sizes = number_list(coded, n)
        for gap, size in zip(gaps, sizes, strict=True):
            place += gap + 1
            whole[place] += (-1 if coded.bits(1) else 1) * (size + 1) * width
    total = whole.reshape(f, 3, N).transpose(0, 2, 1) + origin
    vertices = np.ldexp(total.astype(np.float64), exponent).astype(form)
    assert hashlib.sha256(np.ascontiguousarray(vertices).tobytes()).digest()[:8] == digest
    return vertices


def decode_from_the_text(data: bytes) -> tuple[Any, list[list[int]]]:
    """Vertices and faces of a stream."""
    source = Bytes(data)
    assert source.take(5) in (b"MMSQ\x02", b"MMSQ\x04", b"MMSQ\x07")
    header = Bytes(source.section())
    F, N, M = (header.varint() for _ in range(3))
    form = "<f8" if header.byte() else "<f4"
    header.byte()
    ends = list(header.take(header.byte()))
    grid = [header.varint() for _ in range(header.byte())]
    times = header.byte()
    header.take({0: 0, 1: 16}[times] if times < 2 else header.varint())
    named = Bytes(header.take(header.varint()))
    header.unpack("3f")
    frames = [header.varint() for _ in range(header.varint())]
    assert sum(frames) == F
    section = source.section()
    faces: list[list[int]] = []
    if M:
        faces = cells(section, ends, grid) if section[0] else walk(section, M, N)
    kind = named.byte()
    if kind == 4:
        modes = pair_modes(named, N, faces)
    else:
        modes = lattice_modes(named) if kind == 1 else spring_modes(named, N, faces, kind == 3)
    parts = [block(source.section(), f, N, modes, form) for f in frames]
    assert source.at == len(data)
    return np.concatenate(parts), faces
