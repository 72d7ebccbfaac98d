"""How much of a bare upload's rate is left when the answer is a signature."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Final
from urllib.parse import urlencode

import numpy as np
from load_generator import Load, load, post
from measure import Table, in_words

from modalmotion.simulate import Acquisition, simulate_ventricle

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

from running import RunningService  # noqa: E402 (found on the path just set)

# 25 frames x 3,300 vertices x 3 float32: 990,000 bytes.
GRID: Final = (66, 50)
N_FRAMES: Final = 25
N_CONNECTIONS: Final = 4
N_ROUNDS: Final = 9
SECONDS: Final = 2.0

JSON: Final = {"Accept": "application/json"}
HDF5: Final = {"Accept": "application/x-hdf5"}


def run(folder: Path) -> list[Table]:
    with tempfile.TemporaryDirectory(dir=folder) as place:
        service = RunningService(Path(place) / "results")
        service.program = [str(ROOT / "benchmarks" / "load_server.py")]
        try:
            service.start()
            return [_rates(service)]
        finally:
            service.stop()


def _rates(service: RunningService) -> Table:
    body = raw_beat(GRID)
    known = {"format": "raw", "grid": f"{GRID[0]},{GRID[1]}", "topology": "cup", "unit": "mm"}
    template = service.request("POST", f"/v1/templates?{urlencode(known)}", body).json["id"]
    query = urlencode({**known, "template": template})
    heads = {
        "receive and hash": post("/v1/decode", body, {}),
        "signature, JSON": post(f"/v1/signature?{query}", body, JSON),
        "signature, HDF5": post(f"/v1/signature?{query}", body, HDF5),
    }
    found = {name: Load() for name in heads}
    shares: dict[str, list[float]] = {name: [] for name in heads}
    cpu: dict[str, dict[str, float]] = {name: {"server": 0.0, "workers": 0.0} for name in heads}
    for head in heads.values():
        load(service.port, head, body, N_CONNECTIONS, 1.0)  # warm
    for _ in range(N_ROUNDS):
        rates = {}
        for name, head in heads.items():
            before = service.cpu_seconds()
            part = load(service.port, head, body, N_CONNECTIONS, SECONDS)
            for kind, spent in service.cpu_seconds().items():
                cpu[name][kind] += spent - before[kind]
            rates[name] = part.rate
            found[name].add(part)
        for name, rate in rates.items():
            shares[name].append(rate / rates["receive and hash"])
    table = Table(
        f"{len(body)} bytes of raw float32 over {N_CONNECTIONS} connections, {N_ROUNDS} rounds "
        f"of {SECONDS:g} s in turn; generator on the same machine; ms a request",
        (
            *("answer", "rate /s", "of bare", "latency p50", "p95"),
            *("CPU server", "CPU workers", "receive", "wait", "read", "fit", "render"),
        ),
    )
    for name, total in found.items():
        n = len(total.latencies)
        p50, p95 = np.percentile(total.latencies, [50, 95])
        share = float(np.median(shares[name]))
        at_work = sum(total.stage(stage) for stage in ("read", "fit", "render"))
        cells = [
            *(name, f"{total.rate:.0f}", f"{100 * share:.0f} %", in_words(p50), in_words(p95)),
            *(f"{1e3 * cpu[name][kind] / n:.2f}" for kind in ("server", "workers")),
            f"{total.stage('receive'):.2f}",
            f"{max(0.0, total.stage('worker') - at_work):.2f}",
            *(f"{total.stage(stage):.2f}" for stage in ("read", "fit", "render")),
        ]
        if name.startswith("signature"):
            table.add_at_least(share, 0.30, *cells)
        else:
            table.add(*cells)
    return table


def raw_beat(grid: tuple[int, int], n_frames: int = N_FRAMES) -> bytes:
    """Simulate a beat and write it as raw little-endian float32."""
    beat = simulate_ventricle(
        grid=grid,
        acquisition=Acquisition(n_frames=n_frames, noise=0.6),
        rng=np.random.default_rng(1994),
    )
    return beat.vertices.astype("<f4").tobytes()
