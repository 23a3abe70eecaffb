"""Robots as trees of links for viewers: the URDF, and the values of the passive joints."""

from delta_calibration.description.skeleton import Skeleton
from delta_calibration.description.skeletons import describe
from delta_calibration.description.tree import (
    BASE,
    TOOL,
    TRACKER,
    Cylinder,
    Joint,
    Link,
    Tree,
    frame_prefix,
)
from delta_calibration.description.urdf import urdf

__all__ = [
    "BASE",
    "TOOL",
    "TRACKER",
    "Cylinder",
    "Joint",
    "Link",
    "Skeleton",
    "Tree",
    "describe",
    "frame_prefix",
    "urdf",
]
