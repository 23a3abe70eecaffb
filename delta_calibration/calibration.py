"""What compensation needs of an identified robot."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.samples import at_rest

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """A robot's chain as identified, and the region it holds in."""

    robot: Robot
    chain: Chain
    theta: Array  # (P,)
    region: Region
    joints_lower: Array  # (m,) [rad] lowest measured
    joints_upper: Array  # (m,) [rad]
    noise_floor: float  # [m]
    source: str
    seal: str  # hash of the file's content

    @property
    def geometry(self) -> Array:
        """The mechanism's geometry, (p,)."""
        return self.chain.split(self.theta)[0]

    @property
    def frame(self) -> Frame:
        """`T_tracker_base`."""
        return self.chain.split(self.theta)[2]

    def tool_points(self, readings: Array, q: Array) -> Array:
        """Where the tool is in the base, as the tracker sees it, (n, 3) [m].

        The reflector stands off the tool by the identified offset less the tool's, turned with the
        platform as the model has it at joints q, (n, m) [rad]. This base is the calibration's own:
        an unknown reflector offset and an unknown frame shift alike, and only their sum is
        measured.
        """
        _, offset, frame = self.chain.split(self.theta)
        x = self.chain.pose(at_rest(q), self.theta)
        standoff = self.chain.point(x, offset) - self.chain.point(x, self.robot.tool_offset)
        return frame.inverse().apply(readings) - standoff
