"""How long the codec takes beside SZ3, for the same array at the same error."""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from codec_peers import at_error, is_installed, mean_diagonal, sz3, sz3_file, sz3_read, volumes_of
from measure import Table, Times, in_words, side_by_side
from threadpoolctl import threadpool_limits

from modalmotion.codec import decode, encode
from modalmotion.mesh.sequence import MeshSequence

SHARE = 0.003
N_SAMPLES = 5
EFFORTS = ("realtime", "fast", "balanced")
# Times SZ3's.
BOUNDS = {
    ("heart/lv_grid_32x64", "encode", "fast"): 10.0,
    ("heart/lv_grid_32x64", "decode", "fast"): 10.0,
    ("heart/lv_endocardium", "encode", "fast"): 20.0,
    ("heart/lv_endocardium", "decode", "fast"): 10.0,
    ("heart/lv_endocardium", "decode", "balanced"): 30.0,
    ("literature/pcow", "decode", "fast"): 6.0,
    ("literature/pcow", "decode", "balanced"): 20.0,
}
PROMISED = 2e-3, 12e-6, 0.2e-6
"""Processor seconds of decoding at effort realtime: of a stream, a vertex, a vertex in a frame."""

FIRST = 1.5
"""Of the processor time of the first decode of a process, times a later one."""

# Threads of BLAS wait busily for each other, which is processor time for nothing.
_ONE_THREAD = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS")}

_FRESH = """
import sys, time, json
from modalmotion.codec import decode
data = sys.stdin.buffer.read()
seconds = []
for _ in range(6):
    start = time.process_time()
    decode(data)
    seconds.append(time.process_time() - start)
print(json.dumps(seconds))
"""


def speed(name: str, sequence: MeshSequence) -> Table:
    """Encode and decode in turn with SZ3 at the same RMS; decode in fresh processes."""
    exact = np.ascontiguousarray(sequence.vertices, dtype=np.float32)
    rms = SHARE * mean_diagonal(exact)
    streams = {effort: encode(sequence, rms=rms, effort=effort).data for effort in EFFORTS}
    calls: dict[str, Callable[[], object]] = {}
    for effort, data in streams.items():
        calls[f"encode {effort}"] = partial(encode, sequence, rms=rms, effort=effort)
        calls[f"decode {effort}"] = partial(decode, data)
    found = at_error(partial(sz3, sequence.grid), exact, "rms", rms) if _has_peer() else None
    if found is not None:
        volumes = volumes_of(exact, sequence.grid)
        files = [sz3_file(volume, found.setting) for volume in volumes]
        calls["encode SZ3"] = lambda: [sz3_file(volume, found.setting) for volume in volumes]
        calls["decode SZ3"] = lambda: [sz3_read(file) for file in files]
    # Of the processor: what else runs on the machine makes neither of them dearer.
    with threadpool_limits(1):
        times = side_by_side(calls, n_samples=N_SAMPLES, clock=time.process_time)
    n = exact.shape[0] * exact.shape[1]
    table = Table(
        f"{name}: processor time at RMS {SHARE:.1%}, median of {N_SAMPLES} side by side",
        ("", "bits", "median", "times SZ3's"),
    )
    for effort, data in streams.items():
        bits = f"{8 * len(data) / n:.3f}"
        for what in ("encode", "decode"):
            _compare(table, name, what, effort, times, bits)
        if effort == "realtime":
            stream, vertex, place = PROMISED
            allowed = stream + exact.shape[1] * (vertex + exact.shape[0] * place)
            share = times["decode realtime"].median / allowed
            table.add_at_most(share, 1.0, f"of what is promised: {share:.2f}", bits, "", "")
        seconds, ratio = _first(data)
        label = f"first decode {effort}: {ratio:.2f} times a later one"
        table.add_at_most(ratio, FIRST, label, bits, in_words(seconds), "")
    return table


def _has_peer() -> bool:
    return is_installed("hdf5plugin") and is_installed("h5py")


def _compare(
    table: Table, name: str, what: str, effort: str, times: dict[str, Times], bits: str
) -> None:
    ours = times[f"{what} {effort}"].median
    label = f"{what} {effort}"
    if f"{what} SZ3" not in times:
        table.add(label, bits, in_words(ours), "-")
        return
    theirs = times[f"{what} SZ3"].median
    ratio = ours / theirs
    cells = label, bits, in_words(ours), f"{ratio:.2f} ({in_words(theirs)})"
    bound = BOUNDS.get((name, what, effort))
    if bound is None:
        table.add(*cells)
    else:
        table.add_at_most(ratio, bound, *cells)


def _first(data: bytes) -> tuple[float, float]:
    """Seconds of the first decode of a process, and its ratio to later ones; medians."""
    firsts, ratios = [], []
    for _ in range(N_SAMPLES):
        done = subprocess.run(
            [sys.executable, "-c", _FRESH],
            input=data,
            stdout=subprocess.PIPE,
            check=True,
            env={**os.environ, **_ONE_THREAD},
        )
        first, *later = json.loads(done.stdout)
        firsts.append(first)
        ratios.append(first / statistics.median(later))
    return statistics.median(firsts), statistics.median(ratios)
