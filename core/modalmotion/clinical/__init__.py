"""What a clinician reads from a moving cavity: its volume over time and what it ejects."""

from modalmotion.clinical.readouts import ClinicalReadouts, clinical_readouts
from modalmotion.clinical.volume_curve import VolumeCurve

__all__ = ["ClinicalReadouts", "VolumeCurve", "clinical_readouts"]
