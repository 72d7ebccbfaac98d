"""What is asked of what is stored: which part of it and in which form, and of many at once."""

from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

from pydantic import FailFast, Field, StringConstraints

from modalmotion.classification import TrainingOptions
from modalmotion.errors import ParameterError
from modalmotion.signature.parameters import MOST_MODES
from modalmotion_service.schemas import from_core, requests


class DecodingRequest(from_core.JsonBody):
    """Which frames of a stream to decode."""

    first: int | None = Field(None, ge=0)
    """First frame; the stream's own by default."""
    stop: int | None = Field(None, ge=1)
    """Frame after the last."""

    @property
    def frames(self) -> range | None:
        """Frames to decode; None for all.

        Raises
        ------
        ParameterError
            If the range has only one end.
        """
        if (self.first is None) != (self.stop is None):
            raise ParameterError(
                "The range of frames has only one end.", remedy="Give first and stop."
            )
        return None if self.first is None or self.stop is None else range(self.first, self.stop)


class SequenceList(from_core.Paging):
    """Which sequences to list."""

    subject: requests.Name | None = None
    label: requests.Name | None = None
    tracked: bool = False
    """Only those that were tracked."""


class Reconstruction(from_core.Stated):
    """At which times the surfaces are wanted: those of the frames by default."""

    times: str | None = Field(None, max_length=20_000)
    """In s (frame numbers where there are none), such as 0,0.1,0.25."""
    phases: str | None = Field(None, max_length=20_000)
    """In place of times: rising shares of the cycle, such as 0,0.37. A VTKHDF has the standard
    deviation of each vertex's coordinates between frames."""
    frames: int | None = Field(None, ge=2, le=1000)
    """In place of phases: so many in even steps."""
    max_targets: int | None = Field(None, ge=0, le=10_000)
    """Of a GLB: most morph targets, by energy."""

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


class ViewRequest(from_core.Stated):
    """Frames as they were sent, in place of what the page shows first."""

    first: int | None = Field(None, ge=0)
    """First frame."""
    stop: int | None = Field(None, ge=1)
    """Frame after the last; all by default."""


class DistanceRequest(from_core.Stated):
    """What is compared, and how."""

    to: Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}(-[0-9a-f]{16})?$")]
    """The signature to compare with, by its key or its sequence."""
    closed: bool = True
    """Both are one turn of a cycle; false for a beginning and an end."""


class ReportRequest(from_core.Stated):
    """What a report says beside the signature."""

    model: str | None = Field(None, max_length=80)
    """Model whose kept classification is reported: a name, or name@version. None by default."""


class TrackView(from_core.Stated):
    """What a picture of a track shows."""

    picture: Literal["deviations", "data", "determined", "overlay"] = "deviations"
    """Stated error on the surface, data over the surface by frame, the share of each mode that the
    data have set, or contours over the images, where these were kept."""
    frame: int | None = Field(None, ge=0)
    """Of the stated error; that of the smallest volume by default."""


class ImagesView(from_core.Stated):
    """A frame of images, in place of their description."""

    frame: int | None = Field(None, ge=0)
    """From 0: its slices in 256 shades."""
    track: from_core.SequenceId | None = None
    """Made of these images: its surface is sent too, and each slice's shift."""


class ModesRequest(from_core.Stated):
    """Which vibration modes are requested."""

    modes: int = Field(7, ge=1, le=MOST_MODES)
    """How many; rounded up where a cosine-sine pair would be split."""
    wave_speed: float = Field(1.0, gt=0)
    """c of w = c k, length unit per s."""
    shapes: bool = False
    """Of JSON: give the shapes too."""


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


class LabelledSequence(from_core.JsonBody):
    """A stored sequence, with label and subject for this request."""

    id: from_core.SequenceId
    label: requests.Name | None = Field(None, min_length=1)
    """Its own by default."""
    subject: requests.Name | None = Field(None, min_length=1)
    """Its own by default."""
    # Their values are checked by the library, which stops at the first fault.
    covariates: dict[str, Any] | None = Field(
        None, description=f"Over those stored with it. {requests.COVARIATES}"
    )


