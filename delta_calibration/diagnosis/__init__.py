"""What a session shows that the model does not, and what causes it."""

from delta_calibration.diagnosis.diagnose import STEPS, Diagnosis, calibrated, diagnose
from delta_calibration.diagnosis.model import Model
from delta_calibration.diagnosis.verdict import Finding, Verdict

__all__ = ["STEPS", "Diagnosis", "Finding", "Model", "Verdict", "calibrated", "diagnose"]
