"""Tracks of recordings: of files, of what is in memory, and of one image."""

from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from modalmotion import errors, formats, mesh
from modalmotion.formats.frame import TRACK
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.result import Parser, Reading
from modalmotion.images import ImageSequence, volume
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.notes import Note
from modalmotion.progress import Reporter
from modalmotion.tracking import hdf5, label_maps, label_values, making, observation
from modalmotion.tracking.landmarks import Proposed, landmarks_of, places_of
from modalmotion.tracking.parameters import TrackParameters, require_surface_tracking
from modalmotion.tracking.reading import Recorded, read_observed, recorded_images
from modalmotion.tracking.result import Track


def track(
    observed: MeshSequence | volume.Images | Recorded | Sequence[Any] | Path,
    *,
    start: making.Start | None = None,
    facts: mesh.Facts = mesh.NO_FACTS,
    progress: Reporter | None = None,
    **options: Any,
) -> Track:
    """Track a surface through what does not correspond from frame to frame.

    Parameters
    ----------
    observed : str or Path, MeshSequence, ImageSequence, Volume, PlaneSet, Recorded or sequence
        A file or folder of images, label maps, clouds, contours or changing meshes; or these in
        memory: images, or for each frame an array (n, 3) of points, a mesh (vertices, faces) of
        any connectivity, an `Observation` or several, or None where the frame is missing. Images
        are in LPS mm, and need the landmarks apex and base where they are no label map.
    start : MeshSequence or Template, optional
        A surface whose vertices the result has. Without it a spheroid, tube, sheet, ellipse or line
        is placed by landmarks and brought to the reference frame's points.
    facts : Facts, optional
        Of the sequence that is found; its period is that of the cycle.
    progress : callable, optional
        Called with the number of steps done and of all.
    **options
        The fields of `TrackParameters`: landmarks, unit, modes and others.

    Returns
    -------
    Track
        With the notes of the files before its own.

    Raises
    ------
    InputError
        Naming the frame, the limit and the remedy.

    Examples
    --------
    >>> import modalmotion as mm
    >>> beat = mm.simulate_ventricle(grid=(12, 16), acquisition=mm.Acquisition(n_frames=4))
    >>> mm.track([*beat.vertices.astype(float)], unit="mm", modes=4).n_frames
    4
    """
    names = [one.name for one in fields(TrackParameters)]
    if unknown := [name for name in options if name not in names]:
        raise errors.ParameterError(
            f"track() has no option {unknown[0]!r}.",
            remedy=f"Its options are {', '.join(names)}.",
        )
    parameters = TrackParameters(**options)
    require_surface_tracking(facts)
    if isinstance(observed, MeshSequence):
        facts = replace(facts, period=facts.period or observed.facts.period)
        surfaces = tuple(observation.of_surface(x, observed.faces) for x in observed.vertices)
        observed = Recorded(surfaces, {}, observed.times, observed.unit)
    elif isinstance(observed, Path):
        observed = read_observed(observed, labels=parameters.labels, coordinates=facts.coordinates)
    elif not isinstance(observed, Recorded):
        images = volume.images_in(observed)
        observed = Recorded(tuple(observed), {}) if images is None else recorded_images(images)  # type: ignore[arg-type]
    recorded, proposed, parameters = _labelled(observed, parameters)
    times: Any = recorded.times if parameters.times is None else parameters.times
    if isinstance(times, float | int):
        times = times * np.arange(recorded.n_frames, dtype=np.float64)
    if recorded.images is not None and parameters.unit not in (None, "mm"):
        raise errors.ParameterError(
            f"The unit {parameters.unit!r:.20} was given, but image coordinates are in mm.",
            remedy="Omit the unit, and give landmarks in mm.",
        )
    stated = replace(
        parameters,
        landmarks={**proposed, **recorded.landmarks, **(parameters.landmarks or {})},
        times=times,
        unit=parameters.unit or recorded.unit,
    )
    result = making.motion_in(recorded, stated, start=start, period=facts.period, progress=progress)
    facts = result.sequence.facts.over(facts)
    if recorded.coordinates is not None and facts.coordinates == mesh.UNKNOWN:
        facts = mesh.facts_patched(facts, {"coordinates": recorded.coordinates})
    # Notes of images are the track's own already.
    notes = tuple(dict.fromkeys((*recorded.notes, *result.notes)))
    return replace(result, sequence=result.sequence.with_facts(facts), notes=notes)


