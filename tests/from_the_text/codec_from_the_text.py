"""A decoder made from docs/format.md alone: slow, plain, and without the project's codec."""

from __future__ import annotations

import math
import zlib
from typing import Any

import numpy as np
from text_of_faces import cells, walk
from text_of_modes import (
    Edges,
    dct2,
    edges_of,
    lattice_modes,
    patches_of,
    spring_modes,
)
from text_of_numbers import Array, Bytes, Coded, matrix, mixed_matrix, number_list


def parts_of(coded: Coded, pieces: list[list[int]], P: int) -> list[list[int]]:
    """Vertices of each part: section 11."""
    row = list(range(P))
    members: list[list[int]] = [[] for _ in row]
    for piece, before in zip(pieces, number_list(coded, len(pieces)), strict=True):
        row.insert(0, row.pop(before))
        members[row[0]] += piece
    return members


def mapped(numbers: Array, shape: Array, members: list[list[int]]) -> Array:
    """What the maps add to the rows of the learned components, (components, N)."""
    added = np.zeros((len(numbers), shape.shape[1]))
    for p, part in enumerate(members):
        if not part:
            continue
        functions = [np.full(len(part), 1 / np.sqrt(len(part)))]
        centred = shape[:, part] - shape[:, part].mean(axis=1)[:, None]
        for coordinate in centred:
            left = coordinate - sum((function @ coordinate) * function for function in functions)
            left -= sum((function @ left) * function for function in functions)
            root, e = np.sqrt((left**2).sum()), np.sqrt((centred**2).sum())
            functions.append(left / root if root > e / 64 else 0 * left)
        for j, function in enumerate(functions):
            added[:, part] += np.outer(numbers[:, j * len(members) + p], function)
    return added


def block(data: bytes, f: int, N: int, modes: Array, edges: Edges, form: str) -> Any:
    """Section 11."""
    source = Bytes(data)
    checksum, kind, step = source.unpack("IBf")
    shifts = (0, *source.unpack("3b"))
    exponent = source.zigzag()
    origin = np.array([source.zigzag() for _ in range(3)])
    width, rows, n_modes, n_components = (source.varint() for _ in range(4))
    read_matrix = mixed_matrix if source.byte() else matrix
    largest, P = (source.varint(), source.varint()) if kind == 2 else (0, 0)
    coded = Coded(source.data[source.at :])
    if kind == 2:
        members = parts_of(coded, patches_of(set(range(N)), edges, largest), P)
    components = read_matrix(coded, n_components, 3 * f if kind else 0)
    coefficients = read_matrix(coded, rows, n_modes)
    maps = read_matrix(coded, n_components, 4 * P)

    def values(q: Array) -> Array:
        shift = np.array([shifts[min(abs(int(n)), 3)] for n in q.ravel()]).reshape(q.shape)
        found: Array = np.sign(q) * (np.abs(q) - shift / 256) * step
        return found

    over_space = values(coefficients) @ modes[:n_modes]
    if kind == 2:
        over_space[3:] += mapped(values(maps), over_space[:3] / np.sqrt(f), members)
    positions = np.zeros((f, 3, N))
    fixed = dct2(f)[: 1 if kind else rows // 3]
    for c, component in enumerate(fixed):
        positions += component[:, None, None] * over_space[3 * c : 3 * c + 3]
    learned = values(components)
    for c, component in enumerate(learned):
        norm = math.sqrt((component**2).sum())
        component = component / (norm or 1.0)
        turned = dct2(f).T @ component.reshape(f, -1)
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
    assert zlib.crc32(vertices.tobytes()) == checksum
    return vertices


def decode_from_the_text(data: bytes) -> tuple[Any, list[list[int]]]:
    """Vertices and faces of a stream."""
    source = Bytes(data)
    assert source.take(5) == b"MMSQ\x01"
    header = Bytes(source.section())
    F, N, M = (header.varint() for _ in range(3))
    form = "<f8" if header.byte() else "<f4"
    header.byte()
    ends = list(header.take(header.byte()))
    grid = [header.varint() for _ in range(header.byte())]
    times = header.byte()
    header.take((0, 16, 8 * F)[times])
    named = Bytes(header.take(header.varint()))
    header.unpack("3f")
    frames = [header.varint() for _ in range(header.varint())]
    assert sum(frames) == F
    section = source.section()
    faces: list[list[int]] = []
    if M:
        faces = cells(section, ends, grid) if section[0] else walk(section, M, N)
    modes = lattice_modes(named) if named.byte() == 1 else spring_modes(named, N, faces)
    edges = edges_of(faces)
    parts = [block(source.section(), f, N, modes, edges, form) for f in frames]
    assert source.at == len(data)
    return np.concatenate(parts), faces
