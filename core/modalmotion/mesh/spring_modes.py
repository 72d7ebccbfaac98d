"""Modes of the springs along the edges of a mesh: for surfaces without natural coordinates.

They depend on the connectivity alone, so amplitudes compare within one connectivity only. This
is also the slow twin that the closed forms are measured against.

Where eigenvalues coincide a solver returns any basis of their space. Here each such space gets
the basis that fixed probe vectors, projected into it one after the other, span: it depends on
the space alone. That also fixes the sign of every vector.
"""

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from typing import Final, TypeAlias

import numpy as np
import scipy

from modalmotion.arguments.checking import FrozenArrays
from modalmotion.errors import LimitError, ModeCountError, ParameterError
from modalmotion.mesh.laplacian import graph_laplacian
from modalmotion.mesh.triangles import connectivity_of, pieces_of
from modalmotion.modes.mode_set import ModeSet, lowest_modes
from modalmotion.modes.topologies import ModeLabel, Surface
from modalmotion.representation import Array, Bools, Floats, Ints, shown


@shown()
@dataclass(frozen=True, eq=False)
class SpringModes(FrozenArrays):
    """Lowest modes of equal masses at the vertices and equal springs along the edges, by name.

    Parameters
    ----------
    eigenvalues : (modes,) float64
        Squared angular frequencies for K = M = 1, in increasing order.
    connectivity_id : str
        sha256 of the edges in hex: amplitudes compare where it is the same.
    shapes : (vertices, modes) float64, optional
        Mean square 1 over the vertices in use, zero at those in no triangle; no rows if they are
        not solved for. Not part of equality.
    """

    eigenvalues: Floats
    connectivity_id: str
    shapes: Floats = field(default_factory=lambda: np.zeros((0, 0)))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, SpringModes):
            return NotImplemented
        return self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    @cached_property
    def _key(self) -> tuple[str, bytes]:
        return self.connectivity_id, self.eigenvalues.tobytes()

    def __len__(self) -> int:
        return len(self.eigenvalues)

    @property
    def topology(self) -> None:
        """None: spring modes belong to one mesh and to no topology."""
        return

    @cached_property
    def wavenumbers(self) -> Ints:
        """Place of each mode in the order, (modes, 1) int64."""
        return np.arange(len(self))[:, None]

    @cached_property
    def is_sine(self) -> Bools:
        """False for every mode: spring modes have no pairs."""
        return np.zeros(len(self), dtype=np.bool_)

    @cached_property
    def labels(self) -> tuple[ModeLabel, ...]:
        """The modes' labels, in order."""
        return tuple(ModeLabel((rank,), "spring") for rank in range(len(self)))

    @property
    def arrays(self) -> dict[str, Array]:
        """Datasets of the modes in files."""
        identity = np.array(self.connectivity_id.encode(), dtype="S64")
        return {"spring_eigenvalues": self.eigenvalues, "connectivity_id": identity}

    @property
    def names(self) -> "SpringModes":
        """These modes without their shapes."""
        return SpringModes(self.eigenvalues, self.connectivity_id)

    def take(self, indices: Ints) -> "SpringModes":
        """First modes.

        Raises
        ------
        ParameterError
            For any other modes: their names are their ranks.
        """
        if not np.array_equal(indices, np.arange(len(indices))):
            raise ParameterError(
                "Spring modes of one mesh are named by their rank and come in its order only.",
                remedy="Take the first of them, or set a topology that fits the surface.",
            )
        n = len(indices)
        shapes = np.ascontiguousarray(self.shapes[:, :n])
        return SpringModes(self.eigenvalues[:n], self.connectivity_id, shapes)

    def shapes_on(self, surface: Surface) -> Floats:
        """Shapes on their mesh, (vertices, modes) float64: their own, or solved for."""
        if len(self.shapes):
            return self.shapes
        springs = spring_modes(surface.faces, len(surface.vertices), len(self))
        return springs.shapes[surface.representatives]

    def frequencies_on(self, surface: Surface, wave_speed: float) -> Floats:
        """Frequencies of springs that carry long waves at `wave_speed`, (modes,) rad per s."""
        mesh = connectivity_of(surface.faces, len(surface.vertices))
        steps = surface.vertices[mesh.edges[:, 0]] - surface.vertices[mesh.edges[:, 1]]
        largest = float(np.abs(steps).max(initial=0.0)) or 1.0
        edge_length = largest * float(np.sqrt(((steps / largest) ** 2).sum(axis=1).mean()))
        if not edge_length > 0:
            return np.zeros(len(self))
        valence = 2 * len(mesh.edges) / (len(surface.vertices) - len(mesh.isolated))
        # Springs of length a, z to a vertex, carry long waves at c^2 = (K/M) z a^2 / 4.
        # Neither length is squared: their ratio is usual in every unit.
        factor = 2 * (wave_speed / edge_length) / float(np.sqrt(valence))
        return np.asarray(factor * np.sqrt(np.maximum(self.eigenvalues, 0.0)))

    def length_of(
        self,
        lengths: tuple[float, ...],  # noqa: ARG002 (a mesh without coordinates has none)
        angular_frequencies: Floats,
        wave_speed: float,
    ) -> float:
        """RMS edge times a constant of the mesh; 1 if the highest frequency is zero."""
        # w^2 = 4 c^2 lambda / (z a^2), so c sqrt(lambda) / w is a sqrt(z) / 2.
        w, root = angular_frequencies, np.sqrt(self.eigenvalues)
        if not len(w) or not w[-1] > 0:
            return 1.0
        return float(wave_speed * root[-1] / w[-1])


