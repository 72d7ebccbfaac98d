"""How far the answer moves when the same ventricle is recorded in another way."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Final

import numpy as np
from measure import Table
from numpy.typing import NDArray

from modalmotion.classification import load_model
from modalmotion.simulate import MotionClass

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "support"))

from recorded_again import EXACT, OTHER_COORDINATES, RESAMPLED, Answer, answer, draw_recording

SEED: Final = 31
N_PER_CLASS: Final = 40
NOISE: Final = 0.6
BOUND: Final = 0.01


def run(folder: Path, n_per_class: int = N_PER_CLASS) -> list[Table]:
    """Measure it on ventricles of all classes, mild to severe."""
    del folder
    return [
        _table("The same data, 0.6 mm of noise", "exact", NOISE, n_per_class),
        _table("The same motion, other points or times, no noise", "resampled", 0.0, n_per_class),
        _table("The same, 0.6 mm of noise on the first", "meshes", NOISE, n_per_class),
    ]


_CHANGES: Final = {
    "exact": EXACT,
    "resampled": RESAMPLED,
    # With noise a recording cannot be made again; the same noisy surface can be meshed again.
    "meshes": {k: RESAMPLED[k] for k in ("each triangle in four",)},
}


def _table(title: str, which: str, noise: float, n_per_class: int) -> Table:
    model = load_model()
    table = Table(
        f"Largest change of a probability: {title}",
        ("change", "cases", "median", "99 %", "largest", "within 0.01", "other class", "feature"),
    )
    moved: dict[str, list[tuple[Answer, Answer]]] = {name: [] for name in _CHANGES[which]}
    rng = np.random.default_rng(SEED)
    for _ in range(n_per_class):
        for label in MotionClass:
            recording = draw_recording(label, rng, noise)
            sequence = recording.sequence()
            before = answer(sequence, model)
            for name, change in _CHANGES[which].items():
                other = change(recording, sequence, rng)
                if other is not None:
                    moved[name].append((before, answer(other, model)))
    for name, pairs in moved.items():
        moves = np.array([np.abs(a.probabilities - b.probabilities).max() for a, b in pairs])
        classes = sum(int(a.probabilities.argmax() != b.probabilities.argmax()) for a, b in pairs)
        cells = (
            name,
            str(len(pairs)),
            f"{np.median(moves):.1e}",
            f"{np.quantile(moves, 0.99):.1e}",
            f"{moves.max():.1e}",
            f"{(moves <= BOUND).mean():.1%}",
            str(classes),
            _most_moved(pairs),
        )
        if name in OTHER_COORDINATES:
            table.add(*cells)
        else:
            table.add_at_most(float(np.quantile(moves, 0.99)), BOUND, *cells)
    return table


def _scale() -> NDArray[np.float64]:
    return np.concatenate([member.blend.scale for member in load_model().members])


def _most_moved(pairs: list[tuple[Answer, Answer]]) -> str:
    """Feature that moves most against its own spread, and by how much of it."""
    before, after = (np.stack([pair[k].features for pair in pairs]) for k in (0, 1))
    shares = np.quantile(np.abs(before - after), 0.99, axis=0) / _scale()
    k = int(shares.argmax())
    return f"{pairs[0][0].names[k]} {shares[k]:.1e} sd"
