"""Causes hidden in a drive: the joint moves differently from what its encoder indicates.

Backlash and friction are integrated over the whole commanded motion, moves between poses included.
Sizes at strength 1 are those of a real drive; each of the three drives has its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from blind.cause import Cause, Draw, of_legs
from blind.world import State, World

Array = NDArray[np.float64]

_GAP = 0.29e-3  # [rad] one minute of arc
_FRICTION = 60e-6  # [rad] by which static friction twists the drive
_PRESLIDING = 0.4e-3  # [rad] of travel over which friction builds up
_STRIBECK = 0.05  # [rad/s] above which friction decreases to ...
_COULOMB = 0.2  # ... this share
_GEAR, _WAVE = 33.0, 100.0  # motor turns per joint turn: planetary gear, harmonic drive
_RIPPLE = 0.15e-3  # [rad]
_ECCENTRIC = 0.2e-3  # [rad]
_SCALE = 200e-6
_CREEP = 0.1e-3  # [rad]
_LAG = 3e-3  # [s]
_GIVE = 1 / 2.5e4  # [rad/(N m)]
_TURN = 2 * np.pi
LINES = 1024  # signal periods of an encoder per turn of the joint
_SUBDIVISION = 0.01  # of a period
_FINE = 8  # steps between two samples


@dataclass(frozen=True)
class Drive:
    """Drives of the joints of a machine, with the sizes of a Delta's drives times `size`."""

    size: float = 1.0  # joint unit equivalent to one radian on a Delta
    gears: tuple[float, float] = (_GEAR, _WAVE)  # motor turns, or radians, per joint unit


ROTARY = Drive()


def uneven(rng: np.random.Generator, legs: Array) -> Array:
    """Different sizes for the drives, 0.7 to 1.3 of the typical one, (m,)."""
    return legs * rng.uniform(0.7, 1.3, len(legs))


def either(rng: np.random.Generator, legs: Array) -> Array:
    """The same with random signs, (m,)."""
    return uneven(rng, legs) * rng.choice([-1.0, 1.0], len(legs))


def backlash(
    rng: np.random.Generator, strength: float, legs: Array, drive: Drive = ROTARY
) -> Cause:
    """Backlash: the joint stays until the motor has crossed the gap, then follows it."""
    gap = strength * _GAP * uneven(rng, legs) * drive.size

    def act(world: World, state: State) -> None:
        for leg in np.flatnonzero(gap):
            state.joint[:, leg] += _play(world.command[:, leg], gap[leg] / 2)

    return Cause("backlash", act, of_legs("gap", gap))


def _play(motor: Array, half: float) -> Array:
    """Joint minus motor, (n,), starting in the middle of the gap."""
    at, result = float(motor[0]), []
    for angle in motor.tolist():
        at = min(max(at, angle - half), angle + half)
        result.append(at - angle)
    return np.array(result)


def stick_slip(
    rng: np.random.Generator, strength: float, legs: Array, drive: Drive = ROTARY
) -> Cause:
    """LuGre friction twists the drive: bristles bend at low speed, and relax with speed."""
    size = strength * _FRICTION * uneven(rng, legs) * drive.size

    def act(world: World, state: State) -> None:
        for leg in np.flatnonzero(size):
            bent = _bristles(world.time, world.command[:, leg] / drive.size)
            state.joint[:, leg] -= size[leg] * bent

    # At speed friction is constant, which acts as backlash of twice the deflection.
    play = of_legs("play", 2 * _COULOMB * size)
    return Cause("stick_slip", act, of_legs("friction", size) | play)


def _bristles(time: Array, motor: Array) -> Array:
    """Bend of the bristles relative to that at static friction, (n,): z' = v - |v| z / g(v)."""
    bend, result = 0.0, [0.0]
    steps = np.diff(motor)
    speed = np.abs(steps) / np.diff(time)
    holds = _COULOMB + (1 - _COULOMB) * np.exp(-((speed / _STRIBECK) ** 2))
    for step, hold in zip(steps.tolist(), holds.tolist(), strict=True):
        if step:
            end = math.copysign(hold, step)
            bend = end + (bend - end) * math.exp(-abs(step) / (_PRESLIDING * hold))
        result.append(bend)
    return np.array(result)


def joint_lag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Each servo trails its command: T y' = u - y, integrated in fine steps."""
    constant = strength * _LAG * legs * rng.uniform(0.3, 1.7, len(legs))

    def act(world: World, state: State) -> None:
        for number in range(len(world.items)):
            rows = np.flatnonzero(world.item == number)
            t, u = world.time[rows], world.command[rows]
            step = (t[1] - t[0]) / _FINE
            fine = CubicSpline(t, u)(t[0] + step * np.arange(_FINE * (len(t) - 1) + 1))
            for leg in np.flatnonzero(constant):
                behind = _behind(fine[:, leg], step, constant[leg])
                state.joint[rows, leg] -= behind[::_FINE]

    return Cause("joint_lag", act, of_legs("lag", constant))


def _behind(u: Array, step: float, constant: float) -> Array:
    """u - y from rest, (n,), exact for a u that is linear between its samples."""
    keeps = math.exp(-step / constant)
    slope = np.diff(u, prepend=u[0]) / step
    return np.asarray(lfilter([constant * (1 - keeps)], [1.0, -keeps], slope))


