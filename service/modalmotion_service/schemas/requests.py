"""What requests say: how a file is read, which signature is meant, what is made of it."""

from __future__ import annotations

from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, TypeVar

from pydantic import FailFast, Field, StringConstraints

from modalmotion.classification import DEFAULT_MODEL, TrainingOptions
from modalmotion.classification.model_files import RULE
from modalmotion.codec import Effort
from modalmotion.errors import ParameterError
from modalmotion.formats import ReadLimits, ReadOptions
from modalmotion.mesh import NAMES, NO_FACTS, Facts
from modalmotion.mesh.facts import (
    LONGEST_MODALITY,
    Cavity,
    CoordinateSystem,
    Handedness,
    Tracking,
)
from modalmotion.signature import MOST_OF_FRONT
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import MOST_MODES
from modalmotion.template import GivenLandmarks
from modalmotion.template.body_frame import Components
from modalmotion.tracking.landmarks import landmarks_of, places_of
from modalmotion.tracking.parameters import TrackParameters
from modalmotion_service.schemas.fields import JsonBody, ModelName, Paging, SequenceId
from modalmotion_service.schemas.from_core import descriptions, model_of, value_of

_FACTS: Final = descriptions(Facts)
COVARIATES: Final = _FACTS["covariates"]
_LONGEST_NAME: Final = 200

Name = Annotated[str, StringConstraints(max_length=_LONGEST_NAME)]
Options = TypeVar("Options", bound=JsonBody)


def _unknown(name: str, hint: Any, **limits: Any) -> Any:
    return (hint | None, Field(None, description=_FACTS[name], **limits))


# As the library takes them: absent for unknown.
_FACT_FIELDS: Final[dict[str, Any]] = {
    "tracking": _unknown("tracking", Tracking),
    "handedness": _unknown("handedness", Handedness),
    "coordinates": _unknown("coordinates", CoordinateSystem),
    "period": _unknown("period", float, gt=0),
    "cavity": _unknown("cavity", Cavity),
    "modality": _unknown("modality", str, max_length=LONGEST_MODALITY),
    # Their values are checked by the library, which stops at the first fault.
    "landmarks": _unknown("landmarks", dict[str, Any]),
    "covariates": _unknown("covariates", dict[str, Any]),
}
_NAME_FIELDS: Final[dict[str, Any]] = {
    "subject": (Name | None, Field(None, description="Whose surface it is.")),
    "label": (Name | None, Field(None, description="Known motion class.")),
}


class FactsChange(JsonBody):
    """A change of facts: what is left out stays, null makes it unknown."""

    @property
    def changes(self) -> dict[str, Any]:
        """The stated facts, as `facts_patched` takes them."""
        return {name: getattr(self, name) for name in self.model_fields_set}


FACTS_CHANGE: Final = model_of(FactsChange, **_FACT_FIELDS)


class SequenceChange(JsonBody):
    """What is stated of a sequence: a missing member stays, null removes it."""

    name: Name | None = Field(None, description="What to call it, such as the name of a file.")
    subject: Name | None = Field(None, description="Whose surface it is.")
    label: Name | None = Field(None, description="Known motion class.")
    if TYPE_CHECKING:
        facts: FactsChange | None
    else:
        facts: FACTS_CHANGE | None = Field(
            None, description="Null makes all unknown; landmarks and covariates change by name."
        )
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    times: list[float] | None = Field(
        None, max_length=100_000, description="Of the frames, in s, rising."
    )

    @property
    def restates(self) -> bool:
        """Whether it makes another sequence: unit and times are part of its id."""
        return bool(self.model_fields_set & {"unit", "times"})


class Reading(JsonBody):
    """How to read a file, and statements that override its own."""

    def stated_facts(self) -> dict[str, Any]:
        """Facts that are stated here, ready for `facts_from_texts`."""
        known = type(self).model_fields
        values = {name: getattr(self, name) for name in NAMES if name in known}
        return {name: value for name, value in values.items() if value is not None}

    @cached_property
    def _options(self) -> ReadOptions:
        return value_of(self, ReadOptions, facts=NO_FACTS)

    def options(self, limits: ReadLimits, facts: Facts = NO_FACTS) -> ReadOptions:
        """Translate to the reader's options; once but for limits and facts, for requests repeat."""
        return replace(self._options, limits=limits, facts=facts)


_GRID: Final = (
    tuple[Annotated[int, Field(ge=1, lt=10**9)], ...] | None,
    Field(None, description="Nodes along each axis of a lattice."),
)
_READING: Final[dict[str, Any]] = {
    "grid": _GRID,
    "limits": None,
    "facts": None,
    "dtype": (Literal["float32", "float64"], Field("float32", description="Of raw numbers.")),
    "n_vertices": {"ge": 1},
    **_FACT_FIELDS,
}


