"""What a verdict's laws are worth: stage, part, variables and form against what was hidden."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from blind.unnamed import JOINTS, Law

Array = NDArray[np.float64]

_ALIKE = 0.95  # R^2 of the course from which the form is right
_SAMPLES = 400
# of causes of the catalogue whose effect is taken out
_DRIVE = ("drive",)
TAKEN_OUT: dict[str, Law] = {
    "backlash": Law(_DRIVE, JOINTS, ("direction",), lambda v, _: v["direction"]),
    "joint_lag": Law(_DRIVE, JOINTS, ("rate",), lambda v, _: v["rate"]),
    "joint_scale": Law(_DRIVE, JOINTS, ("q",), lambda v, _: v["q"]),
    "encoder_eccentricity": Law(_DRIVE, JOINTS, ("q",), None),
    "transmission_error": Law(_DRIVE, JOINTS, ("q",), None),
    "joint_compliance": Law(_DRIVE, JOINTS, ("torque",), lambda v, _: v["torque"]),
    "dynamic_deflection": Law(_DRIVE, JOINTS, ("torque",), lambda v, _: v["torque"]),
    "joint_zero_drift": Law(_DRIVE, JOINTS, ("time",), None),
    "stick_slip": Law(_DRIVE, JOINTS, ("direction", "rate"), None),
    "thermal_growth_arm": Law(
        ("structure",), ("arm",), ("temperature",), lambda v, _: v["temperature"]
    ),
    "thermal_growth_base": Law(
        ("structure",),
        ("base_radial", "platform_radial"),
        ("temperature",),
        lambda v, _: v["temperature"],
    ),
    "thermal_growth_forearm": Law(
        ("structure",), ("rod",), ("temperature",), lambda v, _: v["temperature"]
    ),
    "forearm_compliance": Law(("structure",), ("rod",), ("force",), lambda v, _: v["force"]),
    "tracker_drift": Law(("measurement", "structure"), ("tracker", "platform"), ("time",), None),
    "timestamp_latency": Law(_DRIVE, JOINTS, ("rate",), lambda v, _: v["rate"]),
}


def judged(
    laws: Sequence[Mapping[str, Any]], truth: Law | None, values: Mapping[str, Any]
) -> dict[str, bool | None]:
    """What of the likeliest law is right; `told` where there is one.

    Args:
        laws: as a verdict's JSON has them.
        truth: what was hidden; None for a clean machine.
        values: that it was drawn with.
    """
    if not laws:
        return {"told": False}
    if truth is None or not truth.variables:
        return {"told": True, "stage": False, "part": False, "variables": False, "form": False}
    first = laws[0]
    stage = first["stage"] in truth.stages
    part = any(first["part"].startswith(name) for name in truth.parts)
    variables = {_bare(name) for name in first["variables"]} == set(truth.variables)
    form = _form(first, truth, values) if truth.course is not None else None
    return {"told": True, "stage": stage, "part": part, "variables": variables, "form": form}


def _bare(name: str) -> str:
    """A variable without the number of a joint or the name of a part."""
    return "temperature" if name.startswith("temperature") else re.sub(r"_\w+$", "", name)


def _form(law: Mapping[str, Any], truth: Law, values: Mapping[str, Any]) -> bool:
    """Whether the equation has the true course over the region that it was seen in."""
    rng = np.random.default_rng(0)
    named = {name: rng.uniform(*span, _SAMPLES) for name, span in law["region"].items()}
    if "direction" in truth.variables:
        named |= {n: np.sign(v) for n, v in named.items() if n.startswith("direction")}
    bare = {_bare(name): v for name, v in named.items()}
    if set(bare) != set(truth.variables) or truth.course is None:
        return False
    course = truth.course(bare, values)
    rights = [evaluated(text, law["values"], named) for text in law["equation"].split(";")]
    right = max(rights, key=np.ptp)
    if np.ptp(right) == 0.0 or np.ptp(course) == 0.0:
        return False
    return bool(np.corrcoef(right, course)[0, 1] ** 2 > _ALIKE)


def evaluated(text: str, values: Mapping[str, Any], named: Mapping[str, Array]) -> Array:
    """The right side of an equation, by Python's own arithmetic."""
    functions = {"sin": np.sin, "cos": np.cos, "tanh": np.tanh, "exp": np.exp, "sign": np.sign}
    functions |= {"max": np.maximum, "min": np.minimum, "abs": np.abs}
    letters = {name: value["value"] for name, value in values.items()}
    code = text.split("=")[1].strip().replace("^", "**")
    names = {"__builtins__": {}, **functions, **letters, **named}
    return np.broadcast_to(np.asarray(eval(code, names), dtype=float), (_SAMPLES,))
