"""Sequences that the codec is measured on, and what it makes of them."""

from __future__ import annotations

import itertools
from typing import Any, Final

import numpy as np
from real_data import recording
from scipy.spatial.transform import Rotation

from modalmotion.codec import Effort, decode, encode
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.simulate import Acquisition, simulate_ventricle

SHARE: Final = 0.003  # of the mean diagonal, that may be lost
TARGETS: Final = {"rms": "rms", "max": "max_error"}
SEQUENCES: Final = {
    "lattice": ("real ventricle, lattice of 2,048", "heart/lv_grid_32x64", 25),
    "heart": ("real ventricle, mesh of 1,572", "heart/lv_endocardium", 25),
    "cow": ("walking cow, 12 frames", "literature/pcow", 12),
    "robot": ("dancing robot, 25 frames", "robot/Dance", 25),
    "large": ("2 frames of a simulated mesh of 5,000", "", 2),
}
"""By name: what it is, the recording or none, frames."""


def sequence_of(name: str, seed: int = 0) -> MeshSequence:
    """Frames evenly spread over a recording; for other seeds than 0 turned at random."""
    _, path, n_frames = SEQUENCES[name]
    whole = recording(path) if path else beat(5000, n_frames)
    vertices = whole.vertices[np.linspace(0, whole.n_frames - 1, n_frames).astype(int)]
    if seed:
        turn = Rotation.random(random_state=np.random.default_rng([seed, 7])).as_matrix()
        vertices = (vertices @ turn.T).astype(np.float32)
    return mesh_sequence(
        vertices, whole.faces, grid=whole.grid, topology=whole.topology, unit=whole.unit
    )


def beat(n_vertices: int, n_frames: int = 25) -> MeshSequence:
    """Simulate a ventricle whose vertices are off by 0.3 mm."""
    frames, rng = Acquisition(n_frames=n_frames, noise=0.3), np.random.default_rng(1994)
    return simulate_ventricle(n_vertices=n_vertices, acquisition=frames, rng=rng)


def mean_diagonal(sequence: MeshSequence) -> float:
    """D: diagonal of the bounding box, in the mean over frames."""
    extent = np.ptp(sequence.vertices.astype(np.float64), axis=1)
    return float(np.linalg.norm(extent, axis=1).mean())


def coded(name: str, seed: int) -> tuple[float, ...]:
    """Encode at two targets and all efforts, and decode.

    Bits a vertex and frame, target by target; the largest error over the one asked for; in how many
    pairs of efforts the higher takes more bits.
    """
    sequence = sequence_of(name, seed)
    sizes: list[float] = []
    kept, disorder = 0.0, 0
    for target in TARGETS.values():
        bound: dict[str, Any] = {target: SHARE * mean_diagonal(sequence)}
        streams = [encode(sequence, effort=effort, **bound) for effort in Effort]
        for stream in streams:
            errors = decode(stream.data).vertices - sequence.vertices.astype(np.float64)
            far = np.linalg.norm(errors, axis=-1)
            reached = np.sqrt((far**2).mean()) if target == "rms" else far.max()
            kept = max(kept, float(reached) / bound[target])
        bits = [stream.bits_per_vertex_and_frame for stream in streams]
        disorder += sum(higher > lower for lower, higher in itertools.combinations(bits, 2))
        sizes += bits
    return (*sizes, kept, disorder)
