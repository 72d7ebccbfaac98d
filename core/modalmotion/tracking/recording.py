"""Recordings of a table of files: sequences of one mesh, or observations that are tracked first."""

from __future__ import annotations

from pathlib import Path

from modalmotion.errors import ConnectivityError, InputError, ShapeError
from modalmotion.formats import ReadOptions, read_sequence
from modalmotion.formats.frames.frame import TRACK
from modalmotion.formats.parser.answer import Parser
from modalmotion.formats.parser.process import ParserProcess
from modalmotion.formats.result import Reading
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.tracking.hdf5 import kept_track
from modalmotion.tracking.landmarks import landmarks_of
from modalmotion.tracking.parameters import TrackParameters
from modalmotion.tracking.reading import read_observed


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
        Parser to reuse for many files; its own limits then hold.

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
        track = kept_track(source)
        return sequence if track is None else options.apply(Reading(track.sequence)).sequence
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
