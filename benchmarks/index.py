"""The index: lists, look-ups and numbers of a million rows against those of ten thousand."""

from __future__ import annotations

import itertools
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from fastapi.testclient import TestClient
from index_rows import KEY, Rows, fill
from measure import Table, in_words

from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import ResultStore, verify
from modalmotion.store.care.copying import stage_database
from modalmotion.store.folder import ResultName
from modalmotion.store.index.cursor import to_cursor
from modalmotion.store.index.database import Database
from modalmotion.store.index.index import Index
from modalmotion_service.app import create_app
from modalmotion_service.schemas import JobState
from modalmotion_service.settings import Settings
from modalmotion_service.workspace.jobs import Jobs

FEW: Final = 10_000
MANY: Final = int(os.environ.get("MODALMOTION_BENCH_ROWS", "1000000"))
MOST_RATIO: Final = 1.5
N_SAMPLES: Final = int(os.environ.get("MODALMOTION_BENCH_ROUNDS", "400"))
N_REQUESTS: Final = 60


@dataclass(frozen=True)
class _Opened:
    rows: Rows
    store: ResultStore
    jobs: Jobs

    def at(self, number: int) -> str:
        """Cursor behind a sequence."""
        return to_cursor(self.rows.created(number), self.rows.sequence(number))

    def job_at(self, number: int) -> str:
        """Cursor behind a job."""
        return to_cursor(self.rows.created(number), self.rows.job(number))


Call = Callable[[_Opened, int], object]


