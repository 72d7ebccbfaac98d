"""What the axes of a template were found on, and how errors of the positions turn them."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.triangles import mean_slopes
from modalmotion.modes.topology import CUP, CYLINDER, Topology
from modalmotion.template.coordinates.axis import Axes, azimuth, origin_on
from modalmotion.template.coordinates.value import Coordinates
from modalmotion.template.surface import Opening, Surface

Places = dict[str, NDArray[np.float64]]

# Step of a difference, on a surface of about size 1.
_STEP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Placement:
    """Axes of a template, and what they and its coordinates come from.

    Parameters
    ----------
    topology : Topology
    surface, mean : Surface
        The reference, and the mean of all frames in the same place.
    places, mean_places : mapping of str to (3,) float64, scaled
        Stated landmarks on each.
    vertices : mapping of str to int
        Those of them that name a vertex, which is the one on the surface.
    scale : float, length unit
        Of the surfaces.
    axes_of, make : callable
        Find axes on a surface with its places; make coordinates about axes.
    """

    topology: Topology
    surface: Surface
    mean: Surface
    places: Places
    mean_places: Places
    vertices: Mapping[str, int]
    scale: float
    axes_of: Callable[[Surface, Places], Axes]
    make: Callable[..., Coordinates | None]

    @cached_property
    def axes(self) -> Axes:
        """Those of the mean of all frames."""
        return self.axes_of(self.mean, self.mean_places)

    def coordinates(self, axes: Axes, before: NDArray[np.float64]) -> NDArray[np.float64]:
        """Coordinates about other axes, (vertices, axes) float64, like those about its own."""
        surface = self.surface
        if self.topology in (CUP, CYLINDER):
            # Their s is of the openings.
            origin = origin_on(surface, axes.axis, self.places)
            theta = azimuth(surface.vertices - origin, axes.axis, axes.zero)
            return np.stack([before[:, 0], theta], axis=1)
        found = self.make(surface, self.places, axes)
        return before if found is None else found.values

    def slopes(self) -> NDArray[np.float64]:
        """Turn of the axes by errors of the mean's positions.

        The axes follow from area integrals up to the second moment, from the centres of the
        openings and from stated vertices: differences by these, times the slopes of these.

        Returns
        -------
        (3, vertices, 3) float64, rad per length unit
            Of the rotation vector by each position, in the order of the mesh.
        """
        mean, C, o = self.mean, self.mean.covariance, self.mean.offsets
        k = self._turns(lambda step: {"centroid": mean.centroid + step})
        K = np.stack(
            [
                self._turns(lambda step, e=e: {"covariance": C + _symmetric(e, step)})  # type: ignore[misc]
                for e in np.eye(3)
            ],
            axis=1,
        )
        # The area mean of f = k . o + o'K o has these slopes.
        f = k @ o.T + np.einsum("vi,wij,vj->wv", o, K, o)
        slopes = mean_slopes(mean.vertices, mean.faces, f, k[:, None] + 2.0 * o @ K)
        for number, opening in enumerate(mean.openings):

            def changed(
                step: NDArray[np.float64], n: int = number, one: Opening = opening
            ) -> dict[str, tuple[Opening, ...]]:
                other = replace(one, centre=one.centre + step[:3], length=one.length + step[3])
                return {"openings": (*mean.openings[:n], other, *mean.openings[n + 1 :])}

            turns = self._turns(changed, n=4)
            slopes += opening.slopes(mean.vertices, turns[:, :3], turns[:, 3])
        for name, vertex in self.vertices.items():
            slopes[:, vertex] += self._turns(lambda _: {}, name)
        return slopes / self.scale

    def _turns(
        self,
        changed: Callable[[NDArray[np.float64]], Mapping[str, object]],
        place: str = "",
        n: int = 3,
    ) -> NDArray[np.float64]:
        """Rotation vector by each direction of a step in parts of the mean, or in a place."""
        before, columns = self.axes.matrix, []
        for step in _STEP * np.eye(n):
            other, places = copy.copy(self.mean), dict(self.mean_places)
            # Instead of what the surface would work out.
            vars(other).update(changed(step))
            if place:
                places[place] = places[place] + step
            W = self.axes_of(other, places).matrix @ before.T
            columns.append([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        return np.array(columns).T / (2.0 * _STEP)


def _symmetric(a: NDArray[np.float64], b: NDArray[np.float64]) -> NDArray[np.float64]:
    return 0.5 * (np.outer(a, b) + np.outer(b, a))
