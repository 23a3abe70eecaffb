"""The causes, each as what it does to a machine, in units of a real machine's typical size.

A cause changes one of four things: the build, the joints behind the drives, the dimensions in each
sample, or what the tracker says. None has the detector's form: play is an operator with a state,
lag a differential equation, weight the gradient of an energy.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from blind.machine import (
    ARM,
    ARM_CENTRE,
    ARM_KG,
    PLATFORM_KG,
    RADIUS,
    ROD,
    ROD_KG,
    Build,
    Changed,
    assemble,
    pulls,
    torques,
)

Array = NDArray[np.float64]


@dataclass(frozen=True)
class World:
    """All samples of a session, commanded motion included, and what holds during them."""

    time: Array  # (n,) [s]
    item: NDArray[np.int64]  # (n,)
    command: Array  # (n, 3) [rad]
    moving: NDArray[np.bool_]  # (n,) in a measured motion
    payload: Array  # (n,) [kg]
    centre: Array  # (3,) [m]
    arm: Array  # (n,) [K] above 20 degrees
    base: Array  # (n,)
    forearm: Array  # (n,)
    build: Build

    def velocity(self) -> Array:
        """(n, 3) [rad/s] in measured motions, 0 elsewhere."""
        rate = np.zeros_like(self.command)
        for number in np.unique(self.item[self.moving]):
            rows = np.flatnonzero(self.item == number)
            rate[rows] = np.gradient(self.command[rows], self.time[rows], axis=0)
        return rate


@dataclass
class State:
    """What the causes act on, one after the other."""

    joint: Array  # (n, 3) behind the drives
    changed: Changed
    said: dict[str, Any] = field(default_factory=dict)  # what was hidden, for the judge
    late: float = 0.0  # [s] the tracker's stamps
    scale: float = 0.0
    drift: Callable[[Array, Array], Array] | None = None  # (reading, time) -> reading


Act = Callable[[World, State, float, np.random.Generator], None]


def _spread(rng: np.random.Generator, n: int = 3) -> Array:
    """One drive is not like the other."""
    return rng.uniform(0.7, 1.3, n) * rng.choice([-1.0, 1.0], n)


def _positive(rng: np.random.Generator) -> Array:
    return rng.uniform(0.7, 1.3, 3)


def backlash(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """A play operator: the arm moves when the motor has crossed the gap."""
    gap = strength * 0.29e-3 * _positive(rng)
    out = world.command[0].copy()
    shift = np.zeros_like(state.joint)
    for row, motor in enumerate(world.command):
        out = np.clip(out, motor - gap / 2, motor + gap / 2)
        shift[row] = out - motor
    state.joint += shift
    state.said["backlash"] = {f"gap_{i + 1}": float(g) for i, g in enumerate(gap)}


def stick_slip(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """Presliding spring that friction winds up while the joint creeps."""
    size, width = strength * 50e-6 * _positive(rng), 0.3e-3
    wound = np.zeros(3)
    before = world.command[0]
    shift = np.zeros_like(state.joint)
    speed = np.abs(world.velocity())
    for row, motor in enumerate(world.command):
        wound = np.clip(wound + (motor - before) / width, -1.0, 1.0)
        before = motor
        shift[row] = -size * wound * (0.1 + 0.9 * np.exp(-((speed[row] / 0.06) ** 2)))
    state.joint += shift
    state.said["stick_slip"] = {f"stick_{i + 1}": float(g) for i, g in enumerate(size)}


def joint_lag(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """Each servo trails: T dy/dt = u - y, from rest at the start of each motion."""
    constant = strength * 5e-3 * _positive(rng)
    for number in np.unique(world.item[world.moving]):
        rows = np.flatnonzero(world.item == number)
        t, u = world.time[rows], world.command[rows]
        rate = np.gradient(u, t, axis=0)
        gap = constant * rate[0]  # the motion has been going on
        for k, row in enumerate(rows):
            if k:
                step = t[k] - t[k - 1]
                slope = (u[k] - u[k - 1]) / step
                steady = constant * slope
                gap = steady + (gap - steady) * np.exp(-step / constant)
            state.joint[row] -= gap
    state.said["joint_lag"] = {f"lag_{i + 1}": float(c) for i, c in enumerate(constant)}


def timestamp_latency(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """The tracker's clock is off."""
    state.late = float(strength * 3e-3 * rng.choice([-1.0, 1.0]))
    state.said["timestamp_latency"] = {"latency": state.late}


