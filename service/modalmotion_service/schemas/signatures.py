"""Signatures."""

from __future__ import annotations

from functools import cached_property, lru_cache
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, FailFast, Field

from modalmotion.choice.parameters import ErrorKind, ModeOrder, SignatureKind, parameters_as_json
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.modes import ModeLabel
from modalmotion.signature.making import MOST_MODES, ModalSignature, SignatureParameters
from modalmotion.template import GivenLandmarks, Landmarks, Weights
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import price_of
from modalmotion_service.schemas.facts import FactsAnswer
from modalmotion_service.schemas.fields import (
    GRID,
    PLACE,
    TOPOLOGY,
    JsonBody,
    ReferenceShape,
    SequenceId,
    parse_grid,
    parse_place,
)
from modalmotion_service.schemas.tradeoff import PriceAnswer


class SignatureQuery(BaseModel):
    """Query parameters of a signature."""

    model_config = ConfigDict(extra="forbid")

    modes: int | None = Field(
        None,
        ge=1,
        le=MOST_MODES,
        description="Number of modes, three amplitudes a frame each, or one of offsets; rounded up "
        "where a cosine-sine pair would be split, unless split_pairs. 7 if nothing else is "
        "requested.",
    )
    amplitudes: int | None = Field(
        None, ge=1, le=3 * MOST_MODES, description="In place of modes: amplitudes a frame."
    )
    tolerance: float | None = Field(
        None,
        ge=0,
        allow_inf_nan=False,
        description="Error in mm that is not exceeded, with the fewest modes that hold it.",
    )
    tolerance_of: ErrorKind = Field(
        ErrorKind.RMS,
        description="RMS over all vertices and frames, the one by the vertices' shares of the "
        "surface, or the largest of any vertex.",
    )
    tolerance_share: float | None = Field(
        None, ge=0, allow_inf_nan=False, description="A tolerance as a share of the RMS motion."
    )
    auto: bool = Field(False, description="Stop where the residual is noise.")
    order: ModeOrder = Field(
        ModeOrder.FIXED, description="Which modes come first: in fixed order, or by energy."
    )
    most_modes: int | None = Field(
        None, ge=1, le=MOST_MODES, description="Upper limit for tolerance, auto and energy."
    )
    harmonics: int | None = Field(
        None, ge=0, le=10_000, description="Limit each amplitude's path over time to these."
    )
    kind: SignatureKind = Field(
        SignatureKind.MATERIAL,
        description="What amplitudes are of: material follows the vertices; offset measures the "
        "surface along its reference's normals, one amplitude a mode, wherever on it the vertices "
        "lie.",
    )
    split_pairs: bool = Field(
        False,
        description="Take the stated number exactly: the amplitudes of a cosine without its sine "
        "depend on where theta is zero.",
    )
    volumes: bool = Field(
        False,
        description="Give the volume that the surface encloses in each frame, too, openings "
        "closed.",
    )
    deviations: bool = Field(
        False,
        description="Estimate the noise, and give the standard deviation that it makes of each "
        "amplitude. Of a tracked sequence, and with auto, they are given in any case.",
    )
    topology: str | None = TOPOLOGY
    grid: str | None = GRID
    reference: ReferenceShape = Field(
        0,
        description="Shape that displacements are measured from: a frame, or the mean shape, which "
        "does not depend on where the recording starts.",
    )
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
    merge_vertices: bool = Field(
        True,
        description="Whether vertices that coincide in every frame, as on both sides of a seam, "
        "are one vertex of the template; answers still speak of all that were sent.",
    )
    template: SequenceId | None = Field(
        None, description="Id of a template to use in place of one of the sequence's own."
    )

    @cached_property
    def _parameters(self) -> SignatureParameters:
        values = {name: getattr(self, name) for name in SignatureQuery.model_fields}
        values["grid"] = parse_grid(self.grid)
        values["landmarks"] = GivenLandmarks(
            apex=parse_place(values.pop("apex")),
            base=parse_place(values.pop("base")),
            theta_zero=parse_place(values.pop("theta_zero")),
        )
        return SignatureParameters(**values)

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters; once, for requests share what they repeat."""
        return self._parameters


class ManySignatures(JsonBody, SignatureQuery):
    """Query parameters of many signatures in one answer."""

    ids: Annotated[list[SequenceId], FailFast()] = Field(
        min_length=1, description="Of the sequences, in order."
    )


class Label(BaseModel):
    """Name of one mode."""

    wavenumbers: list[int] = Field(
        description="One for each natural coordinate; for spring modes of one mesh their rank."
    )
    part: Literal["cos", "sin", "spring"]

    @staticmethod
    @lru_cache(maxsize=1024)
    def of(label: ModeLabel) -> Label:
        """Write a label out; answers share what they repeat."""
        return Label(wavenumbers=list(label.wavenumbers), part=label.part)


class LandmarksAnswer(BaseModel):
    """Where the natural coordinates sit, and how well the shape determines it."""

    origin: list[float]
    axis: list[float] = Field(description="Unit vector from the apex end to the base end.")
    theta_zero: list[float] = Field(description="Unit vector across the axis with theta = 0.")
    apex: list[float]
    base: list[float]
    strengths: dict[str, float] = Field(
        description="0 where the shape does not decide, 1 where there is no doubt."
    )
    given: list[str] = Field(description="Those that the sender stated.")

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

    rms: list[float] = Field(description="Over all vertices alike.")
    weighted_rms: list[float] = Field(
        description="Over the surface, each vertex by its share of it."
    )
    p95: list[float] = Field(description="95th percentile over all vertices.")
    max: list[float] = Field(description="Of any vertex.")


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
    kind: SignatureKind = Field(description="What the amplitudes are of.")
    shape: tuple[int, int, int] = Field(
        description="Of the amplitudes: frames, modes, 3, or 1 of offsets."
    )
    amplitudes: list[list[list[float]]] = Field(
        description="By frame, mode and direction, in the length unit; of offsets along the "
        "reference's outward normals."
    )
    amplitude_deviations: list[list[list[float]]] | None = Field(
        description="Standard deviation of each amplitude, in the length unit; null where it is "
        "not known."
    )
    deviation_share: float | None = Field(
        description="RMS of these deviations over that of the amplitudes: above 1 they are mostly "
        "error."
    )
    components: Components = Field(
        description="Directions of the amplitudes: x, y, z or radial, tangential, axial."
    )
    landmarks: LandmarksAnswer | None = Field(description="Null where there is no axis.")
    reference_amplitudes: list[list[float]] = Field(
        description="Amplitudes of the reference itself, of its positions from its centroid; 0 "
        "where components are cylindrical."
    )
    volumes: list[float] | None = Field(
        description="Volume that the surface encloses in each frame, in the cubed length unit, if "
        "requested; null where it encloses none."
    )
    translations: list[list[float]] = Field(description="Path of the centroid.")
    angular_frequencies: list[float] = Field(description="rad per s, at the stated wave speed.")
    wave_speed: float
    lengths: list[float] = Field(description="Of the surface along each natural coordinate.")
    rotations: list[list[list[float]]] = Field(description="3 x 3 matrix of each frame.")
    rotation_determined: list[bool]
    rms_error: float = Field(description="Over all vertices and frames.")
    weighted_rms_error: float = Field(
        description="Over all frames, each vertex by its share of the surface."
    )
    max_error: float = Field(description="Of any vertex in any frame.")
    errors: FrameErrors
    motion_rms: list[float] = Field(description="RMS displacement of each frame.")
    weighted_motion_rms: list[float] = Field(
        description="The same, each vertex by its share of the surface."
    )
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
    price: PriceAnswer
    choice: dict[str, object] | None = Field(
        description="Limit, noise and simple kinds of motion, where a tolerance or auto decided."
    )
    facts: FactsAnswer
    notes: list[str]
    parameters: dict[str, object] = Field(
        description="As requested, with the landmarks that the facts state."
    )
    provenance: dict[str, str]
    intended_use: str = INTENDED_USE
    file: str | None = Field(
        description="HDF5 file of this result, within the data folder; null if not stored."
    )

    @staticmethod
    def of(signature: ModalSignature, file: str | None) -> SignatureAnswer:
        """Write a signature out as lists."""
        parameters = signature.parameters
        return SignatureAnswer(
            sequence_id=signature.sequence_id,
            template_id=signature.template_id,
            topology=signature.surface,
            n_frames=signature.n_frames,
            n_vertices=signature.n_vertices,
            unit=signature.unit,
            times=None if signature.times is None else signature.times.tolist(),
            modes=[Label.of(label) for label in signature.modes.labels],
            kind=signature.kind,
            shape=signature.amplitudes.shape,
            amplitudes=signature.amplitudes.tolist(),
            amplitude_deviations=(
                None
                if signature.amplitude_deviations is None
                else signature.amplitude_deviations.tolist()
            ),
            deviation_share=signature.deviation_share,
            components=parameters.components,
            landmarks=(
                None if signature.landmarks is None else LandmarksAnswer.of(signature.landmarks)
            ),
            reference_amplitudes=signature.reference_amplitudes.tolist(),
            volumes=None if signature.volumes is None else signature.volumes.tolist(),
            translations=signature.translations.tolist(),
            angular_frequencies=signature.angular_frequencies.tolist(),
            wave_speed=parameters.wave_speed,
            lengths=list(signature.lengths),
            rotations=signature.rotations.matrices.tolist(),
            rotation_determined=signature.rotations.is_determined.tolist(),
            rms_error=signature.rms_error,
            weighted_rms_error=signature.weighted_rms_error,
            max_error=signature.max_error,
            errors=FrameErrors(
                rms=signature.rms_errors.tolist(),
                weighted_rms=signature.weighted_rms_errors.tolist(),
                p95=signature.p95_errors.tolist(),
                max=signature.max_errors.tolist(),
            ),
            motion_rms=signature.motion_rms.tolist(),
            weighted_motion_rms=signature.weighted_motion_rms.tolist(),
            closure_gap=signature.closure_gap,
            deformation_spectrum=signature.deformation_spectrum.tolist(),
            strain_energy=signature.strain_energy.sum(axis=1).tolist(),
            compression=signature.compression,
            compression_of_sequence=signature.compression_of_sequence,
            condition=signature.condition,
            price=PriceAnswer.of(price_of(signature)),
            choice=None if signature.choice is None else signature.choice.as_json(),
            facts=FactsAnswer.of(signature.facts),
            notes=list(signature.notes),
            parameters=parameters_as_json(parameters),
            provenance=signature.provenance,
            file=file,
        )
