"""A smooth wall in every frame: changes of its lines and its area, and their errors.

A figure is a mean over lines of the relative change of sums of stretch over places. Its error is to
first order: the gradient by the coefficients of the smooth surface, with the covariance of these.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

import numpy as np

from modalmotion.clinical.smooth_wall import Places, Slopes, SmoothWall
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.geometry import vertex_normals
from modalmotion.representation import Floats

LONGITUDINAL: Final = "longitudinal"
CIRCUMFERENTIAL: Final = "circumferential"
AREA: Final = "area"
DIRECTIONS: Final = (LONGITUDINAL, CIRCUMFERENTIAL, AREA)
"""What is measured."""


# How unevenly a wall shortens, of the strain of its length: 0.12 and 0.07 of ventricles of two
# simulators, 0.4 of a real one.
_UNEVEN: Final = 0.1

# Lines of the tissue wave along the wall, which a track does not see, so they are longer than its
# own: by 0.04 and 0.01 of the strain in two simulators. Expected of this, and its deviation.
_LONGER: Final = 0.02
_OMITTED: Final = 0.03


class Measure(NamedTuple):
    """Quantity of which a strain is the change.

    Parameters
    ----------
    kind : str
        One of `DIRECTIONS`.
    lines : (lines, places) float64
        Weight of each place in the length of each line.
    shares : (lines,) float64, optional
        Of each line's strain in the sum; their mean if none are given.
    """

    kind: str
    lines: Floats
    shares: Floats | None = None

    @property
    def counted(self) -> Floats:
        """Share of each line, (lines,)."""
        n = len(self.lines)
        return np.full(n, 1.0 / n) if self.shares is None else self.shares


@dataclass(frozen=True, eq=False)
class WallMotion:
    """A smooth wall in every frame, and the source of its errors.

    Parameters
    ----------
    wall : SmoothWall
    places : Places
        Placed in the frame of end diastole.
    coefficients : (functions, frames, 3) float64, length unit
        Of a track those by which rows keep their heights: what slides along the surface does not
        show in its data, and a row that slides near the apex has another length.
    noise : (frames,) float64, length unit squared
        Variance of each coordinate of a vertex; 0 if there is an `uncertainty`.
    uncertainty : Uncertainty or None
        Of the positions.
    slopes : Slopes
    """

    wall: SmoothWall
    places: Places
    coefficients: Floats
    noise: Floats
    uncertainty: Uncertainty | None
    slopes: Slopes

    @classmethod
    def of(
        cls, positions: Floats, uncertainty: Uncertainty | None, wall: SmoothWall, end_diastole: int
    ) -> "WallMotion":
        """Fit the wall to all frames.

        Parameters
        ----------
        positions : (frames, vertices, 3) float64, length unit
        uncertainty : Uncertainty or None
        wall : SmoothWall
        end_diastole : int
        """
        coefficients = wall.coefficients(positions)
        places = wall.places(coefficients[:, end_diastole])
        if uncertainty is None:
            noise = wall.noise(positions, coefficients)
        else:
            noise = np.zeros(len(positions))
            coefficients = wall.at_heights(places, coefficients, end_diastole)
        slopes = wall.slopes(places, coefficients, noise)
        return cls(wall, places, coefficients, noise, uncertainty, slopes)

    @property
    def n_frames(self) -> int:
        """Number of frames."""
        return len(self.noise)

    @property
    def weights(self) -> Floats:
        """Weight of each place in the mean over the wall, (rows, columns)."""
        columns = self.places.shape[1]
        return np.repeat(self.places.weights[:, None] / columns, columns, axis=1)

    @cached_property
    def stretches(self) -> dict[str, Floats]:
        """Lengths of the slopes and the area between them, without the mean of their noise.

        To second order |d + e| is |d| and half the variance of e across d over |d|; across are two
        components. Of an area |a x b| one component counts, along the normal: it tilts a or b.
        Each is (places, frames), length unit or its square.
        """
        along, around = self.slopes.along, self.slopes.around
        a, b = (np.linalg.norm(slope, axis=2) for slope in (along, around))
        by_a, by_b = self.slopes.noise[:, 0], self.slopes.noise[:, 1]
        area = np.linalg.norm(np.cross(along, around), axis=2)
        return {
            LONGITUDINAL: _without(a, 2.0 * by_a),
            CIRCUMFERENTIAL: _without(b, 2.0 * by_b),
            AREA: _without(area, by_a * b**2 + by_b * a**2),
        }

    def strain(self, measure: Measure, start: int) -> Floats:
        """Relative change of a measure since a frame, (frames,), percent."""
        sums = self._sums(measure)
        changes = sums / sums[:, [start]] - 1.0
        if measure.kind == CIRCUMFERENTIAL and self.uncertainty is not None:
            changes += _LONGER * np.abs(changes)
        return np.asarray(100.0 * (measure.counted @ changes), dtype=np.float64)

    def deviation(self, measure: Measure, frame: int, start: int) -> float:
        """Return the standard deviation of a strain, points; errors of frames are independent."""
        if frame == start:
            return 0.0
        pairs = list(zip(self.gradients(measure, frame, start), (frame, start), strict=True))
        is_row = measure.kind == CIRCUMFERENTIAL and self.uncertainty is not None
        variance = sum(self.variance(each, number, is_row=is_row) for each, number in pairs)
        if is_row:
            by_share = self._by_share(measure, frame, start)
            variance += self._of_bridge(by_share, frame, start)
            variance += (_OMITTED * self.strain(measure, start)[frame]) ** 2
            # The base slides along the surface, and its height counts.
            for _, number in pairs:
                variance += self.variance(self._by_heights(by_share, frame, number)[1], number)
        return float(np.sqrt(variance))

    def _by_share(self, measure: Measure, frame: int, start: int) -> Floats:
        """Change of a strain around, (rows,), points, by the shares at which its rows are."""
        rows = self.stretches[CIRCUMFERENTIAL][:, frame].reshape(self.places.shape)
        lines = measure.lines / self._sums(measure)[:, [start]]
        weights = 100.0 * (measure.counted @ lines).reshape(rows.shape)
        by_share = weights * np.gradient(rows, self.places.ways, axis=0)
        return np.asarray(by_share.sum(axis=1), dtype=np.float64)

    def _of_bridge(self, by_share: Floats, frame: int, start: int) -> float:
        """Variance of a strain around as rows of the tissue do not keep their heights.

        Pieces of a wall shorten unevenly, each by u e of its own, e the strain of the whole length:
        the tissue at the share w is then off by a bridge of the covariance
        (u e)^2 (min(w, w') - w w').
        """
        ways, length = self.places.ways, Measure(LONGITUDINAL, self.weights.reshape(1, -1))
        bridge = np.minimum.outer(ways, ways) - np.outer(ways, ways)
        uneven = _UNEVEN * self.strain(length, start)[frame] / 100.0
        return max(float(uneven**2 * (by_share @ bridge @ by_share)), 0.0)

    def _by_heights(self, by_share: Floats, frame: int, number: int) -> tuple[Floats, Floats]:
        """Gradients of a strain around by the coefficients that set heights: all, and of the base.

        Rows have shares f of the way between the middles of both ends: an end that rises by d moves
        the height that a row has to be at by (1 - f) d or f d, and a place that rises by d is off
        it by so much. So what slides along the surface changes nothing, except at the base.
        """
        rows, columns = self.places.shape
        values = self.places.values.reshape(rows, columns, -1).mean(axis=1)
        ends = self.wall.middles @ self.coefficients[:, frame]
        away = (values @ self.coefficients[:, frame] - ends[0]) @ (ends[1] - ends[0])
        shares = away / ((ends[1] - ends[0]) ** 2).sum()
        by_height = _over(by_share, np.gradient(shares, self.places.ways), 0.0)
        if number != frame:
            # The heights wanted, at end diastole, in place of those that are.
            by_height = -by_height
        first, last = self.wall.middles
        away = (last - first) @ self.coefficients[:, number]
        by_base = np.outer((by_height @ shares) * last, away / (away @ away))
        others = (by_height @ (1.0 - shares)) * first - by_height @ values
        return by_base + np.outer(others, away / (away @ away)), by_base

    def gradients(self, measure: Measure, frame: int, start: int) -> tuple[Floats, Floats]:
        """Differentiate a strain by the coefficients of its frame and of the first.

        Returns
        -------
        (functions, 3) float64 each, percent per length unit
        """
        sums, shares = self._sums(measure), 100.0 * measure.counted
        by_end = shares @ (measure.lines / sums[:, [start]])
        changed = sums[:, [frame]] / sums[:, [start]] ** 2
        by_start = -shares @ (measure.lines * changed)
        gradients = (
            self._by_coefficients(measure.kind, by_end, frame),
            self._by_coefficients(measure.kind, by_start, start),
        )
        if measure.kind == CIRCUMFERENTIAL and self.uncertainty is not None:
            by_share = self._by_share(measure, frame, start)
            for gradient, number in zip(gradients, (frame, start), strict=True):
                gradient += self._by_heights(by_share, frame, number)[0]
        return gradients

    def variance(self, gradient: Floats, frame: int, *, is_row: bool = False) -> float:
        """Variance of a number whose gradient by the coefficients of a frame is given.

        Errors along the surface do not count for a row that keeps its height.
        """
        known = self.uncertainty
        if known is None:
            return float(self.noise[frame] * np.sum(gradient * (self.wall.spread @ gradient)))
        by_vertex, covariances = self.wall.projector.T @ gradient, known.along
        if is_row:
            x = self.wall.shapes @ self.coefficients[:, frame]
            normals, covariances = vertex_normals(x, self.wall.faces), known.across
            by_vertex = (by_vertex * normals).sum(axis=1, keepdims=True) * normals
        by_mode = (known.shapes.T @ by_vertex).ravel()
        alike = np.where(np.isfinite(known.alike), known.alike, 0.0)
        apart = float(known.rest[frame] ** 2 * (alike @ (by_vertex**2).sum(axis=1)))
        return max(float(by_mode @ covariances[frame] @ by_mode), 0.0) + apart

    def _sums(self, measure: Measure) -> Floats:
        sums: Floats = measure.lines @ self.stretches[measure.kind]
        return sums

    def _by_coefficients(self, kind: str, by_stretch: Floats, frame: int) -> Floats:
        places = self.places
        along, around = self.slopes.along[:, frame], self.slopes.around[:, frame]
        weight = by_stretch[:, None]
        total: Floats
        if kind == LONGITUDINAL:
            total = places.along.T @ (weight * _unit(along))
        elif kind == CIRCUMFERENTIAL:
            total = places.around.T @ (weight * _unit(around))
        else:
            normal = _unit(np.asarray(np.cross(along, around), dtype=np.float64))
            total = places.along.T @ (weight * np.cross(around, normal))
            total += places.around.T @ (weight * np.cross(normal, along))
        return total


def _unit(x: Floats) -> Floats:
    return _over(x, np.linalg.norm(x, axis=-1, keepdims=True), 0.0)


def _without(size: Floats, variance: Floats) -> Floats:
    """Subtract the contribution of transverse noise to a size, if it is small."""
    least = np.sqrt(2.0 * variance)
    return size - _over(variance, 2.0 * np.maximum(size, least), 0.0)


def _over(a: Floats, b: Floats, otherwise: float) -> Floats:
    """Divide where the divisor is not zero."""
    shape = np.broadcast_shapes(a.shape, b.shape)
    quotient = np.full(shape, otherwise)
    np.divide(a, b, out=quotient, where=np.broadcast_to(b > 0, shape))
    return quotient
