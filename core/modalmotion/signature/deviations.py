"""Standard deviations of a signature's amplitudes, wherever the error of positions is known."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from modalmotion.choice.fitted_motion import Model
from modalmotion.choice.fitter import Fitter
from modalmotion.choice.noise_level import measure_noise
from modalmotion.choice.parameters import SignatureKind
from modalmotion.errors import ModeCountError
from modalmotion.fit.basis import Basis, make_basis
from modalmotion.fit.deviations import amplitude_deviations, turns_of_axes
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.checks import Uncertainty
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.numeric.products import product


def deviations_of(
    sequence: MeshSequence, model: Model, fitter: Fitter, rotations: Rotations
) -> tuple[NDArray[np.float64] | None, tuple[str, ...]]:
    """Propagate what is known of the positions' errors to the amplitudes.

    Parameters
    ----------
    sequence : MeshSequence
        As it was measured, and not its offsets.
    model : Model
        That was fitted.
    fitter : Fitter
    rotations : Rotations
        Removed before the fit.

    Returns
    -------
    deviations : (frames, modes, n) float64, length unit, or None
        None where nothing is known, and nobody asked for an estimate.
    notes : tuple of str
        What they come from.
    """
    uncertainty, notes = sequence.uncertainty, tuple[str, ...]()
    if uncertainty is None:
        noise = None if model.choice is None else model.choice.noise
        if noise is None and fitter.parameters.deviations:
            noise = measure_noise(_material(sequence, fitter))
            notes = (noise.note(sequence.unit),)
        if noise is None:
            return None, ()
        # Of vertices that count alike: by how much they count is in the fit.
        n = sequence.n_vertices
        independent = noise.independent_vertices * n * float((fitter.template.weights**2).sum())
        uncertainty = Uncertainty.of_noise(
            noise.sigma, sequence.n_frames, n, independent, noise.between_frames
        )
        words = "the noise of the vertices"
    else:
        words = "the deviations of the track"
    is_offset = fitter.offsets is not None
    basis = model.basis
    deviations = amplitude_deviations(
        sequence,
        uncertainty,
        fitter.template,
        basis,
        rotations.matrices,
        fitter.parameters.reference,
        directions=fitter.frames,
        is_offset=is_offset,
        remove_rotation=fitter.parameters.remove_rotation,
    )
    placement = fitter.template.placement
    if placement is not None and fitter.parameters.template is None:
        # Of the sequence itself: where its axes point is part of the error.
        fits = [(fitter, basis)]
        for turn in turns_of_axes(placement, uncertainty, rotations.matrices):
            turned = replace(fitter, template=fitter.template.turned(turn))
            # So many modes that the turned shape just cannot tell them apart: none is about axes.
            with suppress(ModeCountError):
                fits.append((turned, make_basis(turned.template, model.modes)))
        fitted, *others = _amplitudes(fits)
        deviations = np.sqrt(deviations**2 + sum((other - fitted) ** 2 for other in others))
        words += ", and from how far they leave axis and zero of theta undecided"
    text = f"The standard deviations of the amplitudes follow from {words}."
    return deviations, (*notes, text)


def _amplitudes(fits: list[tuple[Fitter, Basis]]) -> list[NDArray[np.float64]]:
    """Amplitudes of the displacements of the first fitter on each template."""
    parts: list[list[NDArray[np.float64]]] = [[] for _ in fits]
    for block in fits[0][0].displacements.blocks():
        for (fitter, basis), found in zip(fits, parts, strict=True):
            u = fitter.in_components(block)[0]
            rows = u.reshape(-1, u.shape[2])
            a = product(rows, basis.columns)[:, : len(basis.modes)] * block.shape.scale
            found.append(a.reshape(len(u), u.shape[1], -1).transpose(0, 2, 1))
    return [np.concatenate(found) for found in parts]


def _material(sequence: MeshSequence, fitter: Fitter) -> Fitter:
    """Fitter of the displacements, whose noise is known."""
    if fitter.offsets is None:
        return fitter
    parameters = replace(fitter.parameters, kind=SignatureKind.MATERIAL)
    return Fitter.of(sequence, fitter.template, parameters)
