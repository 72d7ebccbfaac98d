"""Natural coordinates on meshes: what few modes leave, what remeshing moves, what it costs."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
from displaced import displaced
from measure import Table, in_words, side_by_side
from numpy.typing import NDArray
from real_data import is_there, recording
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh

from modalmotion.choice.fitter import Fitter
from modalmotion.choice.parameters import SignatureParameters
from modalmotion.fit.basis import make_basis
from modalmotion.fit.fit import project
from modalmotion.mesh import cotangent_laplacian, vertex_areas
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.signature.distance import signature_distance
from modalmotion.simulate import VentricleParameters, simulate_ventricle
from modalmotion.template import Template, choose_modes, make_template
from modalmotion.template.body_frame import Components, in_body_frame

ROOT = Path(__file__).resolve().parents[1]

COUNTS = {7: 1.40, 18: 0.93, 37: 0.57}
"""Modes, and the RMS in mm that three amplitudes each may leave on the real ventricle."""

Floats = NDArray[np.float64]


def run(folder: Path) -> list[Table]:
    """Measure everything; the picture of the coordinates goes into the folder."""
    tables = [errors(), comparability(), making(), fitting()]
    if is_there("templates: the picture", "heart/lv_endocardium"):
        picture(recording("heart/lv_endocardium"), folder / "natural_coordinates.png")
    return tables


def errors() -> Table:
    """RMS left by modes of each kind."""
    columns = ("surface", "amplitudes", "natural", "own springs", "Laplace-Beltrami", "cylindrical")
    table = Table("RMS left, mm, against frame 0, weighted by area", columns)
    for name in ("lv_endocardium", "epicardium"):
        if not is_there(f"templates: error of the {name}", f"heart/{name}"):
            continue
        sequence = recording(f"heart/{name}")
        for n_modes, bound in COUNTS.items():
            left = [
                left_by(sequence, n_modes),
                left_by(sequence, n_modes, closed_form=False),
                left_by_beltrami(sequence, n_modes),
                left_by(sequence, n_modes, components=Components.CYLINDRICAL),
            ]
            cells = (name, str(3 * n_modes), *(f"{value:.3f}" for value in left))
            if name == "lv_endocardium":
                table.add_at_most(left[0], bound, *cells)
            else:
                table.add(*cells)
    return table


def comparability() -> Table:
    """Distance between signatures of one motion on several triangulations."""
    sys.path.insert(0, str(ROOT / "tests" / "support"))
    remeshing = importlib.import_module("template_remeshing")
    table = Table(
        "Signature distance, %, between triangulations of one motion",
        ("surface", "on", "vertices", "21 amplitudes", "54", "111"),
    )
    sequences = {
        "simulated": simulate_ventricle(
            VentricleParameters(shape_variation=2.0, motion_variation=2.0),
            n_vertices=1400,
            rng=np.random.default_rng(1),
        )
    }
    if is_there("templates: triangulations of a real heart", "heart/lv_endocardium"):
        sequences["lv_endocardium"] = recording("heart/lv_endocardium")
    for name, sequence in sequences.items():
        moving = (sequence.vertices.astype(np.float64), sequence.faces)
        n, rng = sequence.n_vertices, np.random.default_rng(0)
        before = [_described(sequence, k) for k in COUNTS]
        for label, other in {
            "halved": remeshing.remeshed(moving, n // 2, rng),
            "remeshed": remeshing.remeshed(moving, n, rng),
            "four times": remeshing.remeshed(moving, 4 * n, rng),
            "subdivided": remeshing.subdivided(moving),
        }.items():
            made = mesh_sequence(*other)
            found = [
                100 * signature_distance(_described(made, k), b)
                for k, b in zip(COUNTS, before, strict=True)
            ]
            cells = (name, label, str(made.n_vertices), *(f"{d:.2f}" for d in found))
            table.add_at_most(max(found), 2.0, *cells)
    return table


def making() -> Table:
    """Template of a new mesh beside seven Laplace-Beltrami modes of it."""
    table = Table(
        "Template of a new mesh", ("vertices", "template", "7 Laplace-Beltrami modes", "ratio")
    )
    seconds = []
    for n in (10_000, 100_000):
        sequence = simulate_ventricle(n_vertices=n, rng=np.random.default_rng(0))
        one = mesh_sequence(sequence.vertices[:1], sequence.faces)
        calls: dict[str, Callable[[], object]] = {
            "template": partial(make_template, one),
            "beltrami": partial(beltrami_modes, one, 7),
        }
        times = side_by_side(calls, n_samples=7 if n < 50_000 else 3)
        ours, theirs = times["template"].median, times["beltrami"].median
        seconds.append(ours)
        cells = (f"{n:,}", in_words(ours), in_words(theirs), f"{ours / theirs:.2f}")
        table.add_at_most(ours / theirs, 1.0, *cells)
    growth = seconds[1] / seconds[0]
    table.add_at_most(growth, 20.0, "ten times as many", f"{growth:.1f} times", "", "")
    return table


def fitting() -> Table:
    """Amplitudes and whole fits in copies of the array of displacements."""
    table = Table(
        "25 frames x 4,000 vertices, in float64 copies of the array", ("what", "time", "copies")
    )
    sequence = simulate_ventricle(n_vertices=4000, rng=np.random.default_rng(0))
    template = make_template(sequence)
    basis = make_basis(template, choose_modes(template, 7).modes)
    u = next(Fitter.of(sequence, template).displacements.blocks()).u.transpose(0, 2, 1)
    array = np.ascontiguousarray(u)
    narrow = mesh_sequence(sequence.vertices.astype(np.float32), sequence.faces)
    local = SignatureParameters(components=Components.CYLINDRICAL)
    calls: dict[str, Callable[[], object]] = {
        "copy": array.copy,
        "amplitudes": lambda: project(basis, u),
        "amplitudes, vertex by vertex in memory": lambda: project(basis, array),
        "fit": lambda: Fitter.of(sequence, template).fit(basis),
        "fit of float32": lambda: Fitter.of(narrow, template).fit(basis),
        "fit of cylindrical components": lambda: Fitter.of(sequence, template, local).fit(basis),
    }
    bounds = {"amplitudes": 5.0, "fit": 60.0, "fit of float32": 60.0}
    times = side_by_side(calls, n_samples=60)
    for name, taken in times.items():
        copies = taken.median / times["copy"].median
        cells = (name, in_words(taken.median), f"{copies:.1f}")
        if name in bounds:
            table.add_at_most(copies, bounds[name], *cells)
        else:
            table.add(*cells)
    return table


def picture(sequence: MeshSequence, path: Path) -> None:
    """Draw the natural coordinates of a sequence."""
    from modalmotion.pictures.template import template_figure

    template_figure(make_template(sequence)).savefig(path)


def left_by(
    sequence: MeshSequence,
    n_modes: int,
    *,
    closed_form: bool = True,
    components: Components = Components.CARTESIAN,
) -> float:
    template = make_template(sequence, closed_form=closed_form)
    basis = make_basis(template, choose_modes(template, n_modes).modes)
    fit = Fitter.of(sequence, template, SignatureParameters(components=components)).fit(basis)
    return float(np.sqrt((fit.errors.weighted_rms**2).mean()))


def left_by_beltrami(sequence: MeshSequence, n_modes: int) -> float:
    template = make_template(sequence, closed_form=False)
    u = displaced(sequence, template.weights)
    shapes = beltrami_modes(sequence, n_modes) * np.sqrt(_areas(sequence))[:, None]
    weighted = u * np.sqrt(template.weights)[:, None]
    residual = weighted - np.einsum(
        "nm,fmd->fnd", shapes, np.einsum("nm,fnd->fmd", shapes, weighted)
    )
    return float(np.sqrt((residual**2).sum(axis=(1, 2)).mean()))


def _areas(sequence: MeshSequence) -> Floats:
    return vertex_areas(sequence.vertices[0].astype(np.float64), sequence.faces)


def beltrami_modes(sequence: MeshSequence, n_modes: int) -> Floats:
    """Eigenvectors of the surface itself, orthonormal under its vertex areas."""
    stiffness = cotangent_laplacian(sequence.vertices[0].astype(np.float64), sequence.faces)
    areas = _areas(sequence)
    shift = -1e-4 / areas.sum()
    _, shapes = eigsh(stiffness, n_modes, diags_array(areas, format="csc"), sigma=shift)
    found: Floats = shapes
    return found


def _described(sequence: MeshSequence, n_modes: int) -> Floats:
    template: Template = make_template(sequence)
    basis = make_basis(template, choose_modes(template, n_modes).modes)
    amplitudes = Fitter.of(sequence, template).fit(basis).amplitudes
    assert template.landmarks is not None
    return in_body_frame(amplitudes, template.landmarks)
