"""Signatures, their distances and prices, templates."""

from typing import Literal

from pydantic_core import from_json

from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.modes.topologies import MESH
from modalmotion.notes import Note
from modalmotion.representation import plain
from modalmotion.signature import distance, tradeoff
from modalmotion.signature.choice import SceneError, SceneKind
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.noise import Noise
from modalmotion.signature.parameters import SignatureKind, parameters_as_json
from modalmotion.template import Landmarks, Template, body_frame
from modalmotion.template.vibration_modes import VibrationModes
from modalmotion_service.schemas.from_core import Answer, Paged, mirrors, read_from
from modalmotion_service.schemas.general import FactsAnswer


@mirrors(tradeoff.Price)
class PriceAnswer(Answer):
    """Cost and error of a description."""

    milliseconds: dict[str, float]


@mirrors(tradeoff.Branch, without=["counts", "joint_rms"])
class BranchAnswer(Answer):
    """RMS errors of all whole sets of one topology and one choice of components."""

    modes: list[int]
    amplitudes_per_frame: list[int]
    bytes: list[int]
    """Of the whole trajectory as float64."""
    harmonics: list[int]
    rms_by_harmonics: list[list[float]]
    """By modes, then harmonics."""


@mirrors(SceneError)
class SceneErrorAnswer(Answer):
    """Error that one simple kind of motion leaves, in the length unit."""

    numbers_per_frame: int


@mirrors(Noise)
class NoiseAnswer(Answer):
    """The measurement's noise as estimated."""


class ChosenAnswer(Answer):
    """The requested signature."""

    kind: SceneKind
    """Simplest kind of motion that the scene is."""
    price: PriceAnswer
    topology: str
    components: body_frame.Components
    modes: int
    labels: list[str]
    harmonics: int | None
    notes: list[Note]


@mirrors(tradeoff.Front, without=["branches"])
class TradeoffAnswer(Answer):
    """Cost and error of each choice on one sequence."""

    sequence_id: str
    front: list[BranchAnswer]
    scene: dict[SceneKind, SceneErrorAnswer]
    limit: float | None
    """Error that is not exceeded, length unit."""
    noise: NoiseAnswer | None
    chosen: ChosenAnswer
    fit_milliseconds: dict[str, float]
    """By number of modes."""
    milliseconds: dict[str, float]
    """Of this answer, by stage."""


class Label(Answer):
    """Name of one mode."""

    wavenumbers: list[int]
    """One for each natural coordinate; for spring modes of one mesh their rank."""
    part: Literal["cos", "sin", "spring"]


class SignatureSummary(Answer):
    """A stored signature in a list."""

    key: str
    sequence_id: str
    n_modes: int
    kind: SignatureKind
    rms_error: float
    """Over all vertices and frames, in the length unit."""
    max_error: float
    unit: str | None
    parameters: dict[str, object]
    links: dict[str, str]

    @staticmethod
    def of(text: bytes) -> "SignatureSummary":
        """Summarise a signature that was written out."""
        values = from_json(text)
        return SignatureSummary(
            **{name: values[name] for name in SignatureSummary.model_fields if name in values},
            n_modes=len(values["modes"]),
            links={"self": f"/v1/signatures/{values['key']}"},
        )


class SignaturePageAnswer(Paged):
    """A page of the list of a sequence's signatures."""

    signatures: list[SignatureSummary]


@mirrors(Landmarks, without=["n_loops"])
class LandmarksAnswer(Answer):
    """Where the natural coordinates sit, and how well the shape determines it."""


class FrameErrors(Answer):
    """Distances between vertices and their reconstruction, by frame."""

    rms: list[float]
    """Over all vertices alike."""
    weighted_rms: list[float]
    """Over the surface, each vertex by its share of it."""
    p95: list[float]
    """95th percentile over all vertices."""
    max: list[float]
    """Of any vertex."""


