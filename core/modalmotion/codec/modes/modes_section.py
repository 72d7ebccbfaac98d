"""Modes as the header of a stream names them."""

from __future__ import annotations

import struct
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.bits.varint import read_varint, write_varint
from modalmotion.codec.modes.lattice_modes import LatticeModes
from modalmotion.codec.modes.patch_modes import (
    LARGEST_PATCH,
    MOST_WORK,
    PROBES,
    PatchModes,
    edges_of,
)
from modalmotion.errors import LimitError, MalformedFileError
from modalmotion.modes.order import require_shape
from modalmotion.modes.topology import CLOSED, OPEN, POLE_OPEN, POLE_POLE, Topology

Ints = NDArray[np.int64]

_ENDS: Final = (OPEN, CLOSED, POLE_OPEN, POLE_POLE)
STORED: Final = b"\x00"
_LATTICE: Final = 1
_SPRINGS: Final = 2


def write_modes(modes: LatticeModes | PatchModes) -> bytes:
    """Write which modes these are, and a probe of those that are solved for."""
    if isinstance(modes, LatticeModes):
        parts = [bytes([_LATTICE, len(modes.shape)])]
        for ends, n, fine in zip(modes.topology.ends, modes.shape, modes.fineness, strict=True):
            parts += [bytes([_ENDS.index(ends), fine]), write_varint(n)]
        return b"".join(parts)
    head = bytes([_SPRINGS, modes.seed]) + write_varint(modes.largest_patch)
    return head + struct.pack(f"<{PROBES}h", *modes.probe().tolist())


def read_modes(data: bytes, n_vertices: int, faces: Ints) -> OrthonormalModes:
    """Make the modes that a stream names.

    Raises
    ------
    MalformedFileError
        If they make no sense, or are not those of the encoder.
    LimitError
        If solving for them would take too long.
    """
    try:
        if data[0] == _LATTICE:
            return _read_lattice(data, n_vertices)
        if data[0] == _SPRINGS:
            return _read_springs(data, n_vertices, faces)
    except (IndexError, ValueError, struct.error) as error:
        if hasattr(error, "remedy"):
            raise
    raise MalformedFileError(
        "The stream names no modes that this decoder knows.",
        remedy="The stream is damaged: send it again.",
    )


def _read_lattice(data: bytes, n_vertices: int) -> LatticeModes:
    ends, shape, fineness, position = [], [], [], 2
    for _ in range(data[1]):
        ends.append(_ENDS[data[position]])
        fineness.append(data[position + 1])
        n, position = read_varint(data, position + 2)
        shape.append(n)
    topology = Topology(tuple(ends))
    n_nodes = 1
    for n in shape:
        n_nodes *= n
    if n_nodes != n_vertices or position != len(data):
        raise ValueError
    require_shape(topology, tuple(shape))
    return LatticeModes(topology, tuple(shape), tuple(fineness))


def _read_springs(data: bytes, n_vertices: int, faces: Ints) -> PatchModes:
    largest, position = read_varint(data, 2)
    probe = np.array(struct.unpack_from(f"<{PROBES}h", data, position), dtype=np.int64)
    if largest < 1 or position + 2 * PROBES != len(data):
        raise ValueError
    largest = min(largest, n_vertices)
    if largest > LARGEST_PATCH or float(largest) ** 2 * n_vertices > MOST_WORK:
        raise LimitError(
            f"Patches of {largest} vertices of a mesh of {n_vertices} take too long to solve.",
            remedy="No encoder of this project writes such a stream: refuse its sender.",
            limit="spring_modes",
        )
    modes = PatchModes(edges_of(faces), n_vertices, largest, data[1])
    if np.abs(modes.probe() - probe).max() > 1:
        raise MalformedFileError(
            "The spring modes that this machine finds are not those of the encoder.",
            remedy="Encode the sequence on this machine, or without spring modes.",
        )
    return modes


Floats = NDArray[np.float64]


class OrthonormalModes(Protocol):
    """An orthonormal basis of the vertices, smoothest modes first."""

    def analyse(self, values: Floats) -> Floats:
        """Values to coefficients, (rows, vertices) to (rows, modes)."""

    def synthesise(self, coefficients: Floats) -> Floats:
        """Coefficients of the first modes to values, (rows, modes) to (rows, vertices)."""
