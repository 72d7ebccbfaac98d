"""Controls for norms: simulated ventricles, and readings drawn from a distribution."""

from __future__ import annotations

import numpy as np

import modalmotion as mm
from modalmotion.classification.model import Readable
from modalmotion.classification.motion_features import Extractor
from modalmotion.norm import Norm
from modalmotion.norm.norm import Reading
from modalmotion.simulate import MotionClass, draw_parameters

WORDS = ("radial", "turning", "axial", "oval", "tilt")
COLUMNS = tuple(f"{word} 0 cos {k}" for word in WORDS for k in (1, 2, 3))


def beat(seed: int, label: MotionClass = MotionClass.NORMAL, noise: float = 0.3) -> mm.MeshSequence:
    """A ventricle, coarse and short."""
    rng = np.random.default_rng(seed)
    acquisition = mm.Acquisition(n_frames=10, noise=noise)
    return mm.simulate_ventricle(
        draw_parameters(label, rng), grid=(6, 12), acquisition=acquisition, rng=rng
    )


def drawn(rng: np.random.Generator, number: int, *, has_covariates: bool = False) -> Reading:
    """Draw a reading from a distribution with heavy tails."""
    x = np.exp(rng.normal(size=15)) * rng.normal(size=15)
    covariates: dict[str, float | str] = {}
    if has_covariates:
        age, sex = float(rng.integers(20, 80)), "fm"[rng.integers(2)]
        covariates = {"age": age, "sex": sex}
        x[:5] += 0.1 * age + (sex == "f")
    return Reading(
        values=x,
        quantities=np.array([rng.normal(60, 5), rng.normal(120, 20), rng.normal(50, 10)]),
        fraction=None,
        conditions={"frames": 10, "vertices": 72, "tracking": "material"},
        covariates=covariates,
        sequence_id=str(number),
    )


def norm_of(readings: list[Reading]) -> Norm:
    """Norm of drawn readings."""
    readable = Readable("cup", 7, "", mm.SignatureParameters(modes=7))
    return Norm("drawn", readable, Extractor("axis", n_modes=7), COLUMNS, tuple(readings))