@mirrors(ModalSignature, without=["rms_errors", "weighted_rms_errors", "p95_errors", "max_errors"])
class SignatureAnswer(Answer):
    """A modal signature."""

    topology: str
    n_frames: int
    modes: list[Label]
    kind: SignatureKind
    """What the amplitudes are of."""
    shape: tuple[int, int, int]
    """Of the amplitudes: frames, modes, 3, or 1 of normal displacements."""
    deviation_share: float | None
    """RMS of these deviations over that of the amplitudes: above 1 they are mostly error."""
    components: body_frame.Components
    """Directions of the amplitudes: x, y, z or radial, tangential, axial."""
    landmarks: LandmarksAnswer | None
    """Null where there is no axis."""
    rotations: list[list[list[float]]]
    """3 x 3 matrix of each frame."""
    rotation_determined: list[bool]
    rms_error: float
    """Over all vertices and frames."""
    weighted_rms_error: float
    """Over all frames, each vertex by its share of the surface."""
    max_error: float
    """Of any vertex in any frame."""
    errors: FrameErrors
    closure_gap: float
    """From the last frame back to the first, over the usual step between frames: near 1 for a
    cycle, large for a movement that does not come back."""
    deformation_spectrum: list[float]
    """RMS amplitude of each mode."""
    strain_energy: list[float]
    """Of each frame, per unit mass."""
    compression: float
    """Coordinates over amplitudes of one frame."""
    compression_of_sequence: float
    """Numbers in the sequence over amplitudes and reference shape."""
    price: PriceAnswer
    choice: dict[str, object] | None
    """Limit, noise and simple kinds of motion, where a tolerance or auto decided."""
    facts: FactsAnswer
    parameters: dict[str, object]
    """As requested, with the landmarks that the facts state."""
    intended_use: str = INTENDED_USE
    key: str | None
    """It is /v1/signatures/{key}; null if it is not stored."""
    file: str | None
    """HDF5 file of this result, within the data folder; null if not stored."""

    @staticmethod
    def of(
        signature: ModalSignature, key: str | None = None, file: str | None = None
    ) -> "SignatureAnswer":
        """Write a signature out as lists."""
        parameters = signature.parameters
        return read_from(
            SignatureAnswer,
            signature,
            key=key,
            file=file,
            topology=signature.surface,
            modes=signature.modes.labels,
            shape=signature.amplitudes.shape,
            components=parameters.components,
            rotations=signature.rotations.matrices,
            rotation_determined=signature.rotations.is_determined,
            errors=FrameErrors(
                rms=signature.rms_errors,
                weighted_rms=signature.weighted_rms_errors,
                p95=signature.p95_errors,
                max=signature.max_errors,
            ),
            strain_energy=signature.strain_energy.sum(axis=1),
            price=tradeoff.price_of(signature),
            choice=plain(signature.choice),
            facts=FactsAnswer.of(signature.facts),
            parameters=parameters_as_json(parameters),
        )


@mirrors(distance.Comparison)
class DistanceAnswer(Answer):
    """Distance of one sequence's signature from another's."""


class TemplateAnswer(Answer):
    """Natural coordinates of a surface, and how they were determined."""

    id: str
    """sha256 of its inputs, in hex."""
    topology: str
    """Or "mesh" where no natural coordinates are known."""
    n_vertices: int
    n_faces: int
    lengths: list[float]
    """Along each natural coordinate."""
    landmarks: LandmarksAnswer | None
    notes: list[Note]
    links: dict[str, str]

    @staticmethod
    def of(template: Template) -> "TemplateAnswer":
        """Describe a template."""
        return read_from(
            TemplateAnswer,
            template,
            topology=MESH if template.surface is None else template.surface.name,
            n_faces=len(template.faces),
            links={"self": f"/v1/templates/{template.id}"},
        )


class TemplatePageAnswer(Paged):
    """A page of the list of templates."""

    templates: list[str]
    """Their ids, sorted."""


class ModesAnswer(Answer):
    """Vibration modes of a template's surface."""

    template_id: str
    topology: str
    """Or "mesh" for the spring modes of this mesh alone."""
    modes: list[Label]
    angular_frequencies: list[float]
    frequency_unit: str
    shapes: list[list[float]] | None
    """Of each vertex its value in each mode, mean square 1 over the surface."""
    notes: list[Note]

    @staticmethod
    def of(template: Template, modes: VibrationModes, with_shapes: bool) -> "ModesAnswer":
        """Write modes out."""
        return read_from(
            ModesAnswer,
            modes,
            template_id=template.id,
            topology=modes.surface,
            modes=modes.labels,
            shapes=modes.shapes.tolist() if with_shapes else None,
        )
