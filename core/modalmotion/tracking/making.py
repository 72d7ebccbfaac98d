"""Tracking: from observations of a surface to its motion, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, TypeAlias, cast

import numpy as np

from modalmotion.errors import (
    ModeCountError,
    ParameterError,
    ShapeError,
    TopologyError,
)
from modalmotion.facts import Facts
from modalmotion.images.sequence import Images, images_in
from modalmotion.mesh.checks import require_times
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import Topology
from modalmotion.numeric.kinds import whole
from modalmotion.progress import Progress
from modalmotion.template import Template, make_template
from modalmotion.tracking.contour_ends import with_contour_ends
from modalmotion.tracking.deformable import Deformable
from modalmotion.tracking.doubts import doubts_of_ends, has_landmarks
from modalmotion.tracking.ends_of_data import with_endings
from modalmotion.tracking.first_shape import shape_in
from modalmotion.tracking.folding import require_unfolded, require_volume
from modalmotion.tracking.image_frames import frames_of_images
from modalmotion.tracking.imaged import with_images
from modalmotion.tracking.notes import notes_on
from modalmotion.tracking.observation import observed_frames, of_surface
from modalmotion.tracking.papillary import Papillary
from modalmotion.tracking.passes import (
    again,
    both_ways,
    evidence,
    first_guess,
    noises_of,
    steady,
)
from modalmotion.tracking.posterior import uncertainty_of
from modalmotion.tracking.quality import quality_of
from modalmotion.tracking.request import in_mm, phases_of, with_landmarks
from modalmotion.tracking.result import Track, cavity_in
from modalmotion.tracking.sampled_data import sample_of
from modalmotion.tracking.stated_deviations import across_of, stated_deviations
from modalmotion.tracking.together import chain_of, together

Time: TypeAlias = Literal["cycle", "open"]
Start: TypeAlias = MeshSequence | Template

MOST_MODES: Final = 400
"""That a service takes."""


def track(
    observed: MeshSequence | Images | Sequence[Any],
    *,
    start: Start | None = None,
    topology: Topology | str | None = None,
    landmarks: Mapping[str, Any] | None = None,
    modes: int = 37,
    time: Time = "cycle",
    times: Any = None,
    period: float | None = None,
    unit: str | None = None,
    reference: int | None = 0,
    papillary: Papillary = "pool",
    progress: Progress | None = None,
) -> Track:
    """Track a surface through observations that do not correspond from frame to frame.

    Parameters
    ----------
    observed : MeshSequence, ImageSequence, Volume, PlaneSet or sequence
        For each frame an array (n, 3) of points, a mesh (vertices, faces) of any connectivity,
        an `Observation` or several, an image, or None where the frame is missing. Images are in
        LPS mm, and need the landmarks apex and base.
    start : MeshSequence or Template, optional
        A surface whose vertices the result has; of a sequence its first frame is read. Without
        it a spheroid, tube, sheet, ellipse or line is placed by landmarks and brought to the
        reference frame's points.
    topology : Topology or str, optional
        Of a start without a surface: cup where apex and base are stated, else sphere.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, optional
        In the length unit of the points. One place is that in the reference frame; of several a
        row of NaN is unknown. The end of a surface is what points cannot show: state it in as
        many frames as can be.
    modes : int
        At least 2; rounded up so that no pair is split.
    time : {"cycle", "open"}
        Whether the frames are one period, or part of a motion.
    times : (frames,) array_like, s, optional
        Regular where None.
    period : float, s, optional
        Of the cycle; by default the times and one mean step.
    unit : str, optional
        Length unit: m, cm, mm, um or nm.
    reference : int or None
        Frame whose surface the start is, exactly; None where it is the surface of none. Without
        a start it is the frame that the shape is taken from. Of images it is also the frame whose
        brightness counts, and a start is only where the search begins.
    papillary : {"pool", "wall"}
        Of images: whether papillary muscles count as cavity in volumes.
    progress : callable, optional
        Called with the number of steps done and of all.

    Returns
    -------
    Track

    Raises
    ------
    InputError
        Naming the frame, the limit and the remedy.
    """
    if isinstance(observed, MeshSequence):
        times = observed.times if times is None else times
        unit = observed.unit if unit is None else unit
        period = observed.facts.period if period is None else period
        observed = [of_surface(x, observed.faces) for x in observed.vertices]
    if time not in ("cycle", "open"):
        raise ParameterError(
            f"The time is {time!r:.40}.", remedy="Use cycle for one whole period, or open."
        )
    is_closed = time == "cycle"
    images, shown = images_in(observed), None
    if images is not None:
        times = images.times if times is None else times
        period = images.period if period is None else period
        unit = in_mm(unit)
        shown = frames_of_images(
            images,
            landmarks,
            papillary=papillary,
            start=start,
            modes=modes,
            reference=_require_reference(reference, images.n_frames),
            is_closed=is_closed,
            done=_counted(progress, 6 * images.n_frames),
        )
        observed, start = shown.frames, shown.start
    seen, notes = observed_frames(cast("Sequence[Any]", observed))
    n_frames = len(seen)
    modes = whole("modes", modes)
    at = None if times is None else require_times(times, n_frames)
    phases = phases_of(at, n_frames, period, is_closed=is_closed)
    first = _require_reference(reference, n_frames)
    stated = with_landmarks(seen, landmarks, first, None if shown is None else shown.stated_sd)
    unseen = tuple(k for k, frame in enumerate(seen) if not any(map(len, frame)))
    if first in unseen and start is None:
        first = next(k for k in range(n_frames) if k not in unseen)
        notes += (f"Nothing was observed in the reference; the shape is that of frame {first}.",)
    pinned = None if start is None or reference is None or shown is not None else first
    _require_motion(n_frames, unseen, pinned)
    if modes < 2:
        raise ModeCountError(
            f"{modes} modes are a translation at most, which no surface is tracked by.",
            remedy="Ask for 2 modes or more; 37 are usual.",
        )
    # Searches in images have taken a third.
    done = _counted(progress, 4 * n_frames, 0 if shown is None else 2 * n_frames)
    template, grid = None, None
    if start is not None:
        template = start if isinstance(start, Template) else make_template(start)
        _require_modes(template)
        grid = start.grid if isinstance(start, MeshSequence) else None
    ended = stated if shown is not None else with_contour_ends(stated, template, first)
    shape = None
    if template is None:
        shape = shape_in(ended[first], first, topology)
        template, grid = shape.template, shape.grid
    surface = Deformable.of(template, modes)
    _require_size(surface)
    surface = surface.exact_for_affine()
    is_exact = pinned is not None
    prior, noise = first_guess(surface)
    # A start that is no frame's surface says nothing of where their data end.
    known = first if start is None else pinned
    frames = with_endings(surface, ended, noise, known)
    here = both_ways(surface, frames, first, prior, noise, is_closed=is_closed, done=done)
    gap = here.gap
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    noises = noises_of(surface, here, prior, noise)
    here = again(surface, frames, here.amplitudes(len(surface)), prior, steady(noises, noise), done)
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    noises = noises_of(surface, here, prior, noise)
    Q, h0, prior = chain_of(
        surface, here, prior, phases, first, is_closed=is_closed, is_exact=is_exact
    )
    found = together(
        surface,
        frames,
        here,
        prior,
        [steady(noises, noise)] * n_frames,
        Q,
        pinned,
        done,
    )
    vertices = np.stack([surface.positions(a) for a in found.amplitudes])
    require_unfolded(surface, vertices)
    require_volume(cavity_in(template), vertices)
    truncations = np.array([own.truncation for own in noises])
    across = across_of(found, pinned)
    deviations, volume_deviations = stated_deviations(
        surface, vertices, found, across, noises, pinned, shape
    )
    if pinned is not None:
        truncations[pinned] = 0.0
    quality = np.array([quality_of(surface, info) for info in found.information])
    sequence = mesh_sequence(
        vertices,
        template.faces,
        grid=grid,
        topology=template.topology,
        times=at,
        unit=unit,
        facts=Facts(tracking="offset", period=period),
    )
    uncertainty = uncertainty_of(
        template, surface.shapes, across, found.lasting, truncations, noise.n_values, pinned
    )
    result = Track(
        sequence=replace(sequence, uncertainty=uncertainty),
        template=template,
        modes=surface.modes,
        amplitudes=found.amplitudes,
        covariances=found.lasting,
        prior=prior,
        noise=noise,
        truncations=truncations,
        deviations=deviations,
        volume_deviations=volume_deviations,
        harmonic=h0,
        residuals=np.ascontiguousarray(quality[:, :2]),
        inliers=np.ascontiguousarray(quality[:, 2]),
        coverage=np.ascontiguousarray(quality[:, 3]),
        unseen=unseen,
        gap=gap,
        reference=pinned,
        data=sample_of(stated, found.information),
        notes=notes,
        provenance={
            "modes": len(surface),
            "requested_modes": modes,
            "time": time,
            "reference": None if reference is None else int(reference),
            "template_id": template.id,
        },
    )
    if shown is not None and images is not None:
        result = with_images(result, images, shown)
        notes = (*shown.notes, *notes)
    else:
        is_guessed = start is None and topology is None and not has_landmarks(stated)
        notes = (*notes, *doubts_of_ends(result, stated, frames, is_guessed=is_guessed))
    return replace(result, notes=(*notes, *notes_on(result))).informed()


def _require_modes(template: Template) -> None:
    """Refuse a start whose modes are not known in closed form."""
    if template.surface is None:
        raise TopologyError(
            f"No natural coordinates are known for the start. {template.reason}",
            remedy="Give one open or closed surface as start, a lattice with grid and topology, or "
            "landmarks apex and base in place of a start.",
        )


def _require_motion(n_frames: int, unseen: tuple[int, ...], known: int | None) -> None:
    """Refuse frames of which one surface is known, and no motion."""
    places = {*range(n_frames)} - {*unseen} | ({known} if known is not None else set())
    if n_frames > 1 and len(places) < 2:
        raise ShapeError(
            f"Only frame {min(places)} of {n_frames} was observed, which shows no motion.",
            remedy="Send points of another frame too, or this frame alone.",
            frame=min(places),
        )


def _require_reference(reference: int | None, n_frames: int) -> int:
    """Frame that tracking starts from."""
    if reference is None:
        return 0
    is_whole = type(reference) is int or isinstance(reference, np.integer)
    if not is_whole or not 0 <= reference < n_frames:
        raise ParameterError(
            f"The reference is frame {reference!r:.40}, but there are {n_frames} frames (0 to "
            f"{n_frames - 1}).",
            remedy="Name a frame, counted from 0, or None where the start belongs to none.",
        )
    return int(reference)


def _counted(progress: Progress | None, n_steps: int, count: int = 0) -> Callable[[], None]:
    """Step that reports itself, after `count` others; more than foreseen are not reported."""
    n_steps += count

    def done() -> None:
        nonlocal count
        count += 1
        if progress is not None and count <= n_steps:
            progress(count, n_steps)

    return done


def _require_size(surface: Deformable) -> None:
    if not (np.isfinite(surface.size) and min(surface.template.lengths) > 0):
        raise ShapeError(
            "The start has no extent along one of its axes, so no modes can be told apart on it.",
            remedy="Give a surface as start that is spread out, or other landmarks.",
        )
