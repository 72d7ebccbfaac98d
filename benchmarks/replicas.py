"""What a second replica that keeps nothing adds, and what many files in one request save."""

from __future__ import annotations

import os
import sys
import tempfile
import threading
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

import numpy as np
from load import GRID, JSON, ROOT, raw_beat
from load_generator import Load, load, post
from measure import Table

from modalmotion.client.bodies import body_of, form_body

sys.path.insert(0, str(ROOT / "tests" / "support"))

from running import RunningService

N_ROUNDS: Final = 7
SECONDS: Final = 2.0
N_CONNECTIONS: Final = 4
N_FILES: Final = 16
SMALL: Final = (22, 18)

KNOWN: Final = {"format": "raw", "topology": "cup", "unit": "mm"}


def run(folder: Path) -> list[Table]:
    """Measure one replica and two in turn, and requests of one file and of many."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        settings = {"STATELESS": "true", "WORKERS": "1", "MAX_REQUESTS_PER_MINUTE": "1000000"}
        services = [
            RunningService(
                Path(place) / str(number),
                settings,
                log=Path(place) / f"log{number}",
                is_warm=False,
            )
            for number in range(2)
        ]
        try:
            cores = sorted(os.sched_getaffinity(0))
            for number, one in enumerate(services):
                # What is started has the cores of who starts it.
                os.sched_setaffinity(0, {cores[number % len(cores)]})
                one.start()
            os.sched_setaffinity(0, cores)
            return [_replicas(services), _batches(services[0])]
        finally:
            for one in services:
                one.stop()


def _replicas(services: list[RunningService]) -> Table:
    body = raw_beat(GRID)
    query = urlencode({**KNOWN, "grid": f"{GRID[0]},{GRID[1]}"})
    head = post(f"/v1/signature?{query}", body, JSON)
    for one in services:
        load(one.port, head, body, 2, 1.0)  # warm
    rates: dict[int, list[float]] = {1: [], 2: []}
    cpu: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(N_ROUNDS):
        for n in rates:
            before = _cpu(services)
            total = _load_all(services[:n], head, body)
            rates[n].append(total.rate)
            cpu[n].append(1e3 * (_cpu(services) - before) / len(total.latencies))
    table = Table(
        f"signatures of {len(body)} bytes, replicas of one worker and one core, {N_CONNECTIONS} "
        f"connections, {N_ROUNDS} rounds of {SECONDS:g} s in turn; generator on the same two cores",
        ("replicas", "rate /s", "CPU ms a signature", "two cores give at most", "against one"),
    )
    alone, both = (float(np.median(rates[n])) for n in rates)
    most = 2e3 / float(np.median(cpu[2]))
    table.add("1", f"{alone:.0f}", f"{np.median(cpu[1]):.2f}", "", "")
    ratio = float(np.median(np.divide(rates[2], rates[1])))
    table.add_at_least(
        ratio, 1.5, "2", f"{both:.0f}", f"{np.median(cpu[2]):.2f}", f"{most:.0f} /s", f"{ratio:.2f}"
    )
    return table


def _batches(service: RunningService) -> Table:
    body = raw_beat(SMALL)
    query = urlencode({**KNOWN, "grid": f"{SMALL[0]},{SMALL[1]}"})
    form = form_body([(str(n), body_of(body)) for n in range(N_FILES)])
    many = b"".join(form.pieces())
    heads = {
        "one": (post(f"/v1/signature?{query}", body, JSON), body, 1),
        "many": (
            post(f"/v1/signature?{query}", many, {**JSON, "Content-Type": form.media_type}),
            many,
            N_FILES,
        ),
    }
    rates: dict[str, list[float]] = {name: [] for name in heads}
    cpu: dict[str, list[float]] = {name: [] for name in heads}
    for round_ in range(N_ROUNDS + 1):
        for name, (head, sent, n_files) in heads.items():
            before = _cpu([service])
            part = load(service.port, head, sent, 2, SECONDS)
            if round_:  # the first is warm-up
                n = n_files * len(part.latencies)
                rates[name].append(n_files * part.rate)
                cpu[name].append(1e3 * (_cpu([service]) - before) / n)
    table = Table(
        f"signatures of {len(body)} bytes, one in a request and {N_FILES} in a form, one worker, "
        f"two connections, {N_ROUNDS} rounds of {SECONDS:g} s in turn",
        ("files in a request", "signatures /s", "CPU ms a signature", "against one"),
    )
    for name, (_, _, n_files) in heads.items():
        ratio = float(np.median(np.divide(cpu[name], cpu["one"])))
        cells = (str(n_files), f"{np.median(rates[name]):.0f}", f"{np.median(cpu[name]):.2f}")
        if n_files == 1:
            table.add(*cells, "")
        else:
            table.add_at_most(ratio, 1.0, *cells, f"{ratio:.2f}")
    return table


def _load_all(services: list[RunningService], head: bytes, body: bytes) -> Load:
    """Spread the same number of connections over services."""
    parts: list[Load] = []
    n = N_CONNECTIONS // len(services)
    threads = [
        threading.Thread(
            target=lambda one=one: parts.append(load(one.port, head, body, n, SECONDS))
        )
        for one in services
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    total = Load()
    for part in parts:
        total.latencies += part.latencies
        total.seconds = max(total.seconds, part.seconds)
    return total


def _cpu(services: list[RunningService]) -> float:
    return sum(sum(one.cpu_seconds().values()) for one in services)
