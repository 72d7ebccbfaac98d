"""Ejection fraction from few amplitudes: how far off, with which bound, in what time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray
from real_data import is_there, recording

from modalmotion.clinical import ClinicalReadouts, clinical_readouts
from modalmotion.fit.basis import make_basis
from modalmotion.mesh import Cavity, cavity_of
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.signature.making import ModalSignature, SignatureParameters, modal_signature
from modalmotion.signature.reconstruction import fitted_on, reconstruct
from modalmotion.simulate import simulate_cohort, simulate_ventricle

REAL = (
    ("lv_grid_32x64, cylinder", "lv_grid_32x64", None),
    ("lv_grid_32x64, cup", "lv_grid_32x64", "cup"),
    ("lv_endocardium", "lv_endocardium", None),
    ("epicardium", "epicardium", None),
)
COUNTS = (7, 18, 37)
N_PER_CLASS = 40

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """Ejection fractions of one sequence, percent, and bounds of its smallest volume."""

    mesh: float
    modes_alone: float
    affine_first: float
    bound: float
    volume_error: float
    volume_from_rms: float


def run(_folder: Path) -> list[Table]:
    """Measure everything."""
    return [real(), simulated(), time()]


def real() -> Table:
    table = Table(
        "Ejection fraction of a real heart, percent",
        ("surface", "amplitudes", "mesh", "modes alone", "affine part first", "stated bound"),
    )
    for name, file, topology in REAL:
        if not is_there(f"readouts: {name}", f"heart/{file}"):
            continue
        sequence = recording(f"heart/{file}")
        for n_modes in COUNTS:
            found = reading(sequence, SignatureParameters(modes=n_modes, topology=topology))
            values = (found.mesh, found.modes_alone, found.affine_first, found.bound)
            cells = (name, str(3 * n_modes), *(f"{value:.2f}" for value in values))
            if file == "epicardium":
                table.add(*cells)
            else:
                table.add_at_most(abs(found.affine_first - found.mesh), 1.5, *cells)
    return table


def simulated() -> Table:
    readings = [reading(sequence, SignatureParameters()) for sequence in cohort(N_PER_CLASS)]
    table = Table(
        f"{len(readings)} simulated ventricles, 21 amplitudes",
        ("", "median", "90 %", "95 %", "largest"),
    )
    error = np.array([abs(r.affine_first - r.mesh) for r in readings])
    bound = np.array([r.bound for r in readings])
    rows = {
        "ejection fraction off by, modes alone, points": np.array(
            [abs(r.modes_alone - r.mesh) for r in readings]
        ),
        "the same, affine part first": error,
        "its stated bound, points": bound,
        "smallest volume off by, ml": np.array([r.volume_error for r in readings]) / 1000,
        "first-order bound from the RMS error, ml": np.array([r.volume_from_rms for r in readings])
        / 1000,
    }
    for name, values in rows.items():
        cells = [f"{np.quantile(values, q):.2f}" for q in (0.5, 0.9, 0.95, 1.0)]
        table.add(name, *cells)
    ratio = float(np.median(bound) / np.median(error))
    table.add_at_most(ratio, 5.0, "median bound over median error", f"{ratio:.2f}", "", "", "")
    missed = int((error > bound).sum())
    table.add_at_most(missed, 0, "errors beyond their bound", str(missed), "", "", "")
    within = float((error <= 1.5).mean())
    table.add("share within 1.5 points", f"{within:.0%}", "", "", "")
    return table


def time() -> Table:
    table = Table("Read-outs beside the fit", ("vertices", "signature", "read-outs"))
    for sequence in (simulated_beat(1000), simulated_beat(10_000), simulated_beat(100_000)):
        signature = modal_signature(sequence)
        times = side_by_side(
            {
                "signature": partial(modal_signature, sequence),
                "read-outs": partial(clinical_readouts, signature, sequence),
            },
            n_samples=3,
        )
        taken = (in_words(seconds.best) for seconds in times.values())
        table.add(f"{sequence.n_vertices:,}", *taken)
    return table


def simulated_beat(n: int) -> MeshSequence:
    return simulate_ventricle(n_vertices=n, rng=np.random.default_rng(0))


def cohort(n_per_class: int) -> Iterator[MeshSequence]:
    for case in simulate_cohort(n_per_class, rng=np.random.default_rng(8)):
        yield case.sequence


def reading(sequence: MeshSequence, parameters: SignatureParameters) -> Reading:
    signature = modal_signature(sequence, parameters)
    found = clinical_readouts(signature, sequence)
    template = fitted_on(signature, sequence)
    cavity = cavity_of(template.faces, template.n_vertices)
    alone = np.abs(cavity.volume(reconstruct(signature, sequence)))
    frame = found.mesh_curve.end_systole
    return Reading(
        mesh=found.mesh_curve.share or 0.0,
        modes_alone=float(100 * (1 - alone.min() / alone.max())),
        affine_first=found.curve.share or 0.0,
        bound=found.curve.share_bound or 0.0,
        volume_error=abs(_off(found, frame)),
        volume_from_rms=first_order_bound(signature, sequence, cavity, frame),
    )


def first_order_bound(
    signature: ModalSignature, sequence: MeshSequence, cavity: Cavity, frame: int
) -> float:
    """|n . r| <= |n - its part in the modes| |r|, both in the norm of the fit.

    r, what the modes leave, is orthogonal to them, and n is the gradient of the volume. The
    remainder of second order, with which alone it would be a bound, is left out.
    """
    template = fitted_on(signature, sequence)
    basis = make_basis(template, signature.modes)
    x = reconstruct(signature, sequence, [frame])[0]
    turned = signature.rotations.matrices[frame]
    W = template.weights
    used = W > 0
    n = (gradient(cavity, x) @ turned)[used] / W[used, None]
    root = np.sqrt(W[used])[:, None]
    Phi = basis.shapes[used]
    part, *_ = np.linalg.lstsq(root * Phi, root * n, rcond=None)
    left = root * (n - Phi @ part)
    return float(np.linalg.norm(left) * signature.weighted_rms_errors[frame])


def gradient(cavity: Cavity, x: Floats) -> Floats:
    """Differentiate the volume by each vertex, (vertices, 3), length unit squared."""
    x = x - x[cavity.faces[0, 0]]
    total = np.zeros_like(x)
    corners = [x[cavity.faces[:, k]] for k in range(3)]
    for k in range(3):
        area = np.cross(corners[(k + 1) % 3], corners[(k + 2) % 3]) / 6
        np.add.at(total, cavity.faces[:, k], area)
    for edges in cavity.openings:
        start, end = x[edges[:, 0]], x[edges[:, 1]]
        centre = start.mean(axis=0)
        np.add.at(total, edges[:, 1], np.cross(start, centre) / 6)
        np.add.at(total, edges[:, 0], np.cross(centre, end) / 6)
        np.add.at(total, edges[:, 0], np.cross(end, start).sum(axis=0) / 6 / len(edges))
    return total


def _off(found: ClinicalReadouts, frame: int) -> float:
    return float(found.curve.volumes[frame] - found.mesh_curve.volumes[frame])
