"""Export of an identified machine to other programs: C source, DH tables, corrected points."""

from delta_calibration.export.c_source import CFiles, c_files
from delta_calibration.export.dh import dh_tables
from delta_calibration.export.points import corrected_points, require_points

__all__ = ["CFiles", "c_files", "corrected_points", "dh_tables", "require_points"]
