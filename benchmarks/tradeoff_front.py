"""The front against single fits, and what `auto` finds on simulated ventricles."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from measure import Table, in_words, side_by_side

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.noise_level import measure_noise
from modalmotion.fit.basis import make_basis
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.pictures.tradeoff import tradeoff_figure
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import reconstruct
from modalmotion.simulate import Acquisition, VentricleParameters, simulate_ventricle
from modalmotion.template import choose_modes, make_template
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import measure_front, measure_tradeoff

_COUNTS: Final = (1, 4, 7, 11, 13, 18, 22, 29, 37, 46, 52, 63, 76, 97, 121, 143, 173, 198, 250)


def run(folder: Path) -> list[Table]:
    """Measure the front's cost and the choice of `auto`; a picture goes into the folder."""
    beat = _ventricle({"grid": (50, 80)}, noise=0.2, seed=1)
    found = measure_tradeoff(beat, SignatureParameters(tolerance=0.6))
    tradeoff_figure(found).savefig(folder / "tradeoff.png")
    return [_front_cost(beat), _auto()]


def _front_cost(beat: MeshSequence) -> Table:
    asked = SignatureParameters(topology="cup")
    only = (Components.CARTESIAN,)
    template = make_template(beat)
    front = measure_front(beat, asked, components=only)
    counts = front.branches[0].counts
    largest = int(counts[-1])
    table = Table("RMS front of 25 x 4,000, one topology", ("what", "points", "time", "fits"))

    def fit() -> object:
        modes = choose_modes(make_template(beat), largest, beat.grid).modes
        return Fitter.of(beat, template).fit(make_basis(template, modes))

    times = side_by_side(
        {"front": lambda: measure_front(beat, asked, components=only), "fit": fit}, n_samples=10
    )
    ratio = times["front"].median / times["fit"].median
    table.add(f"fit of {largest} modes", "1", in_words(times["fit"].median), "1")
    table.add_at_most(
        ratio, 3.0, "front", str(len(counts)), in_words(times["front"].median), f"{ratio:.2f}"
    )
    return table


def _auto() -> Table:
    table = Table(
        "auto on simulated ventricles: estimate, and error against the truth over the best count's",
        ("vertices, noise (mm), seeds", "estimate off", "of positions", "of displacements"),
    )
    rng = np.random.default_rng(3)
    for size in ({"grid": (32, 64)}, {"n_vertices": 1500}, {"n_vertices": 500}):
        for noise in (0.0, 0.1, 0.5, 1.0):
            off, placed, moved = [], [], []
            for seed in rng.integers(1 << 30, size=3).tolist():
                noisy = _ventricle(size, noise, seed)
                clean = _ventricle(size, 0.0, seed)
                asked = SignatureParameters(auto=True)
                sigma = measure_noise(Fitter.of(noisy, make_template(noisy), asked)).sigma
                off.append(abs(sigma - noise) / (noise or 1.0))
                ratios = _over_best(noisy, clean)
                placed.append(ratios[0])
                moved.append(ratios[1])
            name = f"{next(iter(size.values()))}, {noise}, {len(off)}"
            cells = (f"{max(placed):.3f}", f"{max(moved):.3f}")
            if noise:
                table.add_at_most(max(off), 0.2, name, f"{max(off):.1%}", *cells)
            else:
                table.add_at_most(max(off), 0.02, name, f"{max(off):.4f} mm", *cells)
            table.add_at_most(max(*placed, *moved), 1.1, "  worst ratio", "", *cells)
    return table


def _ventricle(size: dict[str, Any], noise: float, seed: int) -> MeshSequence:
    return simulate_ventricle(
        VentricleParameters(motion_variation=2.0, shape_variation=2.0),
        acquisition=Acquisition(n_frames=25, noise=noise),
        rng=np.random.default_rng(seed),
        **size,
    )


def _over_best(noisy: MeshSequence, clean: MeshSequence) -> tuple[float, float]:
    """Errors of the chosen count over those of the best: of positions, of displacements."""
    weights = make_template(noisy).weights
    chosen = len(modal_signature(noisy, SignatureParameters(auto=True)).modes)
    own = noisy.vertices[0] - clean.vertices[0]
    errors = {}
    for n in {*_COUNTS, chosen}:
        if n > noisy.n_vertices // 2 and n != chosen:
            continue
        signature = modal_signature(noisy, SignatureParameters(modes=n))
        offsets = reconstruct(signature, noisy) - clean.vertices
        errors[len(signature.modes)] = [
            float(np.sqrt(((part**2).sum(axis=2) @ weights).mean()))
            for part in (offsets, offsets - own)
        ]
    best = np.array(list(errors.values())).min(axis=0)
    return errors[chosen][0] / best[0], errors[chosen][1] / best[1]
