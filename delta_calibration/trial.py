"""Errors of compensation on a simulated machine, as the demonstration reports them.

Three errors are distinguished. *By the model*: what the search for the command leaves. *Measured*:
seen by the tracker, noise and repeatability included. *Against the truth*: the actual position of
the simulated machine, which is not known in a real cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation import Apso, ApsoSettings, TaskCoordinates
from delta_calibration.data import Conditions, Poses
from delta_calibration.geometry import align, rotations
from delta_calibration.plans import make_plan
from delta_calibration.simulation import TrueMachine, standing

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Errors:
    """Statistics of the distances between target and tool over the points of a test."""

    maximum: float  # [m]
    mean: float  # [m]
    three_std: (
        float  # [m] three standard deviations of the distances, as in the Delta paper's table 3
    )
    points: int

    @classmethod
    def of(cls, distance: Array) -> Errors:
        """Compute the statistics of distances (n,) [m]."""
        return cls(
            float(distance.max()),
            float(distance.mean()),
            float(3 * distance.std(ddof=1)),
            len(distance),
        )

    def in_mm(self) -> dict[str, float | int]:
        """The statistics in mm, as written to files."""
        return {
            "max_mm": self.maximum * 1e3,
            "mean_mm": self.mean * 1e3,
            "three_std_mm": self.three_std * 1e3,
            "points": self.points,
        }


def measured_errors(calibration: Calibration, poses: Poses, targets: Array) -> Errors:
    """Measured distances of the stops, each from the nearest target."""
    reached = calibration.tool_points(poses.point, poses.joint, poses.conditions)
    return Errors.of(np.linalg.norm(reached - _nearest(targets, reached), axis=1))


def true_errors(
    calibration: Calibration, machine: TrueMachine, poses: Poses, targets: Array
) -> Errors:
    """True distances of the stops at the encoders' angles: no tracker noise, no repeatability.

    The calibration's own frame and reflector offset are used, as they define the base frame that
    the cell works in.
    """
    true = machine.reflector_points(poses.conditions)
    reached = calibration.tool_points(true, poses.joint, poses.conditions)
    return Errors.of(np.linalg.norm(reached - _nearest(targets, reached), axis=1))


def paper_simulation(
    machine: TrueMachine, count: int = 181, seed: int = 0
) -> tuple[Errors, Errors]:
    """The Delta paper's simulation, in which the model knows the true errors: before and after.

    APSO corrects the line x = -y, z = -711 mm, |x| <= 450 mm.
    """
    line = make_plan("line", machine.robot, count=count, both_sides=False)

    def point(q: Array) -> Array:
        at = standing(q.reshape(-1, q.shape[-1]))
        return machine.tool_points(at).reshape((*q.shape[:-1], 3))

    swarm = Apso(point, ApsoSettings(bound_rad=machine.robot.limits.correction, seed=seed))
    found = swarm.correct(line.joint, line.target)
    before = np.linalg.norm(point(line.joint) - line.target, axis=1)
    after = np.linalg.norm(point(line.joint + found.dq) - line.target, axis=1)
    return Errors.of(before), Errors.of(after)


def _nearest(targets: Array, reached: Array) -> Array:
    """The nearest target of each reached point: targets lie farther apart than any error."""
    distance = np.linalg.norm(reached[:, None] - targets, axis=-1)
    return np.asarray(targets[np.argmin(distance, axis=1)])


def true_misses(
    calibration: Calibration, machine: TrueMachine, at: Conditions, meant: Array, registered: bool
) -> tuple[Array, Array]:
    """True errors of the tool at nominal poses: distance (n,) [m] and rotation (n,) [rad].

    Only the coordinates that the joints command count in the distance.

    Args:
        calibration: supplies the base frame and the reflector's position on the platform.
        machine: the simulated machine.
        at: conditions with the commanded joints and the times.
        meant: poses of the nominal robot, (n, k).
        registered: whether to register the frame anew by the best fit to these points: before a
            calibration no other frame is known.
    """
    robot, chain = machine.robot, machine.chain
    nominal = robot.commanded
    axes = list(TaskCoordinates.of(nominal, robot.tool_offset).axes)
    x = chain.pose(at, machine.theta)
    reached = calibration.tool_points(machine.reflector_points(at), at.joint, at)
    wanted = nominal.points(meant, robot.tool_offset)
    turned = calibration.frame.inverse().rotation @ chain.rotation(at, machine.theta, x)
    if registered:
        best = align(reached, wanted)
        reached, turned = best.apply(reached), best.rotation @ turned
    left = turned @ np.swapaxes(nominal.rotation(meant), 1, 2)
    return (
        np.linalg.norm((reached - wanted)[:, axes], axis=1),
        np.linalg.norm(rotations.log(left), axis=1),
    )
