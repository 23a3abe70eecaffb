"""Structure in no catalogue that is hidden in the drives, each with its equation.

The law of a kind is written once: it moves the machine, and it is the reference of the judge.
Sizes at strength 1 are 30 to 100 micrometres at the platform. Each kind gives its source.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.drives import either, uneven
from blind.inputs import Inputs, put
from blind.truth import DRIVE, JOINTS, after, numbers, of_each, true
from blind.world import State, World

Array = NDArray[np.float64]
One = Callable[[Mapping[str, Array], int], Array]  # inputs, joint from 1 -> (n,) [rad]


def hidden_in_drives(
    kind: str, legs: Array, one: One, variables: str, form: str, values: Mapping[str, float]
) -> Cause:
    """A law of each joint that has it, the same except for its size."""
    joints = numbers(legs)
    part = JOINTS if len(joints) > 1 else f"joint_{joints[0]}"
    law = of_each("q", joints, one)

    def act(world: World, state: State) -> None:
        put(state, law(Inputs(world)))

    said = {"kind": kind, **values}
    where = None if part == JOINTS else part
    return Cause("unknown", act, said, where, truth=true(DRIVE, part, variables, form, law))


def one_of(rng: np.random.Generator, legs: Array) -> Array:
    """One of the legs at random, (3,) of 0 and 1."""
    return np.eye(3)[rng.choice(np.flatnonzero(legs))]


def stiffening(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A strain wave gear stiffens with load; the controller compensates a single stiffness.

    Cubic springs: Tuttle and Seering, IEEE Trans. Robotics and Automation 12 (1996) 368.
    """
    size, exact = strength * 2e-7 * uneven(rng, legs), rng.uniform(9.0, 12.0)  # [N m]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        torque = seen[f"torque_{joint}"]
        return -size[joint - 1] * (torque**3 - exact**2 * torque)

    return hidden_in_drives("stiffening", legs, one, "torque_j", "cube", {"exact": exact})


def speed_forward(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Drag is proportional to the square of speed; the feed-forward was tuned at one speed."""
    size, tuned = strength * 1e-3 * uneven(rng, legs), rng.uniform(0.6, 0.8)  # [s^2], [rad/s]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        rate = seen[f"rate_{joint}"]
        return -size[joint - 1] * rate * (np.abs(rate) - tuned)

    return hidden_in_drives("speed_forward", legs, one, "rate_j", "square", {"tuned": tuned})


def bus_sag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The amplifiers' supply sags with the power of acceleration, and rises under braking."""
    size = strength * 2e-4 * uneven(rng, legs)  # [s^3/rad]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return -size[joint - 1] * seen[f"rate_{joint}"] * seen[f"acceleration_{joint}"]

    return hidden_in_drives("bus_sag", legs, one, "acceleration_j rate_j", "product", {})


def loaded_friction(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Friction grows with the load; the compensation at a reversal was tuned at half of it.

    Load-dependent friction: Waiboer, Aarts and Jonker, Multibody Dynamics (2005).
    """
    size, tuned = strength * 1e-4 * uneven(rng, legs), rng.uniform(0.8, 1.2)  # [rad/kg], [kg]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return -size[joint - 1] * seen[f"direction_{joint}"] * (seen["payload"] - tuned)

    values = {"tuned": tuned}
    return hidden_in_drives("loaded_friction", legs, one, "direction_j payload", "product", values)


def cold_grease(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Friction falls as the grease warms; the compensation at a reversal was tuned half warm.

    Temperature and friction: Simoni et al., Robotics and CIM 36 (2015).
    """
    size, tuned = strength * 2e-5 * uneven(rng, legs), rng.uniform(27.5, 29.5)  # [rad/K], [deg C]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        warm = seen["temperature_arm"] - tuned
        return size[joint - 1] * seen[f"direction_{joint}"] * warm

    variables = "direction_j temperature_arm"
    return hidden_in_drives("cold_grease", legs, one, variables, "product", {"tuned": tuned})


def warm_tape(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A tape scale expands more than the drum it is on; its scale was set on a warm machine."""
    legs = one_of(rng, legs)
    size, tuned = strength * 1.5e-5 * either(rng, legs), rng.uniform(27.0, 30.0)  # [1/K], [deg C]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return size[joint - 1] * (seen["temperature_arm"] - tuned) * seen[f"q_{joint}"]

    variables = "q_j temperature_arm"
    return hidden_in_drives("warm_tape", legs, one, variables, "product", {"tuned": tuned})


def coupled(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A belt or cable runs past the next joint, which transmits to it a share of its rotation.

    As between the joints of cable-driven arms and of wrists with hollow shafts.
    """
    size = strength * 3e-4 * float(rng.choice([-1.0, 1.0])) * uneven(rng, legs)

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return size[joint - 1] * seen[f"q_{after(joint)}"]

    return hidden_in_drives("coupled", legs, one, "q_j+1", "line", {})


def dress_pack(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A hose package between two arms pulls when both swing out."""
    legs = one_of(rng, legs)
    size = strength * 6e-4 * either(rng, legs)  # [1/rad]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return size[joint - 1] * seen[f"q_{joint}"] * seen[f"q_{after(joint)}"]

    return hidden_in_drives("dress_pack", legs, one, "q_j q_j+1", "product", {})


def quadrant_spike(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A spike at each reversal of a joint that decays with travel, as known from circle tests.

    Quadrant glitches: ISO 230-4 and the literature of its users.
    """
    size, far = strength * 2e-4 * uneven(rng, legs), rng.uniform(0.03, 0.06)  # [rad]

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        dies = np.exp(-seen[f"travel_{joint}"] / far)
        return -size[joint - 1] * seen[f"direction_{joint}"] * dies

    variables, values = "direction_j travel_j", {"far": far}
    return hidden_in_drives("quadrant_spike", legs, one, variables, "exponential", values)


def chiller(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Switched cooling water warms and cools the housing of one drive periodically."""
    legs = one_of(rng, legs)
    size, period = strength * 8e-5 * uneven(rng, legs), rng.uniform(700.0, 1500.0)  # [rad], [s]
    phase = rng.uniform(0, 2 * np.pi)

    def one(seen: Mapping[str, Array], joint: int) -> Array:
        return size[joint - 1] * np.sin(2 * np.pi * seen["time"] / period + phase)

    return hidden_in_drives("chiller", legs, one, "time", "sine", {"period": period})


UNNAMED_DRIVES: dict[str, Draw] = {
    "stiffening": stiffening,
    "speed_forward": speed_forward,
    "bus_sag": bus_sag,
    "loaded_friction": loaded_friction,
    "cold_grease": cold_grease,
    "warm_tape": warm_tape,
    "coupled": coupled,
    "dress_pack": dress_pack,
    "quadrant_spike": quadrant_spike,
    "chiller": chiller,
}
