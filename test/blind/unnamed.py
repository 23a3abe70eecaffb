"""More of what is in nobody's catalogue, each with the law that it follows.

The law is what a finder of laws should write down: stage, parts, variables and, of the number that
it moves, its course. A dent has no equation of few terms; it is there to be given none.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.drives import either
from blind.machine import RADIUS
from blind.world import State, World

Array = NDArray[np.float64]
Course = Callable[[Mapping[str, Array], Mapping[str, float]], Array]

_ROOM = 20.0  # [deg C]
JOINTS = tuple(f"joint_{leg}" for leg in (1, 2, 3))


@dataclass(frozen=True)
class Law:
    """What is true of a structure.

    Attributes:
        stages: where it acts; more than one where both say the same.
        parts: of the machine; of each any is right.
        variables: what it depends on, without the numbers of joints.
        course: what it moves by, but for its size, of variables (n,) and the values that it was
            drawn with; None where there is no equation of few terms.
    """

    stages: tuple[str, ...]
    parts: tuple[str, ...]
    variables: tuple[str, ...]
    course: Course | None


def _cause(kind: str, act: Callable[[World, State], None], **values: float) -> Cause:
    return Cause("unknown", act, {"kind": kind, **values})


def hardening_spring(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A reducer gives the more, the more it carries already: rubber that shears."""
    give = strength * 0.4e-6 * rng.uniform(0.8, 1.2, 3)  # [rad/(N m)^3]

    def act(world: World, state: State) -> None:
        state.joint += give * world.moments(state.changed) ** 3

    return _cause("hardening_spring", act)


