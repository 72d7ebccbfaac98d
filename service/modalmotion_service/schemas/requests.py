"""What requests with a file or for a signature state: how it is read, what is made of it."""

from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal, get_type_hints

from pydantic import FailFast, Field, StringConstraints

from modalmotion import classification, codec, errors, formats
from modalmotion.classification import model_files
from modalmotion.mesh.facts import LONGEST_MODALITY, NO_FACTS, Facts
from modalmotion.signature.making import SignatureParameters
from modalmotion.signature.parameters import MOST_MODES
from modalmotion.signature.tradeoff import MOST_OF_FRONT
from modalmotion.template import GivenLandmarks, body_frame
from modalmotion.tracking.label_values import whole_labels
from modalmotion.tracking.landmarks import landmarks_of, places_of
from modalmotion.tracking.parameters import TrackParameters, require_surface_tracking
from modalmotion_service.schemas import from_core

_FACTS: Final = from_core.descriptions(Facts)


COVARIATES: Final = _FACTS["covariates"]


LONGEST_NAME: Final = 200


Name = Annotated[str, StringConstraints(max_length=LONGEST_NAME)]


# As the library takes them: absent for unknown. The values of the last two are checked by it, which
# stops at the first fault.
_HINTS: Final[dict[str, Any]] = {
    **get_type_hints(Facts),
    "period": Annotated[float, Field(gt=0)],
    "modality": Annotated[str, StringConstraints(max_length=LONGEST_MODALITY)],
    **dict.fromkeys(("landmarks", "covariates"), dict[str, Any]),
}
_FACT_FIELDS: Final[dict[str, Any]] = {
    name: (hint | None, Field(None, description=_FACTS[name])) for name, hint in _HINTS.items()
}


class Named(from_core.JsonBody):
    """Whose recording it is, and what it shows."""

    subject: Name | None = None
    """Whose surface it is."""
    label: Name | None = None
    """Known motion class."""


class FactsChange(from_core.JsonBody):
    """A change of facts: what is left out stays, null makes it unknown."""

    @property
    def changes(self) -> dict[str, Any]:
        """The stated facts, as `facts_patched` takes them."""
        return {name: getattr(self, name) for name in self.model_fields_set}


FACTS_CHANGE: Final = from_core.model_of(FactsChange, **_FACT_FIELDS)


class SequenceChange(Named):
    """What is stated of a sequence: a missing member stays, null removes it."""

    name: Name | None = None
    """What to call it, such as the name of a file."""
    if TYPE_CHECKING:
        facts: FactsChange | None
    else:
        facts: FACTS_CHANGE | None = Field(
            None, description="Null makes all unknown; landmarks and covariates change by name."
        )
    unit: str | None = Field(None, max_length=20)
    """m, cm, mm, um or nm."""
    times: list[float] | None = Field(None, max_length=100_000)
    """Of the frames, in s, rising."""


class Reading(from_core.JsonBody):
    """How to read a file, and statements that override its own."""

    def options(self, limits: formats.ReadLimits, facts: Facts = NO_FACTS) -> formats.ReadOptions:
        """Translate to the reader's options."""
        return from_core.value_of(self, formats.ReadOptions, limits=limits, facts=facts)


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


class SequenceStatements(Reading, Named):
    """Statements about a sequence to be stored."""


SEQUENCE: Final = from_core.model_of(SequenceStatements, formats.ReadOptions, **_READING)


class SignatureRequest(from_core.JsonBody):
    """Which signature: its modes by number, tolerance or noise, and what they are measured from."""

    amplitudes: int | None = Field(
        None,
        ge=1,
        le=3 * MOST_MODES,
        description=from_core.descriptions(SignatureParameters)["amplitudes"],
    )

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters."""
        # Of a file landmarks are facts, which the fit reads itself.
        given = getattr(self, "landmarks", None)
        landmarks = given if isinstance(given, GivenLandmarks) else GivenLandmarks()
        return from_core.value_of(
            self, SignatureParameters, amplitudes=self.amplitudes, landmarks=landmarks
        )


_SIGNATURE: Final[dict[str, Any]] = {
    "modes": {"ge": 1, "le": MOST_MODES},
    "harmonics": {"le": 10_000},
}


SIGNATURE: Final = from_core.model_of(SignatureRequest, SignatureParameters, **_SIGNATURE)


class SignatureOfFile(Reading, SignatureRequest):
    """How to read a file, and which signature of the sequence in it; landmarks are facts."""


SIGNATURE_OF_FILE: Final = from_core.model_of(
    SignatureOfFile, formats.ReadOptions, SignatureParameters, **{**_SIGNATURE, **_READING}
)


class TradeRequest(SignatureRequest):
    """A point on the front of a trade, and how far the front reaches."""

    front_modes: int = Field(MOST_OF_FRONT, ge=1, le=MOST_MODES)
    """Modes that the front reaches to."""
    only: body_frame.Components | None = None
    """The only components that are measured; all that the surface has by default."""

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters, in the components that are measured."""
        own = super().parameters()
        return own if self.only is None else replace(own, components=self.only)


