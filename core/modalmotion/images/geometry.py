"""Checks of an image's samples and of its place in space."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.errors import ParameterError, ShapeError

# mm: finer and coarser samples are those of a microscope or of a wrong unit.
_FINEST: Final = 1e-3
_COARSEST: Final = 1e3

# Volume of a cell over that of the box with the same edges: less is a plane.
_FLATTEST: Final = 1e-3


def require_samples(values: Any, n_axes: int) -> NDArray[Any]:
    """Check that samples are real numbers along so many axes; return them, read-only.

    Raises
    ------
    ShapeError
    """
    samples = np.asarray(values)
    if samples.ndim != n_axes or 0 in samples.shape:
        raise ShapeError(
            f"The samples have the shape {samples.shape}, not {n_axes} axes of one sample or more.",
            remedy="Give one number for each voxel or pixel; colours must be one grey value.",
        )
    if samples.dtype.kind not in "iufb":
        raise ShapeError(
            f"The samples are of the type {samples.dtype}, and no real numbers.",
            remedy="Give integers or floating-point numbers.",
        )
    samples = samples.astype(np.uint8) if samples.dtype.kind == "b" else samples.view()
    samples.setflags(write=False)
    return samples


def require_affine(affine: Any, n_axes: int) -> NDArray[np.float64]:
    """Check the map from indices to LPS mm, (4, n_axes + 1) or (3, n_axes + 1).

    Returns
    -------
    (3, n_axes + 1) float64
        A column for the step along each axis, and the place of the first sample.

    Raises
    ------
    ParameterError
        Where it is not finite, or its axes do not span as many directions.
    """
    A = np.array(affine, dtype=np.float64)
    if A.shape not in ((3, n_axes + 1), (4, n_axes + 1)):
        raise ShapeError(
            f"The affine has the shape {A.shape}, not (4, {n_axes + 1}).",
            remedy="Give columns with the step along each axis and the first sample's place, mm.",
        )
    A = A[:3]
    steps = np.linalg.norm(A[:, :-1], axis=0)
    if not np.isfinite(A).all() or not ((steps >= _FINEST) & (steps <= _COARSEST)).all():
        raise ParameterError(
            f"The samples are {', '.join(f'{s:.3g}' for s in steps)} mm apart.",
            remedy=f"Give finite spacings between {_FINEST:g} and {_COARSEST:g} mm.",
        )
    spanned = float(np.sqrt(np.linalg.det((A[:, :-1] / steps).T @ (A[:, :-1] / steps)).clip(0.0)))
    if spanned < _FLATTEST:
        raise ParameterError(
            "Two axes of the image run along one another, so that its voxels have no volume.",
            remedy="Give axes in different directions.",
        )
    A.setflags(write=False)
    return A


def are_missing(samples: NDArray[Any]) -> bool:
    """Tell whether any sample is not finite, looking at a slab at a time."""
    return samples.dtype.kind == "f" and not all(np.isfinite(slab).all() for slab in samples)
