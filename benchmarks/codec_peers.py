"""Peers of the codec: what can be installed, at the coarsest setting that keeps an error."""

from __future__ import annotations

import io
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from importlib import import_module
from importlib.util import find_spec
from operator import itemgetter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.codec.measure import measure
from modalmotion.mesh.sequence import MeshSequence

Positions = NDArray[np.float32]
Volume = NDArray[np.float32]


@dataclass(frozen=True)
class Peer:
    """A coder: from positions and a setting to what `decode` takes, and the bytes of that."""

    encode: Callable[[Positions, float], Any]
    decode: Callable[[Any], Positions]
    size: Callable[[Any], int]

    def at_rms(self, exact: Positions, wanted: float) -> float | None:
        """Find the coarsest setting that keeps an RMS."""
        low, high, best = np.log(wanted) - 4.0, np.log(wanted) + 4.0, None
        for _ in range(12):
            middle = (low + high) / 2
            setting = float(np.exp(middle))
            if measure(exact, self.decode(self.encode(exact, setting))).rms <= wanted:
                best, low = setting, middle
            else:
                high = middle
        return best


def peers_of(sequence: MeshSequence) -> dict[str, Peer]:
    """Those that are installed, each with the layout of the numbers that it compresses best."""
    grid = sequence.grid or (sequence.n_vertices,)
    principal = _principal(sequence)
    peers = {
        "SZ3, interpolated": ("pysz", _by_volumes(grid, *_sz3("INTERP_LORENZO"))),
        "SZ3, predicted": ("pysz", _by_volumes(grid, *_sz3("LORENZO_REG"))),
        "SZ3 in HDF5": ("hdf5plugin", _by_volumes(grid, *_hdf5())),
        "zfp": ("zfpy", _by_volumes(grid, *_zfp())),
        "PCA, basis counted": (
            "numpy",
            Peer(partial(_pca, principal), itemgetter(1), itemgetter(0)),
        ),
        "Draco, each frame": (
            "DracoPy",
            Peer(partial(_draco, sequence.faces), itemgetter(1), itemgetter(0)),
        ),
    }
    return {name: peer for name, (module, peer) in peers.items() if is_installed(module)}


@cache
def is_installed(module: str) -> bool:
    """Tell whether a peer is there, and say once if it is not."""
    there = find_spec(module) is not None
    if not there:
        print(f"{module} is not installed (extra bench): its rows are left out")
    return there


def _by_volumes(
    grid: tuple[int, ...],
    write: Callable[[Volume, float], Any],
    read: Callable[[Any], Volume],
    size: Callable[[Any], int],
) -> Peer:
    """Code frames x vertices, or frames x rows x columns, direction by direction."""

    def encode(exact: Positions, setting: float) -> list[Any]:
        shape = (len(exact), *grid)
        volumes = (np.ascontiguousarray(exact[:, :, i]).reshape(shape) for i in range(3))
        return [write(volume, setting) for volume in volumes]

    def decode(parts: list[Any]) -> Positions:
        volumes = [read(part) for part in parts]
        return np.stack([volume.reshape(len(volume), -1) for volume in volumes], axis=-1)

    return Peer(encode, decode, lambda parts: sum(map(size, parts)))


def _sz3(algorithm: str) -> tuple[Any, Any, Any]:
    """SZ3 itself, by one of its algorithms."""

    def write(volume: Volume, bound: float) -> tuple[Any, tuple[int, ...]]:
        pysz = import_module("pysz")
        config = pysz.szConfig()
        config.errorBoundMode = pysz.szErrorBoundMode.ABS
        config.absErrorBound = bound
        config.cmprAlgo = getattr(pysz.szAlgorithm, algorithm)
        return pysz.sz.compress(volume, config)[0], volume.shape

    def read(part: tuple[Any, tuple[int, ...]]) -> Volume:
        volume: Volume = import_module("pysz").sz.decompress(part[0], np.float32, part[1])[0]
        return volume

    return write, read, lambda part: part[0].nbytes


def _hdf5() -> tuple[Any, Any, Any]:
    """SZ3 as a filter of HDF5."""
    h5py = import_module("h5py")

    def write(volume: Volume, bound: float) -> io.BytesIO:
        file = io.BytesIO()
        with h5py.File(file, "w") as h5:
            filters = import_module("hdf5plugin").SZ3(absolute=bound)
            h5.create_dataset("x", data=volume, chunks=volume.shape, **filters)
        return file

    def read(file: io.BytesIO) -> Volume:
        with h5py.File(file, "r") as h5:
            volume: Volume = h5["x"][:]
            return volume

    def size(file: io.BytesIO) -> int:
        with h5py.File(file, "r") as h5:
            return int(h5["x"].id.get_storage_size())

    return write, read, size


def _zfp() -> tuple[Any, Any, Any]:
    return (
        lambda volume, setting: import_module("zfpy").compress_numpy(volume, tolerance=setting),
        lambda data: import_module("zfpy").decompress_numpy(data),
        len,
    )


def _principal(sequence: MeshSequence) -> tuple[NDArray[np.float64], ...]:
    """Mean, trajectories, strengths and coefficients of the principal components."""
    exact = sequence.vertices.astype(np.float64)
    flat = exact.transpose(0, 2, 1).reshape(3 * len(exact), -1)
    mean = flat.mean(axis=1, keepdims=True)
    return (mean, *np.linalg.svd(flat - mean, full_matrices=False))


def _pca(
    principal: tuple[NDArray[np.float64], ...], exact: Positions, setting: float
) -> tuple[int, Positions]:
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
    bits = np.clip(np.ceil(np.log2(float(np.ptp(exact, axis=1).max()) / setting)), 1, 24)
    known = {"faces": faces.astype(np.uint32) if len(faces) else None, "compression_level": 10}
    total, decoded = 0, np.empty_like(exact)
    for frame, positions in enumerate(exact):
        pack = partial(draco.encode, positions, quantization_bits=int(bits), **known)
        total += len(pack())
        decoded[frame] = draco.decode(pack(preserve_order=True)).points
    return total, decoded
