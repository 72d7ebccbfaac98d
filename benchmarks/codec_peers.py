"""Peers of the codec: what can be installed, at the coarsest setting that keeps an error."""

from __future__ import annotations

import io
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.measure import measure
from modalmotion.mesh.sequence import MeshSequence

Positions = NDArray[np.float32]
Coder = Callable[[Positions, float], tuple[int, Positions]]


def mean_diagonal(vertices: Positions) -> float:
    """D: mean over frames of the diagonal of the bounding box."""
    extent = np.ptp(vertices.astype(np.float64), axis=1)
    return float(np.linalg.norm(extent, axis=1).mean())


@dataclass(frozen=True, eq=False)
class Found:
    """A peer at the coarsest setting that keeps the error."""

    n_bytes: int
    decoded: Positions
    seconds: float
    setting: float


def at_error(coder: Coder, exact: Positions, kind: str, wanted: float) -> Found | None:
    low, high = np.log(wanted) - 4.0, np.log(wanted) + 4.0
    best: Found | None = None
    for _ in range(12):
        middle = (low + high) / 2
        start = time.perf_counter()
        n_bytes, decoded = coder(exact, float(np.exp(middle)))
        seconds = time.perf_counter() - start
        errors = measure(exact, decoded)
        if (errors.rms if kind == "rms" else errors.max_error) <= wanted:
            if best is None or n_bytes < best.n_bytes:
                best = Found(n_bytes, decoded, seconds, float(np.exp(middle)))
            low = middle
        else:
            high = middle
    return best


def peers_of(sequence: MeshSequence) -> dict[str, Coder]:
    """Those that are installed."""
    peers: dict[str, tuple[str, Coder]] = {
        "SZ3": ("hdf5plugin", partial(sz3, sequence.grid)),
        "zfp": ("zfpy", partial(_zfp, sequence.grid)),
        "PCA, basis counted": ("numpy", partial(_pca, _principal(sequence))),
        "Draco, each frame": ("DracoPy", partial(_draco, sequence.faces)),
    }
    return {name: coder for name, (module, coder) in peers.items() if is_installed(module)}


@cache
def is_installed(module: str) -> bool:
    """Tell whether a peer is there, and say once if it is not."""
    there = find_spec(module) is not None
    if not there:
        print(f"{module} is not installed (extra bench): its rows are left out")
    return there


def volumes_of(exact: Positions, grid: tuple[int, ...] | None) -> list[NDArray[np.float32]]:
    """Three arrays, one for each direction: frames x vertices, or frames x rows x columns."""
    shape = (len(exact), *(grid or exact.shape[1:2]))
    return [np.ascontiguousarray(exact[:, :, i]).reshape(shape) for i in range(3)]


def _joined(volumes: list[NDArray[Any]], exact: Positions) -> Positions:
    return np.stack([v.reshape(exact.shape[:2]) for v in volumes], axis=-1).astype(np.float32)


def sz3_file(volume: NDArray[np.float32], bound: float) -> io.BytesIO:
    import h5py

    hdf5plugin = import_module("hdf5plugin")

    file = io.BytesIO()
    with h5py.File(file, "w") as h5:
        filters = hdf5plugin.SZ3(absolute=bound)
        h5.create_dataset("x", data=volume, chunks=volume.shape, **filters)
    return file


def sz3_read(file: io.BytesIO) -> tuple[int, NDArray[np.float32]]:
    import h5py

    with h5py.File(file, "r") as h5:
        return h5["x"].id.get_storage_size(), h5["x"][:]


def sz3(grid: tuple[int, ...] | None, exact: Positions, setting: float) -> tuple[int, Positions]:
    parts = [sz3_read(sz3_file(volume, setting)) for volume in volumes_of(exact, grid)]
    return sum(n for n, _ in parts), _joined([v for _, v in parts], exact)


def _zfp(grid: tuple[int, ...] | None, exact: Positions, setting: float) -> tuple[int, Positions]:
    zfpy = import_module("zfpy")
    packed = [zfpy.compress_numpy(v, tolerance=setting) for v in volumes_of(exact, grid)]
    return sum(map(len, packed)), _joined([zfpy.decompress_numpy(p) for p in packed], exact)


Principal = tuple[NDArray[np.float64], ...]


def _principal(sequence: MeshSequence) -> Principal:
    """Mean, trajectories, strengths and coefficients of the principal components."""
    exact = sequence.vertices.astype(np.float64)
    flat = exact.transpose(0, 2, 1).reshape(3 * len(exact), -1)
    mean = flat.mean(axis=1, keepdims=True)
    U, s, Vt = np.linalg.svd(flat - mean, full_matrices=False)
    return mean, U, s, Vt


def _pca(principal: Principal, exact: Positions, setting: float) -> tuple[int, Positions]:
    """Principal components of the trajectories; basis and coefficients in one step, deflated."""
    mean, U, s, Vt = principal
    left = np.sqrt(np.maximum((s**2).sum() - np.cumsum(s**2), 0.0) / exact[..., 0].size)
    k = int(np.searchsorted(-left, -setting)) + 1
    total, parts = 4 * len(mean), []
    # One step for strength x trajectory and for what the coefficients add at that strength.
    for factor, steps in ((U[:, :k] * s[:k], np.ones(k)), (Vt[:k].T, 1.0 / s[:k])):
        numbers = np.rint(factor / (setting * steps)).astype("<i4")
        planes = np.frombuffer(numbers.tobytes(), np.uint8).reshape(-1, 4).T
        total += len(zlib.compress(planes.tobytes(), 9))
        parts.append(numbers * (setting * steps))
    found = mean + (parts[0] / s[:k]) @ (parts[1] * s[:k]).T
    decoded = found.reshape(len(exact), 3, -1).transpose(0, 2, 1)
    return total, np.ascontiguousarray(decoded, dtype=np.float32)


def _draco(faces: NDArray[np.int64], exact: Positions, setting: float) -> tuple[int, Positions]:
    """Draco, frame by frame.

    Its bytes are those of the layout it compresses best, in which it is free to reorder the
    vertices; its error is measured in the layout that keeps their order, at the same bits.
    """
    draco = import_module("DracoPy")
    extent = float(np.ptp(exact, axis=1).max())
    bits = int(np.clip(np.ceil(np.log2(extent / setting)), 1, 24))
    total, decoded = 0, np.empty_like(exact)
    for frame, positions in enumerate(exact):
        pack = partial(
            draco.encode,
            positions,
            faces=faces.astype(np.uint32) if len(faces) else None,
            quantization_bits=bits,
            compression_level=10,
        )
        total += len(pack())
        decoded[frame] = draco.decode(pack(preserve_order=True)).points
    return total, decoded
