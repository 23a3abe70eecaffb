"""From the model of a machine as it is to the joint command that puts it right."""

from delta_calibration.compensation.aim import Aim
from delta_calibration.compensation.answer import Compensated, Verdict
from delta_calibration.compensation.apso import Apso, ApsoSettings, ApsoStep
from delta_calibration.compensation.base import Compensator, Correction
from delta_calibration.compensation.compensator import JointCompensator, SingleWay
from delta_calibration.compensation.machine import (
    METHODS,
    SOLVERS,
    TABLE,
    Machine,
    Newton,
    Swarm,
    methods_for,
    require_method,
)
from delta_calibration.compensation.newton import NewtonSettings
from delta_calibration.compensation.table import Table
from delta_calibration.compensation.table_build import Follow, TableSettings
from delta_calibration.compensation.table_file import load_table, save_table

__all__ = [
    "METHODS",
    "SOLVERS",
    "TABLE",
    "Aim",
    "Apso",
    "ApsoSettings",
    "ApsoStep",
    "Compensated",
    "Compensator",
    "Correction",
    "Follow",
    "JointCompensator",
    "Machine",
    "Newton",
    "NewtonSettings",
    "SingleWay",
    "Swarm",
    "Table",
    "TableSettings",
    "Verdict",
    "load_table",
    "methods_for",
    "require_method",
    "save_table",
]
