"""Tracking: from observations of a surface to its motion, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from modalmotion.arguments.checking import whole
from modalmotion.errors import ModeCountError, ParameterError, ShapeError, TopologyError
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
from modalmotion.tracking.first_shape import shape_in
from modalmotion.tracking.image_frames import ImageFrames, frames_of_images, with_images
from modalmotion.tracking.iterations import (
    again,
    both_ways,
    evidence,
    first_guess,
    noises_of,
    steady,
)
from modalmotion.tracking.landmarks import with_landmarks
from modalmotion.tracking.map_frames import chain_of, map_frames
from modalmotion.tracking.moving_base import with_assumed_base, with_levels
from modalmotion.tracking.observation import observed_frames, of_surface
from modalmotion.tracking.quality_checks import axis_notes, end_notes, notes_on, quality_of
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
    # 1. What was observed: points, with the edges of images among them, and stated places.
    is_closed = _require_time(time)
    images = images_in(observed)
    data = images if images is not None else observed
    if isinstance(data, MeshSequence):
        unit, period = unit or data.unit, period or data.facts.period
        observed = [of_surface(x, data.faces) for x in data.vertices]
    if isinstance(data, MeshSequence | ImageSequence) and times is None:
        times = data.times
    frames, notes = ((), ()) if images is not None else observed_frames(observed)  # type: ignore[arg-type]
    n = len(frames) if images is None else images.n_frames
    first, modes = _require_reference(reference, n), whole("modes", modes)
    done = _counted(progress, (4 if images is None else 6) * n)
    shown: ImageFrames | None = None
    if images is not None:
        unit, period = _in_mm(unit), period or images.period
        shown = frames_of_images(
            images,
            landmarks,
            papillary=papillary,
            start=start,
            modes=modes,
            reference=first,
            is_closed=is_closed,
            done=done,
        )
        start, (frames, notes) = shown.start, observed_frames(shown.frames)
    at = None if times is None else require_times(times, n)
    phases = _phases(at, n, period, is_closed=is_closed)
    stated = with_landmarks(frames, landmarks, first, None if shown is None else shown.stated_sd)
    unseen = tuple(k for k, frame in enumerate(frames) if not any(map(len, frame)))
    if first in unseen and start is None:
        first = next(k for k in range(n) if k not in unseen)
        notes += (f"Nothing was observed in the reference; the shape is that of frame {first}.",)
    pinned = None if start is None or reference is None or shown is not None else first
    _require_motion(n, unseen, pinned, modes)
    # 2. Where contours end.
    template = None if start is None else _template_of(start)
    ended = stated if shown is not None else with_contour_ends(stated, template, first)
    # 3. The surface of the reference, and its modes.
    shape = None if template is not None else shape_in(ended[first], first, topology)
    template = template if shape is None else shape.template
    assert template is not None  # noqa: S101
    surface = Deformable.of(template, modes).exact_for_affine()
    _require_extent(surface)
    # 4. Prior and noise before anything was seen, and where clouds and meshes end.
    prior, noise = first_guess(surface)
    beside, known = noise, pinned
    if shape is not None:
        beside = replace(noise, sd=shape.noise.sd, truncation=shape.noise.truncation)
        known = first
    frames = found_ends = with_endings(surface, ended, beside, known)
    # 5. Each frame at rest by itself, from the reference on, both ways round the cycle.
    here = both_ways(surface, frames, first, prior, noise, is_closed=is_closed, done=done)
    start_of = here.amplitudes(len(surface))
    shapes = np.stack([surface.positions(a) for a in start_of])
    frames, levels = with_assumed_base(frames, template, first, shapes)
    if shown is not None:
        levels = {**levels, **shown.levels}
    # 6. Prior and noise under which these are the most likely, and the frames once more.
    is_exact = pinned is not None
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    alike = steady(noises_of(surface, here, prior, noise), noise)
    here = again(surface, frames, start_of, prior, alike, done)
    prior, noise = evidence(surface, here.frames, prior, is_exact=is_exact)
    noises = noises_of(surface, here, prior, noise)
    # 7. The chain of time, and all frames at once.
    chain = chain_of(surface, here, prior, phases, first, is_closed=is_closed, is_exact=is_exact)
    found = map_frames(surface, frames, here, chain, steady(noises, noise), pinned, done)
    # 8. The surfaces, which neither fold nor collapse.
    vertices = np.stack([surface.positions(a) for a in found.amplitudes])
    require_unfolded(surface, vertices)
    require_volume(cavity_in(template), vertices)
    # 9. How far they may be off.
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
        grid=shape.grid if shape is not None else getattr(start, "grid", None),
        topology=template.topology,
        times=at,
        unit=unit,
        facts=Facts(tracking="normal_displacement", period=period),
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
        prior=chain.prior,
        noise=noise,
        truncations=truncations,
        deviations=deviations,
        volume_deviations=volume_deviations,
        residuals=np.ascontiguousarray(quality[:, :2]),
        inliers=np.ascontiguousarray(quality[:, 2]),
        coverage=np.ascontiguousarray(quality[:, 3]),
        unseen=unseen,
        reference=pinned,
        data=sample_of(stated, found.information),
        notes=(),
        provenance={
            "requested_modes": modes,
            "time": time,
            "reference": None if reference is None else int(reference),
            "modes": len(surface),
            "template_id": template.id,
        },
    )
    # 10. What the images add, and what speaks against it.
    if images is not None and shown is not None:
        result, notes = with_images(result, images, shown), (*shown.notes, *notes)
    else:
        has_marks = any(part.is_landmark for frame in stated for part in frame)
        is_guessed = start is None and topology is None and not has_marks
        notes = (*notes, *end_notes(result, stated, found_ends, is_guessed=is_guessed))
    result = with_levels(result, levels)
    told = (*notes, *axis_notes(result, stated), *notes_on(result))
    return replace(result, notes=told).informed()


def _require_time(time: str) -> bool:
    """Return whether the frames are a cycle."""
    if time not in ("cycle", "open"):
        raise ParameterError(
            f"The time is {time!r:.40}.", remedy="Use cycle for one whole period, or open."
        )
    return time == "cycle"


def _in_mm(unit: str | None) -> str:
    """Check that images, which are in mm, are not stated in another unit."""
    if unit not in (None, "mm"):
        raise ParameterError(
            f"The unit {unit!r:.20} is stated, but images are placed in mm.",
            remedy="Omit the unit, and give landmarks in mm.",
        )
    return "mm"


def _phases(
    times: NDArray[np.float64] | None, n: int, period: float | None, *, is_closed: bool
) -> NDArray[np.float64]:
    """Find the place of each frame in the cycle, or in the recording, 0 to 1."""
    if times is None or n == 1:
        return np.arange(n) / max(1, n if is_closed else n - 1)
    whole_time = span = float(times[-1] - times[0])
    if is_closed:
        whole_time = span * n / (n - 1) if period is None else float(period)
        if not whole_time > span:
            raise ParameterError(
                f"The times span {span:g} s, the whole period of {whole_time:g} s: the last "
                "frame repeats the first.",
                remedy="Omit the last frame, give a longer period, or track with time open.",
                frame=n - 1,
            )
    return np.asarray((times - times[0]) / whole_time, dtype=np.float64)


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


def _require_extent(surface: Deformable) -> None:
    if not (np.isfinite(surface.size) and min(surface.template.lengths) > 0):
        raise ShapeError(
            "The start has no extent along one of its axes, so it has no modes that differ.",
            remedy="Give a surface as start that is spread out, or other landmarks.",
        )


def _require_motion(n_frames: int, unseen: tuple[int, ...], known: int | None, modes: int) -> None:
    """Refuse frames of which one surface is known and no motion, and a translation alone."""
    places = {*range(n_frames)} - {*unseen} | ({known} if known is not None else set())
    if n_frames > 1 and len(places) < 2:
        raise ShapeError(
            f"Only frame {min(places)} of {n_frames} was observed, which shows no motion.",
            remedy="Send points of another frame too, or this frame alone.",
            frame=min(places),
        )
    if modes < 2:
        raise ModeCountError(
            f"{modes} modes are a translation at most.",
            remedy="Ask for 2 modes or more (mode 0 is a translation); 37 are usual.",
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


def _counted(progress: Progress | None, n_steps: int) -> Callable[[], None]:
    """Step that reports itself; more than foreseen are not reported."""
    count = 0

    def done() -> None:
        nonlocal count
        count += 1
        if progress is not None and count <= n_steps:
            progress(count, n_steps)

    return done