class CasesRequest(from_core.JsonBody):
    """Sequences of a request, by their ids or with what is stated of them."""

    sequences: Annotated[list[from_core.SequenceId | LabelledSequence], FailFast()]
    """Ids; label, subject and covariates are those stored with the sequence, or stated here.
    Sequences of one subject are never on both sides of a split."""

    @property
    def cases(self) -> list[LabelledSequence]:
        """All sequences in the longer form."""
        return [
            case if isinstance(case, LabelledSequence) else LabelledSequence(id=case)
            for case in self.sequences
        ]


class TrainingOptionsBody(from_core.JsonBody):
    """How a model is trained."""

    def options(self) -> TrainingOptions:
        """Translate to the library's options.

        Raises
        ------
        ParameterError
            If one is out of range.
        """
        return TrainingOptions.from_json(self.model_dump(mode="json", exclude_unset=True))


TRAINING: Final = from_core.model_of(TrainingOptionsBody, TrainingOptions)


class TrainingRequest(CasesRequest):
    """Name, sequences and options of a model to train."""

    name: str = Field(min_length=1, max_length=requests.LONGEST_NAME)
    """1 to 64 lower-case letters, digits, '.', '_' and '-'. A name that is known gets its next
    version."""
    if TYPE_CHECKING:
        options: TrainingOptionsBody
    else:
        options: TRAINING = Field(default_factory=TRAINING)


class EvaluationOptions(from_core.JsonBody):
    """Level of the class sets of a test, and a model beside the tested one."""

    coverage: float = Field(0.9, gt=0, lt=1)
    """Level of the class sets."""
    compare_with: str | None = Field(None, max_length=100)
    """Another model that is tested too: name or name@version."""


class EvaluationRequest(CasesRequest, EvaluationOptions):
    """Labelled sequences to test a model on, or to compare it with another on."""


class NormOptions(from_core.JsonBody):
    """Name and modes of a norm."""

    name: from_core.ModelName
    """1 to 64 lower-case letters, digits, '.', '_' and '-', of no other norm."""
    modes: int = Field(7, ge=1, le=MOST_MODES)
    """Of the signatures."""
    topology: str | None = Field(None, max_length=80)
    """Of the signatures; mesh for spring modes. All controls decide it together by default."""


class NormRequest(CasesRequest, NormOptions):
    """Name, controls and modes of a norm to make; one recording of each control."""


class DeviationOptions(from_core.JsonBody):
    """How rare a deviation is."""

    level: float = Field(0.05, gt=0, le=0.5)
    """Share of recordings like the controls that may be called a deviation."""


class DeviationRequest(CasesRequest, DeviationOptions):
    """Recordings to compare with a norm, each, and from five on together."""


class FeatureOptions(from_core.JsonBody):
    """Which features are read, as `SignatureFeatures` names them."""

    modes: int = Field(7, ge=1, le=MOST_MODES)
    """Of the signatures."""
    topology: str | None = Field(None, max_length=80)
    """Of the signatures; mesh for spring modes."""
    kind: Literal["auto", "axis", "summary", "modes", "terms"] = "auto"
    """Parts about the axis of the motion, modes in few numbers, modes, or modes and their terms, of
    a transient."""
    timing: Literal["auto", "cycle", "transient"] = "auto"
    covariates: Literal["all"] | list[str] | None = None
    """Names of covariates that become columns, or all."""
    on_error: Literal["raise", "leave out"] = "raise"
    """Whether sequences that do not fit end the request or are left out."""

    def options(self) -> dict[str, Any]:
        """Options of the library's features."""
        return self.model_dump(exclude={"on_error"})


class FeaturesRequest(CasesRequest, FeatureOptions):
    """Sequences, and which of their features are read."""
