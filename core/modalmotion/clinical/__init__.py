"""Clinical read-outs of a moving cavity: volume over time and ejection fraction."""

from typing import TYPE_CHECKING

from modalmotion.arguments.public import public_list

if TYPE_CHECKING:
    from modalmotion.clinical.readouts import ClinicalReadouts as ClinicalReadouts
    from modalmotion.clinical.readouts import clinical_readouts as clinical_readouts
    from modalmotion.clinical.volume_curve import Fraction as Fraction
    from modalmotion.clinical.volume_curve import VolumeCurve as VolumeCurve

__all__, __getattr__, __dir__ = public_list(globals())
