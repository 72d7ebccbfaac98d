"""What each basis leaves of a motion: closed form, springs, Laplace-Beltrami, PCA."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from noisy_surfaces import individual
from numpy.typing import NDArray
from real_data import is_there, recording
from scipy.sparse import diags_array
from scipy.sparse.linalg import eigsh
from template_surfaces import MAKERS

from modalmotion.mesh import cotangent_laplacian, vertex_areas
from modalmotion.mesh.alignment import displacements_from
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.mesh.spring_modes import spring_modes
from modalmotion.modes import lowest_modes, whole_count
from modalmotion.template import make_template

Floats = NDArray[np.float64]

CLOSED, SPRINGS, BELTRAMI, PCA = "closed form", "spring modes", "Laplace-Beltrami", "PCA"
MOST_MODES = 61  # up to which fronts are measured; whole for cup and cylinder


@dataclass(frozen=True)
class Front:
    """RMS error of one basis against the numbers it takes."""

    amplitudes: NDArray[np.int64]  # (n,), a frame
    rms: Floats  # (n,), over the surface and all frames, mm
    # (n,), to keep for the whole sequence beyond its reference mesh: amplitudes, and the basis
    # where it cannot be made again.
    numbers: NDArray[np.int64]
    motion: float  # the RMS displacement, mm

    def at(self, amplitudes: int) -> float:
        """Error with the largest whole set of at most so many amplitudes, mm."""
        return float(self.rms[np.flatnonzero(self.amplitudes <= amplitudes)[-1]])


def fronts(sequence: MeshSequence, most: int = MOST_MODES) -> dict[str, Front]:
    """Measure every basis that a sequence has, against the same displacements and weights."""
    template = make_template(sequence)
    u = displaced(sequence, template.weights)
    most = min(most, sequence.n_vertices // 4)
    whole = whole_count(template.topology, most, sequence.grid)
    modes = lowest_modes(template.topology, whole, sequence.grid)
    counts = sorted({whole_count(template.topology, k, sequence.grid) for k in range(1, most + 1)})
    ranks, weights = np.arange(1, most + 1), template.weights
    motion = float(np.sqrt(np.einsum("n,fnd->f", weights, u * u).mean()))
    springs = spring_modes(template.faces, sequence.n_vertices, most).shapes
    own = beltrami_modes(mesh_sequence(sequence.vertices[:1], template.faces), most)
    found = {PCA: _principal(u, weights, motion)}
    for name, shapes, of_name in (
        (CLOSED, modes.shapes_on(template), np.array(counts)),
        (SPRINGS, springs, ranks),
        (BELTRAMI, own, ranks),
    ):
        left = left_by(shapes, u, weights)[of_name - 1]
        found[name] = Front(3 * of_name, left, 3 * of_name * len(u), motion)
    return found


def displaced(sequence: MeshSequence, weights: Floats) -> Floats:
    """Displacements from frame 0, rotation removed, (frames, vertices, 3), length unit."""
    blocks = displacements_from(0, sequence, weights).blocks()
    u = np.concatenate([block.u * block.shape.scale for block in blocks])
    return u.transpose(0, 2, 1)


def beltrami_modes(sequence: MeshSequence, n_modes: int) -> Floats:
    """Eigenvectors of the surface of frame 0, orthonormal under its vertex areas."""
    x = sequence.vertices[0].astype(np.float64)
    areas = vertex_areas(x, sequence.faces)
    mass, shift = diags_array(areas, format="csc"), -1e-4 / areas.sum()
    found: Floats = eigsh(cotangent_laplacian(x, sequence.faces), n_modes, mass, sigma=shift)[1]
    return found


def left_by(shapes: Floats, u: Floats, weights: Floats) -> Floats:
    """RMS that the first 1, 2, ... columns leave, one factorisation for all, (columns,)."""
    root = np.sqrt(weights)[:, None]
    Q, _ = np.linalg.qr(root * shapes)
    weighted = root * u
    kept = np.einsum("nm,fnd->fmd", Q, weighted, optimize=True)
    # Taken from the residual of all columns upwards, so nothing is lost to cancellation.
    last = weighted - np.einsum("nm,fmd->fnd", Q, kept, optimize=True)
    beyond = np.cumsum((kept**2).sum(axis=(0, 2))[::-1])[::-1]
    left: Floats = np.sqrt(((last**2).sum() + np.append(beyond[1:], 0.0)) / len(u))
    return left


def surfaces() -> dict[str, MeshSequence]:
    """One moving surface of each topology, and the real ventricle where it is at hand."""
    rng = np.random.default_rng(1994)
    found = {"ventricle (cup)": individual(np.random.default_rng(1994))}
    kinds = {"tube": "cylinder", "ring": "torus", "pear": "sphere", "sheet": "plane"}
    for name, kind in kinds.items():
        moving = MAKERS[kind](1500, rng)
        found[f"{name} ({kind})"] = mesh_sequence(*moving, topology=kind, unit="mm")
    for name in ("lv_endocardium", "lv_grid_32x64"):
        if is_there(f"tradeoff: real {name}", f"heart/{name}"):
            one = recording(f"heart/{name}")
            known = {"grid": one.grid} if one.grid else {"faces": one.faces}
            found[f"real: {name}"] = mesh_sequence(one.vertices, topology="cup", unit="mm", **known)
    return found


def _principal(u: Floats, weights: Floats, motion: float) -> Front:
    """Components of the sequence itself: the best of all bases, which must be kept too."""
    f, n, _ = u.shape
    weighted = (np.sqrt(weights)[:, None] * u).reshape(f, 3 * n)
    squares = np.linalg.svd(weighted, compute_uv=False) ** 2
    rms = np.sqrt(np.append(np.cumsum(squares[::-1])[::-1][1:], 0.0) / f)
    ranks = np.arange(1, f + 1)
    return Front(ranks, rms, ranks * (f + 3 * n), motion)
