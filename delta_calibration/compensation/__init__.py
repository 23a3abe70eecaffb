"""Compensation: joint commands that correct the errors of an identified machine."""

from delta_calibration.compensation.apso import Apso, ApsoSettings
from delta_calibration.compensation.base import Compensator, Correction
from delta_calibration.compensation.command_status import CommandStatus, Compensated
from delta_calibration.compensation.compensator import JointCompensator, SingleWay
from delta_calibration.compensation.machine import (
    METHODS,
    SOLVERS,
    TABLE,
    IdentifiedMachine,
    Newton,
    Swarm,
    methods_for,
    require_method,
)
from delta_calibration.compensation.newton import NewtonSettings
from delta_calibration.compensation.table import Table
from delta_calibration.compensation.table_build import Follow, TableSettings
from delta_calibration.compensation.table_file import load_table, save_table
from delta_calibration.compensation.task_coordinates import TaskCoordinates

__all__ = [
    "METHODS",
    "SOLVERS",
    "TABLE",
    "Apso",
    "ApsoSettings",
    "CommandStatus",
    "Compensated",
    "Compensator",
    "Correction",
    "Follow",
    "IdentifiedMachine",
    "JointCompensator",
    "Newton",
    "NewtonSettings",
    "SingleWay",
    "Swarm",
    "Table",
    "TableSettings",
    "TaskCoordinates",
    "load_table",
    "methods_for",
    "require_method",
    "save_table",
]
