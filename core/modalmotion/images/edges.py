"""Edges on profiles: where brightness turns from that of the inside to that of the outside."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from modalmotion.representation import Bools, Floats, shown

# mm within and beyond an edge that must look like inside and like outside. A wall is thicker.
INNER: Final = 6.0
OUTER: Final = 4.0

# Of the contrast: step of the mean brightness over 3 mm on both sides that makes an edge.
_LEAST_STEP: Final = 0.4
_BESIDE: Final = 3.0

# Likeness of what is next to an edge on its inner side: less is a layer of blood and muscle, and
# the edge is in the middle between the layer and the outside. One that is told from an edge's
# blur, and any where trabeculae are known to be; what it is at least, and how many times the noise
# of one sample it must be below that of blood.
_DISTINCT: Final = 0.45
_FAINT: Final = 0.7
_DARKEST: Final = -0.2
_NOISES: Final = 1.8

# No image has more contrast.
_LABELLED: Final = 1e6

# Per mm: a nearer edge is preferred to one as good farther away.
_NEARER: Final = 0.03


@shown()
@dataclass(frozen=True)
class Levels:
    """Brightness on both sides of a surface.

    Parameters
    ----------
    inside, outside : float
    spread : float
        Standard deviation of noise on one side.
    """

    inside: float
    outside: float
    spread: float

    @property
    def contrast(self) -> float:
        """Difference of both sides over the spread within one."""
        return abs(self.inside - self.outside) / max(self.spread, 1e-300)

    @property
    def layer(self) -> float:
        """Likeness next to an edge below which a layer of blood and muscle is there for certain.

        Labels have no noise, and no layer.
        """
        return self._above_noise(_DISTINCT)

    @property
    def faint_layer(self) -> float:
        """Likeness of thin and bright layers, too, as there are where trabeculae are."""
        return self._above_noise(_FAINT)

    @property
    def is_labelled(self) -> bool:
        """Whether values are labels, which have no noise and are not means over a slice."""
        return self.contrast > _LABELLED

    def _above_noise(self, layer: float) -> float:
        if self.is_labelled:
            return -np.inf
        # Noise of one sample, as likeness.
        return min(layer, 1.0 - _NOISES * 2.0 / max(self.contrast, 1e-300))

    def likeness(self, values: Floats, gain: Floats | float = 1.0) -> Floats:
        """How far values are like the inside (1), the outside (-1), or between; NaN is 0.

        Parameters
        ----------
        values : (...) float64
        gain : (...) float64
            Of the bias field: by which both levels are multiplied.
        """
        half = (self.inside - self.outside) / 2.0
        middle = (self.inside + self.outside) / 2.0
        like: Floats = np.nan_to_num((values / gain - middle) / half, nan=0.0)
        return like


class Edges(NamedTuple):
    """One edge on each profile.

    Parameters
    ----------
    offsets : (n,) float64, mm
    steps : (n,) float64
        Of the mean brightness there, 1 for the whole contrast.
    is_found : (n,) bool
    inside : (n,) float64
        Likeness of what is next to it on its inner side: 1 of blood, less of a layer of muscle
        and blood.
    """

    offsets: Floats
    steps: Floats
    is_found: Bools
    inside: Floats


def find_edges(
    likeness: Floats,
    step: float,
    reach: float,
    extents: Floats,
    crossing: float,
    layer: float = -np.inf,
) -> Edges:
    """Find the edge on each profile: the best split into an inside and an outside.

    Parameters
    ----------
    likeness : (n, samples) float64
        Of profiles from -reach - INNER to reach + OUTER, as `offsets_of` spreads them.
    step : float, mm
    reach : float, mm
    extents : (n,) float64, mm
        Of a voxel along each profile.
    crossing : float
        What a mm of outside on the way from the inside costs, in mm of inside: small where
        structures within the cavity, as papillary muscles, belong to it.
    layer : float
        `Levels.layer` or `Levels.faint_layer`.

    Notes
    -----
    All up to the edge is inside, OUTER beyond it outside. The place between two samples comes
    from the area under the profile next to the edge, which noise moves least: w (a + b) + x (a - b)
    is that between levels a and b, x beyond the middle. b is the outside's, -1; a is 1, or where a
    layer of trabeculae is next to the edge that layer's.
    """
    n, m = likeness.shape
    a, b = round(INNER / step), round(OUTER / step)
    c = np.clip(likeness, -1.0, 1.0)
    up_to = _sums(np.where(c > 0, c, crossing * c)) * step
    whole = _sums(c) * step
    j = np.arange(a, m - b)
    d = (j - a) * step - reach - step / 2
    score = up_to[:, j] - (whole[:, j + b] - whole[:, j]) - _NEARER * np.abs(d)
    k = score.argmax(axis=1)
    rows = np.arange(n)
    beside = min(a, b, max(1, round(_BESIDE / step)))
    at = j[k]
    inner = (whole[rows, at] - whole[rows, at - beside]) / (beside * step)
    outer = (whole[rows, at + beside] - whole[rows, at]) / (beside * step)
    steps = (inner - outer) / 2.0
    is_found = (k > 0) & (k < len(j) - 1) & (steps > _LEAST_STEP)
    # Area: of a window 2 w around the split a share (1 + mean) / 2 is inside.
    w = np.clip(np.rint((1.5 * extents + 1.0) / step).astype(np.int64), 1, min(a, b))
    wide = _sums(np.clip(likeness, -1.5, 1.5)) * step
    area = wide[rows, at + w] - wide[rows, at - w]
    # Farther half of the window: nearer to the edge is its blur.
    half = (w + 1) // 2
    beside_it = (wide[rows, at - half] - wide[rows, at - w]) / (np.maximum(w - half, 1) * step)
    is_layer = (beside_it < layer) & (half < w)
    inside = np.where(is_layer, np.maximum(beside_it, _DARKEST), 1.0)
    x = (area - w * step * (inside - 1.0)) / (inside + 1.0)
    return Edges(d[k] + x, np.clip(steps, 0.0, 1.0), is_found, inside)


def offsets_of(step: float, reach: float) -> Floats:
    """Spread the samples of a profile for `find_edges`, (samples,) float64, mm."""
    n = round(2 * reach / step) + 1
    a, b = round(INNER / step), round(OUTER / step)
    return np.asarray(-reach + step * np.arange(-a, n + b), dtype=np.float64)


def _sums(values: Floats) -> Floats:
    """Sum the first 0, 1, ... samples, (n, samples + 1)."""
    sums = np.zeros((len(values), values.shape[1] + 1))
    np.cumsum(values, axis=1, out=sums[:, 1:])
    return sums