class FileStatements(Reading):
    """Statements about a file."""


class SequenceStatements(Reading):
    """Statements about a sequence to be stored."""

    subject: str | None
    label: str | None


SEQUENCE: Final = model_of(SequenceStatements, ReadOptions, **_READING, **_NAME_FIELDS)


class SignatureRequest(JsonBody):
    """Which signature: its modes by number, tolerance or noise, and what they are measured from."""

    amplitudes: int | None

    @cached_property
    def _parameters(self) -> SignatureParameters:
        # Of a file landmarks are facts, which the fit reads itself.
        given = getattr(self, "landmarks", None)
        landmarks = given if isinstance(given, GivenLandmarks) else GivenLandmarks()
        return value_of(self, SignatureParameters, amplitudes=self.amplitudes, landmarks=landmarks)

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters; once, for requests share what they repeat."""
        return self._parameters


_SIGNATURE: Final[dict[str, Any]] = {
    "grid": _GRID,
    "modes": {"ge": 1, "le": MOST_MODES},
    "harmonics": {"le": 10_000},
    "amplitudes": (
        int | None,
        Field(
            None,
            ge=1,
            le=3 * MOST_MODES,
            description=descriptions(SignatureParameters)["amplitudes"],
        ),
    ),
}
SIGNATURE: Final = model_of(SignatureRequest, SignatureParameters, **_SIGNATURE)


class SignatureOfFile(Reading, SignatureRequest):
    """How to read a file, and which signature of the sequence in it; landmarks are facts."""


SIGNATURE_OF_FILE: Final = model_of(
    SignatureOfFile, ReadOptions, SignatureParameters, **{**_SIGNATURE, **_READING}
)


class TradeRequest(SignatureRequest):
    """A point on the front of a trade, and how far the front reaches."""

    front_modes: int = Field(
        MOST_OF_FRONT, ge=1, le=MOST_MODES, description="Modes that the front reaches to."
    )
    only: Components | None = Field(
        None,
        description="The only components that are measured; all that the surface has by default.",
    )

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters, in the components that are measured."""
        own = super().parameters()
        return own if self.only is None else replace(own, components=self.only)


TRADE: Final = model_of(TradeRequest, SignatureParameters, **_SIGNATURE)


class ManySignatures(SignatureRequest):
    """Which signatures of which sequences."""

    ids: Annotated[list[SequenceId], FailFast()] = Field(
        min_length=1, description="Of the sequences, in order."
    )


MANY_SIGNATURES: Final = model_of(ManySignatures, SignatureParameters, **_SIGNATURE)


class EncodingTarget(JsonBody):
    """At what error, or at what size, to encode: one of the three."""

    rms: float | None = Field(None, gt=0, description="RMS distance of all vertices, not exceeded.")
    max_error: float | None = Field(
        None, gt=0, description="Distance of any vertex, never exceeded."
    )
    bytes: int | None = Field(None, gt=0, description="Size of the stream, not exceeded.")
    effort: Effort = Field(
        Effort.BALANCED,
        description="How many transforms are tried: fast takes a third of the time, in more bits.",
    )


class EncodingOfFile(Reading, EncodingTarget):
    """How to read a file, and at what error to encode the sequence in it."""

    @property
    def target(self) -> EncodingTarget:
        """Error or size alone."""
        return EncodingTarget(**self.model_dump(include=set(EncodingTarget.model_fields)))


ENCODING_OF_FILE: Final = model_of(EncodingOfFile, ReadOptions, **_READING)


class ModelRequest(JsonBody):
    """The model, and how sure its class set must be."""

    model: str = Field(
        DEFAULT_MODEL,
        max_length=100,
        description=f"Name of a model for its newest version, or name@version. {RULE}",
    )
    coverage: float = Field(
        0.9,
        gt=0,
        lt=1,
        description="Probability that the class set holds the true class, for every class.",
    )


class ClassificationRequest(ModelRequest):
    """The model, how sure its class set must be, and what the recording does not carry."""

    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with the sequence. {COVARIATES}"
    )


class ClassOfFile(Reading, ModelRequest):
    """How to read a file, the model, and how sure its class set must be."""


CLASS_OF_FILE: Final = model_of(ClassOfFile, ReadOptions, **_READING)


