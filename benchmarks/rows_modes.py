"""Rows of the table of truth: modes in closed form, beside eigensolvers."""

from __future__ import annotations

import numpy as np
from exact_solutions import lowest_eigenpairs, stiffness_matrix
from experiments import Row, quick, timed
from measure import beside_numpy, medians
from noisy_surfaces import individual
from template_remeshing import subdivided
from tradeoff_bases import BELTRAMI, CLOSED, beltrami_modes, fronts

import modalmotion as mm
from modalmotion.modes import dispersion, wave_vectors
from modalmotion.signature.fit import make_basis
from modalmotion.template import choose_modes

SHAPES: dict[mm.Topology, tuple[tuple[int, ...], ...]] = {
    **dict.fromkeys((mm.CYLINDER, mm.CUP), ((5, 6), (9, 14), (12, 16))),
    **dict.fromkeys((mm.SPHERE, mm.TORUS), ((6, 8), (12, 16))),
    mm.PLANE: ((7, 9),),
    mm.Topology.parse("pole-open x closed x open"): ((4, 6, 3),),
}


@quick(
    Row("modes.eigenvalues.error", "12 lattices off a dense solver", goal=2e-14, tolerance=4e-15),
    Row("modes.dispersion.error", "eq. 7 off the same, relative", goal=2e-14, tolerance=4e-15),
)
def eigenvalues(_: int) -> tuple[float, ...]:
    worst = []
    for lattice in (mm.Lattice(kind, shape) for kind, shapes in SHAPES.items() for shape in shapes):
        dense = np.linalg.eigvalsh(stiffness_matrix(lattice).toarray())
        modes = lattice.all_modes()
        waves = dispersion(lattice, wave_vectors(lattice, modes))
        both = np.sort(np.stack([lattice.angular_frequencies(modes), waves]) ** 2)
        worst.append(np.abs(both - dense).max(axis=1) / dense[-1])
    return tuple(np.max(worst, axis=0).tolist())


@quick(Row("modes.template.left", "RMS left by 7 closed-form modes of a mesh over 7 by eigsh"))
def left(seed: int) -> float:
    """Of the surface itself, weighted by area; mean of five individuals."""
    found = [fronts(individual(np.random.default_rng([seed, k])), 20) for k in range(5)]
    return float(np.mean([each[CLOSED].at(21) / each[BELTRAMI].at(21) for each in found]))


@timed(Row("modes.template.large", "template of 250,000 vertices in random order, over NumPy work"))
def large(seed: int) -> float:
    beat = mm.simulate_ventricle(n_vertices=15_650, rng=np.random.default_rng([seed, 8]))
    moving = beat.vertices[:1].astype(np.float64), beat.faces
    vertices, faces = subdivided(subdivided(moving))
    order = np.random.default_rng([seed, 7]).permutation(vertices.shape[1])
    one = mm.mesh_sequence(vertices[:, order], np.argsort(order)[faces])
    return beside_numpy({"template": lambda: mm.make_template(one)}, 1)["template"]


@timed(
    Row("modes.template.time", "template of 10,000 vertices and 7 modes over 7 by eigsh", goal=1.0),
    Row("modes.lattice.time", "eigsh of 100 x 100 nodes over shapes", "", 800, "higher"),
)
def times(seed: int) -> tuple[float, float]:
    beat = mm.simulate_ventricle(n_vertices=10_000, rng=np.random.default_rng([seed, 9]))
    one = mm.mesh_sequence(beat.vertices[:1], beat.faces)
    lattice = mm.Lattice(mm.CUP, (100, 100))
    modes, matrix = lattice.lowest_modes(7), stiffness_matrix(lattice)
    calls = {
        "ours": lambda: make_basis(t := mm.make_template(one), choose_modes(t, 7)[0]),
        "eigsh": lambda: beltrami_modes(one, 7),
        "shapes": lambda: lattice.shapes(modes),
        "eigsh of the lattice": lambda: lowest_eigenpairs(matrix, 7),
    }
    ours, eigsh, shapes, of_lattice = medians(calls, 7)
    return ours / eigsh, of_lattice / shapes
