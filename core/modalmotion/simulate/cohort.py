"""Classes of motion, and labelled cohorts of simulated ventricles."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Final, NamedTuple

import numpy as np

from modalmotion.errors import ParameterError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.simulate import surface, ventricle
from modalmotion.simulate.parameters import TERRITORY_CENTRES, Territory, VentricleParameters


class MotionClass(StrEnum):
    """Motion of a simulated ventricle. "No motion" is measured, not learned: see classify."""

    NORMAL = "normal"
    HYPOKINESIA = "global hypokinesia"
    AKINESIA = "regional akinesia"
    DYSSYNCHRONY = "dyssynchrony"
    REDUCED_TORSION = "reduced torsion"


_USUAL_EJECTION: Final = 0.63


def draw_parameters(label: MotionClass, rng: "np.random.Generator") -> VentricleParameters:
    """Draw one ventricle of a class, from mild to severe.

    Parameters
    ----------
    label : MotionClass
    rng : numpy.random.Generator

    Returns
    -------
    VentricleParameters

    Notes
    -----
    normal: ejection fraction 54-72 %, twist 9-20 degrees.
    global hypokinesia: ejection fraction 15-50 %, shortening and twist less in proportion
    (less strain and torsion in dilated cardiomyopathy: Ochs et al., Myocardial mechanics in
    dilated cardiomyopathy, J Cardiovasc Magn Reson, 2021), the cavity wider.
    regional akinesia: one coronary territory loses 50-120 % of its contraction, the others
    work as usual.
    dyssynchrony: as in left bundle branch block. The lateral wall lags 55-150 ms behind the
    septum (60-65 ms between basal walls in tissue Doppler, 130 ms in M-mode: Bax et al., Left
    ventricular dyssynchrony predicts response and prognosis after cardiac resynchronization
    therapy, J Am Coll Cardiol, 2004; Pitzalis et al., Cardiac resynchronization therapy
    tailored by echocardiographic evaluation of ventricular asynchrony, same journal, 2002),
    with septal flash and an ejection fraction of 20-60 %.
    reduced torsion: twist of -4 to 5 degrees at a preserved ejection fraction, the whole
    ventricle turning one way or the other (van Dalen et al., Diagnostic value of rigid body
    rotation in noncompaction cardiomyopathy, J Am Soc Echocardiogr, 2011).
    """
    normal = _draw_normal(rng)
    if label == MotionClass.HYPOKINESIA:
        return _weakened(normal, rng.uniform(0.15, 0.50) / _USUAL_EJECTION)
    if label == MotionClass.AKINESIA:
        return _draw_akinetic(normal, rng)
    if label == MotionClass.DYSSYNCHRONY:
        weak = _weakened(normal, rng.uniform(0.20, 0.60) / _USUAL_EJECTION)
        return replace(
            weak,
            delay=rng.uniform(0.055, 0.15),
            delay_azimuth=rng.uniform(-25.0, 25.0),
            septal_flash=rng.uniform(0.1, 0.4),
            period=rng.uniform(0.75, 1.1),
        )
    if label == MotionClass.REDUCED_TORSION:
        level, twist = rng.uniform(-4.0, 6.0), rng.uniform(-4.0, 5.0)
        return replace(normal, apex_rotation=level + twist / 2, base_rotation=level - twist / 2)
    return normal


def _draw_normal(rng: "np.random.Generator") -> VentricleParameters:
    size = rng.normal(1.0, 0.07)
    return VentricleParameters(
        length=88.0 * size * rng.normal(1.0, 0.05),
        radius=25.0 * size * rng.normal(1.0, 0.05),
        truncation=rng.uniform(108.0, 125.0),
        ejection_fraction=rng.uniform(0.54, 0.72),
        longitudinal_shortening=rng.uniform(0.15, 0.24),
        apex_share=rng.uniform(0.1, 0.5),
        apex_rotation=rng.uniform(7.0, 14.0),
        base_rotation=rng.uniform(-6.0, -2.0),
        period=rng.uniform(0.65, 1.1),
        early_filling=rng.uniform(0.6, 0.85),
        # No ventricle contracts simultaneously everywhere.
        delay=rng.uniform(0.0, 0.03),
        delay_azimuth=rng.uniform(0.0, 360.0),
        shape_variation=rng.uniform(0.5, 3.0),
        motion_variation=rng.uniform(0.5, 3.0),
    )


def _weakened(normal: VentricleParameters, share: float) -> VentricleParameters:
    """Ventricle with a share of the contraction, and a wider cavity."""
    share = min(share, 1.0)
    return replace(
        normal,
        ejection_fraction=_USUAL_EJECTION * share,
        longitudinal_shortening=normal.longitudinal_shortening * share,
        apex_rotation=normal.apex_rotation * share,
        base_rotation=normal.base_rotation * share,
        motion_variation=normal.motion_variation * share,
        radius=normal.radius * (1.0 + 0.35 * (1.0 - share)),
        length=normal.length * (1.0 + 0.12 * (1.0 - share)),
    )


def _draw_akinetic(normal: VentricleParameters, rng: "np.random.Generator") -> VentricleParameters:
    azimuth, height = TERRITORY_CENTRES[list(Territory)[int(rng.integers(len(Territory)))]]
    p = replace(
        normal,
        akinesia=rng.uniform(0.5, 1.2),
        akinesia_azimuth=azimuth + rng.uniform(-20.0, 20.0),
        akinesia_height=height + rng.uniform(-0.1, 0.1),
        akinesia_extent=rng.uniform(35.0, 60.0),
    )
    # The remaining wall works as before, so what the region lacks is missing in the whole.
    spheroid = surface.Spheroid(p.length, p.radius, float(np.radians(p.truncation)))
    points = surface.lattice_points(spheroid, (12, 24))
    share = spheroid.radius_at(points.polar_angles) ** 2
    weight = ventricle.region_weight(p, surface.directions(points.polar_angles, points.azimuths))
    lost = p.akinesia * float(share @ weight / share.sum())
    return replace(p, ejection_fraction=p.ejection_fraction * (1.0 - lost))


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
    rng: "np.random.Generator",
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
            sequence = ventricle.simulate_ventricle(
                parameters,
                grid=grid,
                n_vertices=None if is_lattice else n_vertices,
                spacing=list(surface.Spacing)[int(rng.integers(len(surface.Spacing)))],
                acquisition=_draw_acquisition(rng, noise, n_frames, any_start),
                rng=rng,
            )
            yield Case(sequence, label, parameters)


def _draw_acquisition(
    rng: "np.random.Generator", noise: float, n_frames: tuple[int, int], any_start: bool
) -> ventricle.Acquisition:
    return ventricle.Acquisition(
        n_frames=_whole(n_frames, rng),
        start_phase=rng.uniform() if any_start else 0.0,
        is_closed=bool(rng.uniform() < _CLOSED_SHARE),
        noise=noise,
        pose=surface.Pose(
            rotation=surface.random_rotation(rng),
            translation=_vector(rng.uniform(-_TRANSLATION, _TRANSLATION, 3)),
            drift_rotation=_vector(np.radians(rng.normal(0.0, _DRIFT_DEGREES, 3))),
            drift_translation=_vector(rng.normal(0.0, _DRIFT_MM, 3)),
        ),
    )


def _whole(limits: tuple[int, int], rng: "np.random.Generator") -> int:
    return int(rng.integers(limits[0], limits[1] + 1))


def _vector(entries: np.ndarray) -> tuple[float, float, float]:
    x, y, z = (float(entry) for entry in entries)
    return x, y, z
