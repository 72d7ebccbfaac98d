"""What goes over the wire, as pydantic models."""

from __future__ import annotations

from typing import Annotated, Any, Final, Literal

from pydantic import BaseModel, ConfigDict, Field, StringConstraints

from modalmotion.body_frame import Components
from modalmotion.classify import Classification
from modalmotion.codec import Effort, Encoded
from modalmotion.errors import ParameterError
from modalmotion.formats import Format, ReadLimits, ReadOptions, ReadResult
from modalmotion.modes import ModeLabel
from modalmotion.signature import INTENDED_USE, MOST_MODES, ModalSignature, SignatureParameters
from modalmotion.spring_modes import SpringLabel
from modalmotion.store import Job, JobState, SequenceRecord
from modalmotion.template import GivenLandmarks, Landmarks, Template, Weights
from modalmotion.template.landmarks import Place

GRID_PATTERN: Final = r"^[1-9][0-9]{0,8}(,[1-9][0-9]{0,8}){0,2}$"

_NUMBER: Final = r"[+-]?[0-9]{1,15}([.][0-9]{0,20})?(e[+-]?[0-9]{1,3})?"

PLACE: Final[Any] = Field(
    None,
    pattern=f"^([0-9]{{1,9}}|{_NUMBER},{_NUMBER},{_NUMBER})$",
    description="Landmark: the number of a vertex, or a point as x,y,z.",
)

TOPOLOGY: Final[Any] = Field(
    None,
    max_length=80,
    description="cup, cylinder, plane, torus, sphere, open curve or closed curve; over what "
    "the file states.",
)
GRID: Final[Any] = Field(
    None, pattern=GRID_PATTERN, description="Nodes along each axis of a lattice, such as 32,64."
)

JobId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{32}$")]
SequenceId = Annotated[str, StringConstraints(pattern="^[0-9a-f]{64}$")]


class Health(BaseModel):
    """State of the service."""

    status: Literal["ok"] = "ok"
    version: str


class ReadingAnswer(BaseModel):
    """What a reader learned of a file besides the sequence in it."""

    format: str
    ignored: list[str] = Field(description="Arrays and members that were not used.")
    coordinate_system: str | None = Field(
        description="Directions of the axes as the file names them; positions are never turned."
    )
    unit_from: str | None = Field(description="Who states the unit: file, format or caller.")
    times_from: str | None = Field(description="Who states the times: file, format or caller.")
    notes: list[str]

    @staticmethod
    def of(read: ReadResult) -> ReadingAnswer:
        """Write out what was read, but for the sequence."""
        return ReadingAnswer(
            format=read.format,
            ignored=list(read.ignored),
            coordinate_system=read.coordinate_system,
            unit_from=read.unit_from,
            times_from=read.times_from,
            notes=list(read.notes),
        )


class ReadingQuery(BaseModel):
    """What may be said of a file beside it, over what it says itself."""

    model_config = ConfigDict(extra="forbid")

    format: Format | None = Field(None, description="Told from the content by default.")
    topology: str | None = TOPOLOGY
    grid: str | None = GRID
    unit: str | None = Field(None, max_length=20, description="m, cm, mm, um or nm.")
    times: str | None = Field(None, max_length=400_000, description="In s, such as 0,0.04,0.08.")
    frame_interval: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="In s, in place of times."
    )
    n_vertices: int | None = Field(None, ge=1, description="Of raw numbers: vertices a frame.")
    dtype: Literal["float32", "float64"] = Field("float32", description="Of raw numbers.")
    animation: str | None = Field(None, max_length=200, description="Of GLB: by its name.")

    def options(self, limits: ReadLimits) -> ReadOptions:
        """Translate to the reader's options."""
        return ReadOptions(
            format=self.format,
            limits=limits,
            unit=self.unit,
            times=None if self.times is None else tuple(parse_times(self.times)),
            frame_interval=self.frame_interval,
            topology=self.topology,
            grid=parse_grid(self.grid),
            n_vertices=self.n_vertices,
            dtype=self.dtype,
            animation=self.animation,
        )


