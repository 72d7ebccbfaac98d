"""Templates, as the service describes them."""

from __future__ import annotations

from pydantic import BaseModel, Field

from modalmotion.template import Template
from modalmotion_service.schemas.signatures import LandmarksAnswer


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


class TemplateList(BaseModel):
    """All templates."""

    templates: list[str] = Field(description="Their ids, sorted.")
