"""Clinical readouts of a moving cavity: volume over time and ejection fraction."""

from modalmotion.arguments.checking import check_arguments
from modalmotion.clinical.readouts import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.volume_curve import Fraction, VolumeCurve

__all__ = ["ClinicalReadouts", "Fraction", "VolumeCurve", "clinical_readouts"]

check_arguments(globals())
