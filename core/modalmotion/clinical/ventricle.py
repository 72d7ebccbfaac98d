"""Read-outs of a ventricle besides its volume: rates, segments, strain; and as values for JSON."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np

from modalmotion import errors, mesh, modes, notes
from modalmotion.arguments.checking import Plotted
from modalmotion.clinical import dyssynchrony, smooth_wall
from modalmotion.clinical.readouts import ClinicalReadouts, Rates, rates_of
from modalmotion.clinical.segments import RegionalMotion, regional_motion
from modalmotion.clinical.strain import (
    DEFINITIONS,
    Strain,
    Torsion,
    measures_of,
    torsion,
    wall_strain,
)
from modalmotion.clinical.volume_curve import Fraction, VolumeCurve
from modalmotion.clinical.wall_motion import DIRECTIONS, WallMotion
from modalmotion.hdf5.image import INTENDED_USE
from modalmotion.mesh import geometry
from modalmotion.mesh.alignment import Rotations
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.modes import topologies
from modalmotion.representation import Floats, plain, shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on, reconstruct
from modalmotion.template import Template

T = TypeVar("T")


@shown("rates", "regions", "strain")
@dataclass(frozen=True, eq=False)
class VentricleReadouts(Plotted):
    """Read-outs that not every surface has; None otherwise, with the reason.

    Parameters
    ----------
    rates : Rates or None
    regions : RegionalMotion or None
    strain : Strain or None
    torsion : Torsion or None
        None unless it is stated that vertices follow the tissue.
    per_mode : Sensitivities or None
        Effect of a unit of each amplitude on the read-outs.
    reasons : tuple of Note
        Reasons of those that are None.
    """

    rates: Rates | None
    regions: RegionalMotion | None
    strain: Strain | None
    torsion: Torsion | None
    per_mode: "Sensitivities | None"
    reasons: tuple[notes.Note, ...]


def ventricle_readouts(
    signature: ModalSignature,
    sequence: MeshSequence,
    readouts: ClinicalReadouts,
    *,
    template: Template | None = None,
) -> VentricleReadouts:
    """Compute further read-outs of a ventricle's wall and volume.

    Parameters
    ----------
    signature : ModalSignature
    sequence : MeshSequence
        The one it was made from, with its facts.
    readouts : ClinicalReadouts
        Of the same signature: its largest volume is end diastole, its smallest end systole.
    template : Template, optional
        The one that the signature's parameters name, if they name one.
    """
    start, end = readouts.mesh_curve.end_diastole, readouts.mesh_curve.end_systole
    reasons: list[notes.Note] = []

    def attempt(make: Callable[[], T]) -> T | None:
        try:
            return make()
        except errors.InputError as error:
            reasons.append(notes.Note.of("not_computed", reason=str(error), error=error.code))
            return None

    return VentricleReadouts(
        rates=attempt(lambda: rates_of(readouts, sequence.facts.period)),
        regions=attempt(lambda: regional_motion(signature, sequence, start, template=template)),
        strain=attempt(
            lambda: wall_strain(sequence, fitted_on(signature, sequence, template), start, end)
        ),
        torsion=attempt(
            lambda: torsion(sequence, fitted_on(signature, sequence, template), start, end)
        ),
        per_mode=attempt(lambda: sensitivities(signature, sequence, readouts, template=template)),
        reasons=tuple(dict.fromkeys(reasons)),
    )


def readouts_json(readouts: ClinicalReadouts, ventricle: VentricleReadouts) -> dict[str, Any]:
    """Write all read-outs, each number with its interval; volumes in `volume_unit`."""
    return {
        "sequence_id": readouts.sequence_id,
        "template_id": readouts.template_id,
        "amplitudes_per_frame": readouts.n_amplitudes,
        "volume_unit": readouts.volume_unit,
        "times": None if readouts.times is None else readouts.times.tolist(),
        "n_openings": readouts.n_openings,
        "from_signature": volumes_json(readouts.curve, readouts.shown_in),
        "of_mesh": volumes_json(readouts.mesh_curve, readouts.shown_in),
        **ventricle_json(ventricle),
        "notes": [*readouts.notes, *ventricle.reasons],
        "intended_use": INTENDED_USE,
    }


def volumes_json(curve: VolumeCurve, factor: float) -> dict[str, Any]:
    """Write volumes over time in another unit, and their read-outs."""
    figures = {
        name: dict(zip(("value", "low", "high"), one, strict=True))
        for name, one in curve.figures(factor).items()
    }
    return {
        "volumes": (curve.volumes * factor).tolist(),
        "bounds": (curve.bounds * factor).tolist(),
        "end_diastole": curve.end_diastole,
        "end_systole": curve.end_systole,
        **dict.fromkeys(map(str, Fraction)),
        **figures,
    }


def ventricle_json(ventricle: VentricleReadouts) -> dict[str, Any]:
    """Write read-outs: rates, segments and strain, null if a surface has none."""
    regions, strain, per_mode = ventricle.regions, ventricle.strain, ventricle.per_mode
    answer: dict[str, Any] = plain(
        {
            "rates": ventricle.rates,
            "segments": regions
            and {
                "names": regions.names,
                "percent": regions.shares,
                "end_diastole": regions.end_diastole,
                "reason": regions.reason,
            },
            "strain": strain and _strain_json(strain),
            "torsion": ventricle.torsion,
            "per_mode": per_mode
            and {
                "names": per_mode.names,
                "units": per_mode.units,
                "modes": list(map(str, per_mode.labels)),
                "values": per_mode.values,
            },
        }
    )
    return answer


def _strain_json(strain: Strain) -> dict[str, Any]:
    """Write strain, each number with its interval and its definition."""
    return {
        "figures": [
            {
                "name": name,
                "definition": DEFINITIONS.get(name, DEFINITIONS["GCS"]),
                "end_systolic": strain.end_systolic[name],
                "peak": strain.peak[name],
                "curve": strain.curves[:, place],
                "deviations": strain.deviations[:, place],
            }
            for place, name in enumerate(strain.names)
        ],
        "segments": {
            "names": strain.segments,
            "directions": DIRECTIONS,
            "percent": strain.by_segment,
            "end_systolic_deviations": strain.segment_deviations,
            "reason": strain.reason,
        },
        "found_by": "largest and smallest volume",
        **{
            name: getattr(strain, name)
            for name in (
                *("dyssynchrony", "end_diastole", "end_systole", "layer", "source", "notes"),
            )
        },
    }


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
    labels: tuple[modes.ModeLabel, ...]
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
    cavity = mesh.cavity_of(used.faces, used.n_vertices)
    volume, unit = float(np.abs(cavity.volume(surfaces[start]))), readouts.volume_unit
    sign = np.sign(cavity.volume(surfaces[start]))
    by_start, by_end = (sign * geometry.volume_gradient(cavity, surfaces[k]) for k in (start, end))
    found = [
        ("end_diastolic_volume", unit, readouts.shown_in * by_start @ turns[start]),
        ("end_systolic_volume", unit, readouts.shown_in * by_end @ turns[end]),
    ]
    if (fraction := readouts.curve.fraction) is not None:
        found.append((str(fraction), "points", -100.0 / volume * by_end @ turns[end]))
    with suppress(errors.InputError):
        wall, _ = smooth_wall.smooth_walls(used, is_lattice=sequence.grid is not None)
        motion = WallMotion.of(surfaces, None, wall, start)
        for name, one in zip(DEFINITIONS, measures_of(motion), strict=False):
            by_vertex = wall.projector.T @ motion.gradients(one, end, start)[0]
            found.append((name, "points", by_vertex @ turns[end]))
        if (by_frame := _of_dyssynchrony(motion, dyssynchrony.phases_of(sequence))) is not None:
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
    if motion.wall.surface != topologies.CUP:
        return None
    sectors = dyssynchrony.sectors_of(motion)
    volumes, gradients = dyssynchrony.segment_volumes(motion, sectors, dyssynchrony.N_SECTORS)
    if (by_volume := dyssynchrony.index_gradient(volumes, phases)) is None:
        return None
    return np.asarray(np.einsum("fknj,fn->fkj", gradients, by_volume), dtype=np.float64)
