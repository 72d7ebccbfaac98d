"""What a start takes: of the library, and of the service until it answers."""

from __future__ import annotations

import http.client
import os
import resource
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

from load import raw_beat
from measure import Table, in_words

N_ROUNDS: Final = 5
MOST_SECONDS: Final = 60.0
GRID: Final = (20, 16)

BARE: Final = "import numpy, scipy, fastapi"
SIGNATURE: Final = "from modalmotion import modal_signature"
ADDRESS: Final = "127.0.0.1"


def run(folder: Path) -> list[Table]:
    """Time starts in turn, each in a process of its own."""
    bodies = raw_beat(GRID)
    stated = urlencode({"format": "raw", "grid": f"{GRID[0]},{GRID[1]}", "topology": "cup"})
    asked: dict[str, Callable[[http.client.HTTPConnection], None]] = {
        "serve, first answer": lambda to: to.request("GET", "/health/live"),
        "serve, ready": lambda to: to.request("GET", "/health/ready"),
        "serve, first signature": lambda to: to.request(
            "POST", f"/v1/signature?{stated}", bodies, {"Content-Type": "application/octet-stream"}
        ),
    }
    # As installed packages are: compiled once. Where bytecode is not kept, each start compiles all.
    os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
    seconds: dict[str, list[float]] = {}
    cpu: dict[str, list[float]] = {}
    with tempfile.TemporaryDirectory(dir=folder) as place:
        _first(Path(place) / "before", asked["serve, first signature"])
        for number in range(N_ROUNDS):
            for code in (BARE, SIGNATURE, "import modalmotion.signature.making"):
                before, start = _children_cpu(), time.perf_counter()
                subprocess.run([sys.executable, "-c", code], check=True)
                seconds.setdefault(code, []).append(time.perf_counter() - start)
                cpu.setdefault(code, []).append(_children_cpu() - before)
            for name, ask in asked.items():
                taken, spent = _first(Path(place) / f"{number}{name}", ask)
                seconds.setdefault(name, []).append(taken)
                cpu.setdefault(name, []).append(spent)
    table = Table(
        f"starts, median of {N_ROUNDS} rounds in turn; CPU is that of the first process alone",
        ("what", "clock", "least", "CPU", f"CPU / `{BARE}`"),
    )
    bare = statistics.median(cpu[BARE])
    for name, values in seconds.items():
        clock, share = statistics.median(values), statistics.median(cpu[name]) / bare
        times = (clock, min(values), statistics.median(cpu[name]))
        cells = (name, *map(in_words, times), f"{share:.2f}")
        if name == "serve, first answer":
            table.add_at_most(clock, 1.5, *cells)
        else:
            table.add(*cells)
    return [table]


def _first(
    data_dir: Path, ask: Callable[[http.client.HTTPConnection], None]
) -> tuple[float, float]:
    """Seconds from the start of a service to an answer of 200, and its own processor time."""
    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        port = probe.getsockname()[1]
    command = [sys.executable, "-m", "modalmotion", "serve", "--port", str(port)]
    start = time.perf_counter()
    process = subprocess.Popen(
        [*command, "--data-dir", str(data_dir)],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        while time.perf_counter() - start < MOST_SECONDS:
            connection = http.client.HTTPConnection(ADDRESS, port, timeout=MOST_SECONDS)
            try:
                ask(connection)
                if connection.getresponse().status == 200:
                    return time.perf_counter() - start, _cpu(process.pid)
            except OSError:
                time.sleep(0.01)
            finally:
                connection.close()
        raise AssertionError(f"no answer within {MOST_SECONDS:g} s")
    finally:
        process.terminate()
        process.wait()


def _cpu(pid: int) -> float:
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return sum(map(int, fields[11:13])) / os.sysconf("SC_CLK_TCK")


def _children_cpu() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
