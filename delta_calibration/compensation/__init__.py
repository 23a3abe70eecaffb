"""From the model of a machine as it is to the joint command that puts it right."""

from delta_calibration.compensation.apso import Apso, ApsoSettings, ApsoStep
from delta_calibration.compensation.base import Compensator, Correction
from delta_calibration.compensation.newton import Newton, NewtonSettings

__all__ = [
    "Apso",
    "ApsoSettings",
    "ApsoStep",
    "Compensator",
    "Correction",
    "Newton",
    "NewtonSettings",
]
