"""What a session shows that the model does not, and what causes it."""

from delta_calibration.diagnosis.diagnose import (
    FEWEST,
    Diagnosis,
    calibrated,
    diagnose,
    diagnose_observations,
)
from delta_calibration.diagnosis.judge import STEPS, Judgement
from delta_calibration.diagnosis.model import Model
from delta_calibration.diagnosis.observed import Observed
from delta_calibration.diagnosis.verdict import Finding, FoundEquation, Verdict
from delta_calibration.estimation import Measured

__all__ = [
    "FEWEST",
    "STEPS",
    "Diagnosis",
    "Finding",
    "FoundEquation",
    "Judgement",
    "Measured",
    "Model",
    "Observed",
    "Verdict",
    "calibrated",
    "diagnose",
    "diagnose_observations",
]
