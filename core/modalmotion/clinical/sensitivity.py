"""Effect of a millimetre of each mode on a read-out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.clinical.smooth_wall import smooth_walls
from modalmotion.clinical.strain import DEFINITIONS, measures_of
from modalmotion.clinical.wall_motion import WallMotion
from modalmotion.errors import InputError
from modalmotion.mesh import cavity_of
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.geometry import volume_gradient
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes import ModeLabel
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on, reconstruct
from modalmotion.template import Template


@shown("names", "units", "labels")
@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Gradients of read-outs by the amplitudes of one frame.

    Parameters
    ----------
    names : tuple of str
        end_diastolic_volume by the amplitudes at end diastole; end_systolic_volume,
        ejection_fraction (volume_change of other surfaces than cavities), GLS, GCS and GAS by those
        at end systole, as far as the surface has them.
    units : tuple of str
        Of each, for one length unit of an amplitude: volumes in the read-outs' `volume_unit`,
        shares and strain in points.
    labels : tuple of ModeLabel
    values : (names, modes, directions) float64
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    labels: tuple[ModeLabel, ...]
    values: NDArray[np.float64]


def sensitivities(
    signature: ModalSignature,
    sequence: MeshSequence,
    readouts: ClinicalReadouts,
    *,
    template: Template | None = None,
) -> Sensitivities:
    """Differentiate read-outs of a signature's own surfaces by its amplitudes.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from.
    readouts : ClinicalReadouts
        Of the same signature: its frames of end diastole and end systole are used.
    template : Template, optional
        The one that the signature's parameters name, if they name one.

    Raises
    ------
    InputError
        If the surface encloses nothing, or the sequence is another.
    """
    used = fitted_on(signature, sequence, template)
    start, end = readouts.curve.end_diastole, readouts.curve.end_systole
    surfaces = reconstruct(signature, sequence, [start, end], template=template)
    moves = {frame: _moves(signature, sequence, frame, template) for frame in {start, end}}
    cavity = cavity_of(used.faces, used.n_vertices)
    volume, unit = float(np.abs(cavity.volume(surfaces[0]))), readouts.volume_unit
    sign = np.sign(cavity.volume(surfaces[0]))
    by_start, by_end = (sign * volume_gradient(cavity, x) for x in surfaces)
    found = [
        ("end_diastolic_volume", unit, start, readouts.shown_in * by_start),
        ("end_systolic_volume", unit, end, readouts.shown_in * by_end),
    ]
    if readouts.curve.fraction is not None:
        found.append((str(readouts.curve.fraction), "points", end, -100.0 / volume * by_end))
    for name, gradient in _of_strain(used, surfaces, is_lattice=sequence.grid is not None):
        found.append((name, "points", end, gradient))
    values = [np.tensordot(moves[frame], g, axes=((2, 3), (0, 1))) for _, _, frame, g in found]
    return Sensitivities(
        names=tuple(name for name, *_ in found),
        units=tuple(unit for _, unit, *_ in found),
        labels=signature.modes.labels,
        values=np.array(values),
    )


def _moves(
    signature: ModalSignature, sequence: MeshSequence, frame: int, template: Template | None
) -> NDArray[np.float64]:
    """Displacement of vertices by a unit of each amplitude, (modes, directions, vertices, 3)."""
    _, m, n = signature.amplitudes.shape
    units = np.concatenate([np.zeros((1, m, n)), np.eye(m * n).reshape(m * n, m, n)])
    # Superposition is linear: as many frames of one pose as there are amplitudes.
    chosen = np.full(len(units), frame)
    posed = replace(
        signature,
        amplitudes=signature.amplitudes[chosen] + units,
        translations=signature.translations[chosen],
        rotations=Rotations(
            signature.rotations.matrices[chosen], signature.rotations.is_determined[chosen]
        ),
    )
    x = reconstruct(posed, sequence, list(range(len(units))), template=template)
    return np.asarray((x[1:] - x[0]).reshape(m, n, *x.shape[1:]), dtype=np.float64)


def _of_strain(
    template: Template, surfaces: NDArray[np.float64], *, is_lattice: bool
) -> list[tuple[str, NDArray[np.float64]]]:
    """Gradients of global strains at the second surface by its vertices."""
    try:
        wall, _ = smooth_walls(template, is_lattice=is_lattice)
    except InputError:
        return []
    motion = WallMotion.of(surfaces, None, wall, 0)
    gradients = (motion.gradients(one, 1, 0)[0] for one in measures_of(motion))
    return [
        (name, wall.projector.T @ gradient)
        for name, gradient in zip(DEFINITIONS, gradients, strict=False)
    ]
