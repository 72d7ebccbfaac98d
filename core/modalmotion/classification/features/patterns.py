"""Pieces of known motions, and how near, how often and where a motion comes to each."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
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

# Where the windows of each spacing lie among those of all.
_N_PLACES: Final = tuple(_N_TIMES - (LENGTH - 1) * spacing for spacing in _SPACINGS)
_PLACES: Final = {
    spacing: slice(stop - n, stop)
    for spacing, n, stop in zip(_SPACINGS, _N_PLACES, np.cumsum(_N_PLACES).tolist(), strict=True)
}

# Share of the pieces that are compared in shape alone, each mode in deviations from its mean.
_SHARE_OF_SHAPES: Final = 0.8

# Percentiles of the distances to another motion of the class, below which a piece occurs there.
_LEAST_LIMIT: Final = 5.0
_MOST_LIMIT: Final = 10.0

# A signal that moves less than this share of the motion has no shape over time, and no limit is
# less.
_REST: Final = 1e-8

# Motions looked at together: some 5 MB.
_TOGETHER: Final = 32

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
            windows = _windows(_path(terms[some]))
            both = _Rows.of(windows), _Rows.of(_shapes(windows))
            for sought in self._sought:
                found[some, :, sought.members] = _measures(_squares(both, sought), sought)
        return found.reshape(len(terms), -1)

    @cached_property
    def _sought(self) -> tuple[_Sought, ...]:
        """The pieces of each spacing, as they are looked for."""
        sought = []
        for spacing in _SPACINGS:
            paths, shapes = (
                np.flatnonzero((self.spacings == spacing) & (self.is_shape == is_shape))
                for is_shape in (False, True)
            )
            members = np.concatenate([paths, shapes])
            if len(members):
                width = np.maximum(self.limits[members], _REST)
                flat = self.pieces.reshape(len(self), -1)
                sought.append(
                    _Sought(
                        members=members,
                        places=_PLACES[spacing],
                        pieces=(flat[paths].T.copy(), flat[shapes].T.copy()),
                        squares=np.einsum("ij,ij->i", flat[members], flat[members]),
                        factors=-0.5 / width**2,
                    )
                )
        return tuple(sought)


class _Sought(NamedTuple):
    """Pieces of one spacing, as they are looked for.

    Parameters
    ----------
    members : (pieces,) int64
        First those that are compared as they are, then those compared in shape alone.
    places : slice
        Of windows of this spacing, among all.
    pieces : two of (values, n) float64
        Of both kinds.
    squares : (pieces,) float64
    factors : (pieces,) float64
        -1 / (2 width^2) of each.
    """

    members: NDArray[np.int64]
    places: slice
    pieces: tuple[Array, Array]
    squares: Array
    factors: Array


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
        windows = _pieces(_path(terms[sources[mine]]), group)
        at = (starts[mine] * windows.shape[1]).astype(np.int64)
        pieces[mine] = windows[np.arange(len(mine)), at]
        beside = _pieces(_path(terms[others[mine]]), group)
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
    path: Array = np.swapaxes(terms.reshape(n, n_terms, -1), 1, 2) @ _cosines(n_terms)
    return path


@lru_cache(maxsize=16)
def _cosines(n_terms: int) -> Array:
    share = np.linspace(0.0, 1.0, _N_TIMES)
    return np.cos(np.pi * np.arange(1, n_terms + 1)[:, None] * share)


def _windows(path: Array) -> Array:
    """All pieces of motions, one spacing after another, (motions, places, signals, times)."""
    n, n_signals, _ = path.shape
    windows = path.reshape(n, -1).take(_times(n_signals), axis=1)
    return windows.reshape(n, -1, n_signals, LENGTH)


@lru_cache(maxsize=16)
def _times(n_signals: int) -> NDArray[np.int64]:
    """Give the values of a path that each piece has, (places, signals * times)."""
    starts = [np.arange(places.stop - places.start) for places in _PLACES.values()]
    times = np.concatenate(
        [
            start[:, None] + spacing * np.arange(LENGTH)
            for spacing, start in zip(_PLACES, starts, strict=True)
        ]
    )
    of_signals = _N_TIMES * np.arange(n_signals)[:, None] + times[:, None]
    return np.asarray(of_signals.reshape(len(times), -1))


def _shapes(windows: Array) -> Array:
    """Each signal of each piece in deviations from its mean; 0 where it rests."""
    # A product, for sums over few neighbours cost numpy several times as much.
    shapes = windows - (windows @ np.full(LENGTH, 1.0 / LENGTH))[..., None]
    spread = np.sqrt(np.einsum("ijkl,ijkl->ijk", shapes, shapes) / LENGTH)
    shapes /= np.where(spread > _REST, spread, 1.0)[..., None]
    return np.asarray(shapes)


class _Rows(NamedTuple):
    """Windows as rows, (motions, places, values), and their squares, (motions, places, 1)."""

    values: Array
    squares: Array

    @classmethod
    def of(cls, windows: Array) -> _Rows:
        rows = windows.reshape(*windows.shape[:2], -1)
        return cls(rows, np.einsum("ijk,ijk->ij", rows, rows)[..., None])


def _squares(both: tuple[_Rows, _Rows], sought: _Sought) -> Array:
    """Squares of the distances of pieces from motions at each place, (motions, places, pieces)."""
    n_places = sought.places.stop - sought.places.start
    squares = np.empty((len(both[0].values), n_places, len(sought.members)))
    # |w - p|^2 = |w|^2 - 2 w.p + |p|^2, in place: memory that is new costs more than the sums.
    place = 0
    for rows, pieces in zip(both, sought.pieces, strict=True):
        if pieces.shape[1]:
            own = squares[:, :, place : place + pieces.shape[1]]
            np.matmul(rows.values[:, sought.places], pieces, out=own)
            own *= -2.0
            own += rows.squares[:, sought.places]
            place += pieces.shape[1]
    squares += sought.squares
    return np.maximum(squares, 0.0, out=squares)


def _measures(squares: Array, sought: _Sought) -> Array:
    """Say `MEASURES` of squares of distances: (motions, measures, pieces)."""
    nearest = np.minimum.reduce(squares, axis=1)
    squares -= nearest[:, None]
    squares *= sought.factors
    weights = np.exp(squares, out=squares)
    n_places = squares.shape[1]
    # Their sum, and that of places times weights.
    sums = np.array([np.ones(n_places), np.arange(n_places)]) @ weights
    found = np.empty((len(squares), len(MEASURES), squares.shape[2]))
    np.sqrt(nearest, out=found[:, 0])
    np.log(sums[:, 0], out=found[:, 1])
    np.divide(sums[:, 1], sums[:, 0], out=found[:, 2])
    return found


def _pieces(path: Array, group: _Group) -> Array:
    """Give the windows that pieces of a group may be, (motions, places, signals, times)."""
    windows = _windows(path)[:, _PLACES[group.spacing]]
    return _shapes(windows) if group.is_shape else windows


def _groups(spacings: NDArray[np.int64], is_shape: NDArray[np.bool_]) -> Iterator[_Group]:
    for spacing in _SPACINGS:
        for shape in (False, True):
            members = np.flatnonzero((spacings == spacing) & (is_shape == shape))
            if len(members):
                yield _Group(members, spacing, shape)
