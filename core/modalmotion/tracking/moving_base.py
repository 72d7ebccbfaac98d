"""Where the base of a ventricle is in frames that show no end of it: by the volume ejected."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from modalmotion.mesh.geometry import volume_gradient
from modalmotion.modes.topologies import CUP
from modalmotion.representation import Floats
from modalmotion.template import Template
from modalmotion.tracking.observation import Frame, Observation, ends_in, states_end
from modalmotion.tracking.result import Track, cavity_in, normals_of

DESCENT: Final = (0.185, 0.04)
"""Descent of the base per percent of the volume ejected, mm, and its standard deviation, as
published for patients (docs/decisions/0035-motion-from-images.md)."""

OFF_PATH: Final = 1.5
"""Deviation of the base of a frame from the path that this gives all frames, mm."""

HELD: Final = 1.0
"""mm that a surface may leave such a place by: points say nothing along it, and where it is held
softly it stays behind. How far the place is off is added to what is stated."""

# Power of the share of the way along the axis by which a surface goes with its end, and the share
# that is at one.
_NEXT_TO_END: Final = 4
_AT_END: Final = 0.9

LENGTH: Final = 90.0
"""mm from apex to base at end diastole, of those patients."""


def ends_of_cup(template: Template) -> tuple[Floats, Floats]:
    """Tip and middle of the opening of a cup, (3,) each."""
    x, s = template.vertices, template.coordinates[:, 0]
    return x[s <= s.min() + 1e-9].mean(axis=0), x[s >= s.max() - 1e-9].mean(axis=0)


def base_by_volume(
    frames: Sequence[Frame], template: Template, reference: int, shapes: Floats
) -> tuple[Floats, Floats]:
    """Place the base in frames where it is not known.

    Parameters
    ----------
    frames : sequence of Frame
        Which may state it.
    template : Template
        A cup: the shape of the reference frame.
    reference : int
    shapes : (frames, vertices, 3) float64
        About which volumes, and the base's part in them, are linear.

    Returns
    -------
    places : (frames, 3) float64, length unit
    covariance : (frames, frames) float64, length unit squared
        Of their errors along the axis; zero where it is known, and in the reference.

    Notes
    -----
    The base is c E down, E = E0 + g c E being the percentage ejected: c is that of `DESCENT`, and
    what frames show of it where it is known; places are off this path by `OFF_PATH`.
    """
    ends = [ends_in(frame).get("base") for frame in frames]
    known = {k: end for k, end in enumerate(ends) if end is not None and k != reference}
    cavity, s = cavity_in(template), template.coordinates[:, 0]
    assert cavity is not None  # noqa: S101
    tip, base = ends_of_cup(template)
    length = float(np.linalg.norm(tip - base))
    down, unit = (tip - base) / length, length / LENGTH
    volumes = np.abs(cavity.volume(shapes))
    per_volume = 100.0 / float(volumes.max())
    moved = s[:, None] ** _NEXT_TO_END * down
    gains = [abs(float((volume_gradient(cavity, x) * moved).sum())) for x in shapes]
    gain = per_volume * np.array(gains)
    now = (shapes[:, s >= s.max() - 1e-9].mean(axis=1) - base) @ down
    at_rest = per_volume * (volumes[reference] - volumes) - gain * now
    (c, sd), off = (unit * DESCENT[0], unit * DESCENT[1]), unit * OFF_PATH
    precision = sd**-2
    total = c * precision
    for k, place in known.items():
        descent = float((place - base) @ down)
        ejected = at_rest[k] + gain[k] * descent
        precision += (ejected / off) ** 2
        total += ejected * descent / off**2
    c = total / precision
    rise = 1.0 / np.maximum(1.0 - gain * c, 0.5)
    is_open = np.array([k != reference and k not in known for k in range(len(shapes))])
    shared = is_open * at_rest * rise**2
    covariance = np.outer(shared, shared) / precision + np.diag(is_open * (off * rise) ** 2)
    return base + np.outer(c * at_rest * rise, down), covariance


def with_assumed_base(
    frames: Sequence[Frame], template: Template, reference: int, shapes: Floats
) -> tuple[tuple[Frame, ...], Mapping[str, Floats]]:
    """Add the base by volume to frames of points that neither state it nor end there.

    Parameters are those of `base_by_volume`; `levels` are those of `with_levels`.
    """
    is_open = [k != reference and not states_end(own, "base") for k, own in enumerate(frames)]
    if template.surface != CUP or not any(is_open) or cavity_in(template) is None:
        return tuple(frames), {}
    places, covariance = base_by_volume(frames, template, reference, shapes)
    tip, base = ends_of_cup(template)
    sd = HELD * float(np.linalg.norm(base - tip)) / LENGTH
    full = list(frames)
    for k in np.flatnonzero(is_open):
        if len(full[k]):
            level = Observation(
                places[k, None], sd=sd, normals=(base - tip)[None], places=("base",)
            )
            full[k] = (*full[k], level)
    return tuple(full), {"base": covariance}


def with_levels(track: Track, levels: Mapping[str, Floats]) -> Track:
    """Add to what is stated the errors of both ends' levels, covariances (frames, frames) mm^2.

    An end moves along the axis, and the surface next to it goes with it. Strain is between frames:
    of positions only what an end's errors in one frame do not share with the others is added.
    """
    template, known = track.template, track.sequence.uncertainty
    cavity, stated = cavity_in(template), track.volume_deviations
    if not levels or known is None or cavity is None or stated is None:
        return track
    s = template.coordinates[:, 0]
    along, across = np.array(known.along), np.array(known.across)
    deviations, volumes = np.array(track.deviations), np.diag(stated**2)
    enclosed = np.abs(cavity.volume(track.sequence.vertices.astype(np.float64)))
    ed, es = int(enclosed.argmax()), int(enclosed.argmin())
    if ed != es:
        volumes[ed, es] = volumes[es, ed] = track.volume_correlation * stated[ed] * stated[es]
    for name, covariance in levels.items():
        share = (s if name == "base" else 1.0 - s) ** _NEXT_TO_END
        # Frames that are missing have none.
        own, by_volume = np.nan_to_num(covariance), np.zeros(len(stated))
        # Less the mean covariance with the others, none below zero.
        mine = np.diag(own)
        others = (own.sum(axis=1) - mine) / max(len(own) - 1, 1)
        apart = mine - np.clip(others, 0.0, mine)
        for k, x in enumerate(track.sequence.vertices.astype(np.float64)):
            is_at_end = share >= min(_AT_END, share.max())
            axis = x[is_at_end].mean(axis=0) - x[share < 1.0 - _AT_END].mean(axis=0)
            moved = share[:, None] * (axis / np.linalg.norm(axis))
            a = np.linalg.lstsq(known.shapes, moved, rcond=None)[0].ravel()
            along[k] += apart[k] * np.outer(a, a)
            across[k] += apart[k] * np.outer(a, a)
            square = (moved * normals_of(template, x)).sum(axis=1) ** 2
            rest = ((moved**2).sum(axis=1) - square) / 2.0
            deviations[k] = np.sqrt(deviations[k] ** 2 + own[k, k] * np.stack([square, rest], 1))
            by_volume[k] = (volume_gradient(cavity, x) * moved).sum()
        volumes += own * np.outer(by_volume, by_volume)
    sd = np.sqrt(np.diag(volumes))
    is_known = ed == es or not sd[ed] * sd[es] > 0
    correlation = 0.0 if is_known else float(volumes[ed, es] / (sd[ed] * sd[es]))
    return replace(
        track,
        sequence=replace(track.sequence, uncertainty=replace(known, along=along, across=across)),
        covariances=along,
        deviations=deviations,
        volume_deviations=sd,
        volume_correlation=correlation,
    )