Modes: TypeAlias = ModeSet | SpringModes
"""Modes in an order, by name: equal, with equal hashes, where their names are."""


def wave_pairs(modes: Modes) -> tuple[Ints, Ints]:
    """Find the cosine and the sine of each wave vector.

    Returns
    -------
    cosines, sines : (waves,) int64
        In the order of the cosines; the sine is -1 where there is none.
    """
    wavenumbers = list(map(tuple, modes.wavenumbers.tolist()))
    cosines = np.flatnonzero(~modes.is_sine)
    sine_of = {wavenumbers[k]: k for k in np.flatnonzero(modes.is_sine).tolist()}
    sines = [sine_of.get(wavenumbers[k], -1) for k in cosines.tolist()]
    return cosines, np.array(sines, dtype=np.int64)


def whole_counts(modes: Modes) -> Ints:
    """Numbers of first modes that split no cosine-sine pair, increasing, the last one included."""
    return np.append(np.flatnonzero(~modes.is_sine[1:]) + 1, len(modes))


def common_count(modes: Modes) -> int:
    """Count the first modes that every surface of the topology has, whatever its nodes.

    A lattice of few nodes has no modes beyond its Nyquist wavenumbers: from there on its order
    names others. Of one mesh, whose modes belong to no other, it is all.
    """
    if modes.topology is None:
        return len(modes)
    usual = lowest_modes(modes.topology, len(modes))
    is_same = (usual.wavenumbers == modes.wavenumbers).all(axis=1) & (
        usual.is_sine == modes.is_sine
    )
    if is_same.all():
        return len(modes)
    n = int(is_same.argmin())
    # No cosine without its sine.
    return n - int(usual.is_sine[n])


