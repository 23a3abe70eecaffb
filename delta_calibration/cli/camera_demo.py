"""Positioning of the SCARA paper: grid search over commands, with a camera that sees the tool."""

from __future__ import annotations

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.camera_frame import CameraFrame
from delta_calibration.cell.positioning import Positioning
from delta_calibration.cli.options import table
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, Sight
from delta_calibration.simulation import CameraOver, TrueMachine, standing
from delta_calibration.trial import Errors

Array = NDArray[np.float64]

_UNIT = np.pi / 18000  # [rad] a command unit of the paper, 0.01 degree
_TARGETS, _REPEATS, _IMAGES = 8, 3, 10


def positioned_by_camera(machine: TrueMachine, sight: Sight, seed: int) -> dict[str, object]:
    """Correct the targets of a planar arm by a camera; prints and returns the errors.

    The camera's pose is known, as if determined from marks at known places, so that its readings
    of the tool are in base coordinates.
    """
    robot, rng = machine.robot, np.random.default_rng([seed, 3])
    camera = CameraOver.hung(machine, seed)
    targets = make_plan("disc", robot, count=_TARGETS, both_sides=False).target
    known = CameraFrame(sight, camera.frame)
    work = Positioning(robot, targets, _settings(robot), _REPEATS, _IMAGES, known, sight)
    while not work.done:
        work.tell(camera.look(work.step, _IMAGES, rng).mean(axis=0))
    done = work.outcomes
    before = _off(machine, np.array([o.command for o in done]), targets)
    after = _off(machine, np.array([o.joint for o in done]), targets)
    moves = float(np.mean([o.moves for o in done]))
    rows = []
    figures: dict[str, object] = {"moves_mean": moves, "targets": _TARGETS}
    for name, far in (("before", before), ("after", after)):
        e = Errors.of(far)
        rows.append((name, *(f"{v * 1e3:.4f}" for v in (e.maximum, e.mean, e.three_std))))
        figures[name] = e.in_mm()
    click.echo("\n" + table(("error by grid search, truth [mm]", "max", "mean", "3 std"), rows))
    click.echo(f"{_REPEATS} searches per point, {moves:.0f} stops in total, no model\n")
    return figures


def _off(machine: TrueMachine, joint: Array, targets: Array) -> Array:
    """True distance of the tool from its targets in the plane, (n,) [m]."""
    there = machine.tool_points(standing(joint))
    return np.asarray(np.linalg.norm((there - targets)[:, :2], axis=1))


def _settings(robot: Robot) -> GridSettings:
    """Settings of the paper's grid search."""
    joints = robot.joints
    unit = np.full(len(joints.names), _UNIT)
    return GridSettings(unit, joints.lower, joints.upper, robot.limits.correction)
