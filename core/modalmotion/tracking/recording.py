"""Recordings of a table of files: sequences of one mesh, or observations that are tracked first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

from modalmotion.errors import ConnectivityError, InputError, ParameterError, ShapeError
from modalmotion.formats import ReadOptions, read_sequence
from modalmotion.formats.frame import TRACK
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.result import Parser, Reading
from modalmotion.images.sequence import Images
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress
from modalmotion.tracking.hdf5 import kept_track
from modalmotion.tracking.landmarks import landmarks_of
from modalmotion.tracking.making import Start
from modalmotion.tracking.making import track as track_frames
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.reading import USUAL_CONTOURS, Recorded, read_observed
from modalmotion.tracking.result import Track


def sequence_of(
    source: Path, options: ReadOptions | None = None, *, parser: Parser | None = None
) -> MeshSequence:
    """Read a recording as a sequence; what holds no one mesh is tracked.

    A track's own file is its sequence, with the errors that it states. Clouds and contours are
    tracked as they come; meshes of changing connectivity where the facts state `tracking` offset,
    for a mesh that ought to have been one is a mistake. Landmarks of the facts, apex and base as
    points, place the start.

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
    options = ReadOptions() if options is None else options
    if parser is None:
        with ParserProcess(options.limits) as own:
            return sequence_of(source, options, parser=own)
    try:
        sequence = read_sequence(source, options, parser=parser).sequence
        kept = kept_track(source)
        return sequence if kept is None else options.apply(Reading(kept.sequence)).sequence
    except InputError as error:
        if TRACK not in error.remedy:
            raise
        is_mesh = isinstance(error, ShapeError | ConnectivityError)
        if is_mesh and options.facts.tracking != "offset":
            error.remedy += " In a table of files state tracking offset in its row to have it done."
            raise
    parameters = TrackParameters(
        topology=options.topology,
        landmarks=landmarks_of(options.facts),
        unit=options.unit,
        times=options.times if options.frame_interval is None else options.frame_interval,
        facts=options.facts,
    )
    recorded = read_observed(source, coordinates=parameters.coordinates, parser=parser)
    return parameters.follow(recorded).sequence


def track(
    observed: MeshSequence | Images | Recorded | Sequence[Any] | Path,
    *,
    start: Start | None = None,
    progress: Progress | None = None,
    **options: Any,
) -> Track:
    """Track a surface through what does not correspond from frame to frame.

    Parameters
    ----------
    observed : str or Path, or what `tracking.making.track` takes
        A file or folder of images, label maps, clouds, contours or changing meshes; or these in
        memory: an image sequence, or for each frame an array (n, 3) of points or a mesh (vertices,
        faces).
    start : MeshSequence or Template, optional
    progress : callable, optional
    **options
        Of a file the fields of `TrackParameters`; else those of `tracking.making.track`:
        landmarks, unit, modes and others.

    Returns
    -------
    Track

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
    if isinstance(observed, Path):
        contours = options.get("contours", USUAL_CONTOURS)
        observed = read_observed(observed, contours=contours)
    try:
        if isinstance(observed, Recorded):
            parameters = TrackParameters(**options)
            return parameters.follow(observed, start=start, progress=progress)
        return track_frames(observed, start=start, progress=progress, **options)
    except TypeError as error:
        if "unexpected keyword" not in str(error):
            raise
        names = ", ".join(one.name for one in fields(TrackParameters))
        raise ParameterError(
            f"track() cannot be called so: {error}.", remedy=f"Its options are {names}."
        ) from None