def spring_modes(faces: Ints, n_vertices: int, n_modes: int) -> SpringModes:
    """Lowest spring modes of a mesh.

    Parameters
    ----------
    faces : (faces, 3) int64
        At least one. Pieces that are not joined are allowed.
    n_vertices : int
    n_modes : int

    Returns
    -------
    SpringModes
        Mode 0 is constant over the whole mesh; if there are several pieces, the next ones are
        constant on each, the largest piece first, equal ones in the order of first vertices.

    Raises
    ------
    ModeCountError
        If fewer vertices are in use.
    LimitError
        If there are more than `MOST_EQUAL` pieces, or as many modes of one frequency.
    """
    connectivity = connectivity_of(faces, n_vertices)
    if connectivity.n_components > MOST_EQUAL:
        raise LimitError(
            f"The triangles are {connectivity.n_components} separate pieces; at most {MOST_EQUAL} "
            "have spring modes.",
            remedy="Send one surface: leave the small pieces out, or merge vertices that coincide.",
            limit="pieces",
            details={"value": connectivity.n_components, "most": MOST_EQUAL},
        )
    used = np.ones(n_vertices, dtype=np.bool_)
    used[connectivity.isolated] = False
    place = np.cumsum(used) - 1
    edges = place[connectivity.edges]
    n = int(used.sum())
    values, vectors = lowest_eigenpairs(graph_laplacian(edges, n), n_modes, _indicators(edges, n))
    shapes = np.zeros((n_vertices, n_modes))
    shapes[used] = vectors * np.sqrt(n)
    digest = hashlib.sha256(str(n_vertices).encode())
    digest.update(np.ascontiguousarray(connectivity.edges.astype("<i8")).data)
    return SpringModes(np.maximum(values, 0.0), digest.hexdigest(), shapes)


def _indicators(edges: Ints, n: int) -> Floats:
    """One on everything, then one on each piece, the largest first."""
    labels = pieces_of(edges, n)
    _, first, size = np.unique(labels, return_index=True, return_counts=True)
    order = np.lexsort((first, -size))
    columns = [np.ones(n), *(labels == labels[i] for i in first[order])]
    return np.stack(columns, axis=1).astype(np.float64)


MOST_EQUAL: Final = 100
"""Eigenvalues that may coincide: a surface has a handful, a heap of equal pieces as many as it has
pieces, and the space of each is found whole."""


# Below this size the dense solver is faster and finds every multiple eigenvalue.
_DENSE: Final = 600


# Above this one it takes minutes and gigabytes.
_LARGEST_DENSE: Final = 5000


# Eigenvalues closer than this, relative to them and to the largest possible, are one.
_SAME: Final = 1e-8


_ZERO: Final = 1e-11


# Extra pairs, so that a space that ends beyond the requested ones is seen whole.
_GUARD: Final = 8


# A probe whose projection is this much shorter than expected tells nothing.
_FAINT: Final = 1e-3


def lowest_eigenpairs(
    matrix: "scipy.sparse.csc_array", n_pairs: int, first_probes: Floats
) -> tuple[Floats, Floats]:
    """Lowest eigenvalues and eigenvectors of a positive semidefinite matrix.

    Parameters
    ----------
    matrix : (n, n) scipy.sparse.csc_array of float64
    n_pairs : int
    first_probes : (n, k) float64
        Probe vectors tried before the fixed irregular ones.

    Returns
    -------
    eigenvalues : (n_pairs,) float64
        In increasing order.
    vectors : (n, n_pairs) float64
        Orthonormal.

    Raises
    ------
    ModeCountError
        If `n_pairs` exceeds n, or the solver loses some.
    LimitError
        If more than `MOST_EQUAL` eigenvalues coincide.
    """
    n = matrix.shape[0]
    if not 1 <= n_pairs <= n:
        raise ModeCountError(
            f"{n_pairs} modes were requested; there are {n}.",
            remedy=f"Ask for 1 to {n} modes.",
        )
    scale = float(np.abs(matrix).sum(axis=0).max())
    count = n_pairs
    while True:
        values, vectors = _solve(matrix, min(n, count + _GUARD), scale)
        groups = _groups(values, scale)
        if any(g.stop - g.start > MOST_EQUAL for g in groups if g.start < n_pairs):
            raise _too_many_equal()
        # The last group may go on beyond these pairs, unless they are all.
        complete = groups if len(values) == n else groups[:-1]
        if complete and complete[-1].stop >= n_pairs:
            break
        count *= 2
    spaces = [group for group in complete if group.start < n_pairs]
    basis = [_canonical(vectors[:, group], first_probes) for group in spaces]
    return values[:n_pairs], np.concatenate(basis, axis=1)[:, :n_pairs]


