"""Causes hidden in the structure: heat, elastic rods, clearance in the ball joints."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.machine import ARM, RADIUS, ROD
from blind.world import State, World

Array = NDArray[np.float64]

_EXPANSION = 23e-6  # [1/K] aluminium
_STRETCH = 1 / 1.5e6  # [m/N]
_CLEARANCE = 15e-6  # [m] to either side


def thermal_growth_arm(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Arms lengthen as they warm; the sensor on one of them lags a little."""
    expansion = strength * _EXPANSION * legs

    def act(world: World, state: State) -> None:
        warm = world.warming.of("arm", world.time)
        state.changed = state.changed.and_arm(warm[:, None] * expansion * ARM)

    return Cause("thermal_growth_arm", act, {"expansion": strength * _EXPANSION})


def thermal_growth_base(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The base plate grows: its hinges move outward."""
    expansion = strength * _EXPANSION * legs

    def act(world: World, state: State) -> None:
        warm = world.warming.of("base", world.time)
        state.changed = state.changed.and_outward(warm[:, None] * expansion * RADIUS)

    return Cause("thermal_growth_base", act, {"expansion": strength * _EXPANSION})


def thermal_growth_forearm(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Rods lengthen as they warm; they have no sensor unless one is requested."""
    expansion = strength * _EXPANSION * legs

    def act(world: World, state: State) -> None:
        warm = world.warming.of("forearm", world.time)
        longer = warm[:, None] * expansion * ROD
        state.changed = state.changed.and_rod(np.repeat(longer[..., None], 2, axis=2))

    return Cause("thermal_growth_forearm", act, {"expansion": strength * _EXPANSION})


def forearm_compliance(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Each rod is a spring under its tension."""
    give = strength * _STRETCH * legs[:, None] * rng.uniform(0.9, 1.1, (3, 2))

    def act(world: World, state: State) -> None:
        state.changed = state.changed.and_rod(give * world.pulls(state.changed))

    return Cause("forearm_compliance", act, {"give": float(give.mean())})


def ball_joint_clearance(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A rod in tension sits at one end of its clearance, a rod in compression at the other."""
    size, soft = strength * _CLEARANCE * legs[:, None], float(rng.choice([1e-6, 0.2, 0.6]))

    def act(world: World, state: State) -> None:
        pulled = np.tanh(world.pulls(state.changed) / soft)  # soft: [N] over which it changes ends
        state.changed = state.changed.and_rod(size * pulled)

    return Cause(
        "ball_joint_clearance", act, {"clearance": strength * _CLEARANCE, "softness": soft}
    )


STRUCTURE: dict[str, Draw] = {
    "thermal_growth_arm": thermal_growth_arm,
    "thermal_growth_base": thermal_growth_base,
    "thermal_growth_forearm": thermal_growth_forearm,
    "forearm_compliance": forearm_compliance,
    "ball_joint_clearance": ball_joint_clearance,
}
