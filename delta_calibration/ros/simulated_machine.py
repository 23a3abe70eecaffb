"""Live simulation of a machine that follows commands and can be measured at any moment."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.errors import ReachError
from delta_calibration.geometry import rotations
from delta_calibration.robot import Robot
from delta_calibration.simulation import PARTS, Climate, Following, TrueMachine

Array = NDArray[np.float64]

STILL_S = 0.1  # [s] of a constant command after which a move has ended
STIR = 1e-7  # [rad of a Delta] smaller changes of the command count as standing still
AHEAD = 20  # readings drawn in advance
AHEAD_S = 1.0  # [s] for which readings drawn in advance are valid
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])  # quaternion of a reflector, which has no orientation
STEADY = Climate()


@dataclass(frozen=True)
class Measurement:
    """Readings of encoders and tracker at one moment."""

    joint: Array  # (m,) [rad]
    position: Array  # (3,) [m] in the tracker's frame
    quaternion: Array  # (4,) x y z w


class SimulatedMachine:
    """Simulated machine that follows commands at once, with a rest error drawn for each move.

    A move ends when the command was constant for STILL_S; the next begins when it changes. The
    machine does not follow a command that it cannot reach: it stays where it was. Drives and links
    have no dynamics except those of the effects, for which speed, direction and travel are updated
    at each command. A probe's orientation has no noise.

    Args:
        machine: true machine.
        rng: random generator of rest errors and noise.
        now: time [s] of any steady clock at which the cell was switched on.
        climate: temperatures of the cell.

    Raises:
        ReachError: the machine cannot be assembled at its home.
    """

    def __init__(
        self, machine: TrueMachine, rng: np.random.Generator, now: float, climate: Climate = STEADY
    ) -> None:
        self._machine = machine
        self._rng = rng
        self._climate = climate
        self._rest_error = machine.rest_error(rng)
        self._wanted = self._held = machine.chain.mechanism.home
        self._motion = self._motion_held = Following.standing(self._wanted)
        self._begun = self._told = self._stirred = now
        self._from = self._wanted
        self._payload, self._payload_centre = 0.0, np.zeros(3)
        self._ahead: list[Array] = []  # readings at the present position, drawn in advance
        self._read_at, self._read_when = np.full_like(self._wanted, np.nan), now
        self.measure(now)

    def command(self, joint: Array, now: float, stamp: float | None = None) -> None:
        """Go to joint angles (m,) [rad].

        Args:
            joint: commanded joint angles, (m,) [rad].
            now: time [s] of the steady clock.
            stamp: sending time [s] by the sender's clock, from which speeds are derived; by
                default `now` is used.

        Raises:
            ReachError: beyond a joint's limit; the machine stays where it is.
        """
        _require_limits(self._machine.robot, joint)
        stir = STIR * self._machine.robot.commanded.joint_size
        if np.abs(joint - self._from).max() > stir:
            if now - self._stirred >= STILL_S:
                self._rest_error = self._machine.rest_error(self._rng)
            self._from, self._stirred = joint, now
            self._ahead.clear()
        self._motion = self._motion.moved(joint, now if stamp is None else stamp)
        self._wanted, self._told = joint, now

    def carry(self, mass: float, centre: Array) -> None:
        """Take a payload [kg] on the platform, its centre (3,) [m] in the platform's frame."""
        self._payload, self._payload_centre = mass, centre
        self._ahead.clear()

    def measure(self, now: float | None = None) -> Measurement:
        """Take one reading of encoders and tracker, by default at the time of the last command.

        Raises:
            ReachError: the machine cannot be assembled at the command; it stays where it was.
        """
        now = self._told if now is None else now
        if now - self._told > STILL_S:
            self._motion = self._motion.stopped()
        try:
            position = self._position(self._wanted, now)
        except ReachError:
            self._wanted, self._motion = self._held, self._motion_held.stopped()
            raise
        self._held, self._motion_held = self._wanted, self._motion
        encoders = self._machine.encoders(self._held[None], self._rng)[0]
        return Measurement(encoders, position, self._orientation(self._held, now))

    def temperatures(self, now: float) -> dict[str, float]:
        """Temperatures of the cell's parts [deg C]."""
        celsius = self._climate.celsius(np.array([now - self._begun]))[0]
        return dict(zip(PARTS, celsius.tolist(), strict=True))

    def _position(self, joint: Array, now: float) -> Array:
        """One reading (3,) [m]; at rest, several are drawn at once, for little more time."""
        at = self._conditions(joint, now)
        still = not at.velocity.any()
        same = still and np.array_equal(at.joint[0], self._read_at)
        if not (same and self._ahead and now - self._read_when < AHEAD_S):
            count = AHEAD if same else 1
            rows = at.take(np.zeros(count, dtype=np.intp))
            self._ahead = list(self._machine.readings(rows, self._rng))
            self._read_at, self._read_when = at.joint[0], now
        return self._ahead.pop()

    def _conditions(self, joint: Array, now: float) -> Conditions:
        """Conditions of one reading."""
        velocity, acceleration = self._motion.derivatives()
        clock = np.array([now - self._begun])
        return Conditions(
            joint=(joint + self._rest_error)[None],
            time=clock,
            velocity=velocity[None],
            acceleration=acceleration[None],
            direction=self._motion.direction()[None],
            travel=self._motion.travel(joint)[None],
            payload=np.array([self._payload]),
            payload_centre=self._payload_centre[None],
            temperature_parts=PARTS,
            temperature=self._climate.celsius(clock),
            reading=np.full((1, 3), np.nan),
            reading_velocity=np.zeros((1, 3)),
            reading_acceleration=np.zeros((1, 3)),
        )

    def _orientation(self, joint: Array, now: float) -> Array:
        if self._machine.robot.tracker.measures == "position":
            return UPRIGHT
        chain, theta = self._machine.chain, self._machine.theta
        at = self._conditions(joint, now)
        return rotations.to_quaternion(chain.rotation(at, theta, chain.pose(at, theta))[0])


def without_noise(robot: Robot) -> Robot:
    """Copy of a robot with exactly repeating joints, and encoders and tracker without noise."""
    joints = replace(robot.joints, repeatability=0.0, encoder=0.0)
    tracker = replace(robot.tracker, radial=0.0, transverse=0.0, transverse_per_metre=0.0)
    return replace(robot, joints=joints, tracker=tracker)


def _require_limits(robot: Robot, joint: Array) -> None:
    wrong = robot.joints.beyond(joint)
    if wrong:
        raise ReachError(f"command of {wrong}")
