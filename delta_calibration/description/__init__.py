"""Robots as trees of links, for viewers: URDF, and the values of the passive joints."""

from delta_calibration.description.skeleton import Skeleton
from delta_calibration.description.skeletons import describe
from delta_calibration.description.tree import Cylinder, Joint, Link, Tree
from delta_calibration.description.urdf import urdf

__all__ = ["Cylinder", "Joint", "Link", "Skeleton", "Tree", "describe", "urdf"]
