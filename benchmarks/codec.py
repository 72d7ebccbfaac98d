"""The codec beside what can be installed: bits for each vertex and frame at the same error."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from codec_peers import at_error, mean_diagonal, peers_of
from codec_speed import speed
from measure import Table, in_words
from real_data import is_there, recording

from modalmotion.codec import Effort, decode, encode
from modalmotion.codec.measure import measure
from modalmotion.mesh.sequence import MeshSequence

SEQUENCES = (
    "heart/lv_grid_32x64",
    "heart/lv_endocardium",
    "heart/epicardium",
    "heart/lv_contour_64",
    "literature/pcow",
    "literature/chickenCrossing",
    "robot/Dance",
    "fox/run",
)
WORSE = 1.02
"""Of bits that were reached once: what speed may cost."""

BOUNDS = {
    "heart/lv_grid_32x64": (0.192 * WORSE, 0.535 * WORSE, 0.60),
    "heart/lv_endocardium": (0.616 * WORSE, 1.494 * WORSE, 1.4),
    "literature/pcow": (0.379 * WORSE, 1.270 * WORSE, None),
    "literature/chickenCrossing": (0.239 * WORSE, 0.530 * WORSE, None),
    "robot/Dance": (0.185 * WORSE, 0.266 * WORSE, None),
}
SHARES = (("rms", 0.003), ("rms", 0.001), ("max_error", 0.003))


def run(_folder: Path | None = None) -> Iterator[Table]:
    """Tables of bits and of speed; bounds that are missed are marked in them."""
    return tables()


def tables(names: tuple[str, ...] = SEQUENCES, effort: Effort = Effort.BALANCED) -> Iterator[Table]:
    """Bits of each sequence beside its peers', then its speed beside SZ3's."""
    there = [name for name in names if is_there("codec: bits and speed", name)]
    for name in there:
        yield _bits(name, recording(name), effort)
    yield from (speed(name, recording(name)) for name in there)


def _bits(name: str, sequence: MeshSequence, effort: Effort) -> Table:
    exact = np.ascontiguousarray(sequence.vertices, dtype=np.float32)
    D = mean_diagonal(exact)
    n = exact.shape[0] * exact.shape[1]
    table = Table(
        f"{name}: {exact.shape[0]} frames of {exact.shape[1]} vertices, "
        f"D = {D:.4g}, effort {effort}",
        ("coder", "error asked", "bits", "rms / D", "max / D", "KG %", "encode", "decode"),
    )
    for (kind, share), bound in zip(SHARES, BOUNDS.get(name, (None,) * 3), strict=True):
        asked = f"{kind} {share:.1%}"
        start = time.perf_counter()
        wanted: dict[str, Any] = {kind: share * D}
        encoded = encode(sequence, effort=effort, **wanted)
        middle = time.perf_counter()
        decoded = decode(encoded.data)
        end = time.perf_counter()
        errors = measure(exact, decoded.vertices)
        reached = errors.rms if kind == "rms" else errors.max_error
        assert reached <= share * D, "the bound is broken"
        bits = encoded.bits_per_vertex_and_frame
        cells = (
            f"modalmotion ({encoded.transform})",
            asked,
            f"{bits:.3f}",
            f"{errors.rms / D:.5f}",
            f"{errors.max_error / D:.5f}",
            f"{errors.kg_error:.3f}",
            in_words(middle - start),
            in_words(end - middle),
        )
        if bound is None:
            table.add(*cells)
        else:
            table.add_at_most(bits, bound, *cells)
        for peer, coder in peers_of(sequence).items():
            found = at_error(coder, exact, kind, share * D)
            if found is None:
                table.add(peer, asked, "-", "-", "-", "-", "-", "-")
                continue
            errors = measure(exact, found.decoded)
            table.add(
                peer,
                asked,
                f"{8 * found.n_bytes / n:.3f}",
                f"{errors.rms / D:.5f}",
                f"{errors.max_error / D:.5f}",
                f"{errors.kg_error:.3f}",
                in_words(found.seconds),
                "",
            )
    return table


if __name__ == "__main__":
    chosen = tuple(argument for argument in sys.argv[1:] if "/" in argument) or SEQUENCES
    efforts = [argument for argument in sys.argv[1:] if "/" not in argument]
    missed = 0
    for one in tables(chosen, Effort(efforts[0]) if efforts else Effort.BALANCED):
        print(f"{one}\n", flush=True)
        missed += one.n_missed
    sys.exit(min(1, missed))