def slack_spring(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A coupling that turns once its bolts no longer hold by friction."""
    holds, give = rng.uniform(1.0, 3.0), strength * 5e-5 * either(rng, np.ones(3))

    def act(world: World, state: State) -> None:
        state.joint += give * np.clip(world.moments(state.changed) - holds, 0.0, None)

    return _cause("slack_spring", act, holds=float(holds))


def loaded_windup(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Bearings that drag under the load wind the reducer up against the motion."""
    size = strength * 3e-5 * rng.uniform(0.7, 1.3, 3)  # [rad/kg]

    def act(world: World, state: State) -> None:
        state.joint -= size * (world.payload * world.side)[:, None]

    return _cause("loaded_windup", act)


def warm_play(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A gear whose housing grows apart leaves more play the warmer it is."""
    size = strength * 6e-6 * rng.uniform(0.7, 1.3, 3)  # [rad/K]

    def act(world: World, state: State) -> None:
        warm = world.warming.of("arm", world.time)
        state.joint -= size * (warm * world.side)[:, None]

    return _cause("warm_play", act)


def sinking_foot(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The whole frame settles on a foot that gives way, towards an end."""
    way = rng.standard_normal(3)
    way, constant = way / np.linalg.norm(way), rng.uniform(800, 2500)

    def act(world: World, state: State) -> None:
        share = 1 - np.exp(-world.time / constant)
        state.shift = state.shift + strength * 60e-6 * share[:, None] * way

    return _cause("sinking_foot", act, constant=float(constant))


def breathing_tracker(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The hall's heating goes on and off, and the tracker's pillar with it."""
    way, period = rng.standard_normal(3), rng.uniform(1500, 3000)
    phase, size = rng.uniform(0, 2 * np.pi), strength * 30e-6

    def act(world: World, state: State) -> None:
        def distort(reading: Array, time: Array) -> Array:
            return reading + size * np.sin(2 * np.pi * time / period + phase)[:, None] * way

        state.distortions += (distort,)

    return _cause("breathing_tracker", act, period=float(period), phase=float(phase))


def gear_by_heat(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A gear off its axis by as much as its seat has grown."""
    size, phase = strength * 1.5e-5 * rng.uniform(0.7, 1.3, 3), rng.uniform(0, 2 * np.pi, 3)

    def act(world: World, state: State) -> None:
        warm = world.warming.of("arm", world.time)[:, None]
        state.joint += size * warm * np.sin(2 * world.command + phase)

    return _cause("gear_by_heat", act, **{f"phase_{j + 1}": float(p) for j, p in enumerate(phase)})


def leaning_neighbour(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A motor's foot gives under its load, and the next motor stands on the same plate."""
    size, way = strength * 6e-6 * rng.uniform(0.7, 1.3, 3), int(rng.choice([1, 2]))  # [rad/(N m)]

    def act(world: World, state: State) -> None:
        state.joint += size * np.roll(world.moments(state.changed), way, axis=1)

    return _cause("leaning_neighbour", act)


def air_drag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Broad arms trail by the square of their rate."""
    size = strength * 2e-4 * rng.uniform(0.8, 1.2, 3)  # [rad/(rad/s)^2]

    def act(world: World, state: State) -> None:
        state.joint -= size * world.velocity * np.abs(world.velocity)

    return _cause("air_drag", act)


def loaded_whip(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Arms spring back by acceleration times what is on the platform."""
    size = strength * 1e-5 * rng.uniform(0.8, 1.2, 3)  # [rad/(kg rad/s^2)]

    def act(world: World, state: State) -> None:
        state.joint -= size * world.payload[:, None] * world.acceleration

    return _cause("loaded_whip", act)


def dent(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A dent in each gear: an error over a few degrees about one angle."""
    at, size = rng.uniform(0.0, 0.6, 3), strength * 1.5e-4 * either(rng, np.ones(3))

    def act(world: World, state: State) -> None:
        state.joint += size * np.exp(-(((world.command - at) / 0.06) ** 2))

    return _cause("dent", act)


def base_of_two_metals(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A base of two metals bows by the square of its warming, and its hinges come out."""
    size = strength * 6e-6 * RADIUS * rng.uniform(0.8, 1.2)  # [m/K^2]

    def act(world: World, state: State) -> None:
        warm = world.warming.of("base", world.time)
        state.changed = state.changed.and_outward((size * warm**2)[:, None] * np.ones(3))

    return _cause("base_of_two_metals", act)


def bowed_beam(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The beam that the robot hangs from bows with the load, the more the farther out it is."""
    size = strength * 8e-4  # [m/(kg m^2)]

    def act(world: World, state: State) -> None:
        out = world.stand.place[:, 0] ** 2
        down = np.zeros((len(out), 3))
        down[:, 2] = -size * world.payload * out
        state.shift = state.shift + down

    return _cause("bowed_beam", act)


def late_creep(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A belt holds for a while, and creeps from then on."""
    begins = rng.uniform(0.3, 0.6)  # of the session
    size = strength * 1e-4 * either(rng, np.ones(3))

    def act(world: World, state: State) -> None:
        share = np.clip(world.time / world.length - begins, 0.0, None)
        state.joint += size * share[:, None]

    return _cause("late_creep", act, begins=float(begins))


UNNAMED: dict[str, Draw] = {
    "hardening_spring": hardening_spring,
    "slack_spring": slack_spring,
    "loaded_windup": loaded_windup,
    "warm_play": warm_play,
    "sinking_foot": sinking_foot,
    "breathing_tracker": breathing_tracker,
    "gear_by_heat": gear_by_heat,
    "leaning_neighbour": leaning_neighbour,
    "air_drag": air_drag,
    "loaded_whip": loaded_whip,
    "dent": dent,
    "base_of_two_metals": base_of_two_metals,
    "bowed_beam": bowed_beam,
    "late_creep": late_creep,
}

_DRIVE, _STILL = ("drive",), ("structure", "measurement")
_BODIES = ("platform", "base", "tracker")
LAWS: dict[str, Law] = {
    "bump": Law((), (), (), None),
    "ripple": Law((), (), (), None),
    "drag": Law((), (), (), None),
    "grip": Law((), (), (), None),
    "dent": Law((), (), (), None),
    "cross_talk": Law(_DRIVE, JOINTS, ("q",), None),
    "rub": Law(_DRIVE, JOINTS, ("q",), None),
    "rocking": Law(("structure",), ("base",), ("x", "y"), None),
    "hardening_spring": Law(_DRIVE, JOINTS, ("torque",), lambda v, _: v["torque"] ** 3),
    "slack_spring": Law(
        _DRIVE, JOINTS, ("torque",), lambda v, of: np.clip(v["torque"] - of["holds"], 0, None)
    ),
    "loaded_windup": Law(
        _DRIVE, JOINTS, ("direction", "payload"), lambda v, _: v["direction"] * v["payload"]
    ),
    "warm_play": Law(
        _DRIVE,
        JOINTS,
        ("direction", "temperature"),
        lambda v, _: v["direction"] * (v["temperature"] - _ROOM),
    ),
    "sinking_foot": Law(
        _STILL, _BODIES, ("time",), lambda v, of: 1 - np.exp(-v["time"] / of["constant"])
    ),
    "breathing_tracker": Law(
        _STILL,
        _BODIES,
        ("time",),
        lambda v, of: np.sin(2 * np.pi * v["time"] / of["period"] + of["phase"]),
    ),
    "gear_by_heat": Law(_DRIVE, JOINTS, ("q", "temperature"), None),
    "leaning_neighbour": Law(_DRIVE, JOINTS, ("torque",), lambda v, _: v["torque"]),
    "air_drag": Law(_DRIVE, JOINTS, ("rate",), lambda v, _: v["rate"] * np.abs(v["rate"])),
    "loaded_whip": Law(
        _DRIVE, JOINTS, ("acceleration", "payload"), lambda v, _: v["acceleration"] * v["payload"]
    ),
    "base_of_two_metals": Law(
        ("structure",),
        ("base_radial", "platform_radial"),
        ("temperature",),
        lambda v, _: (v["temperature"] - _ROOM) ** 2,
    ),
    "bowed_beam": Law(
        ("structure",), ("platform",), ("x", "payload"), lambda v, _: v["x"] ** 2 * v["payload"]
    ),
    "late_creep": Law(_DRIVE, JOINTS, ("time",), None),
}
