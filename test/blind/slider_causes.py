"""Causes hidden in machines with sliders, in addition to those of any drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw, of_legs
from blind.drives import Drive, drives_of, either
from blind.measurement import timestamp_latency, tracker_drift, tracker_scale
from blind.shared import dimension, in_no_catalogue
from blind.sliders import LINEAR_DELTA, Sliders
from blind.world import State, World

Array = NDArray[np.float64]

_EXPANSION = 23e-6  # [1/K] aluminium
_PITCH = 60e-6
_STEEL = 11.5e-6  # [1/K]


def slider_pitch(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Screws with a pitch that is a little too long or too short."""
    pitch = strength * _PITCH * either(rng, legs)

    def act(world: World, state: State) -> None:
        state.joint += pitch * world.command

    return Cause("slider_pitch", act, of_legs("pitch", pitch))


def thermal_growth_arm(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Rods or struts lengthen as they warm."""
    expansion = strength * _EXPANSION

    def act(world: World, state: State) -> None:
        warm = world.warming.of("arm", world.time)
        longer = warm[:, None] * expansion * world.build.strut
        state.changed = state.changed.plus("strut", longer)

    return Cause("thermal_growth_arm", act, {"expansion": expansion})


def thermal_growth_screw(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Screws lengthen from a bearing above the carriages, as their nuts warm them."""
    warmer, constant = rng.uniform(6.0, 12.0), rng.uniform(1200.0, 2400.0)  # [K], [s]
    fixed, growth = rng.uniform(-0.1, 0.0), strength * _STEEL * warmer

    def act(world: World, state: State) -> None:
        longer = growth * -np.expm1(-world.time / constant)
        state.joint += longer[:, None] * (world.command - fixed)

    known = {"growth": growth, "constant": constant, "fixed": fixed}
    return Cause("thermal_growth_screw", act, known)


def slider_causes(kind: Sliders) -> tuple[dict[str, Draw], dict[str, Draw]]:
    """Causes that can be hidden in such a machine by name, and kinds that are in no catalogue."""
    geared = ("backlash", "stick_slip", "joint_lag", "transmission_error", "joint_zero_drift")
    m, typical = len(kind.joints), 1e-3 if kind is LINEAR_DELTA else 0.1e-3
    each = range(m)

    def wrong(name: str, part: str, axes: tuple[int, ...], of: range = each) -> Draw:
        where = {i + 1: [(part, (i, axis)) for axis in axes] for i in of}
        return dimension(name, "joint", typical, where)

    causes: dict[str, Draw] = {
        "timestamp_latency": timestamp_latency,
        "tracker_drift": tracker_drift,
        "tracker_scale": tracker_scale,
        "slider_pitch": slider_pitch,
        **drives_of(Drive(kind.size, kind.gears), *geared),
        "joint_zero_offset": wrong("joint_zero_offset", "foot", (2,)),
        "thermal_growth_arm": thermal_growth_arm,
        "thermal_growth_screw": thermal_growth_screw,
    }
    if kind is LINEAR_DELTA:
        arms = {i + 1: [("strut", (i,))] for i in each}
        causes["arm_length"] = dimension("arm_length", "joint", typical, arms)
    else:
        causes["base_joint_position"] = wrong("base_joint_position", "foot", (1,))
        causes["platform_joint_position"] = wrong("platform_joint_position", "joint", (1, 2))
    return causes, in_no_catalogue(kind)
