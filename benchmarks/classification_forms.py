"""How often the same ventricle gets the same class as a lattice, a mesh, and cut at its apex."""

from __future__ import annotations

import time
from itertools import combinations
from pathlib import Path
from typing import Final

import numpy as np
from measure import Table

from modalmotion.classification import OFFSET_MODEL, Classification, classify, load_model
from modalmotion.classification.training.train_shipped import OFFSET, RECORDINGS, surfaces_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import (
    Acquisition,
    Case,
    MotionClass,
    Spacing,
    draw_parameters,
    simulate_ventricle,
)

SEED: Final = 47
N_PER_CLASS: Final = 60
LEAST: Final = 97.0


def run(folder: Path, n_per_class: int = N_PER_CLASS) -> list[Table]:
    """Compare the classes by the model of offsets, noise-free and with that of its training."""
    del folder
    noises = (0.0, *sorted({noise for noise, _ in RECORDINGS}))
    return [_table(noise, n_per_class) for noise in noises]


def _table(noise: float, n_per_class: int) -> Table:
    table = Table(
        f"The same class in two forms, {noise:g} mm of noise",
        ("forms", "both have a class", "the same", "right, of the first"),
    )
    model = load_model(OFFSET_MODEL)
    found: list[tuple[str, dict[str, Classification]]] = []
    start = time.process_time()
    for label in OFFSET.classes:
        for number in range(n_per_class):
            forms = _forms(label, noise, [SEED, number, OFFSET.classes.index(label)])
            answers = {name: classify(form, model) for name, form in forms.items()}
            found.append((str(label), answers))
    for one, other in combinations(found[0][1], 2):
        pairs = [(label, a[one].label, a[other].label) for label, a in found]
        both = [(a, b) for _, a, b in pairs if a is not None and b is not None]
        same = 100.0 * float(np.mean([a == b for a, b in both]))
        right = 100.0 * float(np.mean([label == a for label, a, _ in pairs]))
        cells = (f"{one}, {other}", f"{len(both)} of {len(pairs)}", f"{same:.1f} %")
        table.add_at_least(same, LEAST, *cells, f"{right:.1f} %")
    seconds = time.process_time() - start
    table.add("processor time", "", f"{seconds:.0f} s", "")
    return table


def _forms(label: MotionClass, noise: float, seed: list[int]) -> dict[str, MeshSequence]:
    """Simulate one individual in several forms."""
    rng = np.random.default_rng(seed)
    parameters = draw_parameters(label, rng)
    acquisition = Acquisition(
        n_frames=int(rng.integers(12, 41)), start_phase=float(rng.uniform()), noise=noise
    )
    grid = int(rng.integers(12, 37)), 2 * int(rng.integers(12, 37))
    meshes = rng.integers(500, 2501, 2).tolist()

    def form(n_vertices: int | None, spacing: Spacing = Spacing.ARC) -> MeshSequence:
        return simulate_ventricle(
            parameters,
            grid=grid,
            n_vertices=n_vertices,
            spacing=spacing,
            acquisition=acquisition,
            # The individual is drawn first.
            rng=np.random.default_rng([*seed, 1]),
        )

    lattice = form(None)
    return {
        "lattice": lattice,
        "lattice cut at its apex": surfaces_of(Case(lattice, label, parameters), 0.25)[1],
        "rows by height": form(None, Spacing.HEIGHT),
        "mesh": form(meshes[0]),
        "another mesh": form(meshes[1]),
    }
