"""Rotations, rigid frames and their alignment."""

from delta_calibration.geometry.frames import Frame, align

__all__ = ["Frame", "align"]
