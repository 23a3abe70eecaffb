"""Simulated camera over an actual machine."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ConfigError, ReachError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.simulation.machine import TrueMachine, standing

Array = NDArray[np.float64]

_HUNG = 20e-3  # [m] standard deviation of its place from that in the robot's file
_TILT = 0.03  # [rad] standard deviation of its tilt from straight down


@dataclass(frozen=True)
class CameraOver:
    """A fixed camera over a machine that sees a mark at its tool."""

    machine: TrueMachine
    frame: Frame  # T_camera_base, the truth

    @classmethod
    def hung(cls, machine: TrueMachine, seed: int) -> CameraOver:
        """Mount it at the place in the robot's file, with mounting errors and any heading.

        Raises:
            ConfigError: the robot has no camera.
        """
        sight = machine.robot.camera
        if sight is None:
            raise ConfigError(f"robot {machine.robot.name}: its file has no camera")
        rng = np.random.default_rng([seed, 2])
        tilt = rotations.exp(np.append(_TILT * rng.standard_normal(2), 0.0))
        turn = rotations.about_z(rng.uniform(0, 2 * np.pi)) @ np.diag([1.0, -1.0, -1.0])
        rotation = tilt @ turn
        place = sight.place + _HUNG * rng.standard_normal(3)
        return cls(machine, Frame(rotation, -rotation @ place))

    def look(self, joint: Array, count: int, rng: np.random.Generator) -> Array:
        """Images of the tool once joints (m,) have come to rest there, (count, 2) [px].

        They rest off their command by an error of their repeatability.

        Raises:
            ReachError: joints that the machine cannot take, or a tool behind the camera.
        """
        sight = self.machine.robot.camera
        at = standing((joint + self.machine.rest_error(rng))[None])
        point = self.frame.apply(self.machine.tool_points(at))
        pixel = np.full((1, 2), np.nan) if sight is None else sight.camera.image(point)
        if sight is None or not np.isfinite(pixel).all():
            raise ReachError(f"joints {joint}: the camera cannot see the tool there")
        return np.asarray(pixel + sight.noise * rng.standard_normal((count, 2)))


def other_elbow(machine: TrueMachine) -> TrueMachine:
    """The same machine with the elbow of its drawing's home bent the other way.

    Of the postures that reach a place, an arm's controller takes that of its home.
    """
    dimensions = machine.robot.dimensions
    drives = machine.robot.drives
    bent = np.where(np.arange(len(dimensions.home)) == 1, -1.0, 1.0)
    home = drives.read(drives.own(dimensions.home) * bent)
    robot = replace(machine.robot, dimensions=replace(dimensions, home=home))
    return replace(machine, robot=robot)
