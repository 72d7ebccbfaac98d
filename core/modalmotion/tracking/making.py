"""Tracking: from observations of a surface to its motion, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, NamedTuple, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import whole
from modalmotion.errors import (
    ModeCountError,
    ParameterError,
    ShapeError,
    TopologyError,
)
from modalmotion.images import ImageSequence
from modalmotion.images.sequence import Images, images_in
from modalmotion.mesh import Facts
from modalmotion.mesh.checks import require_times
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.modes.topology import Topology
from modalmotion.progress import Progress
from modalmotion.template import Template, make_template
from modalmotion.tracking.contour_ends import with_contour_ends
from modalmotion.tracking.deformable import Deformable, require_unfolded, require_volume
from modalmotion.tracking.deviations import across_of, stated_deviations, uncertainty_of
from modalmotion.tracking.ends_of_data import with_endings
from modalmotion.tracking.first_shape import FirstShape, shape_in
from modalmotion.tracking.image_frames import ImageFrames, frames_of_images
from modalmotion.tracking.imaged import with_images
from modalmotion.tracking.iterations import (
    again,
    both_ways,
    evidence,
    first_guess,
    noises_of,
    steady,
)
from modalmotion.tracking.label_maps import from_labels
from modalmotion.tracking.label_values import is_label_map
from modalmotion.tracking.map_frames import Chain, FramesEstimate, chain_of, map_frames
from modalmotion.tracking.noise import Noise
from modalmotion.tracking.observation import Frame, observed_frames, of_surface
from modalmotion.tracking.quality_checks import end_notes, has_landmarks, notes_on, quality_of
from modalmotion.tracking.request import in_mm, phases_of, with_landmarks
from modalmotion.tracking.result import Papillary, Track, cavity_in, sample_of

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
    asked = _asked(
        observed, start, landmarks, modes, time, times, period, unit, reference, papillary, progress
    )
    first, pinned, is_closed = asked.first, asked.pinned, asked.is_closed
    is_exact = pinned is not None
    # 1. What was observed, and where contours end.
    template = None if asked.start is None else _template_of(asked.start)
    stated, shown = asked.stated, asked.shown
    ended = stated if shown is not None else with_contour_ends(stated, template, first)
    # 2. The surface of the reference, and its modes.
    shape = None
    if template is None:
        shape = shape_in(ended[first], first, topology)
        template = shape.template
    surface = Deformable.of(template, asked.modes)
    _require_size(surface)
    surface = surface.exact_for_affine()
    # 3. Prior and noise before anything was seen.
    prior, noise = first_guess(surface)
    # 4. Where clouds and meshes end, unless the start is the surface of no frame.
    beside = noise
    if shape is not None:
        beside = replace(noise, sd=shape.noise.sd, truncation=shape.noise.truncation)
    frames = with_endings(surface, ended, beside, pinned if shape is None else first)
    # 5. Each frame at rest by itself, from the reference on, both ways round the cycle.
    here = both_ways(surface, frames, first, prior, noise, is_closed=is_closed, done=asked.done)
    gap = here.gap
    # 6. Prior and noise under which these are the most likely, and 7. the frames once more.
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    alike = steady(noises_of(surface, here, prior, noise), noise)
    here = again(surface, frames, here.amplitudes(len(surface)), prior, alike, asked.done)
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    noises = noises_of(surface, here, prior, noise)
    # 8. The chain of time, and 9. all frames at once.
    chain = chain_of(
        surface, here, prior, asked.phases, first, is_closed=is_closed, is_exact=is_exact
    )
    found = map_frames(surface, frames, here, chain, steady(noises, noise), pinned, asked.done)
    # 10. How far they may be off, and what speaks against them.
    result = _stated(asked, surface, shape, found, chain, noise, noises, gap)
    if shown is not None and asked.images is not None:
        result = with_images(result, asked.images, shown)
        notes = (*shown.notes, *asked.notes)
    else:
        is_guessed = start is None and topology is None and not has_landmarks(stated)
        notes = (*asked.notes, *end_notes(result, stated, frames, is_guessed=is_guessed))
    return replace(result, notes=(*notes, *notes_on(result))).informed()


class _Asked(NamedTuple):
    """A request: frames with what was stated of them, their times, and where to begin."""

    images: ImageSequence | None
    shown: ImageFrames | None
    start: Start | None
    stated: tuple[Frame, ...]
    modes: int
    is_closed: bool
    times: NDArray[np.float64] | None
    phases: NDArray[np.float64]
    period: float | None
    unit: str | None
    first: int  # frame that the shape is of
    pinned: int | None  # frame whose surface the start is, exactly
    unseen: tuple[int, ...]
    notes: tuple[str, ...]
    provenance: dict[str, Any]
    done: Callable[[], None]


def _asked(
    observed: MeshSequence | Images | Sequence[Any],
    start: Start | None,
    landmarks: Mapping[str, Any] | None,
    modes: int,
    time: Time,
    times: Any,
    period: float | None,
    unit: str | None,
    reference: int | None,
    papillary: Papillary,
    progress: Progress | None,
) -> _Asked:
    """Check a request, and search images for edges."""
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
    n = len(seen)
    modes = whole("modes", modes)
    at = None if times is None else require_times(times, n)
    phases = phases_of(at, n, period, is_closed=is_closed)
    first = _require_reference(reference, n)
    stated = with_landmarks(seen, landmarks, first, None if shown is None else shown.stated_sd)
    unseen = tuple(k for k, frame in enumerate(seen) if not any(map(len, frame)))
    if first in unseen and start is None:
        first = next(k for k in range(n) if k not in unseen)
        notes += (f"Nothing was observed in the reference; the shape is that of frame {first}.",)
    pinned = None if start is None or reference is None or shown is not None else first
    _require_motion(n, unseen, pinned)
    if modes < 2:
        raise ModeCountError(
            f"{modes} modes are a translation at most.",
            remedy="Ask for 2 modes or more (mode 0 is a translation); 37 are usual.",
        )
    provenance = {
        "requested_modes": modes,
        "time": time,
        "reference": None if reference is None else int(reference),
    }
    # Searches in images have taken a third.
    done = _counted(progress, 4 * n, 0 if shown is None else 2 * n)
    places = stated, modes, is_closed, at, phases, period, unit, first, pinned
    return _Asked(images, shown, start, *places, unseen, notes, provenance, done)


def _stated(
    asked: _Asked,
    surface: Deformable,
    shape: FirstShape | None,
    found: FramesEstimate,
    chain: Chain,
    noise: Noise,
    noises: Sequence[Noise],
    gap: float | None,
) -> Track:
    """Put the track together, with how far it may be off."""
    template, pinned = surface.template, asked.pinned
    vertices = np.stack([surface.positions(a) for a in found.amplitudes])
    require_unfolded(surface, vertices)
    require_volume(cavity_in(template), vertices)
    across = across_of(found, pinned)
    deviations, volume_deviations = stated_deviations(
        surface, vertices, found, across, noises, pinned, shape
    )
    truncations = np.array([own.truncation for own in noises])
    if pinned is not None:
        truncations[pinned] = 0.0
    quality = np.array([quality_of(surface, info) for info in found.information])
    sequence = mesh_sequence(
        vertices,
        template.faces,
        grid=shape.grid if shape is not None else getattr(asked.start, "grid", None),
        topology=template.topology,
        times=asked.times,
        unit=asked.unit,
        facts=Facts(tracking="offset", period=asked.period),
    )
    uncertainty = uncertainty_of(
        template, surface.shapes, across, found.lasting, truncations, noise.n_values, pinned
    )
    provenance = {**asked.provenance, "modes": len(surface), "template_id": template.id}
    return Track(
        sequence=replace(sequence, uncertainty=uncertainty),
        template=template,
        modes=surface.modes,
        amplitudes=found.amplitudes,
        covariances=found.lasting,
        prior=chain.prior,
        noise=noise,
        truncations=truncations,
        deviations=deviations,
        volume_deviations=volume_deviations,
        harmonic=chain.h0,
        residuals=np.ascontiguousarray(quality[:, :2]),
        inliers=np.ascontiguousarray(quality[:, 2]),
        coverage=np.ascontiguousarray(quality[:, 3]),
        unseen=asked.unseen,
        gap=gap,
        reference=pinned,
        data=sample_of(asked.stated, found.information),
        notes=(),
        provenance=provenance,
    )


def _template_of(start: Start) -> Template:
    """Template of a start, whose modes must be known in closed form."""
    template = start if isinstance(start, Template) else make_template(start)
    if template.surface is None:
        raise TopologyError(
            f"No natural coordinates are known for the start. {template.reason}",
            remedy="Give one open or closed surface as start, a lattice with grid and topology, or "
            "landmarks apex and base in place of a start.",
        )
    return template


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


def segment(
    images: Images,
    *,
    landmarks: Mapping[str, Any] | None = None,
    labels: Sequence[int] = (),
    wall: Sequence[int] = (),
    frame: int = 0,
    start: Start | None = None,
    modes: int = 37,
    papillary: Papillary = "pool",
    progress: Progress | None = None,
) -> Track:
    """Find a surface in one image.

    Parameters
    ----------
    images : Volume, PlaneSet or ImageSequence
        In LPS mm; of a sequence one frame is read.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm, optional
        Needed of images that are no label map.
    labels, wall : sequence of int
        Of a label map: values of the cavity, and of the wall around it; by geometry where no label
        is named.
    frame : int
    start, modes, papillary, progress : optional
        As for `track`.

    Returns
    -------
    Track
        Of one frame: its surface with a standard deviation at each vertex, and its volume.

    Raises
    ------
    InputError
        As `track` does, or if there is no such frame.
    """
    sequence = images_in(images)
    if sequence is None:
        raise ShapeError(
            f"A {type(images).__name__} is no image.",
            remedy="Give a Volume, a PlaneSet or an ImageSequence.",
        )
    if not 0 <= frame < sequence.n_frames or sequence.frames[frame] is None:
        raise ParameterError(
            f"There is no image in frame {frame}: there are {sequence.n_frames} frames.",
            remedy="Name a frame that has one, counted from 0.",
            frame=frame,
        )
    one = ImageSequence((sequence.frames[frame],), notes=sequence.notes)
    marks: dict[str, Any] = {}
    if labels or is_label_map(one):
        one, proposed = from_labels(one, labels, wall)
        marks |= proposed
    for name, value in (landmarks or {}).items():
        places = np.asarray(value, dtype=np.float64)
        is_listed = places.ndim == 2 and len(places) == sequence.n_frames
        marks[name] = places[frame] if is_listed else places
    return track(
        one,
        landmarks=marks,
        start=start,
        modes=modes,
        time="open",
        papillary=papillary,
        progress=progress,
    )