class DecodingRequest(JsonBody):
    """Which frames and vertices of a stream to decode."""

    first: int | None = Field(None, ge=0, description="First frame; the stream's own by default.")
    stop: int | None = Field(None, ge=1, description="Frame after the last.")
    first_vertex: int | None = Field(
        None, ge=0, description="First vertex; of some vertices come the triangles between them."
    )
    stop_vertex: int | None = Field(None, ge=1, description="Vertex after the last.")

    def ranges(self) -> tuple[range | None, range | None]:
        """Give the frames and the vertices; None for all.

        Raises
        ------
        ParameterError
            If a range has only one end.
        """
        return (
            _range(self.first, self.stop, "frames", "first and stop"),
            _range(self.first_vertex, self.stop_vertex, "vertices", "first_vertex and stop_vertex"),
        )


def _range(first: int | None, stop: int | None, what: str, names: str) -> range | None:
    if (first is None) != (stop is None):
        raise ParameterError(f"The range of {what} has only one end.", remedy=f"Give {names}.")
    return None if first is None or stop is None else range(first, stop)


class TrackRequest(JsonBody):
    """How to track, and statements about the recording, which override its files'."""

    own_names: ClassVar[frozenset[str]] = frozenset({"landmarks"})

    start: str | None
    images: str | None
    keep: bool
    report: bool
    model: str | None
    times: tuple[float, ...] | None
    frame_interval: float | None
    subject: str | None
    label: str | None

    def parameters(self, facts: Facts) -> TrackParameters:
        """Translate to the library's parameters.

        Raises
        ------
        ParameterError
            If one cannot be read, or two contradict each other.
        """
        if self.keep and self.images is None:
            raise ParameterError(
                "Images are to be kept, and none are named.",
                remedy="Send them to POST /v1/images first, and name them: images=ID&keep=true.",
            )
        if self.model is not None and not self.report:
            raise ParameterError(
                "A model is named, and no report is asked for.",
                remedy="Say report=true; or ask for the class of the track's sequence afterwards.",
            )
        if self.times is not None and self.frame_interval is not None:
            raise ParameterError(
                "Both times and an interval between frames are stated.", remedy="Keep one."
            )
        times = self.frame_interval if self.times is None else self.times
        own = getattr(self, "landmarks", None) or {}
        landmarks = landmarks_of(facts) | {name: places_of(name, at) for name, at in own.items()}
        return value_of(
            self,
            TrackParameters,
            landmarks=landmarks,
            times=times,
            facts=replace(facts, landmarks={}),
        )


TRACK: Final = model_of(
    TrackRequest,
    TrackParameters,
    **{
        **_FACT_FIELDS,
        "facts": None,
        "landmarks": (
            dict[str, Any] | None,
            Field(
                None,
                description="By name: apex and base as a point [x, y, z] in the reference frame, "
                "or one for each frame with null where it is unknown.",
            ),
        ),
        "times": (
            tuple[float, ...] | None,
            Field(None, max_length=100_000, description="Of all frames, in s."),
        ),
        "frame_interval": (
            float | None,
            Field(None, gt=0, description="In s, in place of times."),
        ),
        "modes": {"ge": 2, "le": 400},
        "reference": {"ge": 0},
        "start": (
            SequenceId | None,
            Field(
                None,
                description="A stored sequence: the surface of its first frame is started from, "
                "and the result has its vertices.",
            ),
        ),
        "images": (
            SequenceId | None,
            Field(None, description="Images that were sent before, in place of a body."),
        ),
        "keep": (
            bool,
            Field(False, description="Keep the images; they are deleted once tracked otherwise."),
        ),
        "report": (
            bool,
            Field(
                False,
                description="Make a zip with every form of a report, as a job whose result it is.",
            ),
        ),
        "model": (
            str | None,
            Field(
                None, max_length=80, description="Whose class the report states; none by default."
            ),
        ),
        **_NAME_FIELDS,
    },
)


class SequenceList(Paging):
    """Which sequences to list."""

    subject: Name | None = None
    label: Name | None = None
    tracked: bool = Field(False, description="Only those that were tracked.")


class Reconstruction(JsonBody):
    """At which times the surfaces are wanted: those of the frames by default."""

    times: str | None = Field(
        None,
        max_length=20_000,
        description="In s (frame numbers where there are none), such as 0,0.1,0.25.",
    )
    phases: str | None = Field(
        None,
        max_length=20_000,
        description="In place of times: rising shares of the cycle, such as 0,0.37. A VTKHDF has "
        "the standard deviation of each vertex's coordinates between frames.",
    )
    frames: int | None = Field(
        None, ge=2, le=1000, description="In place of phases: so many in even steps."
    )
    max_targets: int | None = Field(
        None, ge=0, le=10_000, description="Of a GLB: most morph targets, by energy."
    )

    def instants(self) -> tuple[list[float] | None, list[float] | int | None]:
        """Give times and phases.

        Raises
        ------
        ParameterError
            If several are stated, or one is no number.
        """
        stated = [one for one in (self.times, self.phases, self.frames) if one is not None]
        if len(stated) > 1:
            raise ParameterError(
                "Several of times, phases and frames came.", remedy="Give one of them."
            )
        times = None if self.times is None else parse_numbers(self.times)
        return times, self.frames if self.phases is None else parse_numbers(self.phases)


