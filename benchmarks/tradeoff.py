"""The trade of accuracy against time and numbers: the tables and pictures of docs/tradeoff.md."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from measure import in_words, side_by_side, table
from noisy_surfaces import individual
from real_data import ROOT, is_there, recording
from tradeoff_bases import BELTRAMI, CLOSED, PCA, SPRINGS, Front, fronts, surfaces

import modalmotion as mm
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.fit import Fitter, make_basis
from modalmotion.signature.making import SignatureParameters, modal_signature
from modalmotion.store import signature_to_hdf5
from modalmotion.template import choose_modes, make_template

COUNTS = (4, 7, 18, 37, 61)
N_VENTRICLES = 20
KINDS = {CLOSED: "#1f5fa8", SPRINGS: "#d95f02", BELTRAMI: "#1b9e77"}


def run() -> list[str]:
    """Measure, and draw the pictures of the page."""
    by_surface = {name: fronts(sequence) for name, sequence in surfaces().items()}
    draw_surfaces(by_surface, ROOT / "docs" / "figures" / "tradeoff-surfaces.png")
    return [ventricles(), stages(), bases(by_surface), principal(by_surface)]


def draw_surfaces(by_surface: dict[str, dict[str, Front]], path: Path) -> None:
    """Error against amplitudes, a panel for each surface."""
    figure = Figure(figsize=(11.0, 2.9 * -(-len(by_surface) // 3)), layout="constrained")
    for k, (name, found) in enumerate(by_surface.items(), start=1):
        axes = figure.add_subplot(-(-len(by_surface) // 3), 3, k, title=name, ylim=(1e-3, 1.3))
        for kind, colour in KINDS.items():
            front = found[kind]
            left = np.maximum(front.rms / front.motion, 1e-4)
            axes.loglog(front.amplitudes, left, "o-", ms=2.5, color=colour, label=kind)
        axes.set(xlabel="amplitudes per frame", ylabel="residual RMS / motion")
    figure.axes[0].legend(fontsize=8, frameon=False, loc="lower left")
    figure.savefig(path, dpi=90)


def ventricles() -> str:
    """Measure the residual error of ventricles for more and more amplitudes."""
    seeds = map(np.random.default_rng, range(N_VENTRICLES))
    simulated = [individual(rng, n_vertices=1200) for rng in seeds]
    name = "heart/lv_endocardium"
    real = [recording(name)] if is_there("tradeoff: a real ventricle", name) else []
    heads = ["amplitudes per frame", "residual RMS, mm: median", "90 %", "real"]
    heads += ["ejection fraction off by, points: median", "90 %", "real", "kB per beat"]
    found = []
    for k in COUNTS:
        parts = np.array([_left_and_off(sequence, k) for sequence in simulated]).T
        own = _left_and_off(real[0], k) if real else (np.nan, np.nan)
        cells = (
            f"{value:.2f}"
            for of_all, one in zip(parts, own, strict=True)
            for value in (*np.quantile(of_all, (0.5, 0.9)), one)
        )
        found.append((f"{3 * k}", *cells, f"{4 * 3 * k * 25 / 1000:.1f}"))
    title = f"{N_VENTRICLES} simulated ventricles (25 frames, 1,200 vertices), and a real one"
    return table(title, heads, found)


def stages() -> str:
    """Where the time of the usual request goes."""
    made = individual(np.random.default_rng(1994))
    sequence = mesh_sequence(made.vertices.astype(np.float32), made.faces, unit="mm")
    template = make_template(sequence)
    chosen = choose_modes(template, 7)[0]
    basis = make_basis(template, chosen)
    signature = modal_signature(sequence)
    fit = Fitter.of(sequence, template).fit
    calls: dict[str, Callable[[], object]] = {
        "read the npz file, check every number": partial(mm.read_npz, mm.write_npz(sequence)),
        "natural coordinates (once for a mesh)": partial(make_template, sequence),
        "evaluate and factor 7 modes (once for a mesh)": partial(make_basis, template, chosen),
        "fit 25 frames, with rotations and errors": partial(fit, basis),
        "write the HDF5 result": partial(signature_to_hdf5, signature),
        "read-outs, if asked for": partial(mm.clinical_readouts, signature, sequence),
    }
    taken = side_by_side(calls, n_samples=15)
    found = [(name, in_words(float(times.min()))) for name, times in taken.items()]
    title = "A beat of 25 frames and 1,500 vertices, fastest of 15 runs"
    return table(title, ["stage", "time"], found)


def bases(by_surface: dict[str, dict[str, Front]]) -> str:
    """RMS of each basis with the same number of amplitudes."""
    found = [
        (name, *(" / ".join(f"{of[kind].at(a):.3f}" for a in (21, 54, 111)) for kind in KINDS))
        for name, of in by_surface.items()
    ]
    title = "Residual RMS in mm with 21 / 54 / 111 amplitudes per frame"
    return table(title, ["surface", *KINDS], found)


def principal(by_surface: dict[str, dict[str, Front]]) -> str:
    """PCA beside the closed form, by the numbers that must be kept."""
    shares, pair = (0.2, 0.1, 0.05), (CLOSED, PCA)
    found = []
    for name, of in by_surface.items():
        bounds = [(of[kind], share * of[CLOSED].motion) for share in shares for kind in pair]
        found.append((name, *(_numbers(*each) for each in bounds)))
    title = "Numbers to store besides the reference mesh until the residual RMS is a share of the"
    heads = ["surface", *(f"{100 * s:.0f} %, {kind}" for s in shares for kind in pair)]
    return table(f"{title} motion", heads, found)


def _left_and_off(sequence: MeshSequence, n_modes: int) -> tuple[float, float]:
    signature = modal_signature(sequence, SignatureParameters(modes=n_modes))
    found = mm.clinical_readouts(signature, sequence)
    off = (found.curve.share or 0.0) - (found.mesh_curve.share or 0.0)
    return signature.weighted_rms_error, abs(off)


def _numbers(front: Front, bound: float) -> str:
    enough = np.flatnonzero(front.rms <= bound)
    return f"{front.numbers[enough[0]]:,}" if enough.size else f"> {front.numbers[-1]:,}"
