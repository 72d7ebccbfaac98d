"""The store: what a durable write costs, and whether many results slow it down."""

from __future__ import annotations

import hashlib
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from measure import Table

from modalmotion.hdf5.image import _skeleton
from modalmotion.hdf5.sealed import digest_of
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import ModalSignature, modal_signature
from modalmotion.store import (
    ResultStore,
    SequenceRecord,
    sequence_to_hdf5,
    signature_to_hdf5,
    write_atomic,
)
from modalmotion.store.folder import Folder, ResultName
from modalmotion.store.index.database import Database
from modalmotion.store.index.index import Index, put_records, put_results

MOST_RATIO = 2.0
N_SAMPLES = 200


def run(_folder: Path | None = None) -> list[Table]:
    """Print how writes compare with plain ones, and large stores with small ones."""
    report()
    return []


def report(n_few: int = 500, n_many: int = 50_000) -> None:
    sequence = _sequence()
    signature = modal_signature(sequence)
    with tempfile.TemporaryDirectory() as folder:
        _writes(Path(folder), sequence, signature)
        _sizes(Path(folder), signature, n_few, n_many)


def _writes(folder: Path, sequence: MeshSequence, signature: ModalSignature) -> None:
    print("Durable write of a result: image, fsync, rename, fsync of the folder")
    print("against writing and synchronising the same bytes plainly (medians, ms)")
    names = iter(range(10**9))
    cases: list[tuple[str, Callable[[], bytes], int]] = [
        ("signature", lambda: signature_to_hdf5(signature), 300),
        ("signature of a new layout", lambda: _unknown_layout(signature), 100),
        ("sequence", lambda: sequence_to_hdf5(sequence), 100),
    ]
    for name, image, n_rounds in cases:
        data = image()

        def plain(content: bytes = data) -> None:
            with (folder / f"{next(names)}").open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())

        def durable(make: Callable[[], bytes] = image) -> None:
            write_atomic(folder / f"{next(names)}", make())

        alone, whole, building = _interleaved([plain, durable, image], n_rounds)
        print(
            f"  {name:26} {len(data) / 1e3:7.0f} kB  plain {1e3 * alone:6.3f}  "
            f"durable {1e3 * whole:6.3f} (image {1e3 * building:.3f})  "
            f"ratio {whole / alone:.2f}  (at most {MOST_RATIO})"
        )


def _unknown_layout(signature: ModalSignature) -> bytes:
    _skeleton.cache_clear()
    return signature_to_hdf5(signature)


def _sizes(folder: Path, signature: ModalSignature, n_few: int, n_many: int) -> None:
    print(f"Listing and lookup with {n_many} results against {n_few} (medians, ms)")
    few, many = folder / "few", folder / "many"
    sample_few = _fill(few, signature, n_few)
    sample_many = _fill(many, signature, n_many)
    key = signature.parameters.key
    with ResultStore(few) as small, ResultStore(many) as large:
        cursors = {
            store: store.list_sequences(limit=n // 2 if n < 2000 else 1000).cursor
            for store, n in ((small, n_few), (large, n_many))
        }
        tasks: dict[str, Callable[[ResultStore, str], object]] = {
            "first page of 100": lambda store, _: store.list_sequences(),
            "later page of 100": lambda store, _: store.list_sequences(cursor=cursors[store]),
            "page of one subject": lambda store, _: store.list_sequences(subject="P 1"),
            "page of subject and label": lambda store, _: store.list_sequences(
                subject="P 1", label="rest"
            ),
            "record": lambda store, name: store.sequence_record(name),
            "keys of signatures": lambda store, name: store.signatures(name),
            "signature": lambda store, name: store.signature(name, key),
            "put of a signature": lambda store, name: _put(store, signature, name),
        }
        for name, task in tasks.items():
            one, other = _interleaved(
                [_over(task, small, sample_few), _over(task, large, sample_many)], N_SAMPLES
            )
            print(
                f"  {name:26} {n_few}: {1e3 * one:6.3f}  {n_many}: {1e3 * other:6.3f}  "
                f"ratio {other / one:.2f}  (at most {MOST_RATIO})"
            )


def _over(
    task: Callable[[ResultStore, str], object], store: ResultStore, names: Sequence[str]
) -> Callable[[], object]:
    turn = iter(range(10**9))
    return lambda: task(store, names[next(turn) % len(names)])


def _put(store: ResultStore, signature: ModalSignature, name: str) -> Path:
    parameters = replace(signature.parameters, modes=6)
    return store.put_signature(replace(signature, sequence_id=name, parameters=parameters))


def _fill(root: Path, signature: ModalSignature, n: int) -> list[str]:
    """Make a store of n results; give some ids whose files are written out.

    The other files are links to one, for only their names matter, and 50,000 durable writes
    would take minutes.
    """
    folder = Folder(root)
    ResultStore(root).open().close()
    names = [hashlib.sha256(f"{n} {i}".encode()).hexdigest() for i in range(n)]
    step = max(1, n // N_SAMPLES)
    content = signature_to_hdf5(signature)
    one = root / "one"
    one.write_bytes(content)
    records, results = [], []
    for i, name in enumerate(names):
        record = SequenceRecord(
            id=name,
            n_frames=signature.n_frames,
            n_vertices=signature.n_vertices,
            n_faces=0,
            topology="cup",
            grid=None,
            unit="mm",
            has_times=False,
            subject=f"P {i // 250}",
            label="rest" if i % 2 else "stress",
            created=f"2026-01-01T00:00:00.{i:06d}Z",
            has_upload=False,
        )
        result = ResultName("signature", name, "", signature.parameters.key)
        data = content
        for path in (folder.record(name), folder.result(result)):
            path.parent.mkdir(parents=True, exist_ok=True)
        if i % step == 0:
            data = signature_to_hdf5(replace(signature, sequence_id=name))
            folder.result(result).write_bytes(data)
        else:
            folder.result(result).hardlink_to(one)
        records.append(record)
        results.append((result, digest_of(data)))
    database = Database(folder.index)
    with database.write() as connection:
        put_records(connection, records)
        put_results(connection, results)
    Index(database).set_clean(True)
    database.close()
    return names[::step]


def _interleaved(tasks: Sequence[Callable[[], object]], n_rounds: int) -> list[float]:
    """Median time of each task in s, one after the other in every round."""
    times: list[list[float]] = [[] for _ in tasks]
    for round_number in range(n_rounds + 3):
        for task, seconds in zip(tasks, times, strict=True):
            begin = time.perf_counter()
            task()
            if round_number >= 3:
                seconds.append(time.perf_counter() - begin)
    return [statistics.median(seconds) for seconds in times]


def _sequence() -> MeshSequence:
    rng = np.random.default_rng(1)
    return mesh_sequence(
        rng.normal(size=(25, 32 * 64, 3)), grid=(32, 64), topology="cup", unit="mm"
    )


if __name__ == "__main__":
    report()
