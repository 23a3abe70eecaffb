"""What a cell looks like to who watches it: errors, workspace and calibrated region, in the base.

Colours are told apart by colour-blind eyes, and what stands for different things differs in form,
width or size as well.
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

FORESEEN = 100  # places in the region, beside its corners
MOST = 300  # poses whose errors are drawn; more are thinned out
_WIDE, _MIDDLE, _NARROW, _DOT = 0.003, 0.002, 0.0015, 0.006  # [m]
_ROUND = 36  # corners of a circle
_SHEER = 0.12  # opacity of the region
_EDGES = [(a, a ^ bit) for a in range(8) for bit in (1, 2, 4) if not a & bit]  # of a box


class Kind(Enum):
    """What the points of a drawing are corners of."""

    DOTS = 1
    LINES = 2
    TRIANGLES = 3


@dataclass(frozen=True)
class Drawing:
    """Something to be seen."""

    name: str
    kind: Kind
    points: Array  # (n, 3) [m] in the base; two a line, three a triangle
    colour: Colour
    size: float  # [m] width of a line, diameter of a dot
    opacity: float = 1.0


@dataclass(frozen=True)
class Errors:
    """Tool points of some poses, each (n, 3) [m] in the base."""

    meant: Array  # by the drawing, at the commanded joints
    modelled: Array  # by the calibration
    measured: Array | None = None  # by the tracker, seen through the calibration's frame

    @classmethod
    def of(cls, fitted: FittedCalibration, robot: Robot) -> Errors:
        """Those of the poses that a calibration was made from."""
        poses, known = fitted.poses, fitted.calibration
        pose = known.chain.pose(poses.conditions, known.theta)
        return cls(
            tool_points(robot, poses.command),
            known.chain.point(pose, robot.tool_offset),
            known.tool_points(poses.point, poses.joint),
        )

    @classmethod
    def foreseen(cls, known: Calibration) -> Errors:
        """Those that a calibration expects in its region, of its geometry alone."""
        robot, model = known.robot, known.chain.mechanism
        places = known.region.sample(FORESEEN, 0.0, np.random.default_rng(0))
        q = joints_toward(robot, places)
        pose = model.forward(q, known.geometry)
        return cls(tool_points(robot, q), known.chain.point(pose, robot.tool_offset))


def scene(
    robot: Robot, calibration: Calibration | None, fitted: FittedCalibration | None, scale: float
) -> tuple[Drawing, ...]:
    """All that stands still.

    Args:
        robot: whose workspace.
        calibration: in force; its region.
        fitted: what was fitted here; its poses' errors, while its calibration is the one in force,
            else those that the calibration expects.
        scale: that many times as long as they are, errors are drawn.
    """
    drawings = [workspace(robot)]
    if calibration is not None:
        own = fitted is not None and fitted.calibration is calibration
        seen = Errors.of(fitted, robot) if fitted and own else Errors.foreseen(calibration)
        drawings += [*region(calibration.region), *errors(seen, scale)]
    return tuple(drawings)


def workspace(robot: Robot) -> Drawing:
    """The box of the robot's file; without one the cylinder that plans of a Delta cover."""
    box = robot.workspace
    if box is None:
        points = _cylinder(LINE_HALF * np.sqrt(2), PLANE + LOW, PLANE + HIGH)
    else:
        signs = np.array([[(k >> axis & 1) - 0.5 for axis in range(3)] for k in range(8)])
        points = (box.centre + signs * box.size)[np.ravel(_EDGES)]
    return Drawing("workspace", Kind.LINES, points, GREY, _WIDE)


def region(held: Region) -> list[Drawing]:
    """Where the calibration holds: a sheer body and its edges."""
    faces = held.faces
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 3)
    return [
        Drawing("region", Kind.TRIANGLES, faces.reshape(-1, 3), GREEN, 1.0, _SHEER),
        Drawing("region edges", Kind.LINES, edges, GREEN, _NARROW),
    ]


def errors(seen: Errors, scale: float) -> list[Drawing]:
    """From where each pose was meant to be: to where it is measured, to where the model has it.

    Where the two vectors lie together the calibration explains the error.
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
    """Both rims and some lines between them, pairs of points."""
    angle = 2 * np.pi * np.arange(_ROUND + 1) / _ROUND
    around = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    rims = [np.column_stack([around, np.full(_ROUND + 1, z)]) for z in (low, high)]
    lines = [np.stack([rim[:-1], rim[1:]], axis=1).reshape(-1, 3) for rim in rims]
    sides = np.stack([rims[0][:-1:6], rims[1][:-1:6]], axis=1).reshape(-1, 3)
    return np.concatenate([*lines, sides])
