"""One sequence on one template, centred once, and fitted as parameters ask."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.parameters import SignatureKind, SignatureParameters
from modalmotion.fit.basis import Basis
from modalmotion.fit.fit import Fit, fit_displacements
from modalmotion.fit.offsets import Offsets, offsets_of
from modalmotion.fit.superposition import Superposition
from modalmotion.mesh.alignment import DisplacementBlock, Displacements
from modalmotion.mesh.reference import displacements_from
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product
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