def _labelled(
    recorded: Recorded, parameters: TrackParameters
) -> tuple[Recorded, Mapping[str, Proposed], TrackParameters]:
    """Turn label maps to images, with landmarks that they propose and a reference that has both."""
    images, labels = recorded.images, parameters.labels
    if images is None:
        if labels and not recorded.are_typed:
            raise errors.ParameterError(
                "A label was given, but the recording is not a label map and has no typed "
                "contours.",
                remedy="Omit the label, or send a label map as NIfTI, NRRD or MetaImage.",
            )
        return recorded, {}, parameters
    values = label_values.whole_labels(labels)
    if not values and (labels or not label_values.is_label_map(images)):
        return recorded, {}, parameters
    made = label_maps.from_labels(images, values)
    stated = {**recorded.landmarks, **(parameters.landmarks or {})}
    first = parameters.reference or 0
    notes = (*made.images.notes, *label_maps.notes_on_landmarks(images, stated, first))
    if first in made.left_out and not stated:
        there = (k for k, frame in enumerate(images.frames) if frame is not None)
        first = next(k for k in there if k not in made.left_out)
        parameters = replace(parameters, reference=first)
        notes += (Note.of("reference_unobserved", frame=first),)
    return replace(recorded, images=made.images, notes=notes), made.landmarks, parameters


def sequence_of(
    source: Path, options: formats.ReadOptions | None = None, *, parser: Parser | None = None
) -> MeshSequence:
    """Read a recording as a sequence; what holds no one mesh is tracked.

    A track's own file is its sequence, with the errors that it states. Clouds and contours are
    tracked as they come; meshes of changing connectivity only where the facts state
    `tracking` normal_displacement, for a mesh that ought to have been one is a mistake. Landmarks
    of the facts, apex and base as points, place the start.

    Parameters
    ----------
    source : Path
    options : ReadOptions, optional
        Its topology is that of the start, too.
    parser : Parser, optional
        Parser to reuse for many files; its own limits then apply.

    Raises
    ------
    InputError
        If it can neither be read nor tracked.
    """
    options = formats.ReadOptions() if options is None else options
    if parser is None:
        with ParserProcess(options.limits) as own:
            return sequence_of(source, options, parser=own)
    try:
        sequence = formats.read_sequence(source, options, parser=parser).sequence
        kept = hdf5.kept_track(source)
        return sequence if kept is None else options.apply(Reading(kept.sequence)).sequence
    except errors.InputError as error:
        if TRACK not in error.remedy:
            raise
        is_mesh = isinstance(error, errors.ShapeError | errors.ConnectivityError)
        if is_mesh and options.facts.tracking != "normal_displacement":
            error.remedy += (
                " To track it from a table of files, set tracking to normal_displacement in its "
                "row."
            )
            raise
    return track(
        read_observed(source, coordinates=options.facts.coordinates, parser=parser),
        facts=options.facts,
        topology=options.topology,
        landmarks=landmarks_of(options.facts),
        unit=options.unit,
        times=options.times if options.frame_interval is None else options.frame_interval,
    ).sequence


def segment(
    images: volume.Images,
    *,
    landmarks: Mapping[str, Any] | None = None,
    frame: int = 0,
    start: making.Start | None = None,
    progress: Reporter | None = None,
    **options: Any,
) -> Track:
    """Find a surface in one image.

    Parameters
    ----------
    images : Volume, PlaneSet or ImageSequence
        In LPS mm; of a sequence one frame is read.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm, optional
        Needed of images that are no label map.
    frame : int
    start, progress : optional
        As of `track`.
    **options
        Other fields of `TrackParameters`: modes, papillary, labels.

    Returns
    -------
    Track
        Of one frame: its surface with a standard deviation at each vertex, and its volume.

    Raises
    ------
    InputError
        As `track` does, or if there is no such frame.
    """
    sequence = volume.images_in(images)
    if sequence is None:
        raise errors.ShapeError(
            f"A {type(images).__name__} is not an image.",
            remedy="Give a Volume, a PlaneSet or an ImageSequence.",
        )
    if not 0 <= frame < sequence.n_frames or sequence.frames[frame] is None:
        raise errors.ParameterError(
            f"Frame {frame} has no image; the sequence has {sequence.n_frames} frames.",
            remedy="Name a frame that has one, counted from 0.",
            frame=frame,
        )
    places = {name: places_of(name, value) for name, value in (landmarks or {}).items()}
    each = (sequence.n_frames, 3)
    return track(
        ImageSequence((sequence.frames[frame],), notes=sequence.notes),
        start=start,
        progress=progress,
        time="open",
        landmarks={n: at[frame, None] if at.shape == each else at for n, at in places.items()},
        **options,
    )
