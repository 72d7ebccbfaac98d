"""The codec beside what can be installed: bits for each vertex and frame at the same error."""

from __future__ import annotations

import io
import os
import sys
import time
import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray

from modalmotion.codec import Effort, decode, encode
from modalmotion.codec.measure import measure
from modalmotion.formats import read_npz
from modalmotion.mesh.sequence import MeshSequence

DATA = Path(
    os.environ.get("MODALMOTION_DATA", Path(__file__).parents[1] / ".." / "shared" / "data")
)

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
BOUNDS = {
    "heart/lv_grid_32x64": (0.22, 0.58, 0.60),
    "heart/lv_endocardium": (0.62, 1.6, 1.4),
    "literature/pcow": (0.46, 1.4, None),
    "literature/chickenCrossing": (0.36, 0.70, None),
}
SHARES = (("rms", 0.003), ("rms", 0.001), ("max_error", 0.003))
SLOWEST = 10.0

Positions = NDArray[np.float32]
Coder = Callable[[Positions, float], tuple[int, Positions]]


def run(_folder: Path | None = None) -> list[Table]:
    """Print every table; bounds that are missed are marked in them."""
    report()
    return []


def report(names: tuple[str, ...] = SEQUENCES, effort: Effort = Effort.BALANCED) -> int:
    """Print every table; give the number of bounds missed."""
    missed = 0
    for name in names:
        path = DATA / f"{name}.npz"
        if not path.exists():
            print(f"{name}: {path} is not there, skipped")
            continue
        missed += _sequence(name, read_npz(path.read_bytes()).sequence, effort)
    path = DATA / f"{SEQUENCES[0]}.npz"
    if path.exists():
        missed += _speed(read_npz(path.read_bytes()).sequence)
    return missed


def _sequence(name: str, sequence: MeshSequence, effort: Effort) -> int:
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
        for peer, coder in _peers(sequence).items():
            found = _at_error(coder, exact, kind, share * D)
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
    print(f"{table}\n", flush=True)
    return table.n_missed


def _speed(sequence: MeshSequence) -> int:
    """Encode and decode a lattice, in turn with SZ3, at the same guaranteed error."""
    exact = np.ascontiguousarray(sequence.vertices, dtype=np.float32)
    bound = 0.003 * mean_diagonal(exact)
    volumes = _volumes(exact, sequence.grid)
    data = encode(sequence, max_error=bound, effort=Effort.FAST).data
    files = [_sz3_file(volume, bound) for volume in volumes]
    times = side_by_side(
        {
            "encode, modalmotion": partial(encode, sequence, max_error=bound, effort=Effort.FAST),
            "encode, SZ3": lambda: [_sz3_file(volume, bound) for volume in volumes],
            "decode, modalmotion": partial(decode, data),
            "decode, SZ3": lambda: [_sz3_read(file) for file in files],
        },
        n_samples=15,
    )
    table = Table(
        f"Speed, {exact.shape[0]} x {exact.shape[1]} on a lattice, max_error 0.3 %, effort fast, "
        f"{8 * len(data) / exact.shape[0] / exact.shape[1]:.3f} bits",
        ("", "median", "times SZ3's"),
    )
    for what in ("encode", "decode"):
        ours, theirs = times[f"{what}, modalmotion"].median, times[f"{what}, SZ3"].median
        table.add_at_most(ours / theirs, SLOWEST, what, in_words(ours), f"{ours / theirs:.2f}")
    print(f"{table}\n")
    return table.n_missed


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


def _at_error(coder: Coder, exact: Positions, kind: str, wanted: float) -> Found | None:
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
                best = Found(n_bytes, decoded, seconds)
            low = middle
        else:
            high = middle
    return best


def _peers(sequence: MeshSequence) -> dict[str, Coder]:
    return {
        "SZ3": partial(_sz3, sequence.grid),
        "zfp": partial(_zfp, sequence.grid),
        "PCA, basis counted": partial(_pca, _principal(sequence)),
        "Draco, each frame": partial(_draco, sequence.faces),
    }


def _volumes(exact: Positions, grid: tuple[int, ...] | None) -> list[NDArray[np.float32]]:
    """Three arrays, one for each direction: frames x vertices, or frames x rows x columns."""
    shape = (len(exact), *(grid or exact.shape[1:2]))
    return [np.ascontiguousarray(exact[:, :, i]).reshape(shape) for i in range(3)]


def _joined(volumes: list[NDArray[Any]], exact: Positions) -> Positions:
    return np.stack([v.reshape(exact.shape[:2]) for v in volumes], axis=-1).astype(np.float32)


def _sz3_file(volume: NDArray[np.float32], bound: float) -> io.BytesIO:
    import h5py

    hdf5plugin = import_module("hdf5plugin")

    file = io.BytesIO()
    with h5py.File(file, "w") as h5:
        filters = hdf5plugin.SZ3(absolute=bound)
        h5.create_dataset("x", data=volume, chunks=volume.shape, **filters)
    return file


def _sz3_read(file: io.BytesIO) -> tuple[int, NDArray[np.float32]]:
    import h5py

    with h5py.File(file, "r") as h5:
        return h5["x"].id.get_storage_size(), h5["x"][:]


def _sz3(grid: tuple[int, ...] | None, exact: Positions, setting: float) -> tuple[int, Positions]:
    parts = [_sz3_read(_sz3_file(volume, setting)) for volume in _volumes(exact, grid)]
    return sum(n for n, _ in parts), _joined([v for _, v in parts], exact)


def _zfp(grid: tuple[int, ...] | None, exact: Positions, setting: float) -> tuple[int, Positions]:
    zfpy = import_module("zfpy")
    packed = [zfpy.compress_numpy(v, tolerance=setting) for v in _volumes(exact, grid)]
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


if __name__ == "__main__":
    chosen = tuple(argument for argument in sys.argv[1:] if "/" in argument) or SEQUENCES
    efforts = [argument for argument in sys.argv[1:] if "/" not in argument]
    sys.exit(1 if report(chosen, Effort(efforts[0]) if efforts else Effort.BALANCED) else 0)
