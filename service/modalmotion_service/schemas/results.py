"""Compressed streams, classes, read-outs, and answers for many files."""

from pydantic import Field

from modalmotion import clinical, codec
from modalmotion.classification import FLAGS, Classification, answer
from modalmotion.clinical.readouts import Rates
from modalmotion.clinical.strain import Torsion
from modalmotion.clinical.ventricle import Sensitivities, VentricleReadouts, readouts_json
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.notes import Note
from modalmotion_service.schemas import general, signatures
from modalmotion_service.schemas.from_core import Answer, Paged, mirrors, read_from


class EncodedAnswer(Answer):
    """Size and errors of a stream, measured by decoding it; sent as headers beside it."""

    n_bytes: int
    bits_per_vertex_and_frame: float
    rms: float
    max_error: float
    kg_error: float
    transform: str

    @staticmethod
    def of(stream: codec.Encoded) -> "EncodedAnswer":
        """Write the measurements out."""
        return read_from(EncodedAnswer, stream)

    @property
    def headers(self) -> dict[str, str]:
        """As headers: Encoded-RMS, Encoded-Max-Error, ..."""
        return {
            f"Encoded-{name.replace('_', '-').title()}": str(value)
            for name, value in self.model_dump().items()
        }


@mirrors(answer.ModeContribution)
class ContributionAnswer(Answer):
    """Contribution of one mode, or a cosine-sine pair, to a prediction."""


@mirrors(Classification, without=["classes"])
class ClassificationAnswer(Answer):
    """Answer of a model for one sequence."""

    version: int | None
    """Of the model; null if it has been deleted."""
    probability: float
    """Of the most probable class."""
    probabilities: dict[str, float]
    flags: list[str] = Field(description=f"{', '.join(FLAGS)}; with any of them there is no label.")
    explanation: list[ContributionAnswer]
    intended_use: str = INTENDED_USE
    file: str | None
    """HDF5 file of this result, within the data folder; null if not stored."""

    @staticmethod
    def of(
        result: Classification, version: int | None, file: str | None = None
    ) -> "ClassificationAnswer":
        """Write a classification out."""
        return read_from(
            ClassificationAnswer,
            result,
            version=version,
            probabilities=dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
            file=file,
        )


class UploadClassificationAnswer(ClassificationAnswer):
    """Answer of a model for an upload that is not stored."""

    reading: general.ReadingAnswer
    """How the upload was read."""


class ClassificationPageAnswer(Paged):
    """A page of the classifications of a sequence."""

    classifications: list[ClassificationAnswer]


class _Result(Answer):
    name: str
    """As the part of the form names its file."""
    subject: str | None
    """As in the manifest."""
    label: str | None
    error: general.Problem | None
    """As the file would have been answered by itself; null where there is a result."""


class SignatureResult(_Result):
    """The signature of one of many files, or why there is none."""

    signature: signatures.SignatureAnswer | None


class SignatureResults(Answer):
    """Signatures of many files, in the order in which they were sent."""

    results: list[SignatureResult]
    n_failed: int


class ClassificationResult(_Result):
    """The class of one of many files, or why there is none."""

    classification: UploadClassificationAnswer | None


class ClassificationResults(Answer):
    """Classes of many files, in the order in which they were sent."""

    results: list[ClassificationResult]
    n_failed: int


class FigureAnswer(Answer):
    """One number, and the interval in which the surface's own is."""

    value: float
    low: float
    high: float


class VolumeAnswer(Answer):
    """Volume over time, and its read-outs."""

    volumes: list[float]
    """Of each frame, in `volume_unit`."""
    bounds: list[float]
    """The surface's own volume is at most this far from it, in `volume_unit`."""
    end_diastole: int
    """Frame of the largest volume."""
    end_systole: int
    """Frame of the smallest volume."""
    end_diastolic_volume: FigureAnswer
    end_systolic_volume: FigureAnswer
    stroke_volume: FigureAnswer
    ejection_fraction: FigureAnswer | None
    """Stroke volume over end-diastolic volume, percent, where a cavity is stated or the surface is
    a cup. Null elsewhere, of one frame, and where a volume is not positive."""
    volume_change: FigureAnswer | None
    """The same share where the surface is not stated to be that of a cavity."""


