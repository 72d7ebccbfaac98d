"""Weighted least-squares fit of modal amplitudes, and the errors of each frame.

Modal superposition (2) u = Phi a of Nastar (1994), inverted: a = argmin |u - Phi a|_W. By
QR of the weighted shapes, never by normal equations, whose condition is the square.

A plain name counts every vertex of the surface, and all alike; `weighted` precedes what
counts each by its share of the surface. Vertices in no triangle count in no error.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from modalmotion.errors import ModeCountError
from modalmotion.mesh.alignment import (
    DisplacementBlock,
    Displacements,
    Rotations,
    displacements_from,
)
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.mesh.spring_modes import Modes, whole_counts
from modalmotion.numeric.scales import exceeded_by_a_twentieth, orthonormal, root_mean_square
from modalmotion.representation import Floats, Ints, shown
from modalmotion.signature.normal_displacements import NormalDisplacements, normal_displacements_of
from modalmotion.signature.parameters import ErrorKind, SignatureKind, SignatureParameters
from modalmotion.template import Template, body_frame
from modalmotion.template.template import shapes_of

# Amplitudes lose this factor of the data's precision; beyond it they are not worth giving.
LARGEST_CONDITION: Final = 1e8


@dataclass(frozen=True, eq=False)
class Basis:
    """Mode shapes on a template, factored once for any number of frames.

    Parameters
    ----------
    modes : Modes
    shapes : (vertices, modes) float64
        Phi.
    triangle : (modes, modes) float64
        R of the weighted shapes: |R a| is the weighted RMS of the superposed displacement.
    analysis : (modes, vertices) float64
        Q'W^(1/2): coefficients R a of displacements along orthonormal shapes.
    condition : float
        Of the weighted shapes, 1 for orthogonal ones.
    """

    modes: Modes
    shapes: Floats
    triangle: Floats
    analysis: Floats
    condition: float

    @cached_property
    def projector(self) -> Floats:
        """Weighted least-squares solution: amplitudes of displacements, (modes, vertices)."""
        return np.asarray(np.linalg.solve(self.triangle, self.analysis), dtype=np.float64)

    def orthonormal_rows(self, n_modes: int) -> Floats:
        """Shapes Psi = Phi R^-1 of the first modes, orthonormal by weight, (modes, vertices)."""
        R = self.triangle[:n_modes, :n_modes]
        return np.asarray(np.linalg.solve(R.T, self.shapes[:, :n_modes].T), dtype=np.float64)

    def first(self, n_modes: int) -> "Basis":
        """First modes: the first columns of a QR factorisation are that of the first shapes."""
        R = self.triangle[:n_modes, :n_modes]
        modes = self.modes.take(np.arange(n_modes))
        condition = float(np.linalg.cond(R))
        return Basis(modes, self.shapes[:, :n_modes], R, self.analysis[:n_modes], condition)


def make_basis(template: Template, modes: Modes) -> Basis:
    """Evaluate and factor modes on a template.

    Raises
    ------
    ModeCountError
        If the weighted vertices cannot resolve that many modes.
    """
    return factored(modes, shapes_of(modes, template), template.weights)


def factored(modes: Modes, shapes: Floats, weights: Floats) -> Basis:
    """Factor shapes with weights.

    Raises
    ------
    ModeCountError
        If there are fewer weighted vertices than modes, or they cannot distinguish them.
    """
    n_weighted, root = int((weights > 0).sum()), np.sqrt(weights)[:, None]
    Q, R = orthonormal(root * shapes[:, : max(n_weighted, 1)])
    if len(modes) > n_weighted:
        raise _too_many(modes, R, f"cannot be distinguished on {n_weighted} vertices.")
    condition = float(np.linalg.cond(R))
    if not condition <= LARGEST_CONDITION:
        text = (
            f"have the condition {condition:.1e} on this surface, above {LARGEST_CONDITION:.0e}: "
            "the amplitudes would be noise."
        )
        raise _too_many(modes, R, text, condition=condition)
    return Basis(modes, shapes, R, np.ascontiguousarray((root * Q).T), condition)


def _too_many(modes: Modes, R: Floats, message: str, **details: float) -> ModeCountError:
    """Error that names the largest number of modes that passes, in whole pairs."""
    counts = whole_counts(modes)
    most = largest_sound(R, counts[counts <= len(R)])
    return ModeCountError(
        f"{len(modes)} modes {message}",
        remedy=f"Ask for at most {most} modes, or send a finer mesh.",
        details={"modes": len(modes), "most": most, **details},
    )


def largest_sound(R: Floats, counts: Ints) -> int:
    """Find the number of modes of the largest whole set whose amplitudes are worth giving.

    Parameters
    ----------
    R : (modes, modes) float64
        Triangle of the weighted shapes.
    counts : (n,) int64
        Modes of each set, increasing.

    Raises
    ------
    ModeCountError
        If not even those of the smallest set are.
    """
    # The condition is at least this ratio, and grows with the set.
    diagonal = np.abs(np.diag(R))
    bound = np.maximum.accumulate(diagonal) <= LARGEST_CONDITION * np.minimum.accumulate(diagonal)
    n = max(int(bound.sum()), 1) if diagonal[0] > 0 else 1
    # Inverses of nested triangles are nested: one gives the norms of all.
    norms = [np.cumsum((A**2).sum(axis=0)) for A in (R[:n, :n], np.linalg.inv(R[:n, :n]))]
    least = np.sqrt(norms[0] * norms[1]) / np.arange(1, n + 1)
    for count in counts[counts <= max(int((least <= LARGEST_CONDITION).sum()), 1)][::-1].tolist():
        condition = float(np.linalg.cond(R[:count, :count]))
        if condition <= LARGEST_CONDITION:
            return int(count)
    raise ModeCountError(
        f"{counts[0]} modes have the condition {condition:.1e} on this surface.",
        remedy="Send a finer mesh.",
        details={"modes": int(counts[0]), "condition": condition},
    )


@dataclass(frozen=True, eq=False)
class FrameErrors:
    """Distances between vertices of the surface and their reconstruction.

    Parameters
    ----------
    rms : (frames,) float64, length unit
        Over all vertices.
    weighted_rms : (frames,) float64, length unit
        Over the surface, each vertex by its weight: what the fit makes least.
    p95 : (frames,) float64, length unit
        A twentieth of all vertices are farther off.
    max : (frames,) float64, length unit
        Of any vertex.
    """

    rms: Floats
    weighted_rms: Floats
    p95: Floats
    max: Floats

    def over_frames(self, kind: ErrorKind) -> float:
        """Error that a tolerance limits, length unit."""
        if kind == ErrorKind.MAX:
            return float(self.max.max())
        return root_mean_square(self.rms if kind == ErrorKind.RMS else self.weighted_rms)


def errors_of(parts: list[Floats], template: Template, scale: float) -> FrameErrors:
    """Take the errors from squares of distances.

    Parameters
    ----------
    parts : list of (frames, vertices) float64, in units of the scale squared
        Of consecutive frames.
    template : Template
    scale : float, length unit
    """
    squares, weights = np.concatenate(parts), template.weights
    if len(template.isolated):
        squares = np.delete(squares, template.isolated, axis=1)
        weights = np.delete(weights, template.isolated)
    kinds = squares.mean(axis=1), squares @ weights, exceeded_by_a_twentieth(squares)
    return FrameErrors(*(scale * np.sqrt(kind) for kind in (*kinds, squares.max(axis=1))))


@shown()
@dataclass(frozen=True, eq=False)
class Fit:
    """Amplitudes of every frame, and their errors.

    Parameters
    ----------
    basis : Basis
        The modes, factored.
    amplitudes : (frames, modes, n) float64, length unit
        Of x, y, z, of the radial, tangential and axial displacement, or of the normal displacement.
    rotations : Rotations
        Removed before the fit, about the centroid of each frame.
    translations : (frames, 3) float64, length unit
        Path of the weighted centroid from the reference's.
    errors : FrameErrors
    motion : FrameErrors
        Displacements from the reference, rotation removed: the errors with no modes.
    reference_amplitudes : (modes, 3) float64, length unit
        Amplitudes of the reference itself, of its positions from its centroid; zero where
        components are radial, tangential and axial.
    """

    basis: Basis
    amplitudes: Floats
    rotations: Rotations
    translations: Floats
    errors: FrameErrors
    motion: FrameErrors
    reference_amplitudes: Floats


def project(basis: Basis, displacements: Floats) -> Floats:
    """Amplitudes of displacements: their weighted least-squares fit.

    Parameters
    ----------
    basis : Basis
    displacements : (frames, vertices, 3) float64, length unit

    Returns
    -------
    (frames, modes, 3) float64, length unit
    """
    return basis.projector @ displacements


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
    normal_displacements : NormalDisplacements or None
        What is fitted instead, where the parameters ask for it.
    """

    sequence: MeshSequence
    template: Template
    parameters: SignatureParameters
    displacements: Displacements
    normal_displacements: NormalDisplacements | None = None

    @staticmethod
    def of(
        sequence: MeshSequence, template: Template, parameters: SignatureParameters | None = None
    ) -> "Fitter":
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
        normal_displacements = normal_displacements_of(displacements, template)
        return Fitter(sequence, template, parameters, displacements, normal_displacements)

    def asking(self, **changes: Any) -> "Fitter":
        """Fit otherwise, from the same reference: parameters that no template depends on."""
        parameters = replace(self.parameters, **changes)
        displacements = replace(self.displacements, remove_rotation=parameters.remove_rotation)
        return replace(self, parameters=parameters, displacements=displacements)

    @cached_property
    def frames(self) -> Floats | None:
        """Local directions of the components, (vertices, n, 3) float64; None for x, y, z.

        Raises
        ------
        TopologyError
            If the surface has no axis to split components by.
        """
        if self.normal_displacements is not None:
            return self.normal_displacements.directions
        if self.parameters.components == body_frame.Components.CARTESIAN:
            return None
        return body_frame.local_frames(self.template)

    def blocks(self) -> Iterator[DisplacementBlock]:
        """Displacements along the components' directions, in blocks of bounded memory."""
        if self.normal_displacements is not None:
            yield from self.normal_displacements.blocks
            return
        for block in self.displacements.blocks():
            E = self.frames
            yield block if E is None else replace(block, u=body_frame.to_local(block.u, E))

    def along(self, rows: Floats) -> Floats:
        """Products of displacements with rows, such as a projector's.

        Parameters
        ----------
        rows : (modes, vertices) float64

        Returns
        -------
        (frames, modes, n) float64, length unit
        """
        found = [block.u @ rows.T for block in self.blocks()]
        return np.concatenate(found).transpose(0, 2, 1) * self.displacements.shape.scale

    def fit(self, basis: Basis) -> Fit:
        """Fit factored modes to every frame, in blocks of bounded memory."""
        shape, P, phi = self.displacements.shape, basis.projector.T, basis.shapes.T
        amplitudes, moved, left, blocks = [], [], [], []
        for block in self.blocks():
            # One product over the rows of all frames is faster than one for each frame.
            a = block.u.reshape(-1, len(P)) @ P
            moved.append(_squares(block.u))
            left.append(_squares(block.u - (a @ phi).reshape(block.u.shape)))
            a = a.reshape(*block.u.shape[:2], -1)
            amplitudes.append(a.transpose(0, 2, 1))
            blocks.append((block.rotations.matrices, block.rotations.is_determined, block.drifts))
        matrices, determined, drifts = (np.concatenate(each) for each in zip(*blocks, strict=True))
        own = np.zeros((len(basis.modes), 3))
        # Normal displacements are scalars, and the reference's own shape is none of them.
        if self.normal_displacements is not None or self.frames is None:
            own = (shape.rest @ P).T * shape.scale
        return Fit(
            basis=basis,
            amplitudes=np.concatenate(amplitudes) * shape.scale,
            rotations=Rotations(matrices, determined),
            translations=drifts * shape.scale,
            errors=errors_of(left, self.template, shape.scale),
            motion=errors_of(moved, self.template, shape.scale),
            reference_amplitudes=own,
        )

    def refitted(self, fit: Fit, amplitudes: Floats) -> Fit:
        """Give a fit other amplitudes, with the errors that they leave."""
        shape, phi, left = self.displacements.shape, fit.basis.shapes.T, []
        for block in self.blocks():
            a = (amplitudes[block.frames] / shape.scale).transpose(0, 2, 1)
            left.append(_squares(block.u - a @ phi))
        errors = errors_of(left, self.template, shape.scale)
        return replace(fit, amplitudes=amplitudes, errors=errors)


def _squares(u: Floats) -> Floats:
    """Squared lengths of vectors, (frames, n, vertices) to (frames, vertices)."""
    return np.asarray(np.einsum("fiv,fiv->fv", u, u))
