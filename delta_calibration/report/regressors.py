"""What each cause is to be looked at against: the quantity that gives it away."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.effects.loads import gravity_torque
from delta_calibration.effects.thermal_growth import ThermalGrowth
from delta_calibration.effects.unexplained import (
    DIRECTION,
    PAYLOAD,
    SPEED,
    TEMPERATURE,
    TIME,
    Unexplained,
)
from delta_calibration.robot import Robot
from delta_calibration.samples import Conditions
from delta_calibration.wording import spoken

Array = NDArray[np.float64]
Groups = tuple[tuple[str, NDArray[np.bool_]], ...]

_DEGREES = 180 / np.pi
_MOST_LEVELS = 3  # of a payload


@dataclass(frozen=True)
class Regressor:
    """Values (n,) of each sample, for a joint where it is a joint's."""

    title: str  # with its unit
    of: Callable[[Conditions, int], Array]


ANGLE = Regressor("angle of the joint [°]", lambda at, j: _DEGREES * at.joint[:, j])
CLOCK = Regressor("time [min]", lambda at, j: at.time / 60)
VELOCITY = Regressor("speed of the joint [°/s]", lambda at, j: _DEGREES * at.velocity[:, j])
ACCELERATION = Regressor(
    "acceleration of the joint [rad/s²]", lambda at, j: at.acceleration[:, j]
)
LOAD = Regressor("payload [kg]", lambda at, j: at.payload)
DISTANCE = Regressor("distance from the tracker [m]", lambda at, j: _length(at.reading))
READING_SPEED = Regressor(
    "speed of the reflector [m/s]", lambda at, j: _length(at.reading_velocity)
)


def _length(v: Array) -> Array:
    return np.asarray(np.linalg.norm(v, axis=1))


def temperature(part: str) -> Regressor:
    """Of a part."""
    return Regressor(f"temperature of the {spoken(part)} [°C]", lambda at, j: at.of_part(part))


_OF_CAUSE = {
    "joint_lag": VELOCITY,
    "dynamic_deflection": ACCELERATION,
    "timestamp_latency": READING_SPEED,
    "joint_zero_drift": CLOCK,
    "tracker_drift": CLOCK,
    "tracker_scale": DISTANCE,
    "forearm_compliance": LOAD,
    "ball_joint_clearance": ANGLE,
}
_OF_FAMILY = {SPEED: VELOCITY, TIME: CLOCK, PAYLOAD: LOAD}


def regressor_of(member: Candidate, robot: Robot, at: Conditions) -> Regressor:
    """What a member is to be looked at against."""
    effect = member.effect
    if isinstance(effect, ThermalGrowth):
        return temperature(effect.sensor) if effect.sensor else CLOCK
    if isinstance(effect, Unexplained):
        if effect.family == TEMPERATURE:
            return temperature(at.temperature_parts[0])
        return _OF_FAMILY.get(effect.family, ANGLE)
    if effect is not None and member.cause == "joint_compliance":
        mechanism = effect.mechanism
        return Regressor(
            "torque of weight on the joint [N m]",
            lambda at, j: np.asarray(gravity_torque(robot, mechanism, at)[:, j]),
        )
    return _OF_CAUSE.get(member.cause, ANGLE)


def groups_of(member: Candidate, at: Conditions, joint: int) -> Groups:
    """Samples told apart by colour and symbol: by side, by payload, or not at all."""
    family = member.effect.family if isinstance(member.effect, Unexplained) else ""
    if member.cause in ("backlash", "stick_slip") or family == DIRECTION:
        side = at.direction[:, joint]
        return ("joint last went up", side > 0), ("joint last went down", side < 0)
    levels = np.unique(np.round(at.payload[np.isfinite(at.payload)], 3))
    if member.cause in ("joint_compliance", "forearm_compliance") and (
        1 < len(levels) <= _MOST_LEVELS
    ):
        return tuple((f"{kg:g} kg", np.abs(at.payload - kg) < 1e-3) for kg in levels)
    return (("measured", np.ones(len(at), dtype=bool)),)