TRADE: Final = from_core.model_of(TradeRequest, SignatureParameters, **_SIGNATURE)


class ManySignatures(SignatureRequest):
    """Which signatures of which sequences."""

    ids: Annotated[list[from_core.SequenceId], FailFast()] = Field(min_length=1)
    """Of the sequences, in order."""


MANY_SIGNATURES: Final = from_core.model_of(ManySignatures, SignatureParameters, **_SIGNATURE)


class EncodingTarget(from_core.Stated):
    """At what error, or at what size, to encode: one of the three, or 0.3 % of the diagonal."""

    rms: float | None = Field(None, gt=0)
    """RMS distance of all vertices, not exceeded."""
    max_error: float | None = Field(None, gt=0)
    """Distance of any vertex, never exceeded."""
    bytes: int | None = Field(None, gt=0)
    """Size of the stream, not exceeded."""
    effort: codec.Effort = codec.Effort.BALANCED
    """How many transforms are tried: fast takes a third of the time, in more bits."""


class EncodingOfFile(Reading, EncodingTarget):
    """How to read a file, and at what error to encode the sequence in it."""

    @property
    def target(self) -> EncodingTarget:
        """Error or size alone."""
        return EncodingTarget(**self.model_dump(include=set(EncodingTarget.model_fields)))


ENCODING_OF_FILE: Final = from_core.model_of(EncodingOfFile, formats.ReadOptions, **_READING)


class ClassificationRequest(from_core.JsonBody):
    """The model, and how sure its class set must be."""

    model: str = Field(
        classification.DEFAULT_MODEL,
        max_length=100,
        description=f"Name of a model for its newest version, or name@version. {model_files.RULE}",
    )
    coverage: float = Field(0.9, gt=0, lt=1)
    """Probability that the class set contains the true class, for every class."""


class ClassOfFile(Reading, ClassificationRequest):
    """How to read a file, the model, and how sure its class set must be."""


CLASS_OF_FILE: Final = from_core.model_of(ClassOfFile, formats.ReadOptions, **_READING)


class TrackRequest(Named):
    """How to track, and statements about the recording, which override its files'."""

    own_names: ClassVar[frozenset[str]] = frozenset({"landmarks"})

    start: from_core.SequenceId | None = None
    """A stored sequence: the surface of its first frame is started from, and the result has its
    vertices."""
    images: from_core.SequenceId | None = None
    """Images that were sent before, in place of a body."""
    keep: bool = False
    """Keep the images; they are deleted once tracked otherwise."""
    report: bool = False
    """Make a zip with every form of a report, as a job whose result it is."""
    model: str | None = Field(None, max_length=80)
    """Whose class the report states; none by default."""
    landmarks: dict[str, Any] | None = None
    """By name: apex and base as a point [x, y, z] in the reference frame, or one for each frame
    with null where it is unknown."""
    times: tuple[float, ...] | None = Field(None, max_length=100_000)
    """Of all frames, in s."""
    frame_interval: float | None = Field(None, gt=0)
    """In s, in place of times."""

    def parameters(self, facts: Facts) -> TrackParameters:
        """Translate to the library's parameters.

        Raises
        ------
        ParameterError
            If one cannot be read, or two contradict each other.
        """
        if self.keep and self.images is None:
            raise errors.ParameterError(
                "Images are to be kept, and none are named.",
                remedy="Send them to POST /v1/images first, and name them: images=ID&keep=true.",
            )
        if self.model is not None and not self.report:
            raise errors.ParameterError(
                "A model is named, and no report is asked for.",
                remedy="Say report=true; or ask for the class of the track's sequence afterwards.",
            )
        if self.times is not None and self.frame_interval is not None:
            raise errors.ParameterError(
                "Both times and an interval between frames are stated.", remedy="Keep one."
            )
        times = self.frame_interval if self.times is None else self.times
        require_surface_tracking(facts)
        own = {name: places_of(name, at) for name, at in (self.landmarks or {}).items()}
        landmarks = landmarks_of(facts) | own
        made = from_core.value_of(self, TrackParameters, landmarks=landmarks, times=times)
        if self.images is not None:
            whole_labels(made.labels)
        return made


TRACK: Final = from_core.model_of(
    TrackRequest,
    TrackParameters,
    **{name: how for name, how in _FACT_FIELDS.items() if name != "landmarks"},
    modes={"ge": 2, "le": 400},
    reference={"ge": 0},
)


class ImagesStatements(from_core.JsonBody):
    """Nothing is stated beside images."""