def run(folder: Path) -> list[Table]:
    """Give the tables: calls of the library, calls over HTTP, and what reads all rows."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        few, many = fill(Path(name) / "few", FEW), fill(Path(name) / "many", MANY)
        whole = _whole(few, many)
        with ExitStack() as stack:
            opened = [_open(stack, rows) for rows in (few, many)]
            calls = _calls(opened)
        return [calls, _over_http(few, many), whole]


def _open(stack: ExitStack, rows: Rows) -> _Opened:
    store = stack.enter_context(ResultStore(rows.root))
    return _Opened(rows, store, Jobs(store.database))


def _calls(opened: list[_Opened]) -> Table:
    table = Table(
        f"Index of {MANY:,} sequences, results and jobs against {FEW:,} (medians of {N_SAMPLES}, "
        "in turn, each at another place, after as many others)",
        ("call", f"{FEW:,}", f"{MANY:,}", "ratio"),
    )
    pages: dict[str, Call] = {
        "sequences, first page": lambda o, _: o.store.list_sequences(),
        "sequences, a page between": lambda o, i: o.store.list_sequences(cursor=o.at(i)),
        "sequences, last page": lambda o, i: o.store.list_sequences(cursor=o.at(80 + i % 10)),
        "sequences of a subject": lambda o, i: o.store.list_sequences(subject=o.rows.subject(i)),
        "sequences of a label, between": lambda o, i: o.store.list_sequences(
            label="normal", cursor=o.at(i)
        ),
        "sequences of both": lambda o, i: o.store.list_sequences(
            subject=o.rows.subject(i), label=o.rows.label(i)
        ),
        "tracks, first page": lambda o, _: o.store.list_tracks(limit=20),
        "tracks, a page between": lambda o, i: o.store.list_tracks(limit=20, cursor=o.at(i)),
        "tracks, last page": lambda o, i: o.store.list_tracks(cursor=o.at(2000 + i % 10)),
        "tracks of a label": lambda o, _: o.store.list_tracks(label="normal", limit=20),
        "tracks of a subject": lambda o, i: o.store.list_tracks(subject=o.rows.subject(i)),
        "jobs, first page": lambda o, _: o.jobs.list(),
        "jobs, a page between": lambda o, i: o.jobs.list(cursor=o.job_at(i)),
        "jobs, last page": lambda o, i: o.jobs.list(cursor=o.job_at(80 + i % 10)),
        "failed jobs, between": lambda o, i: o.jobs.list(
            state=JobState.FAILED, limit=50, cursor=o.job_at(i)
        ),
    }
    others: dict[str, Call] = {
        "record by id": lambda o, i: o.store.sequence_record(o.rows.sequence(i)),
        "an id that is not there": lambda o, i: o.store.has_sequence(o.rows.sequence(-1 - i)),
        "file of a signature": lambda o, i: o.store.signature_path(o.rows.sequence(i), KEY),
        "digest of a result": lambda o, i: _digest(o, i),
        "keys of signatures": lambda o, i: o.store.signatures(o.rows.sequence(i)),
        "track by id": lambda o, i: o.store.track_record(o.rows.sequence(i - i % 200)),
        "job by id": lambda o, i: o.jobs.get(o.rows.job(i)),
        "jobs about a sequence": lambda o, i: o.jobs.about(
            o.rows.sequence(i), f"/v1/sequences/{o.rows.sequence(i)}"
        ),
        "number of sequences and results": lambda o, _: o.store.count(),
        "number of jobs": lambda o, _: o.jobs.count(),
        "unfinished jobs": lambda o, _: o.jobs.unfinished(),
        "old jobs to forget": lambda o, _: o.jobs.forget_before("2026"),
    }
    for name, call in {**pages, **others}.items():
        one, other = _in_turn([_at_places(call, each) for each in opened], N_SAMPLES)
        ratio = other / one
        table.add_at_most(ratio, MOST_RATIO, name, in_words(one), in_words(other), f"{ratio:.2f}")
    return table


def _digest(opened: _Opened, number: int) -> str | None:
    index = Index(opened.store.database)
    return index.digest(ResultName("signature", opened.rows.sequence(number), "", KEY))


def _over_http(few: Rows, many: Rows) -> Table:
    table = Table(
        f"The service with the same, over its routes (medians of {N_REQUESTS}, in turn)",
        ("request", f"{FEW:,}", f"{MANY:,}", "ratio"),
    )
    requests: dict[str, str] = {
        "GET /v1/sequences": "/v1/sequences",
        "GET /v1/sequences?cursor=": "/v1/sequences?cursor={cursor}",
        "GET /v1/sequences?label=&cursor=": "/v1/sequences?label=normal&cursor={cursor}",
        "GET /v1/sequences/{id}": "/v1/sequences/{sequence}",
        "GET /v1/tracks": "/v1/tracks?limit=20",
        "GET /v1/jobs": "/v1/jobs",
        "GET /v1/jobs?cursor=": "/v1/jobs?cursor={job_cursor}",
        "GET /v1/jobs/{id}": "/v1/jobs/{job}",
        "GET /metrics": "/metrics",
        "GET /health/ready": "/health/ready",
    }
    with ExitStack() as stack:
        served = []
        for rows in (few, many):
            settings = Settings(data_dir=rows.root, workers=1, max_requests_per_minute=1_000_000)
            client = stack.enter_context(TestClient(create_app(settings)))
            state = client.app.state.owners.local  # type: ignore[attr-defined]
            served.append((client, _Opened(rows, state.store, state.jobs)))
        for name, template in requests.items():
            tasks = [_requests(client, opened, template) for client, opened in served]
            one, other = _in_turn(tasks, N_REQUESTS)
            ratio = other / one
            cells = (name, in_words(one), in_words(other), f"{ratio:.2f}")
            table.add_at_most(ratio, MOST_RATIO, *cells)
    return table


def _requests(client: TestClient, opened: _Opened, template: str) -> Callable[[], object]:
    def ask(opened: _Opened, number: int) -> object:
        path = template.format(
            sequence=opened.rows.sequence(number),
            job=opened.rows.job(number),
            cursor=opened.at(number),
            job_cursor=opened.job_at(number),
        )
        response = client.get(path)
        assert response.status_code == 200, response.text
        return response

    return _at_places(ask, opened)


def _whole(few: Rows, many: Rows) -> Table:
    """Time what reads every row: in proportion to their number, and no faster."""
    table = Table(
        "What reads all rows, and its time a row",
        ("work", f"{FEW:,}", f"{MANY:,}", "a row", "ratio a row"),
    )
    works: dict[str, Callable[[Path], object]] = {
        "verify: names of all rows": lambda root: _with_database(root, _names),
        "verify: counting anew": lambda root: _with_database(root, lambda d: Index(d).recount()),
        "backup: the database": _copied,
    }
    for name, work in works.items():
        short = statistics.median(_seconds(work, few.root) for _ in range(9))
        long = min(_seconds(work, many.root) for _ in range(2))
        ratio = (long / many.n) / (short / few.n)
        cells = (name, in_words(short), in_words(long), in_words(long / many.n), f"{ratio:.2f}")
        table.add_at_most(ratio, MOST_RATIO, *cells)
    short, long = (_seconds(_checked, rows.root) / rows.n for rows in (few, many))
    times = in_words(short * few.n), in_words(long * many.n), in_words(long)
    table.add("verify: SQLite's own check", *times, f"{long / short:.2f}")
    files = _seconds_of_files(few.root.parent / "files")
    ratio = (files + long) / (files + short)
    name = f"the same with files of {in_words(files)}"
    table.add_at_most(ratio, MOST_RATIO, name, "", "", in_words(files + long), f"{ratio:.2f}")
    return table


def _checked(root: Path) -> None:
    _with_database(root, Database.faults)


def _seconds_of_files(root: Path, n: int = 200) -> float:
    """Seconds a sequence to check its three small files, of a store that has them."""
    rng = np.random.default_rng(3)
    with ResultStore(root) as store:
        for _ in range(n):
            vertices = rng.normal(size=(4, 64, 3))
            sequence = mesh_sequence(vertices, grid=(8, 8), topology="cup", unit="mm")
            store.put_sequence(sequence)
            store.put_signature(modal_signature(sequence, SignatureParameters(modes=6)))
    start = time.perf_counter()
    assert verify(root).is_sound
    return (time.perf_counter() - start) / n


def _with_database(root: Path, work: Callable[[Database], object]) -> None:
    database = Database(root / "index.sqlite")
    work(database)
    database.close()


def _names(database: Database) -> None:
    index = Index(database)
    assert sum(1 for _ in index.ids()) < sum(1 for _ in index.results())


def _copied(root: Path) -> None:
    staged = stage_database(root / "index.sqlite", root / "copy.sqlite")
    assert staged is not None
    staged.unlink()


def _seconds(work: Callable[[Path], object], root: Path) -> float:
    start = time.perf_counter()
    work(root)
    return time.perf_counter() - start


def _at_places(call: Call, opened: _Opened) -> Callable[[], object]:
    places = itertools.cycle(opened.rows.sample())
    return lambda: call(opened, next(places))


def _in_turn(tasks: Sequence[Callable[[], object]], n: int) -> list[float]:
    """Median time of each task in s, one after the other in every round."""
    times: list[list[float]] = [[] for _ in tasks]
    # The first ones warm what a service that has run for a while has read; the others are of places
    # that have not been read.
    for number in range(2 * n):
        for task, seconds in zip(tasks, times, strict=True):
            begin = time.perf_counter()
            task()
            if number >= n:
                seconds.append(time.perf_counter() - begin)
    return [statistics.median(seconds) for seconds in times]
