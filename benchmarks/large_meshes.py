"""Natural coordinates of a million vertices: time and memory, by each way to solve for them."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path
from typing import Final

import numpy as np
from measure import Table, in_words

from modalmotion.mesh import dissection, machine
from modalmotion.mesh.sequence import mesh_sequence
from modalmotion.simulate import simulate_ventricle
from modalmotion.template import make_template

ROOT: Final = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

N_ROUNDS: Final = 3
START: Final = 62_500
WAYS: Final = {
    "direct": "factorisation",
    "multigrid": "multigrid (`large`)",
    "kernels": "multigrid, compiled (`compile-codec`)",
}


def run(_: Path) -> list[Table]:
    """Take the ways in turn, each in a process of its own."""
    found: dict[str, list[tuple[float, float]]] = {way: [] for way in WAYS}
    for _round in range(N_ROUNDS):
        for way in WAYS:
            done = subprocess.run(
                [sys.executable, __file__, way], capture_output=True, text=True, check=True
            )
            seconds, megabytes = map(float, done.stdout.split())
            found[way].append((seconds, megabytes))
    table = Table(
        f"template of a million vertices (those of a ventricle of {START:,} subdivided twice, "
        f"numbered at random), seconds of processor time, median of {N_ROUNDS}",
        ("solver", "template", "against factorisation", "memory above the mesh"),
    )
    direct = float(np.median([seconds for seconds, _ in found["direct"]]))
    for way, name in WAYS.items():
        seconds, megabytes = (float(value) for value in np.median(found[way], axis=0))
        cells = (name, in_words(seconds), f"{seconds / direct:.2f}", f"{megabytes:,.0f} MB")
        if way != "kernels":
            table.add(*cells)
        else:
            table.add_at_most(seconds, 5.0, *cells)
            table.add_at_most(megabytes, 1200.0, *cells)
    return [table]


def measure(way: str) -> None:
    """Print seconds and megabytes of one template."""
    from template_remeshing import subdivided

    sequence = simulate_ventricle(n_vertices=START, rng=np.random.default_rng(0))
    moving = np.asarray(sequence.vertices[:1], dtype=np.float64), sequence.faces
    vertices, faces = subdivided(subdivided(moving))
    order = np.random.default_rng(1).permutation(vertices.shape[1])
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    one = mesh_sequence(vertices[:, order], place[faces])
    if way == "direct":
        dissection.LARGE = 10**9  # type: ignore[misc]
    if way != "kernels":
        machine._mapped.append(None)
    elif machine.kernels_for(machine.LARGE) is None:
        raise SystemExit("The kernels are not compiled: modalmotion compile-codec")
    # What is imported on the way does not count.
    few = simulate_ventricle(n_vertices=200, rng=np.random.default_rng(0))
    make_template(mesh_sequence(few.vertices[:1], few.faces))
    Path("/proc/self/clear_refs").write_text("5")
    before = _peak()
    start = time.process_time()
    make_template(one)
    print(time.process_time() - start, (_peak() - before) / 1e6)


def _peak() -> int:
    """Most bytes in memory since it was last set to what is there."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(line for line in lines if line.startswith("VmHWM")).split()[1])


if __name__ == "__main__":
    measure(sys.argv[1])
