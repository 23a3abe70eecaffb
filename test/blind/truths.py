"""True laws of the causes in the catalogue, for trials in which they are removed from it.

Causes that are in no catalogue state their own laws.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from blind.cell import Cell
from blind.machine import ARM, RADIUS, ROD
from blind.session import Trial
from blind.truth import (
    ARMS,
    BASE,
    DRIVE,
    JOINTS,
    MEASUREMENT,
    PLATFORM,
    RODS,
    STRUCTURE,
    TRACKER,
    Truth,
    of_each,
    of_rods,
    of_shift,
    true,
)

Array = NDArray[np.float64]
Values = Mapping[str, float | str]
One = Callable[[Mapping[str, Array], int], Array]

_INERTIA = 0.28  # [kg m^2] approximate moment of inertia of a joint without payload
_DELAY = "what all joints trail alike, the whole reading is late by"


def _of_legs(values: Values, name: str) -> dict[int, float]:
    """Values of the legs that have one, by the number of the leg."""
    named = ((leg, values.get(f"{name}_{leg}")) for leg in (1, 2, 3))
    return {leg: float(value) for leg, value in named if value is not None}


def _drives(legs: Mapping[int, float], one: One, variables: str, form: str) -> Truth:
    part = JOINTS if len(legs) > 1 else f"joint_{next(iter(legs))}"
    return true(DRIVE, part, variables, form, of_each("q", list(legs), one))


def backlash(values: Values, cell: Cell) -> Truth:
    gap = _of_legs(values, "gap")
    return _drives(gap, lambda s, j: -gap[j] / 2 * s[f"direction_{j}"], "direction_j", "sign")


def stick_slip(values: Values, cell: Cell) -> Truth:
    """Friction's level at speed is backlash; its decrease with speed is the Stribeck curve."""
    size, play = _of_legs(values, "friction"), _of_legs(values, "play")
    slow = 0.05  # [rad/s] over which the generator's friction decreases

    def one(seen: Mapping[str, Array], j: int) -> Array:
        level = play[j] / (2 * size[j])
        falls = level + (1 - level) * np.exp(-((seen[f"rate_{j}"] / slow) ** 2))
        return -size[j] * seen[f"direction_{j}"] * falls

    return _drives(size, one, "direction_j rate_j", "exponential")


def joint_lag(values: Values, cell: Cell) -> Truth:
    lag = _of_legs(values, "lag")
    return _drives(lag, lambda s, j: -lag[j] * s[f"rate_{j}"], "rate_j", "line")


def timestamp_latency(values: Values, cell: Cell) -> Truth:
    late = float(values["latency"])
    law = of_each("q", [1, 2, 3], lambda s, j: -late * s[f"rate_{j}"])
    late_reading = tuple(
        true(MEASUREMENT, TRACKER, variables, None, None)
        for variables in ("speed", "rate_1 rate_2 rate_3")
    )
    return true(DRIVE, JOINTS, "rate_j", "line", law, _DELAY, late_reading)


def encoder_eccentricity(values: Values, cell: Cell) -> Truth:
    size, bearing = _of_legs(values, "size"), _of_legs(values, "bearing")

    def one(seen: Mapping[str, Array], j: int) -> Array:
        return size[j] * np.sin(seen[f"q_{j}"] - bearing[j])

    return _drives(size, one, "q_j", "sine")


def transmission_error(values: Values, cell: Cell) -> Truth:
    size = _of_legs(values, "size")

    def one(seen: Mapping[str, Array], j: int) -> Array:
        waves = (
            float(values[f"share_{k}"])
            * np.sin(
                float(values[f"order_{k}"]) * seen[f"q_{j}"] + float(values[f"phase_{k}_{j}"])
            )
            for k in (1, 2)
        )
        return np.asarray(size[j] * sum(waves))

    return _drives(size, one, "q_j", "sine")


def joint_scale(values: Values, cell: Cell) -> Truth:
    scale = _of_legs(values, "scale")
    return _drives(scale, lambda s, j: scale[j] * s[f"q_{j}"], "q_j", "line")


def joint_zero_drift(values: Values, cell: Cell) -> Truth:
    size, slips = _of_legs(values, "drift"), values["kind"] == "step"
    when = float(values["share"]) * cell.length

    def one(seen: Mapping[str, Array], j: int) -> Array:
        time = seen["time"]
        return size[j] * ((time > when) if slips else time / cell.length)

    return _drives(size, one, "time", "step" if slips else "line")


