"""What a signature is asked for."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass, field
from functools import cached_property
from typing import Final

import numpy as np

from modalmotion.body_frame import Components
from modalmotion.errors import ModeCountError, ParameterError
from modalmotion.template import GivenLandmarks, Weights

# Above this a signature is no longer compact, and a typing error is more likely.
MOST_MODES: Final = 2000


@dataclass(frozen=True)
class SignatureParameters:
    """What a signature is asked for.

    Parameters
    ----------
    modes : int
        Number of modes; each has three amplitudes a frame. Rounded up where a pair would be
        split.
    topology : str or None
        Name of the topology, over what the sequence states.
    grid : tuple of int or None
        Lattice shape, over what the sequence states.
    reference : int
        Frame from which displacements are measured.
    weights : Weights
    remove_rotation : bool
    wave_speed : float, length unit per s
        c of w = c k, which frequencies and strain energy are stated with.
    components : Components
        What the three amplitudes of a mode stand for: x, y, z or radial, tangential, axial.
    landmarks : GivenLandmarks
        Places that are stated and not left to the shape.
    closed_form : bool
        False asks for the spring modes of the mesh itself, whatever its topology.
    template : str or None
        Id of a template to use in place of one made from the sequence's own reference.
    """

    modes: int = 7
    topology: str | None = None
    grid: tuple[int, ...] | None = None
    reference: int = 0
    weights: Weights = Weights.AREA
    remove_rotation: bool = True
    wave_speed: float = 1.0
    components: Components = Components.CARTESIAN
    landmarks: GivenLandmarks = field(default_factory=GivenLandmarks)
    closed_form: bool = True
    template: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.modes <= MOST_MODES:
            raise ModeCountError(
                f"{self.modes} modes were asked for; a signature has 1 to {MOST_MODES}.",
                remedy=f"Ask for 1 to {MOST_MODES} modes; 7 is the usual number.",
                details={"modes": self.modes, "most": MOST_MODES},
            )
        if not (np.isfinite(self.wave_speed) and self.wave_speed > 0):
            raise ParameterError(
                f"The wave speed is {self.wave_speed}.", remedy="Use a finite speed above zero."
            )

    @cached_property
    def key(self) -> str:
        """Short name of this choice of parameters, for file names and ETags."""
        text = json.dumps(asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]
