"""Labelled cohorts of simulated ventricles, recorded in many ways."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.simulate.classes import MotionClass, draw_parameters
from modalmotion.simulate.parameters import VentricleParameters
from modalmotion.simulate.pose import Pose, random_rotation
from modalmotion.simulate.spheroid import Spacing
from modalmotion.simulate.ventricle import Acquisition, simulate_ventricle

# Ranges that every recording is drawn from.
_ROWS, _HALF_COLUMNS, _VERTICES = (12, 36), (12, 36), (500, 2500)
_TRANSLATION, _DRIFT_MM, _DRIFT_DEGREES = 100.0, 1.5, 2.0
_CLOSED_SHARE: Final = 0.3


@shown("label", "subject", "sequence.n_frames", "sequence.n_vertices")
class Case(NamedTuple):
    """One labelled ventricle."""

    sequence: MeshSequence
    label: MotionClass
    parameters: VentricleParameters


def simulate_cohort(
    n_per_class: int,
    *,
    rng: np.random.Generator,
    classes: Sequence[MotionClass] = tuple(MotionClass),
    noise: float = 0.6,
    n_frames: tuple[int, int] = (15, 40),
    triangle_share: float = 0.5,
    any_start: bool = False,
) -> Iterator[Case]:
    """Simulate as many ventricles of each class, one after the other.

    Severity, geometry, pose, drift, number of frames and mesh differ from case to case; see
    `draw_parameters` for the classes.

    Parameters
    ----------
    n_per_class : int
    rng : numpy.random.Generator
    classes : sequence of MotionClass
    noise : float, mm
        Standard deviation of each coordinate of each vertex in each frame.
    n_frames : (int, int)
        Fewest and most frames of a beat.
    triangle_share : float
        Share of irregular triangulations; the others are lattices.
    any_start : bool
        Whether a recording starts anywhere in the beat, not at end diastole.

    Yields
    ------
    Case
        Class by class in turn, so that any stretch of the cohort is balanced.

    Raises
    ------
    ParameterError
        If the number of cases or a share is out of range.
    """
    if n_per_class < 0 or not 0.0 <= triangle_share <= 1.0 or not 1 <= n_frames[0] <= n_frames[1]:
        raise ParameterError(
            f"A cohort of {n_per_class} a class, with {n_frames} frames and a share of "
            f"{triangle_share} triangulations, was requested.",
            remedy="Use 0 or more cases, at least 1 frame, and a share from 0 to 1.",
        )
    for _ in range(n_per_class):
        for label in classes:
            parameters = draw_parameters(label, rng)
            is_lattice = rng.uniform() >= triangle_share
            grid = _whole(_ROWS, rng), 2 * _whole(_HALF_COLUMNS, rng)
            n_vertices = _whole(_VERTICES, rng)
            sequence = simulate_ventricle(
                parameters,
                grid=grid,
                n_vertices=None if is_lattice else n_vertices,
                spacing=list(Spacing)[int(rng.integers(len(Spacing)))],
                acquisition=_draw_acquisition(rng, noise, n_frames, any_start),
                rng=rng,
            )
            yield Case(sequence, label, parameters)


def _draw_acquisition(
    rng: np.random.Generator, noise: float, n_frames: tuple[int, int], any_start: bool
) -> Acquisition:
    return Acquisition(
        n_frames=_whole(n_frames, rng),
        start_phase=rng.uniform() if any_start else 0.0,
        is_closed=bool(rng.uniform() < _CLOSED_SHARE),
        noise=noise,
        pose=Pose(
            rotation=random_rotation(rng),
            translation=_vector(rng.uniform(-_TRANSLATION, _TRANSLATION, 3)),
            drift_rotation=_vector(np.radians(rng.normal(0.0, _DRIFT_DEGREES, 3))),
            drift_translation=_vector(rng.normal(0.0, _DRIFT_MM, 3)),
        ),
    )


def _whole(limits: tuple[int, int], rng: np.random.Generator) -> int:
    return int(rng.integers(limits[0], limits[1] + 1))


def _vector(entries: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(entry) for entry in entries)
    return x, y, z
