"""Pieces of known motions, and how near, how often and where a motion comes to each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.frozen_arrays import FrozenArrays
from modalmotion.representation import shown

N_PATTERNS: Final = 300
"""Pieces that a model looks for; 1,000 are no better (decision 28)."""

MEASURES: Final = ("nearest", "how often", "where")
"""What is said of each piece."""

# Times at which a motion is looked at, and those that a piece has.
_N_TIMES: Final = 32
LENGTH: Final = 11

# Steps between the times of a piece: the longest takes all but two times.
_SPACINGS: Final = (1, 2, 3)

# Share of the pieces that are compared in shape alone, each mode in deviations from its mean.
_SHARE_OF_SHAPES: Final = 0.8

# Percentiles of the distances to another motion of the class, below which a piece occurs there.
_LEAST_LIMIT: Final = 5.0
_MOST_LIMIT: Final = 10.0

# A signal that moves less than this share of the motion has no shape over time, and no limit is
# less.
_REST: Final = 1e-8

# Motions looked at together: some 10 MB.
_TOGETHER: Final = 256

Array = NDArray[np.float64]


@shown()
@dataclass(frozen=True, eq=False)
class Patterns(FrozenArrays):
    """Pieces of known motions.

    Parameters
    ----------
    pieces : (patterns, signals, times) float64
        Shares of the motion's total; signals are modes times directions.
    spacings : (patterns,) int64
        Steps from one time of a piece to the next.
    is_shape : (patterns,) bool
        Whether the shape alone counts, each signal in deviations from its mean.
    limits : (patterns,) float64
        Distance that tells how near a place must be to count.

    Notes
    -----
    After Guillaume, Vrain and Elloumi, Random dilated shapelet transform: a new approach for time
    series shapelets, ICPRAI, 2022. There a piece occurs or does not, and where it is nearest is
    one place; here places count by their nearness, so that rounding moves no feature by more.
    """

    pieces: Array
    spacings: NDArray[np.int64]
    is_shape: NDArray[np.bool_]
    limits: Array

    def __post_init__(self) -> None:
        for array in (self.pieces, self.spacings, self.is_shape, self.limits):
            array.setflags(write=False)

    def __len__(self) -> int:
        return len(self.pieces)

    @property
    def arrays(self) -> tuple[Array, ...]:
        """All of them as numbers, as `of_arrays` takes them."""
        return (
            self.pieces,
            self.spacings.astype(np.float64),
            self.is_shape.astype(np.float64),
            self.limits,
        )

    @classmethod
    def of_arrays(cls, arrays: Sequence[Array]) -> Patterns:
        """Patterns of their numbers.

        Raises
        ------
        ValueError
            If they are no patterns.
        """
        pieces, spacings, is_shape, limits = arrays
        if not (np.isin(spacings, _SPACINGS).all() and np.isfinite(pieces).all()):
            raise ValueError("a pattern of the model cannot be looked for")
        return cls(pieces, spacings.astype(np.int64), is_shape > 0.0, limits)

    def features(self, terms: Array) -> Array:
        """How near, how often and where motions come to each piece.

        Parameters
        ----------
        terms : (motions, terms, modes, directions) float64
            Cosine terms of courses, as shares of the motion's total.

        Returns
        -------
        (motions, measures * patterns) float64
            The distance at the nearest place; the log of how many places count; their mean place,
            in steps.
        """
        found = np.empty((len(terms), len(MEASURES), len(self)))
        for start in range(0, len(terms), _TOGETHER):
            some = slice(start, start + _TOGETHER)
            path = _path(terms[some])
            for group in _groups(self.spacings, self.is_shape):
                distances = _distances(path, self.pieces[group.members], group)
                found[some][:, :, group.members] = _measures(distances, self.limits[group.members])
        return found.reshape(len(terms), -1)


class _Group(NamedTuple):
    """Pieces that are compared alike."""

    members: NDArray[np.int64]
    spacing: int
    is_shape: bool


def no_patterns() -> Patterns:
    """Patterns before any motion is known."""
    nothing = np.zeros(0)
    return Patterns(
        np.zeros((0, 0, LENGTH)), nothing.astype(np.int64), nothing.astype(np.bool_), nothing
    )


def learn_patterns(terms: Array, y: NDArray[np.int64], seed: int) -> Patterns:
    """Draw pieces of motions, and from another motion of its class the limit of each.

    Parameters
    ----------
    terms : (motions, terms, modes, directions) float64
        Of at least one motion; see `Patterns.features`.
    y : (motions,) int64
        Their classes.
    seed : int
    """
    rng = np.random.default_rng(seed)
    n = N_PATTERNS
    spacings = rng.choice(_SPACINGS, n).astype(np.int64)
    is_shape = rng.uniform(size=n) < _SHARE_OF_SHAPES
    sources = rng.integers(len(y), size=n)
    others = np.array([_other(y, source, rng) for source in sources.tolist()])
    starts = rng.uniform(size=n)
    percents = rng.uniform(_LEAST_LIMIT, _MOST_LIMIT, n)
    n_signals = terms.shape[2] * terms.shape[3]
    pieces, limits = np.empty((n, n_signals, LENGTH)), np.empty(n)
    for group in _groups(spacings, is_shape):
        mine = group.members
        windows = _windows(_path(terms[sources[mine]]), group)
        at = (starts[mine] * windows.shape[1]).astype(np.int64)
        pieces[mine] = windows[np.arange(len(mine)), at]
        beside = _windows(_path(terms[others[mine]]), group)
        apart = np.sqrt(((beside - pieces[mine][:, None]) ** 2).sum(axis=(2, 3)))
        limits[mine] = [
            np.percentile(own, share) for own, share in zip(apart, percents[mine], strict=True)
        ]
    return Patterns(pieces, spacings, is_shape, limits)


def pattern_names(n: int) -> list[str]:
    """Names of the features of so many patterns, in their order."""
    return [f"pattern {k + 1} {measure}" for measure in MEASURES for k in range(n)]


def _other(y: NDArray[np.int64], source: int, rng: np.random.Generator) -> int:
    """Draw another motion of the same class; of any where there is none, or itself if alone."""
    every = np.arange(len(y)) != source
    same = np.flatnonzero(every & (y == y[source]))
    rest = same if len(same) else np.flatnonzero(every)
    return int(rng.choice(rest)) if len(rest) else source


def _path(terms: Array) -> Array:
    """Motions at evenly spaced times, (motions, signals, times), of their cosine terms."""
    n, n_terms = terms.shape[:2]
    share = np.linspace(0.0, 1.0, _N_TIMES)
    cosines = np.cos(np.pi * np.arange(1, n_terms + 1)[:, None] * share)
    flat = terms.reshape(n, n_terms, -1)
    path: Array = np.swapaxes(flat, 1, 2) @ cosines
    return path


def _windows(path: Array, group: _Group) -> Array:
    """All pieces of motions, (motions, places, signals, times)."""
    n_places = _N_TIMES - (LENGTH - 1) * group.spacing
    times = np.arange(n_places)[:, None] + group.spacing * np.arange(LENGTH)
    windows: Array = path[:, :, times].transpose(0, 2, 1, 3)
    if group.is_shape:
        windows = windows - windows.mean(axis=3, keepdims=True)
        spread = np.sqrt((windows**2).mean(axis=3, keepdims=True))
        windows /= np.where(spread > _REST, spread, 1.0)
    return windows


def _distances(path: Array, pieces: Array, group: _Group) -> Array:
    """Distances of pieces from motions at each place, (motions, places, pieces)."""
    windows = _windows(path, group)
    n, n_places = windows.shape[:2]
    flat, wanted = windows.reshape(n * n_places, -1), pieces.reshape(len(pieces), -1)
    squares = -2.0 * (flat @ wanted.T)
    squares += np.einsum("ij,ij->i", flat, flat)[:, None]
    squares += np.einsum("ij,ij->i", wanted, wanted)
    distances: Array = np.sqrt(np.maximum(squares, 0.0)).reshape(n, n_places, -1)
    return distances


def _measures(distances: Array, limits: Array) -> Array:
    """Say `MEASURES` of distances (motions, places, pieces): (motions, measures, pieces)."""
    nearest = distances.min(axis=1)
    width = np.maximum(limits, _REST)
    excess = 0.5 * (distances - nearest[:, None]) * (distances + nearest[:, None])
    weights = np.exp(-excess / width**2)
    total = weights.sum(axis=1)
    places = np.arange(distances.shape[1], dtype=np.float64)
    where = np.einsum("ijk,j->ik", weights, places) / total
    return np.stack([nearest, np.log(total), where], axis=1)


def _groups(spacings: NDArray[np.int64], is_shape: NDArray[np.bool_]) -> Iterator[_Group]:
    for spacing in _SPACINGS:
        for shape in (False, True):
            members = np.flatnonzero((spacings == spacing) & (is_shape == shape))
            if len(members):
                yield _Group(members, spacing, shape)
