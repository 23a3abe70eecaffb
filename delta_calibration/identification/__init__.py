"""From measured poses to what the machine really is."""

from delta_calibration.identification.fit import Identification, Residuals, chain_of, identify
from delta_calibration.identification.noise import Noise
from delta_calibration.identification.observability import Observability, Redundancy

__all__ = [
    "Identification",
    "Noise",
    "Observability",
    "Redundancy",
    "Residuals",
    "chain_of",
    "identify",
]
