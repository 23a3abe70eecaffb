"""Rotations, rigid frames and their alignment, and a pinhole camera."""

from delta_calibration.geometry.camera import Camera
from delta_calibration.geometry.frames import Frame, align, carried_step

__all__ = ["Camera", "Frame", "align", "carried_step"]