def joint_compliance(values: Values, cell: Cell) -> Truth:
    give = _of_legs(values, "give")
    return _drives(give, lambda s, j: -give[j] * s[f"torque_{j}"], "torque_j", "line")


def dynamic_deflection(values: Values, cell: Cell) -> Truth:
    """By the inertia torque alone; approximately by the joint's own acceleration."""
    give, whole = _of_legs(values, "give"), joint_compliance(values, cell)
    quick = _drives(
        give, lambda s, j: -give[j] * _INERTIA * s[f"acceleration_{j}"], "acceleration_j", "line"
    )
    why = "most of a joint's moment of inertia goes with its own acceleration"
    return replace(whole, why=why, instead=(quick,))


def _grows(left: str, part: str, sensor: str, length: float) -> Callable[[Values, Cell], Truth]:
    """By its own temperature sensor, or by time."""

    def truth(values: Values, cell: Cell) -> Truth:
        size, celsius = float(values["expansion"]) * length, f"temperature_{sensor}"
        rise, slow = cell.warming.rise[sensor], cell.warming.constant[sensor]

        def of_sensor(seen: Mapping[str, Array]) -> dict[str, Array]:
            return dict.fromkeys(lefts, size * (seen[celsius] - 20.0))

        def of_clock(seen: Mapping[str, Array]) -> dict[str, Array]:
            return dict.fromkeys(lefts, -size * rise * np.expm1(-seen["time"] / slow))

        by_clock = true(STRUCTURE, part, "time", "exponential", of_clock)
        why = "a part warms as time goes on"
        return true(STRUCTURE, part, celsius, "line", of_sensor, why, (by_clock,))

    sides = "ab" if left == "rod" else ("",)
    lefts = [f"d{left}_{leg}{side}" for leg in (1, 2, 3) for side in sides]
    return truth


def forearm_compliance(values: Values, cell: Cell) -> Truth:
    give = float(values["give"])
    return true(STRUCTURE, RODS, "force_j", "line", of_rods(lambda pull: give * pull))


def ball_joint_clearance(values: Values, cell: Cell) -> Truth:
    soft, size = float(values["softness"]), float(values["clearance"])
    law = of_rods(lambda pull: size * np.tanh(pull / soft))
    return true(STRUCTURE, RODS, "force_j", "saturation", law)


def tracker_drift(values: Values, cell: Cell) -> Truth:
    """Approximately a shift with one time course: the rotation is about a distant stand."""
    slow = float(values["constant"])
    settles = np.isfinite(slow)

    def share(seen: Mapping[str, Array]) -> Array:
        gone = -np.expm1(-seen["time"] / slow) if settles else seen["time"]
        return np.asarray(gone[:, None] * np.ones(3))

    form = "exponential" if settles else "line"
    stages, parts = f"{MEASUREMENT} {STRUCTURE}", f"{TRACKER} {BASE} {PLATFORM}"
    turning = true(MEASUREMENT, TRACKER, "time x y z", None, None)
    why = "a stand that moves and a base that moves are the same to who reads their difference"
    return true(stages, parts, "time", form, of_shift(share), why, (turning,))


TRUTHS: dict[str, Callable[[Values, Cell], Truth]] = {
    "backlash": backlash,
    "stick_slip": stick_slip,
    "joint_lag": joint_lag,
    "timestamp_latency": timestamp_latency,
    "encoder_eccentricity": encoder_eccentricity,
    "transmission_error": transmission_error,
    "joint_scale": joint_scale,
    "joint_zero_drift": joint_zero_drift,
    "joint_compliance": joint_compliance,
    "dynamic_deflection": dynamic_deflection,
    "thermal_growth_arm": _grows("arm", ARMS, "arm", ARM),
    "thermal_growth_base": _grows("hinge", f"{BASE} hinges", "base", RADIUS),
    "thermal_growth_forearm": _grows("rod", RODS, "forearm", ROD),
    "forearm_compliance": forearm_compliance,
    "ball_joint_clearance": ball_joint_clearance,
    "tracker_drift": tracker_drift,
}


def truth_of(trial: Trial) -> Truth | None:
    """Truth of a trial with one hidden cause; None for a clean one.

    Raises:
        ValueError: it hides several.
        KeyError: its cause is geometric; the study does not remove these.
    """
    if not trial.causes:
        return None
    if len(trial.causes) > 1:
        raise ValueError(f"{len(trial.causes)} causes are hidden; one is expected")
    cause = trial.causes[0]
    return cause.truth or TRUTHS[cause.name](cause.values, trial.cell)
