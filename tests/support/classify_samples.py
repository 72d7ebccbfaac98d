"""Small labelled cohorts of curves and ventricles, made once."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from modalmotion.classification import Model, TrainingCase, TrainingOptions, train
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import MotionClass, simulate_cohort

QUICK_CARD = TrainingOptions(repetitions=1)
"""What a user gets, without what only the card is for."""

TWO = (MotionClass.NORMAL, MotionClass.HYPOKINESIA)


@cache
def cohort(n_per_class: int, seed: int = 11, classes: tuple[str, ...] = TWO) -> list[TrainingCase]:
    """Simulated ventricles."""
    kinds = [MotionClass(label) for label in classes]
    rng = np.random.default_rng(seed)
    return [
        TrainingCase(modal_signature(case.sequence), str(case.label), f"{seed}-{number}")
        for number, case in enumerate(simulate_cohort(n_per_class, rng=rng, classes=kinds))
    ]


@cache
def small_model() -> Model:
    """Trained on `cohort(6)`."""
    return train(cohort(6), "small", QUICK_CARD)


@cache
def curves_model() -> Model:
    """Trained on `curves(12)`."""
    return train(curves(12), "tongue", QUICK_CARD)


def curve(label: str, rng: np.random.Generator, n_frames: int = 24) -> MeshSequence:
    """A curve that rises at its tip or at its back, like a tongue, turned any way."""
    s = np.linspace(0.0, 1.0, 11)
    shape = np.stack([60 * s, 20 * np.sin(np.pi * s), np.zeros(11)], axis=1)
    where = 0.8 if label == "tip" else 0.35
    bump = np.exp(-(((s - where) / 0.2) ** 2))
    t = np.linspace(0.0, 1.0, n_frames)
    height = rng.uniform(6.0, 10.0) * np.exp(-(((t - rng.uniform(0.45, 0.55)) / 0.15) ** 2))
    moved = np.repeat(shape[None], n_frames, axis=0)
    moved[:, :, 1] += height[:, None] * bump
    moved += 0.3 * rng.standard_normal(moved.shape)
    turn: NDArray[np.float64] = Rotation.random(random_state=rng).as_matrix()
    return mesh_sequence(moved @ turn.T, topology="open curve", unit="mm")


@cache
def curves(n_per_class: int, seed: int = 100) -> list[TrainingCase]:
    """Curves of two classes."""
    rng = np.random.default_rng(seed)
    parameters = SignatureParameters(modes=7)
    return [
        TrainingCase(modal_signature(curve(label, rng), parameters), label, f"speaker {number}")
        for number in range(n_per_class)
        for label in ("tip", "back")
    ]
