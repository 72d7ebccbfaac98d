"""Cost and error of a description, and the front of all choices."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion.choice.scene import SceneKind
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import Price


class PriceAnswer(BaseModel):
    """Cost and error of a description."""

    rms_error: float = Field(description="Over all vertices and frames, in `unit`.")
    weighted_rms_error: float = Field(
        description="Over all frames, each vertex by its share of the surface."
    )
    p95_error: float = Field(description="95th percentile over all vertices, worst frame.")
    max_error: float = Field(description="Of any vertex in any frame.")
    unit: str | None = Field(description="mm; null where the unit of the input is unknown.")
    condition: float
    amplitudes_per_frame: int
    numbers: int = Field(description="Of the whole trajectory.")
    bytes: int = Field(description="Of these numbers as float64, which is how they are stored.")
    bytes_float32: int
    compression: float = Field(description="Coordinates over amplitudes of one frame.")
    compression_of_sequence: float = Field(description="With the reference counted.")
    milliseconds: dict[str, float] = Field(
        description="By stage; those of a stored result are in the Server-Timing header."
    )

    @staticmethod
    def of(price: Price) -> PriceAnswer:
        """Write a price out."""
        return PriceAnswer(**vars(price))


class BranchAnswer(BaseModel):
    """RMS errors of all whole sets of one topology and one choice of components."""

    topology: str
    components: Components
    modes: list[int]
    amplitudes_per_frame: list[int]
    bytes: list[int] = Field(description="Of the whole trajectory as float64.")
    rms: list[float] = Field(description="Over all vertices and frames, in the length unit.")
    weighted_rms: list[float] = Field(description="By the vertices' shares of the surface.")
    harmonics: list[int]
    rms_by_harmonics: list[list[float]] = Field(description="By modes, then harmonics.")
    weighted_rms_by_harmonics: list[list[float]]
    condition: float
    ends_because: str


class SceneErrorAnswer(BaseModel):
    """Error that one simple kind of motion leaves, in the length unit."""

    rms: float
    weighted_rms: float
    p95: float
    max: float
    numbers_per_frame: int | None


class NoiseAnswer(BaseModel):
    """The measurement's noise as estimated."""

    sigma: float = Field(description="Standard deviation of a coordinate, length unit.")
    lowest: float = Field(description="Lower end of its range.")
    highest: float | None = Field(description="Upper end; null where nothing bounds it.")
    between_frames: float = Field(description="Correlation of a frame's noise with the next's.")
    between_neighbours: float = Field(description="Correlation of the noise of two neighbours.")
    independent_vertices: float = Field(
        description="Vertices of independent noise that average like these."
    )
    mixed: int = Field(
        description="Times that independent noise is averaged over neighbours to be as smooth."
    )
    rounding: float = Field(description="Added by storing the numbers.")
    modes: int = Field(description="Spatial modes that were told apart.")


class ChosenAnswer(BaseModel):
    """The requested point of the front."""

    kind: SceneKind = Field(description="deformable for modes, or the simpler kind that holds.")
    price: PriceAnswer
    topology: str | None = None
    components: Components | None = None
    modes: int | None = None
    labels: list[str] = []
    harmonics: int | None = None
    notes: list[str] = []
    matrices: list[list[list[float]]] | None = Field(
        None, description="A of A (x - c) + c + t, of a static, rigid or affine motion."
    )
    shifts: list[list[float]] | None = None


class TradeoffAnswer(BaseModel):
    """Cost and error of each choice on one sequence."""

    sequence_id: str
    unit: str | None
    n_frames: int
    n_vertices: int
    motion_rms: float = Field(description="The RMS error of no modes at all.")
    weighted_motion_rms: float
    front: list[BranchAnswer]
    scene: dict[SceneKind, SceneErrorAnswer]
    limit: float | None = Field(description="Error that is not exceeded, length unit.")
    noise: NoiseAnswer | None
    chosen: ChosenAnswer
    fit_milliseconds: dict[str, float] = Field(description="By number of modes.")
    milliseconds: dict[str, float] = Field(description="Of this answer, by stage.")
