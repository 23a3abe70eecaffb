"""Finds and corrects mistakes in sessions: units, wiring, clocks, frames and files."""

from delta_calibration.doctor.change import Mistake
from delta_calibration.doctor.check import check, examine, lacks_joints, require_sound
from delta_calibration.doctor.checked import Checked

__all__ = ["Checked", "Mistake", "check", "examine", "lacks_joints", "require_sound"]
