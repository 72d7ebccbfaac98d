"""The codec beside what can be installed, at the same RMS: bits, and processor time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from codec_peers import peers_of
from coded_sequences import SEQUENCES, mean_diagonal, sequence_of
from measure import in_words, side_by_side, table
from real_data import is_there
from threadpoolctl import threadpool_limits

from modalmotion.codec import Effort, decode, encode
from modalmotion.mesh.sequence import MeshSequence

SHARE = 0.003


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
            parts = peer.encode(exact, setting)
            sizes[name] = peer.size(parts)
            calls[f"encode {name}"] = partial(peer.encode, exact, setting)
            calls[f"decode {name}"] = partial(peer.decode, parts)
    # Of the processor and one thread: what else runs on the machine makes none of them dearer.
    with threadpool_limits(1):
        times = side_by_side(calls, 3, time.process_time)
    rows = [
        (
            name,
            f"{8 * size / n_places:.3f}",
            *(in_words(times[f"{way} {name}"].median) for way in ("encode", "decode")),
        )
        for name, size in sizes.items()
    ]
    title = f"{what}: {n_places:,} positions, RMS {SHARE:.1%} of the diagonal"
    return table(title, ["coder", "bits", "encode", "decode"], rows)
