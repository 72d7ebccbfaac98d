"""The fit done slowly: rotation from SciPy, least squares from NumPy, everything sorted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from template_surfaces import Floats

from modalmotion.signature.fit import Fit
from modalmotion.template import Template


@dataclass(frozen=True, eq=False)
class SlowFit:
    amplitudes: Floats
    matrices: Floats
    rms: Floats
    weighted_rms: Floats
    p95: Floats
    largest: Floats
    motion: Floats
    weighted_motion: Floats


def slow_fit(
    vertices: Floats,
    template: Template,
    shapes: Floats,
    *,
    remove_rotation: bool,
    frames: Floats | None = None,
) -> SlowFit:
    """Frame by frame: rotation from SciPy, least squares from NumPy, everything sorted."""
    start, results = vertices[0], []
    w = template.weights
    centre = w @ start
    for frame in vertices:
        here = w @ frame
        R = np.eye(3)
        if remove_rotation:
            R = Rotation.align_vectors(frame - here, start - centre, w)[0].as_matrix()
        u = (frame - here) @ R + here - start
        if frames is not None:
            u = np.einsum("nij,nj->ni", frames, u)
        root = np.sqrt(w)[:, None]
        a = np.linalg.lstsq(root * shapes, root * u, rcond=None)[0]
        squares = ((u - shapes @ a) ** 2).sum(axis=1)
        moved = (u**2).sum(axis=1)
        ranked = np.sort(squares)[::-1]
        results.append(
            (
                a,
                R,
                np.sqrt(squares.mean()),
                np.sqrt(w @ squares),
                np.sqrt(ranked[len(ranked) // 20]),
                np.sqrt(squares.max()),
                np.sqrt(moved.mean()),
                np.sqrt(w @ moved),
            )
        )
    return SlowFit(*(np.array(column) for column in zip(*results, strict=True)))


def assert_same(fit: Fit, slow: SlowFit) -> None:
    assert fit.amplitudes == pytest.approx(slow.amplitudes, abs=1e-10)
    assert fit.rotations.matrices == pytest.approx(slow.matrices, abs=1e-10)
    assert fit.errors.rms == pytest.approx(slow.rms, abs=1e-10)
    assert fit.errors.weighted_rms == pytest.approx(slow.weighted_rms, abs=1e-10)
    assert fit.errors.p95 == pytest.approx(slow.p95, abs=1e-10)
    assert fit.errors.max == pytest.approx(slow.largest, abs=1e-10)
    assert fit.motion.rms == pytest.approx(slow.motion, abs=1e-10)
    assert fit.motion.weighted_rms == pytest.approx(slow.weighted_motion, abs=1e-10)
