"""The query of the trade."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from modalmotion.choice.parameters import MOST_MODES, SignatureParameters
from modalmotion.template.body_frame import Components
from modalmotion.tradeoff import MOST_OF_FRONT
from modalmotion_service.schemas import SignatureQuery


class TradeoffQuery(SignatureQuery):
    """Query parameters of a front, and of a point on it."""

    front_modes: int = Field(
        MOST_OF_FRONT, ge=1, le=MOST_MODES, description="Modes that the front reaches to."
    )
    components: Components | None = Field(  # type: ignore[assignment]
        None, description="The only ones that are measured; all that the surface has by default."
    )

    def parameters(self) -> SignatureParameters:
        """Translate to the library's parameters, Cartesian components first."""
        values: dict[str, Any] = self.model_dump(exclude={"front_modes"})
        values["components"] = self.components or Components.CARTESIAN
        return SignatureQuery(**values).parameters()
