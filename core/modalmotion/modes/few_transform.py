"""Displacements of a lattice as amplitudes of a few modes, and back.

One product for each axis with the few functions that occur along it: N N' P + N' P P'
multiplications instead of N N' for each mode.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.modes.factors import Factors
from modalmotion.modes.frames import blocks, require_finite, require_frames, require_output
from modalmotion.modes.lattice import Lattice
from modalmotion.modes.mode_set import ModeSet
from modalmotion.modes.topology import Topology
from modalmotion.numeric.stacked_products import multiply

# Numbers in factors cached from call to call, at most 512 KB: frame after frame their
# evaluation would take as long as the products. Larger ones take little beside theirs.
_KEPT: Final = 1 << 16


def project(lattice: Lattice, modes: ModeSet, displacements: NDArray[Any]) -> NDArray[np.float64]:
    """Amplitudes of modes in displacements, (2) inverted: a = Phi'u / nodes.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    displacements : (frames, nodes, directions) float32 or float64, any length unit
        Read in blocks of frames, so that it may be mapped from a file.

    Returns
    -------
    (frames, modes, directions) float64, the same unit
        The same bits on any number of threads, and for a frame in any company.

    Raises
    ------
    ShapeError
        If the displacements are not a real array of that shape.
    NonFiniteError
        Naming the first frame and node that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    return project_with(_factors(lattice, modes), displacements)


def superpose(
    lattice: Lattice,
    modes: ModeSet,
    amplitudes: NDArray[Any],
    *,
    out: NDArray[Any] | None = None,
) -> NDArray[np.float64]:
    """Displacements of modes with these amplitudes, modal superposition (2) u = Phi a.

    Parameters
    ----------
    lattice : Lattice
    modes : ModeSet
    amplitudes : (frames, modes, directions) float32 or float64, any length unit
    out : (frames, nodes, directions) float64, optional
        Receives the displacements. Mapped to a file, it bounds the memory.

    Returns
    -------
    (frames, nodes, directions) float64, the same unit
        The same bits on any number of threads, and for a frame in any company.

    Raises
    ------
    ShapeError
        If the amplitudes or `out` are not a real array of that shape.
    NonFiniteError
        Naming the first frame and mode that are not finite.
    TopologyError, ParameterError
        If the lattice has no such modes.
    """
    return superpose_with(_factors(lattice, modes), amplitudes, out=out)


def project_with(factors: Factors, displacements: NDArray[Any]) -> NDArray[np.float64]:
    """Project with factors at hand; see `project`."""
    source = require_frames(displacements, "displacements", factors.n_nodes, "nodes")
    n_directions = source.shape[2]
    n_products = factors.separable.n_products
    first, *others = factors.separable.sums
    weights = factors.coefficients[:, None]
    amplitudes = np.empty((len(source), factors.n_modes, n_directions))
    # Overflow shows in the amplitudes.
    with np.errstate(over="ignore", invalid="ignore"):
        for frames in blocks(len(source), factors.n_nodes * n_directions):
            block = np.ascontiguousarray(source[frames], dtype=np.float64)
            values, n_done = block, len(block)
            for f in factors.functions:
                values = multiply(f, values.reshape(n_done, f.shape[1], -1))
                n_done *= len(f)
            values = values.reshape(len(block), n_products, n_directions)
            result = amplitudes[frames]
            np.multiply(values.take(first.product, axis=1), weights[first.term], out=result)
            for terms in others:
                result[:, terms.mode] += values[:, terms.product] * weights[terms.term]
            result /= factors.n_nodes
            require_finite(result, block, frames.start, "node")
    return amplitudes


def superpose_with(
    factors: Factors, amplitudes: NDArray[Any], *, out: NDArray[Any] | None = None
) -> NDArray[np.float64]:
    """Superpose with factors at hand; see `superpose`."""
    source = require_frames(amplitudes, "amplitudes", factors.n_modes, "modes")
    n_directions = source.shape[2]
    n_products = factors.separable.n_products
    first, *others = factors.separable.spreads
    weights = factors.coefficients[:, None]
    displacements = require_output(out, (len(source), factors.n_nodes, n_directions))
    for frames in blocks(len(source), factors.n_nodes * n_directions):
        block = np.ascontiguousarray(source[frames], dtype=np.float64)
        require_finite(block, block, frames.start, "mode")
        values = np.zeros((len(block), n_products, n_directions))
        values[:, first.product] = block.take(first.mode, axis=1) * weights[first.term]
        for terms in others:
            values[:, terms.product] += block[:, terms.mode] * weights[terms.term]
        n_left = len(block) * n_products
        for axis in reversed(range(len(factors.functions))):
            f = factors.functions[axis]
            n_left //= len(f)
            into = None if axis else displacements[frames].reshape(n_left, f.shape[1], -1)
            values = multiply(f.T, values.reshape(n_left, len(f), -1), into)
    return displacements


def _factors(lattice: Lattice, modes: ModeSet) -> Factors:
    """Evaluate factors, or return those of an earlier call."""
    if len(modes) * sum(lattice.shape) <= _KEPT:
        return _factors_kept(lattice.topology, lattice.shape, modes)
    return lattice.factors(modes)


@lru_cache(maxsize=16)
def _factors_kept(topology: Topology, shape: tuple[int, ...], modes: ModeSet) -> Factors:
    # Shapes do not depend on the springs. The lattice itself is not cached.
    return Lattice(topology, shape).factors(modes)
