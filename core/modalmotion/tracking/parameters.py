"""Options of a track, the same in Python, for the command line and over HTTP."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from numbers import Integral
from typing import Any, Final, Literal, TypeAlias

from modalmotion import errors, mesh
from modalmotion.arguments.checking import whole
from modalmotion.representation import shown
from modalmotion.tracking.result import CONVENTIONS, Papillary

Time: TypeAlias = Literal["cycle", "open"]

USUAL_MODES: Final = 37


@shown()
@dataclass(frozen=True)
class TrackParameters:
    """How to track observations, and statements that override those of the files.

    Parameters
    ----------
    topology : str, optional
        Topology of a start without a surface, such as cup, sphere or cylinder. By default a cup
        where apex and base are stated, else a sphere.
    modes : int
        Modes, three amplitudes per frame each. At least 2; rounded up so that no pair is split.
    time : {"cycle", "open"}
        Whether the frames are one period, or part of a motion.
    reference : int or None
        Frame in which tracking starts. A start is its surface, exactly; that of no frame where it
        is None. Without a start the shape is taken from it. Of images it is also the frame whose
        brightness counts, and a start is only where the search begins.
    landmarks : mapping of "apex" and "base" to (3,) or (frames, 3) array_like
        Places in the length unit of the points; they override those of the files by name. One place
        is that in the reference frame; of several a row of NaN is unknown. The end of a surface is
        what points cannot show: state it in as many frames as can be.
    papillary : {"pool", "wall"}
        Of images: whether papillary muscles count as cavity in volumes.
    labels : tuple of str or int
        Label of the cavity in a label map, or parts of the names of the typed contours to read. By
        default the label that another one encloses, and LV_ENDOCARDIAL. "none": it is no label map
        but a grey image of few whole numbers.
    unit : str, optional
        Length unit: m, cm, mm, um or nm.
    times : tuple of float, or float, s, optional
        Of all frames, or the interval from frame to frame.
    """

    topology: str | None = None
    modes: int = USUAL_MODES
    time: Time = "cycle"
    reference: int | None = 0
    landmarks: Mapping[str, Any] = field(default_factory=dict)
    papillary: Papillary = "pool"
    labels: tuple[str | int, ...] = ()
    unit: str | None = None
    times: tuple[float, ...] | float | None = None

    def __post_init__(self) -> None:
        if self.time not in ("cycle", "open"):
            raise errors.ParameterError(
                f"The option time is {self.time!r:.40}.",
                remedy="Use cycle (one whole period) or open.",
            )
        if self.papillary not in CONVENTIONS:
            raise errors.ParameterError(
                f"The papillary muscle convention is {self.papillary!r:.40}.",
                remedy="Use pool (they count as cavity) or wall (they do not).",
            )
        if not isinstance(self.landmarks, Mapping | None):
            raise errors.ParameterError(
                f"The landmarks are {self.landmarks!r:.40}, without names.",
                remedy='Give each with its name, such as {"apex": (x, y, z)}.',
            )
        # A text would be taken apart to letters, each of which is part of some name.
        is_list = isinstance(self.labels, tuple | list)
        if not is_list or not all(isinstance(one, str | Integral) for one in self.labels):
            raise errors.ParameterError(
                f"The labels are {self.labels!r:.40}.",
                remedy="Give a list of whole numbers, or of names, such as (3,).",
            )
        if whole("modes", self.modes) < 2:
            raise errors.ModeCountError(
                f"{self.modes} modes are a translation at most.",
                remedy="Ask for 2 modes or more (mode 0 is a translation); 37 are usual.",
            )


def require_surface_tracking(facts: mesh.Facts) -> None:
    """Refuse facts that state that tissue was tracked.

    Raises
    ------
    ParameterError
    """
    if facts.tracking not in ("normal_displacement", "unknown"):
        raise errors.ParameterError(
            f"The fact 'tracking' is {facts.tracking!r}: tracking follows the surface, not its "
            "tissue.",
            remedy="Leave it out; it becomes normal_displacement.",
            details={"fact": "tracking"},
        )
