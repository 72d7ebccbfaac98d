"""Reason for the number of modes of a signature."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

from modalmotion.choice.noise import Noise
from modalmotion.choice.parameters import USUAL_MODES, ErrorKind
from modalmotion.choice.scene import SceneError, SceneKind
from modalmotion.representation import shown

COMPACT: Final = 10
"""Coordinates for each amplitude of a frame, from which a signature is called compact."""


def note_on_compactness(n_modes: int, n_vertices: int) -> tuple[str, ...]:
    """Say that so many modes are no longer compact, if they are more than the usual number."""
    if n_modes <= USUAL_MODES or n_modes * COMPACT <= n_vertices:
        return ()
    return (
        (
            f"{n_modes} modes of {n_vertices} vertices are no longer compact: "
            f"{n_vertices / n_modes:.1f} coordinates for each amplitude of a frame."
        ),
    )


@shown("asked", "limit", "limit_of", "scene", "noise.sigma")
@dataclass(frozen=True)
class ModelChoice:
    """Reason for the modes of a signature.

    Parameters
    ----------
    asked : str
        "tolerance", "tolerance_share" or "auto".
    limit : float, length unit
        The error limit; for "auto" the weighted RMS error that noise alone would leave.
    limit_of : ErrorKind
    noise : Noise or None
        The estimate, for "auto".
    scene : SceneKind
        The simplest kind of motion that holds the limit.
    errors : dict of SceneKind to SceneError
        Error of each kind.
    normal : tuple of float or None
        Unit normal of the plane that a planar motion was limited to.
    """

    asked: str
    limit: float
    limit_of: ErrorKind
    noise: Noise | None
    scene: SceneKind
    errors: dict[SceneKind, SceneError]
    normal: tuple[float, float, float] | None

    def as_json(self) -> dict[str, Any]:
        """Plain values, for files and answers."""
        return asdict(self)

    @staticmethod
    def from_json(values: dict[str, Any]) -> ModelChoice:
        """Read the output of `as_json`, after a round trip through JSON."""
        noise, normal = values["noise"], values["normal"]
        return ModelChoice(
            asked=values["asked"],
            limit=values["limit"],
            limit_of=ErrorKind(values["limit_of"]),
            noise=None if noise is None else Noise(**noise),
            scene=SceneKind(values["scene"]),
            errors={SceneKind(k): SceneError(**e) for k, e in values["errors"].items()},
            normal=None if normal is None else (normal[0], normal[1], normal[2]),
        )
