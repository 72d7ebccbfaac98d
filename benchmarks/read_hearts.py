"""Ventricles to read figures from, what is true of them, and what the product states."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipe
from strain_truth import StrainTruth, fine_twin, strain_truth

import modalmotion as mm
from modalmotion.facts import Facts
from modalmotion.mesh import cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.simulate import Acquisition, MotionClass, draw_parameters, simulate_ventricle

MESHES: Final[dict[str, dict[str, Any]]] = {
    "16x32": {"grid": (16, 32)},
    "32x64": {"grid": (32, 64)},
    "triangles": {"n_vertices": 2000},
}


def hearts(
    mesh: str, seed: int, n_per_class: int
) -> Iterator[tuple[MeshSequence, StrainTruth, np.random.Generator]]:
    """Ventricles of all classes without noise, what is true of them, and what draws the noise."""
    frames = Acquisition(n_frames=12)
    for k, label in enumerate(list(MotionClass) * n_per_class):
        parameters, state = draw_parameters(label, np.random.default_rng([seed, k])), [seed, k, 1]
        rng = np.random.default_rng(state)
        clean = simulate_ventricle(parameters, acquisition=frames, rng=rng, **MESHES[mesh])
        twin = clean if clean.grid else fine_twin(parameters, state, frames)
        yield clean, strain_truth(twin, by_length=clean.grid is None), rng


def true_figures(clean: MeshSequence, truth: StrainTruth) -> dict[str, float]:
    volumes = volumes_of(clean)
    share = 100 * (1 - volumes.min() / volumes.max())
    return {
        "ef": share,
        "edv": float(volumes.max()),
        "gls": truth.gls,
        "gcs": truth.gcs,
        "gas": truth.gas,
    }


def noisy(clean: MeshSequence, noise: float, rng: np.random.Generator) -> MeshSequence:
    return replace(clean, vertices=clean.vertices + rng.normal(0.0, noise, clean.vertices.shape))


def read(sequence: MeshSequence) -> dict[str, tuple[float, float, float]]:
    """Each figure as the product states it, with the ends of its interval."""
    signature = mm.modal_signature(sequence)
    curve = mm.clinical_readouts(signature, sequence).curve
    strain = mm.strain(sequence)
    assert curve.share is not None
    assert curve.share_range is not None
    return {
        "ef": (curve.share, *curve.share_range),
        "edv": (curve.end_diastolic_volume, *curve.end_diastolic_range),
        **{name.lower(): strain.end_systolic[name] for name in ("GLS", "GCS", "GAS")},
    }


def volumes_of(clean: MeshSequence) -> NDArray[np.float64]:
    cavity = cavity_of(clean.faces, clean.n_vertices)
    return np.abs(cavity.volume(clean.vertices.astype(np.float64)))


def shrinking_ellipsoid(rng: np.random.Generator) -> tuple[MeshSequence, dict[str, float]]:
    """Half an ellipsoid that shrinks by unequal shares, and its strain by elliptic integrals."""
    rest = rng.uniform((25, 20, 75), (30, 24, 85))
    short = rest * rng.uniform(0.7, 0.85, 3)
    sphere = _half_sphere(32, 64)
    beat = mm.mesh_sequence(
        np.stack([sphere * rest, sphere * short]),
        grid=(32, 64),
        topology="cup",
        unit="mm",
        facts=Facts(tracking="material", cavity="lv"),
    )
    lengths = {"gls": _meridian, "gcs": _equator}
    strains = {name: 100 * (of(short) / of(rest) - 1) for name, of in lengths.items()}
    return beat, strains


def _half_sphere(rows: int, columns: int) -> NDArray[np.float64]:
    polar = (np.arange(rows) + 0.5) / rows * np.pi / 2
    around = 2 * np.pi * np.arange(columns) / columns
    rings = np.stack([np.cos(around), np.sin(around), np.zeros(columns)], axis=1)
    heights = np.array([0.0, 0.0, -1.0])
    nodes = np.sin(polar)[:, None, None] * rings + np.cos(polar)[:, None, None] * heights
    return np.asarray(nodes.reshape(-1, 3))


def _meridian(axes: NDArray[np.float64]) -> float:
    """Mean length of quarter ellipses from the apex of an ellipsoid to its equator."""
    turns = 2 * np.pi * (np.arange(720) + 0.5) / 720
    r = np.hypot(axes[0] * np.cos(turns), axes[1] * np.sin(turns))
    long, short = np.maximum(r, axes[2]), np.minimum(r, axes[2])
    return float((long * ellipe(1 - (short / long) ** 2)).mean())


def _equator(axes: NDArray[np.float64]) -> float:
    short, long = sorted(axes[:2])
    return float(4 * long * ellipe(1 - (short / long) ** 2))