class ViewRequest(JsonBody):
    """Frames as they were sent, in place of what the page shows first."""

    first: int | None = Field(None, ge=0, description="First frame.")
    stop: int | None = Field(None, ge=1, description="Frame after the last; all by default.")


class DistanceRequest(JsonBody):
    """What is compared, and how."""

    to: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}(-[0-9a-f]{16})?$")] = Field(
        description="The signature to compare with, by its key or its sequence."
    )
    closed: bool = Field(
        True, description="Both are one turn of a cycle; false for a beginning and an end."
    )


class ReportRequest(JsonBody):
    """What a report says beside the signature."""

    model: str | None = Field(
        None,
        max_length=80,
        description="Model whose kept classification is reported: a name, or name@version. None "
        "by default.",
    )


class TrackView(JsonBody):
    """What a picture of a track shows."""

    picture: Literal["deviations", "data", "determined", "overlay"] = Field(
        "deviations",
        description="Stated error on the surface, data over the surface by frame, the share of "
        "each mode that the data have set, or contours over the images, where these were kept.",
    )
    frame: int | None = Field(
        None, ge=0, description="Of the stated error; that of the smallest volume by default."
    )


class ImagesView(JsonBody):
    """A frame of images, in place of their description."""

    frame: int | None = Field(None, ge=0, description="From 0: its slices in 256 shades.")
    track: SequenceId | None = Field(
        None, description="Made of these images: its surface is sent too, and each slice's shift."
    )


class ModesRequest(JsonBody):
    """Which vibration modes are requested."""

    modes: int = Field(
        7,
        ge=1,
        le=MOST_MODES,
        description="How many; rounded up where a cosine-sine pair would be split.",
    )
    wave_speed: float = Field(1.0, gt=0, description="c of w = c k, length unit per s.")
    shapes: bool = Field(False, description="Of JSON: give the shapes too.")


class LabelledSequence(JsonBody):
    """A stored sequence, with label and subject for this request."""

    id: SequenceId
    label: Name | None = Field(None, min_length=1, description="Its own by default.")
    subject: Name | None = Field(None, min_length=1, description="Its own by default.")
    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with it. {COVARIATES}"
    )


class CasesRequest(JsonBody):
    """Sequences of a request, by their ids or with what is stated of them."""

    sequences: Annotated[list[SequenceId | LabelledSequence], FailFast()] = Field(
        description="Ids; label, subject and covariates are those stored with the sequence, or "
        "stated here. Sequences of one subject are never on both sides of a split."
    )

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return [
            case if isinstance(case, LabelledSequence) else LabelledSequence(id=case)
            for case in self.sequences
        ]

    def without_cases(self, kind: type[Options]) -> Options:
        """Give all but the sequences."""
        known = self.model_dump(include=set(kind.model_fields), exclude_unset=True)
        return kind.model_validate(known)


class TrainingOptionsBody(JsonBody):
    """How a model is trained."""

    def options(self) -> TrainingOptions:
        """Translate to the library's options.

        Raises
        ------
        ParameterError
            If one is out of range.
        """
        return TrainingOptions.from_json(self.model_dump(mode="json", exclude_unset=True))


TRAINING: Final = model_of(TrainingOptionsBody, TrainingOptions)


class TrainingRequest(CasesRequest):
    """Name, sequences and options of a model to train."""

    name: str = Field(
        min_length=1,
        max_length=_LONGEST_NAME,
        description="1 to 64 lower-case letters, digits, '.', '_' and '-'. A name that is known "
        "gets its next version.",
    )
    if TYPE_CHECKING:
        options: TrainingOptionsBody
    else:
        options: TRAINING = Field(default_factory=TRAINING)


class EvaluationOptions(JsonBody):
    """Level of the class sets of a test, and a model beside the tested one."""

    coverage: float = Field(0.9, gt=0, lt=1, description="Level of the class sets.")
    compare_with: str | None = Field(
        None, max_length=100, description="Another model that is tested too: name or name@version."
    )


class EvaluationRequest(CasesRequest, EvaluationOptions):
    """Labelled sequences to test a model on, or to compare it with another on."""


