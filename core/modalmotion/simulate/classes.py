"""Classes of motion, and the parameters that a ventricle of each class may have."""

from __future__ import annotations

from dataclasses import replace
from enum import StrEnum
from typing import Final

import numpy as np

from modalmotion.simulate.motion import region_weight
from modalmotion.simulate.parameters import (
    TERRITORY_CENTRES,
    Territory,
    VentricleParameters,
)
from modalmotion.simulate.spheroid import Spheroid, directions
from modalmotion.simulate.surface import lattice_points


class MotionClass(StrEnum):
    """Motion of a simulated ventricle. "No motion" is measured, not learned: see classify."""

    NORMAL = "normal"
    HYPOKINESIA = "global hypokinesia"
    AKINESIA = "regional akinesia"
    DYSSYNCHRONY = "dyssynchrony"
    REDUCED_TORSION = "reduced torsion"


_USUAL_EJECTION: Final = 0.63


def draw_parameters(label: MotionClass, rng: np.random.Generator) -> VentricleParameters:
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


def _draw_normal(rng: np.random.Generator) -> VentricleParameters:
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


def _draw_akinetic(normal: VentricleParameters, rng: np.random.Generator) -> VentricleParameters:
    azimuth, height = TERRITORY_CENTRES[list(Territory)[int(rng.integers(len(Territory)))]]
    p = replace(
        normal,
        akinesia=rng.uniform(0.5, 1.2),
        akinesia_azimuth=azimuth + rng.uniform(-20.0, 20.0),
        akinesia_height=height + rng.uniform(-0.1, 0.1),
        akinesia_extent=rng.uniform(35.0, 60.0),
    )
    # The remaining wall works as before, so what the region lacks is missing in the whole.
    spheroid = Spheroid(p.length, p.radius, float(np.radians(p.truncation)))
    points = lattice_points(spheroid, (12, 24))
    share = spheroid.radius_at(points.polar_angles) ** 2
    weight = region_weight(p, directions(points.polar_angles, points.azimuths))
    lost = p.akinesia * float(share @ weight / share.sum())
    return replace(p, ejection_fraction=p.ejection_fraction * (1.0 - lost))
