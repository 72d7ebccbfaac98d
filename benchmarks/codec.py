"""The codec beside what can be installed, at the same RMS: bits, and processor time."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from typing import Any

import numpy as np
from coded_sequences import SEQUENCES, SHARE, mean_diagonal, sequence_of
from measure import in_words, medians, table
from numpy.typing import NDArray
from real_data import is_there
from threadpoolctl import threadpool_limits

from modalmotion.codec import Effort, decode, encode
from modalmotion.codec.search import measure
from modalmotion.mesh.sequence import MeshSequence

Positions = NDArray[np.float32]
Volume = NDArray[np.float32]


def run() -> Iterator[str]:
    """One table for each sequence."""
    for name, (what, path, _) in SEQUENCES.items():
        if not path or is_there("codec: peers", path):
            yield _table(what, sequence_of(name))


def _table(what: str, sequence: MeshSequence) -> str:
    exact = np.ascontiguousarray(sequence.vertices, dtype=np.float32)
    rms, n_places = SHARE * mean_diagonal(sequence), exact.shape[0] * exact.shape[1]
    sizes: dict[str, int] = {}
    calls: dict[str, Callable[[], object]] = {}
    for effort in Effort:
        encoded = partial(encode, sequence, rms=rms, effort=effort)
        data = encoded().data
        sizes[effort] = len(data)
        calls |= {f"encode {effort}": encoded, f"decode {effort}": partial(decode, data)}
    for name, peer in peers_of(sequence).items():
        if (setting := peer.at_rms(exact, rms)) is not None:
            sizes[name], parts = peer.encode(exact, setting)
            calls[f"encode {name}"] = partial(peer.encode, exact, setting)
            calls[f"decode {name}"] = partial(peer.decode, parts)
    # Of the processor and one thread: what else runs on the machine makes none of them dearer.
    with threadpool_limits(1):
        times = dict(zip(calls, medians(calls, 3), strict=True))
    rows = []
    for name, size in sizes.items():
        both = (in_words(times[f"{way} {name}"]) for way in ("encode", "decode"))
        rows.append((name, f"{8 * size / n_places:.3f}", *both))
    title = f"{what}: {n_places:,} positions, RMS {SHARE:.1%} of the diagonal"
    return table(title, ["coder", "bits", "encode", "decode"], rows)


@dataclass(frozen=True)
class Peer:
    """A coder: from positions and a setting to a number of bytes, and to what `decode` takes."""

    encode: Callable[[Positions, float], tuple[int, Any]]
    decode: Callable[[Any], Positions]

    def at_rms(self, exact: Positions, wanted: float) -> float | None:
        """Find the coarsest setting that keeps an RMS."""
        low, high, best = np.log(wanted) - 4.0, np.log(wanted) + 4.0, None
        for _ in range(12):
            middle = (low + high) / 2
            setting = float(np.exp(middle))
            if measure(exact, self.decode(self.encode(exact, setting)[1])).rms <= wanted:
                best, low = setting, middle
            else:
                high = middle
        return best


def peers_of(sequence: MeshSequence) -> dict[str, Peer]:
    """Those that are installed, each with the layout of the numbers that it compresses best."""
    grid = sequence.grid or (sequence.n_vertices,)
    peers = {
        "SZ3, interpolated": ("pysz", _by_volumes(grid, *_sz3("INTERP_LORENZO"))),
        "SZ3, predicted": ("pysz", _by_volumes(grid, *_sz3("LORENZO_REG"))),
        "SZ3 in HDF5": ("hdf5plugin", _by_volumes(grid, _to_hdf5, _from_hdf5)),
    }
    return {name: peer for name, (module, peer) in peers.items() if find_spec(module)}


def _by_volumes(
    grid: tuple[int, ...],
    write: Callable[[Volume, float], tuple[int, Any]],
    read: Callable[[Any], Volume],
) -> Peer:
    """Code frames x vertices, or frames x rows x columns, direction by direction."""

    def encode(exact: Positions, setting: float) -> tuple[int, Any]:
        shape = (len(exact), *grid)
        volumes = (np.ascontiguousarray(exact[:, :, i]).reshape(shape) for i in range(3))
        sizes, parts = zip(*(write(volume, setting) for volume in volumes), strict=True)
        return sum(sizes), parts

    def decode(parts: tuple[Any, ...]) -> Positions:
        volumes = [read(part) for part in parts]
        return np.stack([volume.reshape(len(volume), -1) for volume in volumes], axis=-1)

    return Peer(encode, decode)


def _sz3(algorithm: str) -> tuple[Any, Any]:
    """SZ3 itself, by one of its algorithms."""

    def write(volume: Volume, bound: float) -> tuple[int, Any]:
        pysz = import_module("pysz")
        config = pysz.szConfig()
        config.errorBoundMode = pysz.szErrorBoundMode.ABS
        config.absErrorBound = bound
        config.cmprAlgo = getattr(pysz.szAlgorithm, algorithm)
        data = pysz.sz.compress(volume, config)[0]
        return data.nbytes, (data, volume.shape)

    def read(part: tuple[Any, tuple[int, ...]]) -> Any:
        return import_module("pysz").sz.decompress(part[0], np.float32, part[1])[0]

    return write, read


def _to_hdf5(volume: Volume, bound: float) -> tuple[int, io.BytesIO]:
    """SZ3 as a filter of HDF5."""
    file, filters = io.BytesIO(), import_module("hdf5plugin").SZ3(absolute=bound)
    with import_module("h5py").File(file, "w") as h5:
        dataset = h5.create_dataset("x", data=volume, chunks=volume.shape, **filters)
        h5.flush()
        return dataset.id.get_storage_size(), file


def _from_hdf5(file: io.BytesIO) -> Any:
    with import_module("h5py").File(file, "r") as h5:
        return h5["x"][:]
