"""Simulated ventricles, and read-outs of them worked out the slow way."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical import ClinicalReadouts, VolumeCurve, clinical_readouts
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.simulate import simulate_cohort

Floats = NDArray[np.float64]


def read(sequence: MeshSequence, **parameters: object) -> ClinicalReadouts:
    asked = SignatureParameters(**parameters)  # type: ignore[arg-type]
    return clinical_readouts(modal_signature(sequence, asked), sequence)


def cohort(n_per_class: int, seed: int) -> Iterator[MeshSequence]:
    for case in simulate_cohort(n_per_class, rng=np.random.default_rng(seed)):
        yield case.sequence


def share(curve: VolumeCurve) -> float:
    assert curve.share is not None
    return curve.share


def share_range(curve: VolumeCurve) -> tuple[float, float]:
    assert curve.share_range is not None
    return curve.share_range


def share_bound(curve: VolumeCurve) -> float:
    assert curve.share_bound is not None
    return curve.share_bound


def ejected(volumes: Floats) -> float:
    return float(100 * (1 - volumes.min() / volumes.max()))
