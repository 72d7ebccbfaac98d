"""Effect of a millimetre of each mode on a read-out."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np

from modalmotion.clinical.dyssynchrony import (
    N_SECTORS,
    index_gradient,
    phases_of,
    sectors_of,
    segment_volumes,
    volume_gradients,
)
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
from modalmotion.modes.topology import CUP
from modalmotion.representation import Floats, shown
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
        at end systole, as far as the surface has them; SDI by those of all frames, each in its
        share of the change of volume: 0 at end diastole, 1 at end systole.
    units : tuple of str
        Of each, for one length unit of an amplitude: volumes in the read-outs' `volume_unit`,
        shares and strain in points, SDI in percent of the cycle.
    labels : tuple of ModeLabel
    values : (names, modes, directions) float64
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    labels: tuple[ModeLabel, ...]
    values: Floats


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
    surfaces = reconstruct(signature, sequence, template=template)
    surfaces -= surfaces[0].mean(axis=0)
    # Displacements before rotation, so gradients are turned back.
    moves, turns = _moves(signature, sequence, template), signature.rotations.matrices
    cavity = cavity_of(used.faces, used.n_vertices)
    volume, unit = float(np.abs(cavity.volume(surfaces[start]))), readouts.volume_unit
    sign = np.sign(cavity.volume(surfaces[start]))
    by_start, by_end = (sign * volume_gradient(cavity, surfaces[k]) for k in (start, end))
    found = [
        ("end_diastolic_volume", unit, readouts.shown_in * by_start @ turns[start]),
        ("end_systolic_volume", unit, readouts.shown_in * by_end @ turns[end]),
    ]
    if (fraction := readouts.curve.fraction) is not None:
        found.append((str(fraction), "points", -100.0 / volume * by_end @ turns[end]))
    with suppress(InputError):
        wall, _ = smooth_walls(used, is_lattice=sequence.grid is not None)
        motion = WallMotion.of(surfaces, None, wall, start)
        for name, one in zip(DEFINITIONS, measures_of(motion), strict=False):
            by_vertex = wall.projector.T @ motion.gradients(one, end, start)[0]
            found.append((name, "points", by_vertex @ turns[end]))
        if (by_frame := _of_dyssynchrony(motion, phases_of(sequence))) is not None:
            volumes = readouts.curve.volumes
            shares = (volumes[start] - volumes) / (volumes[start] - volumes[end])
            total = np.einsum("f,fkj,fji->ki", shares, by_frame, turns)
            found.append(("SDI", "% of the cycle", wall.projector.T @ total))
    values = [np.tensordot(moves, gradient, axes=((2, 3), (0, 1))) for *_, gradient in found]
    return Sensitivities(
        names=tuple(name for name, *_ in found),
        units=tuple(unit for _, unit, _ in found),
        labels=signature.modes.labels,
        values=np.array(values),
    )


def _moves(signature: ModalSignature, sequence: MeshSequence, template: Template | None) -> Floats:
    """Displacement by a unit of each amplitude, unrotated, (modes, directions, vertices, 3)."""
    _, m, n = signature.amplitudes.shape
    # Superposition is linear: a frame at rest, and one for each amplitude.
    units = np.concatenate([np.zeros((1, m, n)), np.eye(m * n).reshape(m * n, m, n)])
    still = Rotations(np.tile(np.eye(3), (len(units), 1, 1)), np.ones(len(units), dtype=np.bool_))
    posed = replace(
        signature, amplitudes=units, translations=np.zeros((len(units), 3)), rotations=still
    )
    x = reconstruct(posed, sequence, template=template)
    return np.asarray((x[1:] - x[0]).reshape(m, n, *x.shape[1:]), dtype=np.float64)


def _of_dyssynchrony(motion: WallMotion, phases: Floats) -> Floats | None:
    """Gradient of the index by the coefficients of every frame, (frames, functions, 3)."""
    if motion.wall.surface != CUP:
        return None
    sectors = sectors_of(motion)
    volumes = segment_volumes(motion, sectors, N_SECTORS)
    if (by_volume := index_gradient(volumes, phases)) is None:
        return None
    gradients = np.array(
        [volume_gradients(motion, sectors, N_SECTORS, k) for k in range(motion.n_frames)]
    )
    # A volume is of the third degree in the coefficients: its gradient tells its sign.
    sign = np.sign(np.einsum("fkj,kfj->", gradients.sum(axis=2), motion.coefficients))
    return np.asarray(sign * np.einsum("fknj,fn->fkj", gradients, by_volume), dtype=np.float64)
