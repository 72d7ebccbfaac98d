"""Templates, as the service describes them."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from modalmotion.choice.parameters import MOST_MODES
from modalmotion.modes.topology import MESH
from modalmotion.template import Template
from modalmotion.template.vibration_modes import VibrationModes
from modalmotion_service.schemas.signatures import Label, LandmarksAnswer


class TemplateAnswer(BaseModel):
    """Natural coordinates of a surface, and how they were determined."""

    id: str = Field(description="sha256 of its inputs, in hex.")
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
            topology=MESH if template.surface is None else template.surface.name,
            n_vertices=template.n_vertices,
            n_faces=len(template.faces),
            lengths=list(template.lengths),
            landmarks=(
                None if template.landmarks is None else LandmarksAnswer.of(template.landmarks)
            ),
            notes=list(template.notes),
            links={"self": f"/v1/templates/{template.id}"},
        )


class TemplateList(BaseModel):
    """All templates."""

    templates: list[str] = Field(description="Their ids, sorted.")


class ModesQuery(BaseModel):
    """Which vibration modes are requested."""

    model_config = ConfigDict(extra="forbid")

    modes: int = Field(
        7,
        ge=1,
        le=MOST_MODES,
        description="How many; rounded up where a cosine-sine pair would be split.",
    )
    wave_speed: float = Field(
        1.0, gt=0, allow_inf_nan=False, description="c of w = c k, length unit per s."
    )
    shapes: bool = Field(False, description="Of JSON: give the shapes too.")


class ModesAnswer(BaseModel):
    """Vibration modes of a template's surface."""

    template_id: str
    topology: str = Field(description='Or "mesh" for the spring modes of this mesh alone.')
    modes: list[Label]
    angular_frequencies: list[float]
    frequency_unit: str
    shapes: list[list[float]] | None = Field(
        description="Of each vertex its value in each mode, mean square 1 over the surface."
    )
    notes: list[str]

    @staticmethod
    def of(template: Template, modes: VibrationModes, with_shapes: bool) -> ModesAnswer:
        """Write modes out."""
        return ModesAnswer(
            template_id=template.id,
            topology=modes.surface,
            modes=[Label.of(label) for label in modes.labels],
            angular_frequencies=modes.angular_frequencies.tolist(),
            frequency_unit=modes.frequency_unit,
            shapes=modes.shapes.tolist() if with_shapes else None,
            notes=list(modes.notes),
        )
