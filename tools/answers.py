"""Writes down what the library answers, and compares two such records.

A record holds the digests of arrays and plain values (not of files: those hold versions and
times) of signatures, decoded vertices, classes and read-outs, and the arrays themselves, so that
a comparison can say how far an answer moved::

    python tools/answers.py record before.npz ../shared/data
    python tools/answers.py compare before.npz after.npz

A change that only moves code must leave every digest as it is.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
from collections.abc import Callable, Iterator
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

import modalmotion as mm
from modalmotion.classification import classify
from modalmotion.codec import decode, encode

N_SIMULATED = 20

# Above this many numbers a sequence is thinned: what grows with it is time, not coverage.
MOST_NUMBERS = 600_000

SIGNATURES: dict[str, dict[str, Any]] = {
    "default": {},
    "amplitudes=54": {"amplitudes": 54},
    "auto": {"auto": True},
    "cylindrical": {"components": "cylindrical"},
    "mean": {"reference": "mean"},
}
"""Parameters by name."""

TARGETS = {"0.3 %": 0.003, "0.1 %": 0.001, "3 %": 0.03}
"""RMS errors of streams, as shares of the extent."""

# Of a machine and a version, not of an answer.
LEFT_OUT = {"provenance", "ms", "bytes", "price", "cost"}


def sequences(folder: Path) -> Iterator[tuple[str, mm.MeshSequence]]:
    """Yield every real sequence below a folder, and simulated ones."""
    for path in sorted(folder.rglob("*.npz")):
        sequence = mm.read_npz(path.read_bytes()).sequence
        step = -(-sequence.vertices.size // MOST_NUMBERS)
        if step > 1:
            # One vertex more or less is another mesh; one frame is not.
            sequence = mm.mesh_sequence(
                np.asarray(sequence.vertices[::step]), sequence.faces, unit=sequence.unit
            )
        yield str(path.relative_to(folder).with_suffix("")), sequence
    for seed in range(N_SIMULATED):
        rng = np.random.default_rng(seed)
        noise = mm.Acquisition(noise=0.2 * (seed % 4))
        yield f"simulated/{seed}", mm.simulate_ventricle(acquisition=noise, rng=rng)


def leaves(name: str, value: object) -> Iterator[tuple[str, object]]:
    """Yield the arrays and plain values of an answer by their paths."""
    if isinstance(value, Enum):
        yield name, str(value.value)
    elif is_dataclass(value) and not isinstance(value, type):
        for part in fields(value):
            if part.name not in LEFT_OUT:
                yield from leaves(f"{name}.{part.name}", getattr(value, part.name))
    elif isinstance(value, dict):
        for key in value:
            yield from leaves(f"{name}.{key}", value[key])
    elif isinstance(value, list | tuple) and any(
        is_dataclass(item) or isinstance(item, np.ndarray | Enum) for item in value
    ):
        for place, item in enumerate(value):
            yield from leaves(f"{name}.{place}", item)
    else:
        yield name, value


def answers(name: str, sequence: mm.MeshSequence) -> Iterator[tuple[str, object]]:
    """Yield everything that is asked of one sequence; a refusal is an answer too."""
    yield f"{name}/id", sequence.id

    def ask(what: str, answer: Callable[[], object]) -> Iterator[tuple[str, object]]:
        try:
            yield from leaves(f"{name}/{what}", answer())
        except mm.ModalMotionError as refusal:
            yield f"{name}/{what}", f"{type(refusal).__name__}: {refusal}"

    for label, values in SIGNATURES.items():
        if label == "cylindrical":
            values = {"components": _cylindrical()}
        parameters = mm.SignatureParameters(**values)
        yield from ask(f"signature {label}", partial(mm.modal_signature, sequence, parameters))
    yield from ask("class", partial(classify, sequence))
    yield from ask("readouts", lambda: mm.clinical_readouts(mm.modal_signature(sequence), sequence))
    extent = float(np.ptp(np.asarray(sequence.vertices, dtype=np.float64), axis=(0, 1)).max())
    for label, share in TARGETS.items():
        stream = encode(sequence, rms=share * extent).data
        yield f"{name}/stream {label}", hashlib.sha256(stream).hexdigest()
        back = decode(stream)
        yield f"{name}/decoded {label}", np.asarray(back.vertices)
        yield f"{name}/decoded faces {label}", np.asarray(back.faces)


def _cylindrical() -> object:
    """Look the word up by its value: where its class lies may change."""
    default = mm.SignatureParameters().components
    return type(default)("cylindrical")


def record(target: Path, folder: Path, only: str) -> None:
    """Write every answer to a file."""
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    digests: dict[str, str] = {}
    for name, sequence in sequences(folder):
        if only not in name:
            continue
        print(name, file=sys.stderr)
        for key, value in answers(name, sequence):
            if isinstance(value, np.ndarray) and value.dtype.kind in "fiub":
                arrays[key] = value
                text = f"{value.dtype.str}{value.shape}".encode() + value.tobytes()
            else:
                text = json.dumps(value, sort_keys=True, default=repr).encode()
                arrays[f"{key}|value"] = np.frombuffer(text, np.uint8)
            digests[key] = hashlib.sha256(text).hexdigest()
    arrays["digests"] = np.frombuffer(json.dumps(digests).encode(), np.uint8)
    np.savez_compressed(target, **arrays)  # type: ignore[arg-type]


def compare(before: Path, after: Path) -> int:
    """Print what differs, and by how much; return the number of differences."""
    old, new = np.load(before), np.load(after)
    was = json.loads(bytes(old["digests"]))
    now = json.loads(bytes(new["digests"]))
    n_different = 0
    for key in sorted(was.keys() | now.keys()):
        if was.get(key) == now.get(key):
            continue
        n_different += 1
        if key in old and key in new and old[key].shape == new[key].shape:
            a, b = old[key].astype(np.float64), new[key].astype(np.float64)
            change = float(np.nanmax(np.abs(a - b), initial=0.0))
            size = float(np.sqrt(np.nanmean(a**2)))
            print(f"{key}: largest change {change:.3g}, RMS {size:.3g}")
        else:
            texts = [
                bytes(side[f"{key}|value"]).decode()[:200] if f"{key}|value" in side else "-"
                for side in (old, new)
            ]
            print(f"{key}: {texts[0]} -> {texts[1]}")
    print(f"{len(was)} answers before, {len(now)} now, {n_different} different")
    return n_different


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    ways = parser.add_subparsers(dest="way", required=True)
    recording = ways.add_parser("record")
    recording.add_argument("target", type=Path)
    recording.add_argument("folder", type=Path)
    recording.add_argument("--only", default="", help="part of the names of sequences")
    comparing = ways.add_parser("compare")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    chosen = parser.parse_args()
    if chosen.way == "record":
        record(chosen.target, chosen.folder, chosen.only)
    else:
        sys.exit(bool(compare(chosen.before, chosen.after)))


if __name__ == "__main__":
    main()
