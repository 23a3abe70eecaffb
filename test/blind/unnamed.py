"""More structure in no catalogue, each with its equation: structure, base, measurement.

Those of the drives are in `unnamed_drives`. They are chosen from effects of real machines and from
their metrology, without regard to what the search can express. Sizes at strength 1 are 15 to 100
um.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.drives import either, uneven
from blind.inputs import Inputs, put
from blind.truth import (
    BASE,
    MEASUREMENT,
    PLATFORM,
    RODS,
    STRUCTURE,
    TRACKER,
    Law,
    Truth,
    numbers,
    of_each,
    of_rods,
    of_shift,
    true,
)
from blind.unnamed_drives import UNNAMED_DRIVES, one_of
from blind.world import State, World

Array = NDArray[np.float64]

_ONE_READING = "a tracker that reads one point cannot tell a shift of base, platform or reading"
_HINGE = "the motor's hinge is a part of the base and carries the arm"


def _hidden(kind: str, law: Law, truth: Truth, values: Mapping[str, float]) -> Cause:
    def act(world: World, state: State) -> None:
        put(state, law(Inputs(world)))

    return Cause("unknown", act, {"kind": kind, **values}, truth=truth)


def _shifted(kind: str, law: Law, variables: str, form: str, values: Mapping[str, float]) -> Cause:
    """A displacement of the platform, which the base or the reading may explain as well."""
    stages, parts = f"{STRUCTURE} {MEASUREMENT}", f"{PLATFORM} {BASE} {TRACKER}"
    return _hidden(kind, law, true(stages, parts, variables, form, law, _ONE_READING), values)


def _any_way(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


def loose_bearing(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A worn main bearing: its axis moves sideways with the arm's direction of motion."""
    legs = one_of(rng, legs)
    size, leg = strength * 50e-6 * either(rng, legs), numbers(legs)[0]

    def one(seen: Mapping[str, Array], leg: int) -> Array:
        return size[leg - 1] * seen[f"direction_{leg}"]

    law = of_each("hinge", [leg], one)
    parts = f"joint_{leg} arm_{leg} hinge_{leg} base_{leg} {BASE}"
    truth = true(STRUCTURE, parts, "direction_j", "sign", law, _HINGE)
    return _hidden("loose_bearing", law, truth, {})


def loose_bond(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Failed bonds at the ends of carbon rods, which yield in tension only.

    The controller compensates one stiffness for both directions, as measured for the whole.
    """
    size = strength * 3e-6  # [m/N]
    law = of_rods(lambda pull: size * (np.maximum(pull, 0.0) - pull / 2))
    truth = true(STRUCTURE, RODS, "force_j", "dead zone", law)
    return _hidden("loose_bond", law, truth, {"give": size})


def sun_on_one_arm(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The sun warms one arm, which the sensor on the others does not detect."""
    legs = one_of(rng, legs)
    size, slow = strength * 0.15e-3 * uneven(rng, legs), rng.uniform(500.0, 1200.0)  # [m], [s]
    leg = numbers(legs)[0]

    def one(seen: Mapping[str, Array], leg: int) -> Array:
        return -size[leg - 1] * np.expm1(-seen["time"] / slow)

    law = of_each("arm", [leg], one)
    truth = true(STRUCTURE, f"arm_{leg}", "time", "exponential", law)
    return _hidden("sun_on_one_arm", law, truth, {"constant": slow})


def hose_weight(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Above some height the platform carries the hose's weight, and is pushed down and aside."""
    size, begins = strength * 0.8e-3 * _any_way(rng), rng.uniform(-0.76, -0.70)  # [m/m], [m]
    law = of_shift(lambda seen: np.maximum(seen["z"] - begins, 0.0)[:, None] * size)
    return _shifted("hose_weight", law, "z", "dead zone", {"begins": begins})


def air_conditioning(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The hall's air temperature varies periodically by a degree and moves the tracker's stand.

    Variations of workshop air: ISO/TR 16015.
    """
    size, period = strength * 25e-6 * _any_way(rng), rng.uniform(600.0, 1500.0)  # [m], [s]
    phase = rng.uniform(0, 2 * np.pi)

    def leans(time: Array) -> Array:
        return np.sin(2 * np.pi * time / period + phase)[:, None] * size

    def act(world: World, state: State) -> None:
        state.distortions += (lambda reading, time: reading + leans(time),)

    law = of_shift(lambda seen: leans(seen["time"]))
    stages, parts = f"{MEASUREMENT} {STRUCTURE}", f"{TRACKER} {BASE} {PLATFORM}"
    truth = true(stages, parts, "time", "sine", law, _ONE_READING)
    return Cause("unknown", act, {"kind": "air_conditioning", "period": period}, truth=truth)


UNNAMED: dict[str, Draw] = {
    **UNNAMED_DRIVES,
    "loose_bearing": loose_bearing,
    "loose_bond": loose_bond,
    "sun_on_one_arm": sun_on_one_arm,
    "hose_weight": hose_weight,
    "air_conditioning": air_conditioning,
}