class NormOptions(JsonBody):
    """Name and modes of a norm."""

    name: ModelName = Field(
        description="1 to 64 lower-case letters, digits, '.', '_' and '-', of no other norm."
    )
    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None,
        max_length=80,
        description="Of the signatures; mesh for spring modes. All controls decide it together "
        "by default.",
    )


class NormRequest(CasesRequest, NormOptions):
    """Name, controls and modes of a norm to make; one recording of each control."""


class DeviationOptions(JsonBody):
    """How rare a deviation is."""

    level: float = Field(
        0.05,
        gt=0,
        le=0.5,
        description="Share of recordings like the controls that may be called a deviation.",
    )


class DeviationRequest(CasesRequest, DeviationOptions):
    """Recordings to compare with a norm, each, and from five on together."""


class FeatureOptions(JsonBody):
    """Which features are read, as `SignatureFeatures` names them."""

    modes: int = Field(7, ge=1, le=MOST_MODES, description="Of the signatures.")
    topology: str | None = Field(
        None, max_length=80, description="Of the signatures; mesh for spring modes."
    )
    kind: Literal["auto", "axis", "summary", "modes", "terms"] = Field(
        "auto",
        description="Parts about the axis of the motion, modes in few numbers, modes, or modes "
        "and their terms.",
    )
    timing: Literal["auto", "cycle", "transient"] = "auto"
    covariates: Literal["all"] | list[str] | None = Field(
        None, description="Names of covariates that become columns, or all."
    )
    on_error: Literal["raise", "leave out"] = Field(
        "raise", description="Whether sequences that do not fit end the request or are left out."
    )

    def options(self) -> dict[str, Any]:
        """Options of the library's features."""
        return self.model_dump(exclude={"on_error"})


class FeaturesRequest(CasesRequest, FeatureOptions):
    """Sequences, and which of their features are read."""


def parse_numbers(text: str) -> list[float]:
    """Read numbers such as "0,0.1,0.25".

    Raises
    ------
    ParameterError
        If one of them is not a number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(
            f"{text[:60]!r} are not all numbers.", remedy="Write them as 0,0.1,0.25."
        ) from None


class ImagesStatements(JsonBody):
    """Nothing is stated beside images."""


BODIES: Final[tuple[type[JsonBody], ...]] = (
    *(SEQUENCE, SIGNATURE, SIGNATURE_OF_FILE, TRADE, MANY_SIGNATURES, ENCODING_OF_FILE),
    *(CLASS_OF_FILE, TRACK, SequenceChange, ClassificationRequest, DecodingRequest),
    *(TrainingRequest, EvaluationRequest, NormRequest, DeviationRequest, FeaturesRequest),
    ImagesStatements,
)
"""Models that bodies and statements are read as."""

_ID: Final = "3f5c" * 16
EXAMPLES: Final[dict[str, Any]] = {
    "SequenceStatements": {"unit": "mm", "subject": "P-7", "cavity": "lv"},
    "SignatureRequest": {"modes": 18, "reference": "mean"},
    "SignatureOfFile": {"modes": 7, "unit": "mm"},
    "TradeRequest": {"tolerance": 0.5},
    "ManySignatures": {"ids": [_ID], "modes": 7},
    "EncodingOfFile": {"max_error": 0.5, "unit": "mm"},
    "ClassOfFile": {"model": DEFAULT_MODEL, "unit": "mm"},
    "TrackRequest": {"modes": 37, "landmarks": {"apex": [0, 0, -40], "base": [0, 0, 40]}},
    "SequenceChange": {"label": "rest", "facts": {"period": 0.8, "covariates": {"age": 61}}},
    "ClassificationRequest": {"model": DEFAULT_MODEL, "coverage": 0.95},
    "DecodingRequest": {"first": 2, "stop": 5},
    "TrainingRequest": {
        "name": "wall-motion",
        "sequences": [_ID, {"id": _ID, "label": "akinesia"}],
        "options": {"modes": 7},
    },
    "EvaluationRequest": {"sequences": [_ID], "compare_with": "wall-motion@1"},
    "NormRequest": {"name": "volunteers", "sequences": [_ID], "modes": 7},
    "DeviationRequest": {"sequences": [_ID], "level": 0.05},
    "FeaturesRequest": {"sequences": [_ID], "covariates": ["age"]},
    "sequence_id": _ID,
    "key": f"{_ID}-0a1b2c3d4e5f6071",
    "images_id": _ID,
    "track_id": _ID,
    "template_id": _ID,
    "job_id": "0a1b" * 8,
    "name": "wall-motion",
}
"""Of each body, by the name of its model; and of what stands in a path."""