class UploadQuery(ReadingQuery):
    """What may be said of an upload beside the file."""

    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")


class SequenceSummary(BaseModel):
    """What is known of a kept sequence."""

    id: str = Field(description="sha256 of the content, in hex.")
    n_frames: int
    n_vertices: int
    n_faces: int
    topology: str | None = Field(description="As stated with the upload; null if it was not.")
    grid: list[int] | None = Field(description="Nodes along each axis of a lattice.")
    unit: str | None = Field(description="Length unit; null if unknown.")
    has_times: bool
    subject: str | None
    label: str | None
    created: str = Field(description="When it was first received, ISO 8601 in UTC.")
    reading: ReadingAnswer | None = Field(
        None, description="What the upload held besides; only in the answer to it."
    )
    links: dict[str, str]

    @staticmethod
    def of(record: SequenceRecord, reading: ReadingAnswer | None = None) -> SequenceSummary:
        """Summarise a record of the store."""
        here = f"/v1/sequences/{record.id}"
        return SequenceSummary(
            id=record.id,
            n_frames=record.n_frames,
            n_vertices=record.n_vertices,
            n_faces=record.n_faces,
            topology=record.topology,
            grid=None if record.grid is None else list(record.grid),
            unit=record.unit,
            has_times=record.has_times,
            subject=record.subject,
            label=record.label,
            created=record.created,
            reading=reading,
            links={
                "self": here,
                "signature": f"{here}/signature",
                "classifications": f"{here}/classifications",
            },
        )


class SequencePageAnswer(BaseModel):
    """A page of the list of sequences."""

    sequences: list[SequenceSummary]
    cursor: str | None = Field(description="For the next page; null on the last.")


class SequenceNames(BaseModel):
    """What people call a sequence; what is left out stays."""

    model_config = ConfigDict(extra="forbid")

    subject: str | None = Field(None, max_length=200, description="Whose surface it is.")
    label: str | None = Field(None, max_length=200, description="Known motion class.")


