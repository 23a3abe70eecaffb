"""Two nominal cable robots, and an independent model: cable by cable, rotations by quaternions."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import dist

import numpy as np
from scipy.spatial.transform import Rotation

from delta_calibration.mechanisms import CableDimensions
from delta_calibration.robot import load_robot

EIGHT_CABLES, TOLERANCES = load_robot("cdpr8").dimensions, load_robot("cdpr8").tolerances
ZEROS_FREE = replace(TOLERANCES, zero=10e-3)
FOUR_CABLES = CableDimensions(  # a point on three low cables and one from above
    anchors=np.array([[1.6, 0.0, 0.0], [-0.8, 1.4, 0.0], [-0.8, -1.4, 0.0], [0.0, 0.0, 2.5]]),
    joints=np.zeros((4, 3)),
    drum_radius=np.full(4, 0.05),
    gear=np.full(4, 10.0),
    tackle=np.ones(4),
    home_place=np.array([0.0, 0.0, 0.6]),
    pretension=60.0,
)


@dataclass(frozen=True)
class Winches:
    """A real machine: anchors, joints and gains of its cables; motor angles are zero at `home`."""

    anchors: np.ndarray  # (m, 3) [m]
    joints: np.ndarray  # (m, 3) [m]
    gains: np.ndarray  # (m,) [m/rad]
    home: np.ndarray  # (3,) or (6,)
    offsets: np.ndarray | float = 0.0  # [m] let out at counter zero beyond the home length

    def lengths(self, pose) -> np.ndarray:
        """Cable lengths at one pose, (m,) [m]."""
        turn = Rotation.from_rotvec(pose[3:]) if len(pose) == 6 else Rotation.identity()
        ends = [turn.apply(joint) + pose[:3] for joint in self.joints]
        return np.array([dist(a, b) for a, b in zip(self.anchors, ends, strict=True)])

    def motors(self, poses) -> np.ndarray:
        """Motor angles at poses, (n, m) [rad]."""
        zero = self.lengths(self.home) + self.offsets
        return np.array([(self.lengths(pose) - zero) / self.gains for pose in poses])

    def seen_from(self, turn, place, poses) -> np.ndarray:
        """Poses in the frame of a device, rotated and displaced from the robot's."""
        turn, rows = Rotation.from_rotvec(turn), []
        for pose in poses:
            row = turn.apply(pose[:3]) + place
            if len(pose) == 6:
                row = np.concatenate([row, (turn * Rotation.from_rotvec(pose[3:])).as_rotvec()])
            rows.append(row)
        return np.array(rows)


def built(dimensions, rng, scale=1.0, offsets=0.0) -> Winches:
    """The nominal machine with manufacturing errors: 10 mm, 2 mm, half a percent."""
    d = dimensions
    body = len(d.home) == 6
    return Winches(
        anchors=d.anchors + scale * rng.normal(0.0, 10e-3, d.anchors.shape),
        joints=d.joints + body * scale * rng.normal(0.0, 2e-3, d.joints.shape),
        gains=d.drum_radius
        / (d.gear * d.tackle)
        * (1 + scale * rng.normal(0.0, 5e-3, len(d.gear))),
        home=d.home,
        offsets=offsets,
    )


def workspace(dimensions, n, rng) -> np.ndarray:
    """Poses in the middle of the workspace of either machine, (n, k)."""
    if len(dimensions.home) == 3:
        return rng.uniform([-0.25, -0.25, 0.3], [0.25, 0.25, 1.4], (n, 3))
    place = rng.uniform([-1.0, -0.8, 0.7], [1.0, 0.8, 1.8], (n, 3))
    return np.hstack([place, rng.uniform(-0.15, 0.15, (n, 3))])


def geometry_of(machine: Winches, free_zeros=False) -> np.ndarray:
    """The machine as the package's parameter vector."""
    parts = [machine.anchors]
    if len(machine.home) == 6:
        parts.append(machine.joints)
    parts.append(machine.gains[:, None])
    if free_zeros:
        parts.append(np.broadcast_to(machine.offsets, len(machine.gains))[:, None])
    return np.concatenate(parts, axis=1).reshape(-1)
