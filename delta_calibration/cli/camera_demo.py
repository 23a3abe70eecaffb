"""The SCARA paper's positioning: a lattice of commands, and a camera that sees the tool."""

from __future__ import annotations

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.cli.options import table
from delta_calibration.compensation.grid_search import GridSearch, averaged
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot
from delta_calibration.simulation import Machine, standing
from delta_calibration.simulation.camera import Camera, homography, on_plane
from delta_calibration.trial import Errors

Array = NDArray[np.float64]

_UNIT = np.pi / 18000  # [rad] a command unit of the paper, 0.01 degree
_TARGETS, _REPEATS = 8, 3
_HEIGHT, _FOCAL = 1.5, 9000.0  # [m], [px]: a pixel is a sixth of a millimetre
_WINDOW = 0.03  # [m] half of the square of marks about a target


def positioned_by_camera(machine: Machine, seed: int) -> dict[str, object]:
    """Drive a plane arm's targets right by what a camera sees of them; prints, returns figures.

    The camera looks at each target with four marks about it, whose places are known: what it says
    of the tool is in the plane's coordinates, and as right as the marks are.
    """
    robot, rng = machine.robot, np.random.default_rng([seed, 3])
    plan = make_plan("disc", robot, count=_TARGETS, both_sides=False)
    before, after, moves = [], [], []
    for target, command in zip(plan.target, plan.joint, strict=True):
        eye = _Eye(machine, target, rng)
        settings = _settings(robot, eye.noise, float(np.linalg.norm(target)))
        found, edges = [], None
        for _ in range(_REPEATS):
            search = GridSearch(command, target[:2], settings, edges)
            while not search.done:
                search.tell(eye.look(search.step))
            found.append(search.result)
            edges = search.result.edges
        joint = command + averaged(found, settings.unit).dq
        before.append(eye.off(command))
        after.append(eye.off(joint))
        moves.append(sum(result.moves for result in found))
    rows = []
    figures: dict[str, object] = {"moves_mean": float(np.mean(moves)), "targets": _TARGETS}
    for name, far in (("before", before), ("after", after)):
        e = Errors.of(np.array(far))
        rows.append((name, *(f"{v * 1e3:.4f}" for v in (e.maximum, e.mean, e.three_std))))
        figures[name] = e.in_mm()
    click.echo("\n" + table(("error by grid search, truth [mm]", "max", "mean", "3 std"), rows))
    click.echo(f"{_REPEATS} searches a point, {np.mean(moves):.0f} stops in all, no model\n")
    return figures


class _Eye:
    """A camera over a target, taught by four marks, and the machine under it."""

    def __init__(self, machine: Machine, target: Array, rng: np.random.Generator) -> None:
        self._machine, self._target, self._rng = machine, target, rng
        self._camera = Camera.over(target, _HEIGHT, _FOCAL, rng)
        corners = _WINDOW * np.array([[1, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]])
        marks = target + corners
        self._plane = homography(self._camera.find(marks, rng), marks[:, :2])
        self.noise = self._camera.noise * _HEIGHT / _FOCAL  # [m]

    def look(self, joint: Array) -> Array:
        """Where the picture has the tool at joints (m,) come to rest, (2,) [m]."""
        there = self._machine.tool_points(
            standing((joint + self._machine.rest_error(self._rng))[None])
        )
        return np.asarray(on_plane(self._plane, self._camera.find(there, self._rng))[0])

    def off(self, joint: Array) -> float:
        """How far the tool truly is from the target in the plane [m]."""
        there = self._machine.tool_points(standing(joint[None]))[0]
        return float(np.linalg.norm((there - self._target)[:2]))


def _settings(robot: Robot, camera: float, reach: float) -> GridSettings:
    """The paper's lattice with the noise to expect of the camera [m] and of joints at a reach."""
    joints = robot.joints
    return GridSettings(
        unit=np.full(len(joints.names), _UNIT),
        lower=joints.lower,
        upper=joints.upper,
        bound=robot.limits.correction,
        noise=float(np.hypot(camera, joints.repeatability * reach)),
    )
