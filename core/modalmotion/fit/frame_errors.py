"""Distances between vertices and their reconstruction, frame by frame: docs/error.md.

A plain name counts every vertex that was sent, and all alike; `weighted` stands before what
counts each by its share of the surface.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from modalmotion.numeric.quantile import exceeded_by_a_twentieth
from modalmotion.numeric.scale import lengths, power_of_two
from modalmotion.template import Template


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Distances between vertices and their reconstruction.

    Parameters
    ----------
    rms : (frames,) float64, length unit
        Over all vertices.
    weighted_rms : (frames,) float64, length unit
        Over the surface, each vertex by its weight: what the fit makes least.
    p95 : (frames,) float64, length unit
        A twentieth of all vertices are farther off.
    max : (frames,) float64, length unit
        Of any vertex.
    surface_max : (frames,) float64, length unit
        Of any vertex that is in a triangle.
    """

    rms: NDArray[np.float64]
    weighted_rms: NDArray[np.float64]
    p95: NDArray[np.float64]
    max: NDArray[np.float64]
    surface_max: NDArray[np.float64]

    @staticmethod
    def joined(parts: list[FrameErrors]) -> FrameErrors:
        """Put the errors of consecutive frames together."""
        return FrameErrors(
            *(
                np.concatenate([getattr(part, f.name) for part in parts])
                for f in fields(FrameErrors)
            )
        )


def errors_of(
    squares: NDArray[np.float64],
    weights: NDArray[np.float64],
    scale: float,
    loose: NDArray[np.float64] | None = None,
) -> FrameErrors:
    """Take the errors from distances.

    Parameters
    ----------
    squares : (frames, vertices) float64, in units of the scale squared
        At the vertices of the surface.
    weights : (vertices,) float64
        Their shares of it.
    scale : float, length unit
    loose : (frames, n) float64, length unit, optional
        Distances of the vertices in no triangle, which may be of any size.
    """
    weighted = _weighted_rms(squares, weights, scale)
    largest = scale * np.sqrt(squares.max(axis=1))
    if loose is None or not loose.shape[1]:
        rms = scale * np.sqrt(squares.mean(axis=1))
        p95 = scale * np.sqrt(exceeded_by_a_twentieth(squares))
        return FrameErrors(rms, weighted, p95, largest, largest)
    distances = np.concatenate([scale * np.sqrt(squares), loose], axis=1)
    rms, most = _plain_rms(distances)
    return FrameErrors(rms, weighted, exceeded_by_a_twentieth(distances), most, largest)


def rms_of(
    squares: NDArray[np.float64],
    weights: NDArray[np.float64],
    scale: float,
    loose: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Take the plain and the weighted RMS alone from distances; parameters as of `errors_of`."""
    weighted = _weighted_rms(squares, weights, scale)
    if not loose.shape[1]:
        return scale * np.sqrt(squares.mean(axis=1)), weighted
    return _plain_rms(np.concatenate([scale * np.sqrt(squares), loose], axis=1))[0], weighted


def _weighted_rms(
    squares: NDArray[np.float64], weights: NDArray[np.float64], scale: float
) -> NDArray[np.float64]:
    # einsum adds in one order on any number of threads.
    weighted: NDArray[np.float64] = scale * np.sqrt(np.einsum("fn,n->f", squares, weights))
    return weighted


def _plain_rms(
    distances: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Root of the mean square of distances of any size, and the largest of them."""
    most = distances.max(axis=1)
    shares = distances / np.where(most > 0, most, 1.0)[:, None]
    return most * np.sqrt((shares**2).mean(axis=1)), most


def errors_of_offsets(offsets: NDArray[np.float64], template: Template) -> FrameErrors:
    """Take the errors from the vectors between vertices and their reconstruction.

    Parameters
    ----------
    offsets : (frames, vertices, 3) float64, length unit
    template : Template
    """
    loose, weights, isolated = None, template.weights, template.isolated
    if len(isolated):
        loose = lengths(offsets[:, isolated])
        offsets = np.delete(offsets, isolated, axis=1)
        weights = np.delete(weights, isolated)
    scale = power_of_two(float(np.abs(offsets).max(initial=0.0)))
    return errors_of(((offsets / scale) ** 2).sum(axis=2), weights, scale, loose)
