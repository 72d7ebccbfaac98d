"""One sequence on one template, and simple scenes: static, rigid, affine, planar."""

from __future__ import annotations

from dataclasses import dataclass, replace
from enum import StrEnum
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from modalmotion.mesh.alignment import DisplacementBlock, Displacements, Rotations
from modalmotion.mesh.reference import displacements_from
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product, root_mean_square, weighted_sum
from modalmotion.representation import shown
from modalmotion.signature.basis import Basis
from modalmotion.signature.fit import Fit, FrameErrors, errors_of_offsets, fit_displacements
from modalmotion.signature.parameters import SignatureKind, SignatureParameters
from modalmotion.signature.superposition import Offsets, Superposition, offsets_of
from modalmotion.template import Template
from modalmotion.template.body_frame import Components, local_frames, to_local


@dataclass(frozen=True, eq=False)
class Fitter:
    """Fits of any modes to one sequence on one template.

    Parameters
    ----------
    sequence : MeshSequence
        In the template's topology.
    template : Template
    parameters : SignatureParameters
    displacements : Displacements
        Of the sequence, from the reference that the parameters name.
    offsets : Offsets or None
        Where the parameters ask for them: the sequence and its displacements are then those of
        its offsets.
    """

    sequence: MeshSequence
    template: Template
    parameters: SignatureParameters
    displacements: Displacements
    offsets: Offsets | None = None

    @staticmethod
    def of(
        sequence: MeshSequence, template: Template, parameters: SignatureParameters | None = None
    ) -> Fitter:
        """Centre a sequence on a template; 7 modes against frame 0 by default."""
        parameters = SignatureParameters() if parameters is None else parameters
        displacements = displacements_from(
            parameters.reference,
            sequence,
            template.weights,
            template.isolated,
            remove_rotation=parameters.remove_rotation,
        )
        if parameters.kind == SignatureKind.MATERIAL:
            return Fitter(sequence, template, parameters, displacements)
        offsets = offsets_of(displacements, template)
        along = offsets.displacements
        return Fitter(along.sequence, template, parameters, along, offsets)

    def asking(self, **changes: Any) -> Fitter:
        """Fit otherwise, from the same reference: parameters that no template depends on."""
        parameters = replace(self.parameters, **changes)
        displacements = self.displacements
        if self.offsets is None:
            displacements = replace(displacements, remove_rotation=parameters.remove_rotation)
        return replace(self, parameters=parameters, displacements=displacements)

    @cached_property
    def frames(self) -> NDArray[np.float64] | None:
        """Local directions of the components, (vertices, n, 3) float64; None for x, y, z.

        Raises
        ------
        TopologyError
            If the surface has no axis to split components by.
        """
        if self.offsets is not None:
            return self.offsets.directions
        if self.parameters.components == Components.CARTESIAN:
            return None
        return local_frames(self.template)

    def fit(self, basis: Basis) -> Fit:
        """Fit factored modes to every frame; errors as `fit_displacements`."""
        fit = fit_displacements(self.displacements, basis, self.frames)
        if self.offsets is None:
            return fit
        # Offsets are scalars, and the reference's own shape is none of them.
        shape, n_modes = self.displacements.shape, len(basis.modes)
        own = product(shape.rest, basis.columns)[:, :n_modes].T * shape.scale
        return replace(fit, reference_amplitudes=own)

    def coefficients(self, basis: Basis) -> NDArray[np.float64]:
        """Find those of each frame along orthonormal shapes, (frames, modes, n), length unit."""
        parts = []
        for block in self.displacements.blocks():
            u = self.in_components(block)[0]
            c = product(u.reshape(-1, u.shape[2]), basis.analysis.T) * block.shape.scale
            parts.append(c.reshape(*u.shape[:2], -1).transpose(0, 2, 1))
        return np.concatenate(parts)

    def in_components(
        self, block: DisplacementBlock
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Displacements along the directions of the components.

        Returns
        -------
        u : (frames, n, vertices) float64, in units of the shape's scale
        loose_u : (frames, n, 3) float64, length unit
            Of the vertices in no triangle.
        """
        if self.frames is None:
            return block.u, block.loose_u
        loose = np.einsum("nij,fnj->fni", self.frames[block.loose], block.loose_u)
        return to_local(block.u, self.frames), loose

    def superposition(self, shapes: NDArray[np.float64]) -> Superposition:
        """Superpose shapes, (vertices, modes) float64, on the reference."""
        start = self.displacements.start
        return Superposition(start, self.template.weights @ start, shapes, self.frames)


_BLOCK: Final = 500_000

# A reference that is flat to this share of its size has no affine motion off its plane.
_FLAT: Final = 1e-12


class SceneKind(StrEnum):
    """Kinds of motion, the ones that need fewest numbers first."""

    STATIC = "static"
    RIGID = "rigid"
    AFFINE = "affine"
    PLANAR = "planar"
    DEFORMABLE = "deformable"


NUMBERS: Final = {SceneKind.STATIC: 0, SceneKind.RIGID: 6, SceneKind.AFFINE: 12}
"""Numbers a frame that describe a motion of each kind."""


@dataclass(frozen=True)
class SceneError:
    """Error of a kind of motion when it describes all of the motion.

    Parameters
    ----------
    rms, weighted_rms, p95, max : float, length unit
        RMS over all vertices and frames; that by the vertices' shares of the surface; the
        largest 95th percentile of any frame; the largest of any vertex in any frame.
    """

    rms: float
    weighted_rms: float
    p95: float
    max: float


@shown("kind", "error.rms", "error.max")
@dataclass(frozen=True, eq=False)
class LinearMotion:
    """Positions A (x - c) + c + t of a reference's positions x and its centroid c.

    Parameters
    ----------
    kind : SceneKind
        static: A = 1 and t = 0. rigid: A a rotation. affine: A any matrix.
    matrices : (frames, 3, 3) float64
    shifts : (frames, 3) float64, length unit
    error : SceneError
    """

    kind: SceneKind
    matrices: NDArray[np.float64]
    shifts: NDArray[np.float64]
    error: SceneError

    def positions(
        self, start: NDArray[np.float64], centre: NDArray[np.float64], frames: slice = slice(None)
    ) -> NDArray[np.float64]:
        """Positions in some frames.

        Parameters
        ----------
        start : (vertices, 3) float64, length unit
            Of the reference.
        centre : (3,) float64, length unit
            Its weighted centroid.
        frames : slice

        Returns
        -------
        (frames, vertices, 3) float64, length unit
        """
        A, t = self.matrices[frames], self.shifts[frames]
        x: NDArray[np.float64] = (start - centre) @ A.transpose(0, 2, 1)
        x += centre + t[:, None, :]
        return x


@shown()
@dataclass(frozen=True)
class PlanarMotion:
    """Displacements without their component off a plane, rotation removed.

    Parameters
    ----------
    normal : tuple of float
        Unit vector across the plane, in the coordinates of the reference.
    error : SceneError
        Of leaving that component out.
    """

    normal: tuple[float, float, float]
    error: SceneError


@shown()
@dataclass(frozen=True, eq=False)
class Scene:
    """A motion measured against each simple kind.

    Parameters
    ----------
    static, rigid, affine : LinearMotion
    planar : PlanarMotion
    """

    static: LinearMotion
    rigid: LinearMotion
    affine: LinearMotion
    planar: PlanarMotion

    @property
    def errors(self) -> dict[SceneKind, SceneError]:
        """Error of each kind."""
        return {
            kind: getattr(self, kind.value).error
            for kind in SceneKind
            if kind != SceneKind.DEFORMABLE
        }


def scene_of(fitter: Fitter, rotations: Rotations) -> Scene:
    """Measure a sequence against each simple kind of motion.

    Parameters
    ----------
    fitter : Fitter
    rotations : Rotations
        About the centroid of each frame, from the fit of its modes.
    """
    sequence, template = fitter.sequence, fitter.template
    start, weights = fitter.displacements.start, template.weights
    centre = weighted_sum(weights, start)
    rest = start - centre
    size = float(np.abs(rest[weights > 0]).max(initial=0.0)) or 1.0
    moments = (rest / size * weights[:, None]).T @ (rest / size)
    values, axes = np.linalg.eigh(moments)
    spread = values > _FLAT * values.max(initial=0.0)
    f = sequence.n_frames
    shifts, affine = np.empty((f, 3)), np.empty((f, 3, 3))
    for k, positions in enumerate(sequence.vertices):
        u = positions - start
        shifts[k] = weighted_sum(weights, u)
        # A - 1 = sum w u (x - c)' M^-1; nothing is known of directions the reference lacks.
        slopes = (u / size * weights[:, None]).T @ (rest / size)
        inverse = axes[:, spread] / values[spread] @ axes[:, spread].T
        affine[k] = np.eye(3) + slopes @ inverse
    identity = np.tile(np.eye(3), (f, 1, 1))
    motions = {
        SceneKind.STATIC: (identity, np.zeros((f, 3))),
        SceneKind.RIGID: (rotations.matrices, shifts),
        SceneKind.AFFINE: (affine, shifts),
    }
    linear = {
        kind: _linear(sequence, template, start, centre, kind, *motion)
        for kind, motion in motions.items()
    }
    return Scene(
        linear[SceneKind.STATIC],
        linear[SceneKind.RIGID],
        linear[SceneKind.AFFINE],
        planar_motion(fitter),
    )


def planar_motion(fitter: Fitter) -> PlanarMotion:
    """Find the plane that contains most of the displacements, each frame's rotation removed."""
    template, turned = fitter.template, fitter.asking(remove_rotation=True).displacements
    moments = np.zeros((3, 3))
    for block in turned.blocks():
        flat = block.u.transpose(0, 2, 1).reshape(-1, 3)
        moments += (flat * np.tile(template.weights, len(block.u))[:, None]).T @ flat
    normal = np.linalg.eigh(moments)[1][:, 0]
    largest = int(np.argmax(np.abs(normal)))
    normal = normal * (1.0 if normal[largest] > 0 else -1.0)
    errors = []
    for block in turned.blocks():
        off = block.u.transpose(0, 2, 1) @ normal * block.shape.scale
        off[:, block.loose] = block.loose_u @ normal
        errors.append(errors_of_offsets(off[:, :, None] * normal, template))
    x, y, z = normal.tolist()
    return PlanarMotion((x, y, z), _over_frames(errors))


def _linear(
    sequence: MeshSequence,
    template: Template,
    start: NDArray[np.float64],
    centre: NDArray[np.float64],
    kind: SceneKind,
    matrices: NDArray[np.float64],
    shifts: NDArray[np.float64],
) -> LinearMotion:
    nothing = SceneError(0.0, 0.0, 0.0, 0.0)
    motion = LinearMotion(kind, matrices, shifts, nothing)
    step = max(1, _BLOCK // (3 * sequence.n_vertices))
    errors = []
    for first in range(0, sequence.n_frames, step):
        at = slice(first, first + step)
        x = start[None] if kind == SceneKind.STATIC else motion.positions(start, centre, at)
        errors.append(errors_of_offsets(x - sequence.vertices[at], template))
    return LinearMotion(kind, matrices, shifts, _over_frames(errors))


def _over_frames(parts: list[FrameErrors]) -> SceneError:
    errors = FrameErrors.joined(parts)
    return SceneError(
        rms=root_mean_square(errors.rms),
        weighted_rms=root_mean_square(errors.weighted_rms),
        p95=float(errors.p95.max()),
        max=float(errors.max.max()),
    )
