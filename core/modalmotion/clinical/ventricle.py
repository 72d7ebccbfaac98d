"""Read-outs of a ventricle besides its volume: rates, segments, strain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

from modalmotion.arguments.checking import Plotted
from modalmotion.clinical.rates import Rates, rates_of
from modalmotion.clinical.readouts import ClinicalReadouts
from modalmotion.clinical.segments import RegionalMotion, regional_motion
from modalmotion.clinical.sensitivity import Sensitivities, sensitivities
from modalmotion.clinical.strain import Strain, wall_strain
from modalmotion.clinical.torsion import Torsion, torsion
from modalmotion.errors import InputError
from modalmotion.mesh.sequence import MeshSequence
from modalmotion.representation import shown
from modalmotion.signature.making import ModalSignature
from modalmotion.signature.reconstruction import fitted_on
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
    reasons : tuple of str
        Reasons of those that are None.
    """

    rates: Rates | None
    regions: RegionalMotion | None
    strain: Strain | None
    torsion: Torsion | None
    per_mode: Sensitivities | None
    reasons: tuple[str, ...]


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
    reasons: list[str] = []

    def attempt(make: Callable[[], T]) -> T | None:
        try:
            return make()
        except InputError as error:
            reasons.append(str(error))
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
