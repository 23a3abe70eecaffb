"""A machine that does not exist, live: it goes where it is told and is measured at any moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import ReachError
from delta_calibration.geometry import rotations
from delta_calibration.robot import Robot
from delta_calibration.samples import at_rest
from delta_calibration.simulation import Machine

Array = NDArray[np.float64]

STILL_S = 0.1  # [s] a command that stands still for so long has ended the move
STIR = 1e-7  # [rad] less than this is standing still
AHEAD = 20  # readings
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])  # what a reflector's pose says, which has no orientation


@dataclass(frozen=True)
class Measurement:
    """What encoders and tracker say at one moment."""

    joint: Array  # (m,) [rad]
    position: Array  # (3,) [m] in the tracker's frame
    quaternion: Array  # (4,) x y z w


class SimulatedMachine:
    """Follows commands at once, beside them by a rest error that is drawn anew for each move.

    A move ends when the command has stood still for STILL_S, the next begins when it stirs. What
    the machine cannot take up is not followed: it stays where it was. Commands are smooth, so that
    there are no dynamics in it; a probe's orientation has no noise.

    Args:
        machine: the truth.
        rng: of rest errors and noise.
        now: time [s] of any steady clock.

    Raises:
        ReachError: the machine cannot be assembled at its home.
    """

    def __init__(self, machine: Machine, rng: np.random.Generator, now: float) -> None:
        self._machine = machine
        self._rng = rng
        self._rest_error = machine.rest_error(rng)
        self._wanted = self._held = machine.chain.mechanism.home
        self._stirred = now
        self._from = self._wanted
        self._ahead: list[Array] = []  # readings of where it stands, not yet asked for
        self._read_at = np.full_like(self._wanted, np.nan)
        self.measure()

    def command(self, joint: Array, now: float) -> None:
        """Go to joint angles (m,) [rad].

        Raises:
            ReachError: beyond a joint's limit; it stays where it is.
        """
        _require_limits(self._machine.robot, joint)
        if np.abs(joint - self._from).max() > STIR:
            if now - self._stirred >= STILL_S:
                self._rest_error = self._machine.rest_error(self._rng)
            self._from, self._stirred = joint, now
        self._wanted = joint

    def measure(self) -> Measurement:
        """Take one reading of everything.

        Raises:
            ReachError: it cannot be assembled where it was told to go; it stays where it was.
        """
        try:
            position = self._position(self._wanted)
        except ReachError:
            self._wanted = self._held
            raise
        self._held = self._wanted
        encoders = self._machine.encoders(self._held[None], self._rng)[0]
        return Measurement(encoders, position, self._orientation(self._held))

    def _position(self, joint: Array) -> Array:
        """One reading (3,) [m]; at rest they are drawn ahead, at little more than one's cost."""
        actual = joint + self._rest_error
        same = np.array_equal(actual, self._read_at)
        if not (same and self._ahead):
            rows = np.tile(actual, (AHEAD if same else 1, 1))
            self._ahead = list(self._machine.readings(rows, self._rng))
            self._read_at = actual
        return self._ahead.pop()

    def _orientation(self, joint: Array) -> Array:
        if self._machine.robot.tracker.measures == "position":
            return UPRIGHT
        chain, theta = self._machine.chain, self._machine.theta
        x = chain.pose(at_rest((joint + self._rest_error)[None]), theta)
        frame = chain.split(theta)[2]
        orientation = frame.rotation @ chain.mechanism.rotation(x)[0]
        return rotations.to_quaternion(orientation)


def without_noise(robot: Robot) -> Robot:
    """The same robot with joints that repeat exactly, encoders and tracker without noise."""
    joints = replace(robot.joints, repeatability=0.0, encoder=0.0)
    tracker = replace(robot.tracker, radial=0.0, transverse=0.0, transverse_per_metre=0.0)
    return replace(robot, joints=joints, tracker=tracker)


def _require_limits(robot: Robot, joint: Array) -> None:
    beyond = np.flatnonzero((joint < robot.joints.lower) | (joint > robot.joints.upper))
    if beyond.size:
        k = int(beyond[0])
        low, high = np.degrees([robot.joints.lower[k], robot.joints.upper[k]])
        raise ReachError(
            f"command of {np.degrees(joint[k]):.2f} degrees for {robot.joints.names[k]}; "
            f"allowed: {low:.1f} to {high:.1f}"
        )
