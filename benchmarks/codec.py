"""The codec beside what can be installed, at the same RMS: bits, and time beside SZ3's."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np
from codec_peers import IN_HDF5, Peer, peers_of
from coded_sequences import SEQUENCES, mean_diagonal, sequence_of
from measure import Table, in_words, side_by_side
from real_data import is_there
from threadpoolctl import threadpool_limits

from modalmotion.codec import Effort, decode, encode
from modalmotion.mesh.sequence import MeshSequence

SHARE = 0.003
N_SAMPLES = 3
PROMISED = 2e-3, 12e-6, 0.2e-6
"""Processor seconds of decoding at effort realtime: of a stream, a vertex, a vertex in a frame."""


def run(_folder: Path | None = None) -> Iterator[Table]:
    """One table for each sequence."""
    for name, (what, path, _) in SEQUENCES.items():
        if not path or is_there("codec: peers", path):
            yield _table(what, sequence_of(name))


def _table(what: str, sequence: MeshSequence) -> Table:
    exact = np.ascontiguousarray(sequence.vertices, dtype=np.float32)
    rms = SHARE * mean_diagonal(sequence)
    n_frames, n_vertices = exact.shape[:2]
    table = Table(
        f"{what}: {n_frames} frames of {n_vertices} vertices, RMS {SHARE:.1%} of the diagonal",
        ("coder", "bits", "encode", "over SZ3's", "over SZ3's in HDF5", "decode", "SZ3", "in HDF5"),
    )
    sizes: dict[str, int] = {}
    calls: dict[str, Callable[[], object]] = {}
    for effort in Effort:
        data = encode(sequence, rms=rms, effort=effort).data
        sizes[effort] = len(data)
        calls[f"encode {effort}"] = partial(encode, sequence, rms=rms, effort=effort)
        calls[f"decode {effort}"] = partial(decode, data)
    for name, peer in peers_of(sequence).items():
        if (setting := peer.at_rms(exact, rms)) is not None:
            _take(name, peer, exact, setting, sizes, calls)
    # Of the processor and one thread: what else runs on the machine makes none of them dearer.
    with threadpool_limits(1):
        timed = side_by_side(calls, N_SAMPLES, time.process_time)
    seconds = {name: times.median for name, times in timed.items()}
    # Itself with the algorithm that takes fewer bits, and within HDF5.
    sz3 = min(
        (name for name in sizes if name.startswith("SZ3, ")), key=sizes.__getitem__, default=""
    )
    for name, size in sizes.items():
        cells = [name, f"{8 * size / (n_frames * n_vertices):.3f}"]
        for way in ("encode", "decode"):
            ours = seconds[f"{way} {name}"]
            theirs = (seconds.get(f"{way} {peer}") for peer in (sz3, IN_HDF5))
            cells += [in_words(ours), *(f"{ours / one:.2f}" if one else "" for one in theirs)]
        if name != Effort.REALTIME:
            table.add(*cells)
            continue
        stream, vertex, place = PROMISED
        promised = stream + n_vertices * (vertex + n_frames * place)
        table.add_at_most(seconds["decode realtime"], promised, *cells)
    return table


def _take(
    name: str,
    peer: Peer,
    exact: np.ndarray[tuple[int, ...], np.dtype[np.float32]],
    setting: float,
    sizes: dict[str, int],
    calls: dict[str, Callable[[], object]],
) -> None:
    encoded = peer.encode(exact, setting)
    sizes[name] = peer.size(encoded)
    calls[f"encode {name}"] = partial(peer.encode, exact, setting)
    calls[f"decode {name}"] = partial(peer.decode, encoded)