def encoder_eccentricity(
    rng: np.random.Generator, strength: float, legs: Array, drive: Drive = ROTARY
) -> Cause:
    """A code disc mounted off its axis: the read head measures angles about another centre."""
    size = strength * _ECCENTRIC * uneven(rng, legs) * drive.size
    bearing = rng.uniform(0, 2 * np.pi, len(legs))

    def act(world: World, state: State) -> None:
        angle = world.command - bearing
        state.joint += np.arctan2(size * np.sin(angle), 1 + size * np.cos(angle))

    return Cause("encoder_eccentricity", act, of_legs("size", size) | of_legs("bearing", bearing))


def encoder_interpolation(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Errors of two encoder signals, and the angle error that results after the arc tangent."""
    off = _TURN * strength * _SUBDIVISION * legs * rng.uniform(-1.0, 1.0, (4, len(legs)))

    def act(world: World, state: State) -> None:
        phase = LINES * world.command
        cosine = np.cos(phase) + off[0]
        sine = (1 + off[2]) * np.sin(phase + off[3]) + off[1]
        told = np.arctan2(sine, cosine)
        more = told - phase
        state.joint -= (more - _TURN * np.round(more / _TURN)) / LINES

    names = "sine", "cosine", "second_sine", "second_cosine"
    shares = np.array([1.0, -1.0, -0.5, -0.5])[:, None]
    every = zip(names, shares * off / LINES, strict=True)
    known = {key: value for name, row in every for key, value in of_legs(name, row).items()}
    return Cause("encoder_interpolation", act, known)


def transmission_error(
    rng: np.random.Generator, strength: float, legs: Array, drive: Drive = ROTARY
) -> Cause:
    """Gear error with one and two periods per motor turn."""
    size = strength * _RIPPLE * uneven(rng, legs) * drive.size
    phase = rng.uniform(0, 2 * np.pi, (2, len(legs)))
    wave = bool(rng.random() < 0.5)
    ratio, main = (drive.gears[1], 2) if wave else (drive.gears[0], int(rng.integers(1, 3)))
    shares = np.where(np.array([1, 2]) == main, 1.0, 0.25)

    def act(world: World, state: State) -> None:
        motor = ratio * world.command
        for turns in (1, 2):
            state.joint += size * shares[turns - 1] * np.sin(turns * motor + phase[turns - 1])

    said = {"cycles": ratio * main, **of_legs("size", size)}
    for turns in (1, 2):  # each order with its share, for the judge of equations
        said[f"order_{turns}"], said[f"share_{turns}"] = ratio * turns, shares[turns - 1]
        said |= {
            f"phase_{turns}_{leg + 1}": float(phase[turns - 1, leg]) for leg in range(len(legs))
        }
    return Cause("transmission_error", act, said)


def joint_scale(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A wrong number of counts per turn."""
    scale = strength * _SCALE * either(rng, legs)

    def act(world: World, state: State) -> None:
        state.joint += scale * world.command

    return Cause("joint_scale", act, of_legs("scale", scale))


def joint_zero_drift(
    rng: np.random.Generator, strength: float, legs: Array, drive: Drive = ROTARY
) -> Cause:
    """A coupling that creeps during the whole session, or slips once."""
    size = strength * _CREEP * either(rng, legs) * drive.size
    slips, when = rng.random() < 0.5, rng.random()

    def act(world: World, state: State) -> None:
        share = world.time / world.length
        course = share > 0.25 + 0.5 * when if slips else share
        state.joint += size * course[:, None]

    said = {"kind": "step" if slips else "ramp", "share": 0.25 + 0.5 * when if slips else 1.0}
    return Cause("joint_zero_drift", act, {**of_legs("drift", size), **said})


def joint_compliance(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Each drive is a spring loaded by weight, and by inertia in motion."""
    give = strength * _GIVE * uneven(rng, legs)

    def act(world: World, state: State) -> None:
        state.joint -= give * world.moments(state.changed)

    return Cause("joint_compliance", act, of_legs("give", give))


def dynamic_deflection(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Drives that hold all weight but yield to inertia."""
    give = strength * _GIVE * uneven(rng, legs)

    def act(world: World, state: State) -> None:
        state.joint -= give * world.pushes()

    return Cause("dynamic_deflection", act, of_legs("give", give))


DRIVES: dict[str, Draw] = {
    "backlash": backlash,
    "stick_slip": stick_slip,
    "joint_lag": joint_lag,
    "encoder_eccentricity": encoder_eccentricity,
    "transmission_error": transmission_error,
    "joint_scale": joint_scale,
    "joint_zero_drift": joint_zero_drift,
    "joint_compliance": joint_compliance,
    "dynamic_deflection": dynamic_deflection,
}


def drives_of(drive: Drive, *names: str) -> dict[str, Draw]:
    """Some of these causes with the sizes of other drives."""
    sized = (backlash, stick_slip, encoder_eccentricity, transmission_error, joint_zero_drift)
    return {n: partial(DRIVES[n], drive=drive) if DRIVES[n] in sized else DRIVES[n] for n in names}
