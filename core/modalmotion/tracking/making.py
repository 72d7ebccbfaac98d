"""Tracking: from observations of a surface to its motion, each with its uncertainty."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from modalmotion import errors, mesh
from modalmotion.mesh import checks
from modalmotion.mesh.sequence import MeshSequence, mesh_sequence
from modalmotion.notes import Note
from modalmotion.progress import Reporter, reported
from modalmotion.representation import Floats
from modalmotion.template import Template, make_template
from modalmotion.tracking import contour_ends, ends_of_data, moving_base, reading
from modalmotion.tracking.deformable import Deformable, require_unfolded, require_volume
from modalmotion.tracking.first_shape import FirstShape, shape_in
from modalmotion.tracking.image_frames import ImageFrames, frames_of_images, with_images
from modalmotion.tracking.landmarks import with_landmarks
from modalmotion.tracking.map_frames import (
    FramesEstimate,
    Iteration,
    amplitudes_of,
    chain_of,
    evidence,
    first_guess,
    frames_at_rest,
    map_frames,
    paths_from,
)
from modalmotion.tracking.noise import Noise, Prior
from modalmotion.tracking.observation import Frame, observed_frames
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.quality_checks import (
    axis_notes,
    end_notes,
    notes_on,
    quality_of,
    stated_deviations,
    uncertainty_of,
)
from modalmotion.tracking.result import Track, cavity_in, sample_of

Start: TypeAlias = MeshSequence | Template


def motion_in(
    recorded: reading.Recorded,
    parameters: TrackParameters,
    *,
    start: Start | None = None,
    period: float | None = None,
    progress: Reporter | None = None,
) -> Track:
    """Track a surface through observations that do not correspond from frame to frame.

    Parameters
    ----------
    recorded : Recorded
        Images need the landmarks apex and base.
    parameters : TrackParameters
        Its landmarks and times alone count, not those of the recording.
    start : MeshSequence or Template, optional
        A surface whose vertices the result has; of a sequence its first frame is read. Without
        it a spheroid, tube, sheet, ellipse or line is placed by landmarks and brought to the
        reference frame's points.
    period : float, s, optional
        Of the cycle; by default the times and one mean step.
    progress : callable, optional
        Called with the number of steps done and of all.

    Raises
    ------
    InputError
        Naming the frame, the limit and the remedy.
    """
    seen = _observed(recorded, parameters, start, period, progress)
    ended, between = _with_ends_of_contours(seen)
    surface, shape = _surface_of(seen, ended)
    frames = _with_ends_of_data(seen, surface, shape, ended)
    here, based, levels = _frame_by_frame(seen, surface, frames)
    likely = _most_likely(seen, surface, based, here)
    found = _all_frames(seen, surface, based, likely)
    vertices = _surfaces(surface, found)
    result = _with_deviations(seen, surface, shape, found, vertices, likely)
    # The base is assumed in frames without contours; those between slices are others.
    both = {name: between.get(name, 0.0) + own for name, own in levels.items()}
    return _with_notes(seen, result, frames, {**between, **both})


class _Seen(NamedTuple):
    """What was observed, and what is asked of it.

    `stated` are the frames with stated places, `first` the frame that tracking starts from,
    `pinned` the one whose surface is known, `unseen` those without a point.
    """

    recorded: reading.Recorded
    parameters: TrackParameters
    stated: tuple[Frame, ...]
    shown: ImageFrames | None
    template: Template | None
    grid: tuple[int, ...] | None
    times: Floats | None
    period: float | None
    phases: Floats
    first: int
    pinned: int | None
    unseen: tuple[int, ...]
    notes: tuple[Note, ...]
    done: Callable[[], object]

    @property
    def is_closed(self) -> bool:
        """Whether the frames are one cycle."""
        return self.parameters.time == "cycle"

    @property
    def paths(self) -> tuple[list[int], ...]:
        """Frames from the first on, round a cycle in both ways until they meet."""
        return paths_from(self.first, len(self.stated), is_closed=self.is_closed)


def _observed(
    recorded: reading.Recorded,
    p: TrackParameters,
    start: Start | None,
    period: float | None,
    progress: Reporter | None,
) -> _Seen:
    """1. What was observed: points, with the edges of images among them, and stated places."""
    images, shown, is_closed = recorded.images, None, p.time == "cycle"
    if images is None:
        frames, notes = observed_frames(recorded.frames)
    n = recorded.n_frames
    first = _require_reference(p.reference, n)
    # More steps than foreseen are not reported.
    steps = reported(range((4 if images is None else 6) * n), progress)
    next(steps)
    pinned = None if start is None or p.reference is None or images is not None else first
    if images is not None:
        shown = frames_of_images(
            images,
            p.landmarks,
            start=start,
            modes=p.modes,
            reference=first,
            is_closed=is_closed,
            done=lambda: next(steps, None),
        )
        start, (frames, notes) = shown.start, observed_frames(shown.frames)
        period = period or images.period
    times = None if p.times is None else checks.require_times(p.times, n)
    phases = _phases(times, n, period, is_closed=is_closed)
    stated = with_landmarks(frames, p.landmarks, first, None if shown is None else shown.stated_sd)
    unseen = tuple(k for k, frame in enumerate(frames) if not any(map(len, frame)))
    if first in unseen and start is None:
        first = next(k for k in range(n) if k not in unseen)
        notes += (Note.of("reference_unobserved", frame=first),)
    _require_motion(n, unseen, pinned)
    return _Seen(
        recorded,
        p,
        stated,
        shown,
        None if start is None else _template_of(start),
        getattr(start, "grid", None),
        times,
        period,
        phases,
        first,
        pinned,
        unseen,
        notes,
        lambda: next(steps, None),
    )


def _with_ends_of_contours(seen: _Seen) -> tuple[tuple[Frame, ...], Mapping[str, Floats]]:
    """2. Where contours end."""
    if seen.shown is not None:
        return seen.stated, {}
    return contour_ends.with_contour_ends(seen.stated, seen.template, seen.first)


def _surface_of(seen: _Seen, ended: tuple[Frame, ...]) -> tuple[Deformable, FirstShape | None]:
    """3. The surface of the reference, and its modes."""
    template, shape = seen.template, None
    if template is None:
        shape = shape_in(ended[seen.first], seen.first, seen.parameters.topology)
        template = shape.template
    surface = Deformable.of(template, seen.parameters.modes).exact_for_affine()
    if not (np.isfinite(surface.size) and min(template.lengths) > 0):
        raise errors.ShapeError(
            "The start has no extent along one of its axes, so its modes cannot be distinguished.",
            remedy="Give a starting surface with extent along all axes, or other landmarks.",
        )
    return surface, shape


def _with_ends_of_data(
    seen: _Seen, surface: Deformable, shape: FirstShape | None, ended: tuple[Frame, ...]
) -> tuple[Frame, ...]:
    """4. Where clouds and meshes end."""
    _, noise = first_guess(surface)
    if shape is None:
        return ends_of_data.with_endings(surface, ended, noise, seen.pinned)
    beside = replace(noise, sd=shape.noise.sd, truncation=shape.noise.truncation)
    return ends_of_data.with_endings(surface, ended, beside, seen.first)


def _frame_by_frame(
    seen: _Seen, surface: Deformable, frames: tuple[Frame, ...]
) -> tuple[Iteration, tuple[Frame, ...], Mapping[str, Floats]]:
    """5. Each frame at rest by itself, both ways round the cycle; where the base is assumed."""
    prior, noise = first_guess(surface)
    here = frames_at_rest(surface, frames, prior, noise, seen.paths, seen.done)
    shapes = np.stack([surface.positions(a) for a in amplitudes_of(surface, here)])
    based, levels = moving_base.with_assumed_base(frames, surface.template, seen.first, shapes)
    return here, based, levels if seen.shown is None else {**levels, **seen.shown.levels}


class _Likely(NamedTuple):
    """Frames at rest under the prior and the noise that make them the most likely."""

    here: Iteration
    prior: Prior
    noise: Noise
    truncations: Floats


def _most_likely(
    seen: _Seen, surface: Deformable, frames: tuple[Frame, ...], here: Iteration
) -> _Likely:
    """6. Prior and noise under which the frames are the most likely, and the frames once more."""
    is_exact, (before, _) = seen.pinned is not None, first_guess(surface)
    prior, noise, _ = evidence(surface, here, before, is_exact=is_exact)
    starts = amplitudes_of(surface, here)
    here = frames_at_rest(surface, frames, prior, noise, seen.paths, seen.done, starts)
    return _Likely(here, *evidence(surface, here, prior, is_exact=is_exact))


def _all_frames(
    seen: _Seen, surface: Deformable, frames: tuple[Frame, ...], likely: _Likely
) -> FramesEstimate:
    """7. The chain of time, and all frames at once."""
    here, prior, noise, _ = likely
    is_exact, is_closed = seen.pinned is not None, seen.is_closed
    chain = chain_of(
        surface, here, prior, seen.phases, seen.first, is_closed=is_closed, is_exact=is_exact
    )
    return map_frames(surface, frames, here, chain, noise, seen.pinned, seen.done)


def _surfaces(surface: Deformable, found: FramesEstimate) -> Floats:
    """8. The surfaces, which neither fold nor collapse."""
    vertices = np.stack([surface.positions(a) for a in found.amplitudes])
    require_unfolded(surface, vertices)
    require_volume(cavity_in(surface.template), vertices)
    return vertices


def _with_deviations(
    seen: _Seen,
    surface: Deformable,
    shape: FirstShape | None,
    found: FramesEstimate,
    vertices: Floats,
    likely: _Likely,
) -> Track:
    """9. How far they may be off."""
    p, pinned, template = seen.parameters, seen.pinned, surface.template
    _, _, noise, truncations = likely
    if pinned is not None:
        truncations[pinned] = 0.0
    deviations, volume_deviations = stated_deviations(
        surface, vertices, found, truncations, noise.n_values, pinned, shape
    )
    quality = np.array([quality_of(surface, info) for info in found.information])
    sequence = mesh_sequence(
        vertices,
        template.faces,
        grid=seen.grid if shape is None else shape.grid,
        topology=template.topology,
        times=seen.times,
        unit=p.unit,
        facts=mesh.Facts(tracking="normal_displacement", period=seen.period),
    )
    uncertainty = uncertainty_of(
        template, surface.shapes, found.across, found.lasting, truncations, noise.n_values, pinned
    )
    return Track(
        sequence=replace(sequence, uncertainty=uncertainty),
        template=template,
        modes=surface.modes,
        amplitudes=found.amplitudes,
        covariances=found.lasting,
        prior=found.prior,
        noise=noise,
        truncations=truncations,
        deviations=deviations,
        volume_deviations=volume_deviations,
        residuals=np.ascontiguousarray(quality[:, :2]),
        inliers=np.ascontiguousarray(quality[:, 2]),
        coverage=np.ascontiguousarray(quality[:, 3]),
        unseen=seen.unseen,
        reference=pinned,
        data=sample_of(seen.stated, found.information),
        notes=seen.notes,
        provenance={
            "requested_modes": int(p.modes),
            "time": p.time,
            "reference": None if p.reference is None else int(p.reference),
            "modes": len(surface),
            "template_id": template.id,
        },
    )


def _with_notes(
    seen: _Seen, result: Track, frames: tuple[Frame, ...], levels: Mapping[str, Floats]
) -> Track:
    """10. What the images add, and what speaks against the result."""
    images, shown, notes = seen.recorded.images, seen.shown, seen.notes
    if images is not None and shown is not None:
        result = with_images(result, images, shown, seen.parameters.papillary)
        notes = (*shown.notes, *notes)
    else:
        has_marks = any(part.is_landmark for frame in seen.stated for part in frame)
        is_guessed = seen.template is None and seen.parameters.topology is None and not has_marks
        notes = (*notes, *end_notes(result, seen.stated, frames, is_guessed=is_guessed))
    result = moving_base.with_levels(result, levels)
    told = (*notes, *axis_notes(result, seen.stated), *notes_on(result))
    return replace(result, notes=told).informed()


def _phases(times: Floats | None, n: int, period: float | None, *, is_closed: bool) -> Floats:
    """Find the place of each frame in the cycle, or in the recording, 0 to 1."""
    if times is None or n == 1:
        return np.arange(n) / max(1, n if is_closed else n - 1)
    whole_time = span = float(times[-1] - times[0])
    if is_closed:
        whole_time = span * n / (n - 1) if period is None else float(period)
        if not whole_time > span:
            raise errors.ParameterError(
                f"The times span {span:g} s, the whole period of {whole_time:g} s: the last "
                "frame repeats the first.",
                remedy="Omit the last frame, give a longer period, or track with time=open.",
                frame=n - 1,
            )
    return np.asarray((times - times[0]) / whole_time, dtype=np.float64)


def _template_of(start: Start) -> Template:
    """Template of a start, whose modes must be known in closed form."""
    template = start if isinstance(start, Template) else make_template(start)
    if template.surface is None:
        raise errors.TopologyError(
            f"No natural coordinates are known for the start. {template.reason}",
            remedy="Give one open or closed surface as start, a lattice with grid and topology, "
            "or the landmarks apex and base instead of a start.",
        )
    return template


def _require_motion(n_frames: int, unseen: tuple[int, ...], known: int | None) -> None:
    """Refuse frames of which one surface is known and no motion."""
    places = {*range(n_frames)} - {*unseen} | ({known} if known is not None else set())
    if n_frames > 1 and len(places) < 2:
        raise errors.ShapeError(
            f"Only frame {min(places)} of {n_frames} was observed, which shows no motion.",
            remedy="Send points of at least one more frame, or this frame alone.",
            frame=min(places),
        )


def _require_reference(reference: int | None, n_frames: int) -> int:
    """Frame that tracking starts from."""
    if reference is None:
        return 0
    is_whole = type(reference) is int or isinstance(reference, np.integer)
    if not is_whole or not 0 <= reference < n_frames:
        raise errors.ParameterError(
            f"The reference is frame {reference!r:.40}, but there are {n_frames} frames (0 to "
            f"{n_frames - 1}).",
            remedy="Name a frame, counted from 0, or None if the start belongs to no frame.",
        )
    return int(reference)