def encoder_eccentricity(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """A code disc off its axis."""
    size, phase = strength * 0.4e-3 * _positive(rng), rng.uniform(0, 2 * np.pi, 3)
    state.joint += size * np.sin(world.command - phase)
    state.said["encoder_eccentricity"] = {f"size_{i + 1}": float(s) for i, s in enumerate(size)}


def transmission_error(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """Gear or wave generator: once or twice a motor turn, and a little of its double."""
    cycles = float(rng.choice([33.0, 66.0, 100.0, 200.0]))
    size, phase = strength * 0.1e-3 * _positive(rng), rng.uniform(0, 2 * np.pi, 3)
    state.joint += size * np.sin(cycles * world.command + phase)
    state.said["transmission_error"] = {"cycles": cycles}


def joint_scale(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """Counts a turn entered wrong."""
    scale = strength * 400e-6 * _spread(rng)
    state.joint += scale * world.command
    state.said["joint_scale"] = {f"scale_{i + 1}": float(s) for i, s in enumerate(scale)}


def joint_zero_drift(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """A coupling that creeps, or slips once."""
    size = strength * 0.1e-3 * _spread(rng)
    if rng.random() < 0.5:
        at = rng.uniform(0.25, 0.75) * world.time[~world.moving].max()
        state.joint += size * (world.time[:, None] > at)
    else:
        state.joint += size * world.time[:, None] / 7200.0 * 1.5
    state.said["joint_zero_drift"] = {f"drift_{i + 1}": float(s) for i, s in enumerate(size)}


def joint_compliance(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """Each drive a spring under the gradient of the potential energy."""
    give = strength * 4e-5 * _positive(rng)
    for _ in range(2):
        moment = torques(
            world.command, world.build, state.changed, world.payload, world.centre
        )
    state.joint += -give * moment
    state.said["joint_compliance"] = {f"compliance_{i + 1}": float(c) for i, c in enumerate(give)}


def forearm_compliance(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """Each rod a spring under its tension."""
    give = strength * 6e-7
    tension = pulls(world.command, world.build, state.changed, world.payload, world.centre)
    state.changed = state.changed.and_rod(give * tension)
    state.said["forearm_compliance"] = {"rod_compliance": give}


def ball_joint_clearance(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """A rod end sits at either end of its clearance, by the sign of the rod's force."""
    size = strength * 20e-6
    tension = pulls(world.command, world.build, state.changed, world.payload, world.centre)
    state.changed = state.changed.and_rod(size * np.tanh(tension / 0.3))
    state.said["ball_joint_clearance"] = {"clearance": size}


def dynamic_deflection(
    world: World, state: State, strength: float, rng: np.random.Generator
) -> None:
    """Springs in the drives under the inertia of all that moves, by D'Alembert's principle."""
    give = strength * 4e-4
    h = 1e-5
    for number in np.unique(world.item[world.moving]):
        rows = np.flatnonzero(world.item == number)
        t, u = world.time[rows], world.command[rows]
        place = assemble(u, world.build).place
        acceleration = np.gradient(np.gradient(place, t, axis=0), t, axis=0)
        angular = np.gradient(np.gradient(u, t, axis=0), t, axis=0)
        mass = PLATFORM_KG + 3 * ROD_KG + world.payload[rows][:, None]
        inertia = ARM_KG * (ARM_CENTRE * ARM) ** 2 * 1.4 + ROD_KG * ARM**2
        for joint in range(3):
            d = h * (np.arange(3) == joint)
            slope = (
                assemble(u + d, world.build).place - assemble(u - d, world.build).place
            ) / (2 * h)
            moment = np.sum(mass * acceleration * slope, axis=1) + inertia * angular[:, joint]
            state.joint[rows, joint] -= give * moment
    state.said["dynamic_deflection"] = {"dynamic_compliance": give}


def _warm(part: str, temperature: str) -> Act:
    def act(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
        growth = strength * 23e-6 * getattr(world, temperature)
        if part == "arm":
            state.changed = replace(state.changed, arm=state.changed.arm + growth[:, None] * ARM)
        elif part == "forearm":
            state.changed = state.changed.and_rod((growth * ROD)[:, None, None])
        else:
            state.changed = replace(
                state.changed, outward=state.changed.outward + growth[:, None] * RADIUS
            )
        state.said[f"thermal_growth_{part}"] = {"expansion": strength * 23e-6}

    return act


def tracker_scale(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """Wrong air: every distance reads too long."""
    state.scale = float(strength * 30e-6 * rng.choice([-1.0, 1.0]))
    state.said["tracker_scale"] = {"scale": state.scale}


def tracker_drift(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """The stand settles: towards an end, or on and on."""
    shift = strength * 40e-6 * _unit(rng)
    turn = strength * 12e-6 * _unit(rng)
    constant = float(rng.choice([1500.0, 3000.0, 1e9]))

    def drift(reading: Array, time: Array) -> Array:
        share = time / 3600 if constant > 1e8 else 2 * (1 - np.exp(-time / constant))
        moved = Rotation.from_rotvec(share[:, None] * turn).apply(reading)
        return moved + share[:, None] * shift

    state.drift = drift
    state.said["tracker_drift"] = {"constant": constant}


def _unit(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return vector / np.linalg.norm(vector)


ACTS: dict[str, Act] = {
    "backlash": backlash,
    "stick_slip": stick_slip,
    "joint_lag": joint_lag,
    "timestamp_latency": timestamp_latency,
    "encoder_eccentricity": encoder_eccentricity,
    "transmission_error": transmission_error,
    "joint_scale": joint_scale,
    "joint_zero_drift": joint_zero_drift,
    "joint_compliance": joint_compliance,
    "forearm_compliance": forearm_compliance,
    "ball_joint_clearance": ball_joint_clearance,
    "dynamic_deflection": dynamic_deflection,
    "thermal_growth_arm": _warm("arm", "arm"),
    "thermal_growth_base": _warm("base", "base"),
    "thermal_growth_forearm": _warm("forearm", "forearm"),
    "tracker_scale": tracker_scale,
    "tracker_drift": tracker_drift,
}

# name of a build's field, typical size, shape of what is changed in one chain
BUILT: dict[str, tuple[str, float]] = {
    "joint_zero_offset": ("zero", 2e-3),
    "arm_length": ("arm", 0.4e-3),
    "forearm_length": ("rod", 0.5e-3),
    "base_joint_position": ("hinge", 0.6e-3),
    "base_joint_tilt": ("tilt", 2e-3),
    "parallelogram_mismatch": ("mismatch", 0.3e-3),
}


def misbuilt(
    build: Build, cause: str, strength: float, rng: np.random.Generator
) -> tuple[Build, int]:
    """A build with one dimension of one chain off, and the chain (0, 1, 2)."""
    part, typical = BUILT[cause]
    leg = int(rng.integers(3))
    size = strength * typical * float(rng.choice([-1.0, 1.0]))
    if part == "mismatch":
        rod = build.rod.copy()
        rod[leg] += np.array([-0.5, 0.5]) * size
        return replace(build, rod=rod), leg
    value = getattr(build, part).copy()
    if part == "hinge":
        value[leg, 0] += size
    elif part == "tilt":
        value[leg, 2] += size
    else:
        value[leg] += size
    return replace(build, **{part: value}), leg


def _bump(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """Something that pushes where it stands: smooth bumps in joint space."""
    for _ in range(6):
        centre = rng.uniform(-0.1, 0.8, 3)
        size = strength * 0.2e-3 * rng.standard_normal(3)
        near = np.exp(-np.sum((world.command - centre) ** 2, axis=1) / (2 * 0.3**2))
        state.joint += size * near[:, None]


def _drag(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """A hose that pulls by where the platform stands around the column."""
    place = assemble(world.command, world.build).place
    bearing = np.arctan2(place[:, 1], place[:, 0]) - rng.uniform(0, 2 * np.pi)
    reach = np.hypot(place[:, 0], place[:, 1]) / 0.4
    pull = np.stack([np.sin(2 * bearing + k) for k in range(3)], axis=1)
    state.joint += strength * 0.15e-3 * reach[:, None] ** 2 * pull


def _cross_talk(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """One joint's angle shows in its neighbour's."""
    other = np.roll(world.command, 1, axis=1)
    phase = rng.uniform(0, 2 * np.pi, 3)
    state.joint += strength * 0.12e-3 * np.sin(6 * other + phase)


def _grip(world: World, state: State, strength: float, rng: np.random.Generator) -> None:
    """The gripper shifts under its load, differently here and there."""
    phase = rng.uniform(0, 2 * np.pi, 3)
    state.joint += (
        strength * 0.08e-3 * world.payload[:, None] * np.sin(4 * world.command + phase)
    )


UNKNOWN: dict[str, Act] = {
    "bump": _bump,
    "drag": _drag,
    "cross_talk": _cross_talk,
    "grip": _grip,
}
