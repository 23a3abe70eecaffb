"""What an identified machine is handed on as, to programs that are not this package's."""

from delta_calibration.export.c_source import CFiles, c_files

__all__ = ["CFiles", "c_files"]