class SignatureQuery(BaseModel):
    """Which signature is asked for."""

    model_config = ConfigDict(extra="forbid")

    modes: int = Field(
        7,
        ge=1,
        le=MOST_MODES,
        description="Number of modes, three amplitudes a frame each; rounded up where a "
        "cosine-sine pair would be split.",
    )
    topology: str | None = TOPOLOGY
    grid: str | None = GRID
    reference: int = Field(0, ge=0, description="Frame that displacements are measured from.")
    weights: Weights = Field(
        Weights.AREA, description="How much each vertex counts: its area, or all alike."
    )
    remove_rotation: bool = Field(True, description="Take out each frame's rotation first.")
    wave_speed: float = Field(
        1.0, gt=0, allow_inf_nan=False, description="c of w = c k, length unit per s."
    )
    components: Components = Field(
        Components.CARTESIAN, description="Of the amplitudes: x, y, z or radial, tangential, axial."
    )
    apex: str | None = PLACE
    base: str | None = PLACE
    theta_zero: str | None = PLACE
    closed_form: bool = Field(
        True, description="False asks for the spring modes of the mesh itself."
    )
    template: SequenceId | None = Field(
        None, description="Id of a template to use in place of one of the sequence's own."
    )

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters."""
        return SignatureParameters(
            modes=self.modes,
            topology=self.topology,
            grid=parse_grid(self.grid),
            reference=self.reference,
            weights=self.weights,
            remove_rotation=self.remove_rotation,
            wave_speed=self.wave_speed,
            components=self.components,
            landmarks=GivenLandmarks(
                apex=parse_place(self.apex),
                base=parse_place(self.base),
                theta_zero=parse_place(self.theta_zero),
            ),
            closed_form=self.closed_form,
            template=self.template,
        )


def parse_place(text: str | None) -> Place | None:
    """Read a landmark: the number of a vertex, or a point such as "1.5,0,-3"."""
    if text is None:
        return None
    if "," not in text:
        return int(text)
    x, y, z = (float(part) for part in text.split(","))
    return x, y, z


def parse_times(text: str) -> list[float]:
    """Read times such as "0,0.1,0.25".

    Raises
    ------
    ParameterError
        If one of them is no number.
    """
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise ParameterError(
            f"The times {text[:60]!r} are not all numbers.", remedy="Write them as 0,0.1,0.25."
        ) from None


def parse_grid(text: str | None) -> tuple[int, ...] | None:
    """Read a lattice shape such as "32,64"."""
    return None if text is None else tuple(int(n) for n in text.split(","))


class ManySignatures(SignatureQuery):
    """Which signatures are asked for in one answer."""

    ids: list[SequenceId] = Field(min_length=1, description="Of the sequences, in order.")


class Label(BaseModel):
    """Name of one mode."""

    wavenumbers: list[int] = Field(
        description="One for each natural coordinate; for spring modes of one mesh their rank."
    )
    part: Literal["cos", "sin", "spring"]

    @staticmethod
    def of(label: ModeLabel | SpringLabel) -> Label:
        """Write a label out."""
        if isinstance(label, SpringLabel):
            return Label(wavenumbers=[label.rank], part="spring")
        return Label(wavenumbers=list(label.wavenumbers), part=label.part)


class LandmarksAnswer(BaseModel):
    """Where the natural coordinates sit, and how well the shape determines it."""

    origin: list[float]
    axis: list[float] = Field(description="Unit vector from the apex end to the base end.")
    theta_zero: list[float] = Field(description="Unit vector across the axis with theta = 0.")
    apex: list[float]
    base: list[float]
    strengths: dict[str, float] = Field(
        description="0 where the shape could as well say another, 1 where there is no doubt."
    )
    given: list[str] = Field(description="Which ones the sender stated.")

    @staticmethod
    def of(landmarks: Landmarks) -> LandmarksAnswer:
        """Write landmarks out."""
        return LandmarksAnswer(
            origin=landmarks.origin.tolist(),
            axis=landmarks.axis.tolist(),
            theta_zero=landmarks.theta_zero.tolist(),
            apex=landmarks.apex.tolist(),
            base=landmarks.base.tolist(),
            strengths=dict(landmarks.strengths),
            given=list(landmarks.given),
        )


class FrameErrors(BaseModel):
    """Distances between vertices and their reconstruction, by frame."""

    rms: list[float] = Field(description="Over the surface.")
    p95: list[float] = Field(description="95th percentile over the surface.")
    max: list[float] = Field(description="Over all vertices.")


class SignatureAnswer(BaseModel):
    """A modal signature."""

    sequence_id: str
    template_id: str
    topology: str
    n_frames: int
    n_vertices: int
    unit: str | None
    times: list[float] | None = Field(description="s")
    modes: list[Label]
    shape: tuple[int, int, int] = Field(description="Of the amplitudes: frames, modes, 3.")
    amplitudes: list[list[list[float]]] = Field(
        description="By frame, mode and direction, in the length unit."
    )
    components: Components = Field(
        description="Directions of the amplitudes: x, y, z or radial, tangential, axial."
    )
    landmarks: LandmarksAnswer | None = Field(description="Null where there is no axis.")
    translations: list[list[float]] = Field(description="Path of the centroid.")
    angular_frequencies: list[float] = Field(description="rad per s, at the stated wave speed.")
    wave_speed: float
    lengths: list[float] = Field(description="Of the surface along each natural coordinate.")
    rotations: list[list[list[float]]] = Field(description="3 x 3 matrix of each frame.")
    rotation_determined: list[bool]
    rms_error: float = Field(description="Over all frames.")
    max_error: float = Field(description="Over all frames and vertices.")
    errors: FrameErrors
    motion_rms: list[float] = Field(description="RMS displacement of each frame.")
    closure_gap: float = Field(
        description="From the last frame back to the first, over the usual step between frames: "
        "near 1 for a cycle, large for a movement that does not come back."
    )
    deformation_spectrum: list[float] = Field(description="RMS amplitude of each mode.")
    strain_energy: list[float] = Field(description="Of each frame, per unit mass.")
    compression: float = Field(description="Coordinates over amplitudes of one frame.")
    compression_of_sequence: float = Field(
        description="Numbers in the sequence over amplitudes and reference shape."
    )
    condition: float
    notes: list[str]
    parameters: dict[str, object] = Field(description="As asked for.")
    provenance: dict[str, str]
    intended_use: str = INTENDED_USE
    file: str = Field(description="HDF5 file of this result, within the data folder.")

    @staticmethod
    def of(signature: ModalSignature, file: str) -> SignatureAnswer:
        """Write a signature out as lists."""
        asked = signature.parameters
        return SignatureAnswer(
            sequence_id=signature.sequence_id,
            template_id=signature.template_id,
            topology=signature.surface,
            n_frames=signature.n_frames,
            n_vertices=signature.n_vertices,
            unit=signature.unit,
            times=None if signature.times is None else signature.times.tolist(),
            modes=[Label.of(label) for label in signature.modes.labels],
            shape=signature.amplitudes.shape,
            amplitudes=signature.amplitudes.tolist(),
            components=asked.components,
            landmarks=(
                None if signature.landmarks is None else LandmarksAnswer.of(signature.landmarks)
            ),
            translations=signature.translations.tolist(),
            angular_frequencies=signature.angular_frequencies.tolist(),
            wave_speed=asked.wave_speed,
            lengths=list(signature.lengths),
            rotations=signature.rotations.matrices.tolist(),
            rotation_determined=signature.rotations.is_determined.tolist(),
            rms_error=signature.rms_error,
            max_error=signature.max_error,
            errors=FrameErrors(
                rms=signature.rms_errors.tolist(),
                p95=signature.p95_errors.tolist(),
                max=signature.max_errors.tolist(),
            ),
            motion_rms=signature.motion_rms.tolist(),
            closure_gap=signature.closure_gap,
            deformation_spectrum=signature.deformation_spectrum.tolist(),
            strain_energy=signature.strain_energy.sum(axis=1).tolist(),
            compression=signature.compression,
            compression_of_sequence=signature.compression_of_sequence,
            condition=signature.condition,
            notes=list(signature.notes),
            parameters={
                "modes": asked.modes,
                "topology": asked.topology,
                "grid": None if asked.grid is None else list(asked.grid),
                "reference": asked.reference,
                "weights": asked.weights.value,
                "remove_rotation": asked.remove_rotation,
                "wave_speed": asked.wave_speed,
                "components": asked.components.value,
                "landmarks": asked.landmarks.as_json(),
                "closed_form": asked.closed_form,
                "template": asked.template,
            },
            provenance=signature.provenance,
            file=file,
        )


class DistanceAnswer(BaseModel):
    """Distance of one sequence's signature from another's."""

    distance: float = Field(description="|a - b| / |b| in the frame of the body, by phase.")
    uses_theta_zero: bool = Field(
        description="False where the zero of theta is not determined: magnitudes of pairs are "
        "compared then."
    )


class TemplateAnswer(BaseModel):
    """Natural coordinates of a surface, and how they were found."""

    id: str = Field(description="sha256 of what it was made from, in hex.")
    topology: str = Field(description='Or "mesh" where no natural coordinates are known.')
    n_vertices: int
    n_faces: int
    lengths: list[float] = Field(description="Along each natural coordinate.")
    landmarks: LandmarksAnswer | None
    notes: list[str]
    links: dict[str, str]

    @staticmethod
    def of(template: Template) -> TemplateAnswer:
        """Describe a template."""
        return TemplateAnswer(
            id=template.id,
            topology="mesh" if template.surface is None else template.surface.name,
            n_vertices=template.n_vertices,
            n_faces=len(template.faces),
            lengths=list(template.lengths),
            landmarks=(
                None if template.landmarks is None else LandmarksAnswer.of(template.landmarks)
            ),
            notes=list(template.notes),
            links={"self": f"/v1/templates/{template.id}"},
        )


class EncodingTarget(BaseModel):
    """At what error, or at what size, to encode: one of the three."""

    model_config = ConfigDict(extra="forbid")

    rms: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="RMS distance of vertices, not exceeded."
    )
    max_error: float | None = Field(
        None, gt=0, allow_inf_nan=False, description="Of every coordinate, never exceeded."
    )
    bytes: int | None = Field(None, gt=0, description="Size of the stream, not exceeded.")
    effort: Effort = Field(Effort.BALANCED, description="How many transforms are tried.")


class EncodedAnswer(BaseModel):
    """What was measured on a stream after decoding it; given as headers beside the stream."""

    n_bytes: int
    bits_per_vertex_and_frame: float
    rms: float
    max_error: float
    kg_error: float
    transform: str

    @staticmethod
    def of(found: Encoded) -> EncodedAnswer:
        """Write out what was measured."""
        return EncodedAnswer(
            n_bytes=found.n_bytes,
            bits_per_vertex_and_frame=found.bits_per_vertex_and_frame,
            rms=found.rms,
            max_error=found.max_error,
            kg_error=found.kg_error,
            transform=found.transform,
        )

    @property
    def headers(self) -> dict[str, str]:
        """As headers: Encoded-RMS, Encoded-Max-Error, ..."""
        return {
            f"Encoded-{name.replace('_', '-').title()}": str(value)
            for name, value in self.model_dump().items()
        }


class ClassificationRequest(BaseModel):
    """Which model is asked."""

    model_config = ConfigDict(extra="forbid")

    model: str = Field(
        "ventricle-simulated", max_length=100, description="Name of a classification model."
    )


class ClassificationAnswer(BaseModel):
    """What a model says of one sequence."""

    sequence_id: str
    model: str
    model_id: str = Field(description="sha256 of the model.")
    label: str | None = Field(description="Most probable class; null where the model abstains.")
    probability: float = Field(description="Of the most probable class.")
    probabilities: dict[str, float]
    notes: list[str]
    provenance: dict[str, str]
    intended_use: str = INTENDED_USE
    file: str = Field(description="HDF5 file of this result, within the data folder.")

    @staticmethod
    def of(result: Classification, file: str) -> ClassificationAnswer:
        """Write a classification out."""
        return ClassificationAnswer(
            sequence_id=result.sequence_id,
            model=result.model,
            model_id=result.model_id,
            label=result.label,
            probability=result.probability,
            probabilities=dict(zip(result.classes, result.probabilities.tolist(), strict=True)),
            notes=list(result.notes),
            provenance=result.provenance,
            file=file,
        )


class ClassificationList(BaseModel):
    """Everything that models have said of one sequence."""

    classifications: list[ClassificationAnswer]


class Problem(BaseModel):
    """An error, after RFC 9457."""

    model_config = ConfigDict(extra="allow")

    type: str
    title: str
    status: int
    code: str = Field(description="Stable name of the kind of problem.")
    detail: str
    frame: int | None = Field(None, description="Frame at fault, counted from 0.")
    vertex: int | None = Field(None, description="Vertex at fault, counted from 0.")
    limit: str | None = Field(None, description="Limit that was exceeded.")
    remedy: str | None = Field(None, description="What to do about it.")


class JobAnswer(BaseModel):
    """Long work, and how far it is."""

    id: str
    kind: str = Field(description="upload, signature, signatures or classification.")
    state: JobState
    progress: float = Field(description="Share that is done, 0 to 1.")
    result: str | None = Field(description="Link to the result; null until there is one.")
    error: dict[str, Any] | None = Field(description="The problem it failed with.")
    created: str = Field(description="ISO 8601 in UTC.")
    updated: str = Field(description="ISO 8601 in UTC.")
    links: dict[str, str]

    @staticmethod
    def of(job: Job) -> JobAnswer:
        """Write a job out."""
        here = f"/v1/jobs/{job.id}"
        done = job.result or {}
        return JobAnswer(
            id=job.id,
            kind=job.kind,
            state=job.state,
            progress=job.progress,
            result=f"{here}/result" if "file" in done else done.get("link"),
            error=job.error,
            created=job.created,
            updated=job.updated,
            links={"self": here},
        )


class JobPageAnswer(BaseModel):
    """A page of the list of jobs."""

    jobs: list[JobAnswer]
    cursor: str | None = Field(description="For the next page; null on the last.")
