"""Modal superposition, (2) of Nastar (1994), on a reference shape, rotation put back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.fit.frame_errors import FrameErrors, errors_of_offsets
from modalmotion.fit.offsets import offset_reference
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.reference import reference_positions
from modalmotion.mesh.sequence import MeshSequence, Reference
from modalmotion.template import Template
from modalmotion.template.body_frame import Components, from_local, local_frames

# Floats of positions held at once while they are compared.
_BLOCK: Final = 500_000


@dataclass(frozen=True, eq=False)
class Superposition:
    """A reference shape, mode shapes on it, and how both become positions.

    Parameters
    ----------
    start : (vertices, 3) float64, length unit
        Reference positions.
    centre : (3,) float64, length unit
        Its weighted centroid.
    shapes : (vertices, modes) float64
    frames : (vertices, n, 3) float64 or None
        Local directions of the components; None for x, y, z.
    holds_drift : bool
        Whether shapes hold the path of the centroid, as displacements do and offsets do not.
    """

    start: NDArray[np.float64]
    centre: NDArray[np.float64]
    shapes: NDArray[np.float64]
    frames: NDArray[np.float64] | None
    holds_drift: bool = True

    @staticmethod
    def on(
        sequence: MeshSequence,
        template: Template,
        shapes: NDArray[np.float64],
        *,
        reference: Reference,
        components: Components,
    ) -> Superposition:
        """Superpose shapes on one frame of a sequence, or on its mean shape."""
        start = reference_positions(sequence, reference)
        frames = None if components == Components.CARTESIAN else local_frames(template)
        return Superposition(start, template.weights @ start, shapes, frames)

    @staticmethod
    def of_offsets(
        sequence: MeshSequence,
        template: Template,
        shapes: NDArray[np.float64],
        *,
        reference: Reference,
    ) -> Superposition:
        """Superpose shapes along the normals of a reference."""
        start = reference_positions(sequence, reference)
        directions, centre = offset_reference(template, start)
        return Superposition(start, centre, shapes, directions, holds_drift=False)

    def positions(
        self,
        amplitudes: NDArray[np.float64],
        matrices: NDArray[np.float64],
        translations: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Positions that amplitudes, rotations and the path of the centroid stand for.

        Parameters
        ----------
        amplitudes : (frames, modes, n) float64, length unit
        matrices : (frames, 3, 3) float64
        translations : (frames, 3) float64, length unit

        Returns
        -------
        (frames, vertices, 3) float64, length unit
        """
        # (2) u = sum_p a_p phi_p
        u = self.shapes @ amplitudes
        if self.frames is not None:
            u = from_local(u, self.frames)
        # R (x - c + u - d) + c + d, so written that what does not move stays to the last bit.
        drift = translations[:, None, :]
        if not self.holds_drift:
            u = u + drift
        turned = (self.start - self.centre + u - drift) @ (matrices - np.eye(3)).transpose(0, 2, 1)
        x: NDArray[np.float64] = self.start + u
        x += turned
        return x


def measured(
    sequence: MeshSequence,
    template: Template,
    superposition: Superposition,
    amplitudes: NDArray[np.float64],
    rotations: Rotations,
    translations: NDArray[np.float64],
) -> FrameErrors:
    """Measure superposed positions against those of the sequence.

    Parameters
    ----------
    sequence : MeshSequence
    template : Template
    superposition : Superposition
    amplitudes : (frames, modes, 3) float64, length unit
    rotations : Rotations
    translations : (frames, 3) float64, length unit
    """
    parts = []
    step = max(1, _BLOCK // (3 * sequence.n_vertices))
    for first in range(0, sequence.n_frames, step):
        at = slice(first, first + step)
        x = superposition.positions(amplitudes[at], rotations.matrices[at], translations[at])
        x -= sequence.vertices[at]
        parts.append(errors_of_offsets(x, template))
    return FrameErrors.joined(parts)
