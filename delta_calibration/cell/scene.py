"""Drawings of a cell for display: errors, workspace and calibrated region, in the base frame.

The colours are safe for colour-blind viewers, and different things also differ in form, width or
size.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.cell.fitting import FittedCalibration
from delta_calibration.description.tree import BLACK, BLUE, GREEN, GREY, VERMILION, Colour
from delta_calibration.plans import HIGH, LINE_HALF, LOW, PLANE, joints_toward, tool_points
from delta_calibration.region import Region
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

FORESEEN = 100  # places sampled in the region, besides its corners
MOST = 300  # poses whose errors are drawn; more are thinned out
_WIDE, _MIDDLE, _NARROW, _DOT = 0.003, 0.002, 0.0015, 0.006  # [m]
_ROUND = 36  # corners of a circle
_SHEER = 0.12  # opacity of the region
_EDGES = [(a, a ^ bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]  # of a box


class Kind(Enum):
    """Geometric primitive that the points of a drawing form."""

    DOTS = 1
    LINES = 2
    TRIANGLES = 3


@dataclass(frozen=True)
class Drawing:
    """Set of equal primitives to display."""

    name: str
    kind: Kind
    points: Array  # (n, 3) [m] in the base; two a line, three a triangle
    colour: Colour
    size: float  # [m] width of a line, diameter of a dot
    opacity: float = 1.0


@dataclass(frozen=True)
class Errors:
    """Tool points of some poses, each (n, 3) [m] in the base."""

    meant: Array  # by the nominal model, at the commanded joints
    modelled: Array  # by the calibrated model
    measured: Array | None = None  # by the tracker, transformed by the calibration's frame

    @classmethod
    def of(cls, fitted: FittedCalibration, robot: Robot) -> Errors:
        """Errors at the poses that a calibration was fitted to."""
        poses, known = fitted.poses, fitted.calibration
        pose = known.chain.pose(poses.conditions, known.theta)
        return cls(
            tool_points(robot, poses.command),
            known.chain.point(pose, robot.tool_offset),
            known.tool_points(poses.point, poses.joint, poses.conditions),
        )

    @classmethod
    def foreseen(cls, known: Calibration) -> Errors:
        """Errors that a calibration predicts in its region, from its geometry alone."""
        robot, model = known.robot, known.chain.mechanism
        places = known.region.sample(FORESEEN, 0.0, np.random.default_rng(0))
        q = joints_toward(robot, places)
        pose = model.forward(q, known.geometry)
        return cls(tool_points(robot, q), known.chain.point(pose, robot.tool_offset))


def scene(
    robot: Robot, calibration: Calibration | None, fitted: FittedCalibration | None, scale: float
) -> tuple[Drawing, ...]:
    """Drawings of workspace, region and errors.

    Args:
        robot: robot whose workspace is drawn.
        calibration: active calibration, whose region is drawn.
        fitted: last fit; the errors of its poses are drawn if its calibration is the active one,
            otherwise those that the active calibration predicts.
        scale: magnification of the errors.
    """
    drawings = [workspace(robot)]
    if calibration is not None:
        own = fitted is not None and fitted.calibration is calibration
        seen = Errors.of(fitted, robot) if fitted and own else Errors.foreseen(calibration)
        drawings += [*region(calibration.region), *errors(seen, scale)]
    return tuple(drawings)


def workspace(robot: Robot) -> Drawing:
    """Workspace box of the robot file; if there is none, the cylinder covered by Delta plans."""
    box = robot.workspace
    if box is None:
        points = _cylinder(LINE_HALF * np.sqrt(2), PLANE + LOW, PLANE + HIGH)
    else:
        signs = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)])
        points = (box.centre + signs * box.size)[np.ravel(_EDGES)]
    return Drawing("workspace", Kind.LINES, points, GREY, _WIDE)


def region(held: Region) -> list[Drawing]:
    """Region where the calibration is valid: a translucent body and its edges."""
    faces = held.faces
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3)
    return [
        Drawing("region", Kind.TRIANGLES, faces.reshape(-1, 3), GREEN, 1.0, _SHEER),
        Drawing("region edges", Kind.LINES, edges, GREEN, _NARROW),
    ]


def errors(seen: Errors, scale: float) -> list[Drawing]:
    """Error vectors from each nominal point to the measured and to the modelled one.

    Where the two vectors coincide, the calibration explains the error.
    """
    reached = [("error calibrated", seen.modelled, BLUE, _MIDDLE)]
    if seen.measured is not None:
        reached.append(("error measured", seen.measured, VERMILION, _WIDE))
    every = np.hstack([seen.meant, *(points for _, points, _, _ in reached)])
    rows = np.flatnonzero(np.isfinite(every).all(axis=1))
    rows = rows[:: -(-len(rows) // MOST) or 1]
    meant = seen.meant[rows]

    def vectors(name: str, points: Array, colour: Colour, width: float) -> Drawing:
        tips = meant + scale * (points[rows] - meant)
        return Drawing(name, Kind.LINES, np.stack([meant, tips], 1).reshape(-1, 3), colour, width)

    dots = Drawing("nominal", Kind.DOTS, meant, BLACK, _DOT)
    return [dots, *(vectors(*each) for each in reached)]


def _cylinder(radius: float, low: float, high: float) -> Array:
    """Edges of a cylinder as pairs of points: both rims and some lines between them."""
    angle = 2 * np.pi * np.arange(_ROUND + 1) / _ROUND
    around = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rims = [np.column_stack([around, np.full(_ROUND + 1, z)]) for z in (low, high)]
    lines = [np.stack([rim[:-1], rim[1:]], axis=1).reshape(-1, 3) for rim in rims]
    sides = np.stack([rims[0][:-1:6], rims[1][:-1:6]], axis=1).reshape(-1, 3)
    return np.concatenate([*lines, sides])
