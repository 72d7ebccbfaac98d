"""The codec beside SZ3, at the same RMS: bits, and processor time."""

from __future__ import annotations

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
    """SZ3 by one of its algorithms, direction by direction, rows and columns of a lattice apart."""

    algorithm: str
    grid: tuple[int, ...]

    def encode(self, exact: Positions, bound: float) -> tuple[int, list[Any]]:
        """Give the number of bytes, and what `decode` takes."""
        pysz = import_module("pysz")
        config = pysz.szConfig()
        config.errorBoundMode = pysz.szErrorBoundMode.ABS
        config.absErrorBound = bound
        config.cmprAlgo = getattr(pysz.szAlgorithm, self.algorithm)
        shape = (len(exact), *self.grid)
        volumes = (np.ascontiguousarray(exact[:, :, i]).reshape(shape) for i in range(3))
        parts = [pysz.sz.compress(volume, config)[0] for volume in volumes]
        return sum(part.nbytes for part in parts), [(part, shape) for part in parts]

    def decode(self, parts: list[Any]) -> Positions:
        """Decompress the three directions."""
        volumes = [import_module("pysz").sz.decompress(x, np.float32, n)[0] for x, n in parts]
        return np.stack([volume.reshape(len(volume), -1) for volume in volumes], axis=-1)

    def at_rms(self, exact: Positions, wanted: float) -> float | None:
        """Find the coarsest setting that keeps an RMS."""
        low, high, best = np.log(wanted) - 4.0, np.log(wanted) + 4.0, None
        for _ in range(12):
            setting = float(np.exp(middle := (low + high) / 2))
            if measure(exact, self.decode(self.encode(exact, setting)[1])).rms <= wanted:
                best, low = setting, middle
            else:
                high = middle
        return best


def peers_of(sequence: MeshSequence) -> dict[str, Peer]:
    """SZ3 by two of its algorithms, if it is installed."""
    algorithms = {"SZ3, interpolated": "INTERP_LORENZO", "SZ3, predicted": "LORENZO_REG"}
    grid = sequence.grid or (sequence.n_vertices,)
    return {name: Peer(of, grid) for name, of in algorithms.items() if find_spec("pysz")}