@mirrors(Rates)
class RatesAnswer(Answer):
    """How fast the cavity empties and fills; volumes in `volume_unit`."""


class SegmentsAnswer(Answer):
    """Inward motion of the wall over the radius at end diastole (Cerqueira 2002)."""

    names: list[str]
    """The 17 segments, or the four rings."""
    percent: list[list[float | None]]
    """By frame, then by segment."""
    end_diastole: int
    reason: str
    """Why there are rings only; empty if there are segments."""


class StrainFigureAnswer(Answer):
    """A strain since end diastole, percent; negative is shorter."""

    name: str
    """GLS, GCS, GAS, or GCS at one level."""
    definition: str
    """What it is the relative change of."""
    end_systolic: FigureAnswer
    """At end systole, with its 95 % interval."""
    peak: FigureAnswer
    """Where it is most negative."""
    curve: list[float]
    """By frame."""
    deviations: list[float]
    """Standard deviation by frame, points."""


class SegmentStrainAnswer(Answer):
    """Strain of the segments, percent."""

    names: list[str]
    """The 17 segments, or the four rings."""
    directions: list[str]
    percent: list[list[list[float | None]]]
    """By frame, segment, direction."""
    end_systolic_deviations: list[list[float | None]]
    """Standard deviation at end systole by segment and direction, points."""
    reason: str
    """Why there are rings only; empty if there are segments."""


class StrainAnswer(Answer):
    """Strain of the wall as lengths and areas of its smooth surface (Voigt 2015)."""

    figures: list[StrainFigureAnswer]
    segments: SegmentStrainAnswer
    dyssynchrony: FigureAnswer | None
    """Systolic dyssynchrony index, percent of the cycle; null of too few frames."""
    end_diastole: int
    end_systole: int
    found_by: str
    """How these frames were found."""
    layer: str
    """Surface of the wall that was measured."""
    source: str
    """What the surface came from."""
    notes: list[Note]


@mirrors(Torsion)
class TorsionAnswer(Answer):
    """Turning and shear of a wall of material points since end diastole, degrees, by frame."""


@mirrors(Sensitivities, without=["labels"])
class PerModeAnswer(Answer):
    """What one length unit of each amplitude does to the read-outs at end systole."""

    modes: list[str]


class ReadoutsAnswer(Answer):
    """Read-outs from a cavity's volume over time."""

    sequence_id: str
    template_id: str
    amplitudes_per_frame: int
    volume_unit: str
    """ml; cubed length units where the unit is unknown."""
    times: list[float] | None
    """s"""
    n_openings: int
    """Each closed by a fan to the mean of its vertices."""
    from_signature: VolumeAnswer
    """From the amplitudes and the reference shape; the bounds are what leaving out all other modes
    puts on it, not the accuracy of the measurement."""
    of_mesh: VolumeAnswer
    """Of the frames as they were sent."""
    rates: RatesAnswer | None
    """Null where times are unknown."""
    segments: SegmentsAnswer | None
    """Null where this is not a ventricle."""
    strain: StrainAnswer | None
    """Null of a surface without coordinates along and around it."""
    torsion: TorsionAnswer | None
    """Null unless the vertices are stated to follow the tissue (tracking=material)."""
    per_mode: PerModeAnswer | None
    """Null where a volume is not known."""
    notes: list[Note]
    intended_use: str = INTENDED_USE

    @staticmethod
    def of(readouts: clinical.ClinicalReadouts, ventricle: VentricleReadouts) -> "ReadoutsAnswer":
        """Write read-outs out."""
        return ReadoutsAnswer(**readouts_json(readouts, ventricle))
