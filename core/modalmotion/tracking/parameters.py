"""Parameters of a track, the same in Python, for the command line and over HTTP."""

from __future__ import annotations

import inspect
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from modalmotion.errors import ConnectivityError, InputError, ParameterError, ShapeError
from modalmotion.formats import ReadOptions, read_sequence
from modalmotion.formats.frame import TRACK
from modalmotion.formats.parser_process import ParserProcess
from modalmotion.formats.result import Parser, Reading
from modalmotion.images import ImageSequence
from modalmotion.images.sequence import Images, images_in
from modalmotion.mesh import NO_FACTS, UNKNOWN, Facts, facts_patched
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.progress import Progress
from modalmotion.representation import shown
from modalmotion.tracking.hdf5 import kept_track
from modalmotion.tracking.label_maps import from_labels, notes_on_landmarks
from modalmotion.tracking.label_values import is_label_map
from modalmotion.tracking.landmarks import Proposed, as_places, landmarks_of
from modalmotion.tracking.making import Start, Time
from modalmotion.tracking.making import track as track_frames
from modalmotion.tracking.reading import (
    USUAL_CONTOURS,
    Recorded,
    read_observed,
    recorded_images,
)
from modalmotion.tracking.result import Papillary, Track

USUAL_MODES: Final = 37


@shown()
@dataclass(frozen=True)
class TrackParameters:
    """How to track recorded observations, and statements that override those of the files.

    Parameters
    ----------
    topology : str, optional
        Topology of a start without a surface, such as cup, sphere or cylinder.
    modes : int
        Modes, three amplitudes per frame each.
    time : {"cycle", "open"}
        Whether the frames are one period, or part of a motion.
    reference : int or None
        Frame in which tracking starts.
    contours : tuple of str
        Of typed contours: parts of the names of those to read.
    landmarks : mapping of str to array
        As for `making.track`; they override those of the files by name.
    papillary : {"pool", "wall"}
        Of images: whether papillary muscles count as cavity.
    labels : tuple of int
        Of label maps: value of the cavity, by default that which another label encloses. Apex and
        base are proposed from it where nobody states them: `label_maps.from_labels`.
    unit : str, optional
        Length unit: m, cm, mm, um or nm.
    times : tuple of float, or float, s, optional
        Of all frames, or the interval from frame to frame.
    facts : Facts
        Of the sequence that is found; its period is that of the cycle.
    """

    topology: str | None = None
    modes: int = USUAL_MODES
    time: Time = "cycle"
    reference: int | None = 0
    contours: tuple[str, ...] = USUAL_CONTOURS
    landmarks: Mapping[str, Any] = field(default_factory=dict)
    papillary: Papillary = "pool"
    labels: tuple[int, ...] = ()
    unit: str | None = None
    times: tuple[float, ...] | float | None = None
    facts: Facts = NO_FACTS

    def __post_init__(self) -> None:
        if self.facts.tracking not in ("normal_displacement", "unknown"):
            raise ParameterError(
                f"The fact 'tracking' is {self.facts.tracking!r}: what is tracked follows the "
                "surface, and not its tissue.",
                remedy="Leave it out; it becomes normal_displacement.",
                details={"fact": "tracking"},
            )

    @property
    def coordinates(self) -> str | None:
        """Coordinate system that is stated, None for none."""
        stated = self.facts.coordinates
        return None if stated == UNKNOWN else stated

    def follow(
        self,
        recorded: Recorded,
        *,
        start: Start | None = None,
        progress: Progress | None = None,
    ) -> Track:
        """Track recorded observations.

        Parameters
        ----------
        recorded : Recorded
        start : MeshSequence or Template, optional
        progress : callable, optional

        Returns
        -------
        Track
            With the notes of the files before its own.

        Raises
        ------
        InputError
            As `making.track` does.
        """
        recorded, proposed = self._labelled(recorded)
        times: Any = recorded.times if self.times is None else self.times
        if isinstance(times, float | int):
            times = times * np.arange(recorded.n_frames, dtype=np.float64)
        result = track_frames(
            recorded.frames if recorded.images is None else recorded.images,
            start=start,
            topology=self.topology,
            landmarks={**proposed, **recorded.landmarks, **self.landmarks},
            modes=self.modes,
            time=self.time,
            times=times,
            period=self.facts.period,
            unit=self.unit or recorded.unit,
            reference=self.reference,
            papillary=self.papillary,
            progress=progress,
        )
        facts = result.sequence.facts.over(self.facts)
        if recorded.coordinates is not None and facts.coordinates == UNKNOWN:
            facts = facts_patched(facts, {"coordinates": recorded.coordinates})
        return replace(
            result,
            sequence=result.sequence.with_facts(facts),
            # Notes of images are the track's own already.
            notes=tuple(dict.fromkeys((*recorded.notes, *result.notes))),
        )

    def _labelled(self, recorded: Recorded) -> tuple[Recorded, Mapping[str, Proposed]]:
        """Turn label maps to images, with the landmarks that they propose."""
        images = recorded.images
        if not self.labels and (images is None or not is_label_map(images)):
            return recorded, {}
        if images is None:
            raise ParameterError(
                "A label is named, but there are no images.",
                remedy="Leave the label out, or give a label map as NIfTI, NRRD or MetaImage.",
            )
        made = from_labels(images, self.labels)
        stated = {**recorded.landmarks, **self.landmarks}
        outside = notes_on_landmarks(images, stated, self.reference or 0)
        notes = (*made.images.notes, *outside)
        return replace(recorded, images=made.images, notes=notes), made.landmarks


def sequence_of(
    source: Path, options: ReadOptions | None = None, *, parser: Parser | None = None
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
        if is_mesh and options.facts.tracking != "normal_displacement":
            error.remedy += (
                " In a table of files state tracking normal_displacement in its row to track it."
            )
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
    taken = inspect.signature(TrackParameters if isinstance(observed, Recorded) else track_frames)
    if unknown := [name for name in options if name not in taken.parameters]:
        names = ", ".join(one.name for one in fields(TrackParameters))
        raise ParameterError(
            f"track() has no option {unknown[0]!r}.", remedy=f"Its options are {names}."
        )
    if isinstance(observed, Recorded):
        parameters = TrackParameters(**options)
        return parameters.follow(observed, start=start, progress=progress)
    return track_frames(observed, start=start, progress=progress, **options)


def segment(
    images: Images,
    *,
    landmarks: Mapping[str, Any] | None = None,
    frame: int = 0,
    start: Start | None = None,
    modes: int = USUAL_MODES,
    papillary: Papillary = "pool",
    labels: tuple[int, ...] = (),
    progress: Progress | None = None,
) -> Track:
    """Find a surface in one image.

    Parameters
    ----------
    images : Volume, PlaneSet or ImageSequence
        In LPS mm; of a sequence one frame is read.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like, mm, optional
        Needed of images that are no label map.
    frame : int
    start : MeshSequence or Template, optional
    modes, papillary, labels, progress : optional
        As of `TrackParameters` and `track`.

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
    places = {name: as_places(name, value) for name, value in (landmarks or {}).items()}
    each = (sequence.n_frames, 3)
    marks = {name: own[frame] if own.shape == each else own for name, own in places.items()}
    parameters = TrackParameters(
        landmarks=marks, time="open", modes=modes, papillary=papillary, labels=tuple(labels)
    )
    return parameters.follow(recorded_images(one), start=start, progress=progress)