def _solve(matrix: "scipy.sparse.csc_array", count: int, scale: float) -> tuple[Floats, Floats]:
    n = matrix.shape[0]
    is_dense = n <= _DENSE or count > n // 3
    shift = -1e-4 * scale * 600 / n
    for attempt in range(0 if is_dense else 3):
        # More room on each attempt: a larger subspace meets more copies.
        room = min(n, (attempt + 2) * count + 20)
        try:
            values, vectors = scipy.sparse.linalg.eigsh(
                matrix, k=count, sigma=shift, ncv=room, v0=_irregular(n, attempt), tol=0
            )
        except scipy.sparse.linalg.ArpackError as error:
            raise _too_many_equal() from error
        order = np.argsort(values, kind="stable")
        values, vectors = values[order], vectors[:, order]
        groups = _groups(values, scale)
        if len(groups) < 2:
            return values, vectors
        # Krylov methods may miss copies of a multiple eigenvalue; the signs of the pivots
        # tell how many there are below a gap (Sylvester's law of inertia).
        last = groups[-1].start
        between = (values[last - 1] + values[last]) / 2
        if _n_below(matrix, between) == last:
            return values, vectors
        count = min(n - 1, count + _GUARD)
    if n > _LARGEST_DENSE and not is_dense:
        raise ModeCountError(
            f"The lowest {count} spring modes of {n} vertices could not all be solved for: too "
            "many frequencies coincide.",
            remedy="Ask for fewer modes, or state a topology.",
        )
    values, vectors = scipy.linalg.eigh(matrix.toarray())
    return values[:count], vectors[:, :count]


def _too_many_equal() -> LimitError:
    return LimitError(
        f"More than {MOST_EQUAL} modes of the mesh have the same frequency: it is made of many "
        "equal parts.",
        remedy="Send one surface, without the parts that repeat.",
        limit="equal_frequencies",
        details={"most": MOST_EQUAL},
    )


def _n_below(matrix: "scipy.sparse.csc_array", value: float) -> int:
    shifted = scipy.sparse.csc_array(matrix - value * scipy.sparse.eye_array(matrix.shape[0]))
    factors = scipy.sparse.linalg.splu(
        shifted, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )
    return int((factors.U.diagonal() < 0).sum())


def _groups(values: Floats, scale: float) -> list[slice]:
    """Find runs of eigenvalues that coincide."""
    gaps = np.diff(values) > _SAME * np.abs(values[1:]) + _ZERO * scale
    starts = [0, *(np.flatnonzero(gaps) + 1).tolist()]
    return [slice(a, b) for a, b in zip(starts, [*starts[1:], len(values)], strict=True)]


def _canonical(space: Floats, first_probes: Floats) -> Floats:
    """Give a space the basis that the probes span in it, one after the other."""
    n, k = space.shape
    vectors: list[Floats] = []
    expected = np.sqrt(k / n)
    for index in range(first_probes.shape[1] + 50 * k):
        if index < first_probes.shape[1]:
            probe = first_probes[:, index]
        else:
            probe = _irregular(n, index - first_probes.shape[1])
        # Coordinates within the space: the projection is space @ inside.
        inside = space.T @ (probe / np.linalg.norm(probe))
        for _ in range(2):
            for before in vectors:
                inside = inside - (before @ inside) * before
        length = float(np.linalg.norm(inside))
        if length > _FAINT * expected:
            vectors.append(inside / length)
            if len(vectors) == k:
                break
    return np.asarray(space @ np.stack(vectors, axis=1))


def _irregular(n: int, index: int) -> Floats:
    """Return a fixed vector without pattern: fractional parts of multiples of a square root."""
    # k^2 + 1 is no square.
    step = np.sqrt((index + 1) ** 2 + 1)
    return np.asarray(np.modf(np.arange(1, n + 1) ** 2 * (step % 1.0))[0] - 0.5)
