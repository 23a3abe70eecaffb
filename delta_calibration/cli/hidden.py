"""Table of the causes that a demonstration hid in its machine, with the values found."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.options import table
from delta_calibration.documents import load_schema, read_document
from delta_calibration.effects import Effect
from delta_calibration.simulation import TrueMachine
from delta_calibration.wording import NO_VALUE, figures, listed, spoken, unit_in

_SURE = 1.96  # standard errors either side of a 95 % interval
_SHOWN = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}


def hidden_and_found(machine: TrueMachine, extended: Path) -> str:
    """Table with a line per hidden value: true value, found value and its 95 % interval.

    Causes are compared by their names. A value is given only if the effect found follows the same
    course as the hidden one; the values of a ramp and of a settling are not of one kind. A line
    below the table says where the courses differ.

    Args:
        machine: simulated machine with the true values.
        extended: file of the calibration that was extended by the effects found.
    """
    data = read_document(extended, lambda _: load_schema("calibration"))
    effects = load_calibration(extended, machine.robot).chain.effects
    each = [
        (effect, {p["name"]: (float(p["value"]), float(p["std"])) for p in entry["parameters"]})
        for effect, entry in zip(effects, data.get("effects", []), strict=True)
    ]
    rows, differ = [], []
    for effect, values in zip(
        machine.chain.effects, machine.chain.effect_values(machine.theta), strict=True
    ):
        alike = [(other, told) for other, told in each if _kind(other) == _kind(effect)]
        _, found = min(alike, key=lambda one: _differ(effect, one[0]), default=(effect, {}))
        for parameter, value in zip(effect.parameters, values.tolist(), strict=True):
            if value != parameter.nominal:
                told = found.get(parameter.name)
                name = f"{spoken(effect.cause)}, {spoken(parameter.name)}"
                rows.append(_row(name, effect.told_unit(parameter), value, told))
        differ += _courses(effect, effects)
    head = ("hidden", "unit", "true", "found", "95 % interval")
    return "\n".join([table(head, rows), *differ])


def _kind(effect: Effect) -> tuple[str, str]:
    """Cause and course: effects that agree in both have values with the same meaning."""
    return effect.cause, effect.follows


def _differ(one: Effect, other: Effect) -> float:
    """How much the settings of two effects of one kind differ, relative to their sizes."""
    each = ((value, other.settings.get(name)) for name, value in one.settings.items())
    numbers = [(a, b) for a, b in each if isinstance(a, float) and isinstance(b, float)]
    return sum(abs(a - b) / max(abs(a), abs(b), 1e-12) for a, b in numbers)


def _courses(hidden: Effect, found: Sequence[Effect]) -> list[str]:
    """Line that says how the courses of one cause differ; none if they do not."""
    others = list(dict.fromkeys(e.follows for e in found if e.cause == hidden.cause))
    if not others or hidden.follows in others or not all((hidden.follows, *others)):
        return []
    return [
        f"{spoken(hidden.cause)}: the cause is the same; it is hidden as {hidden.follows} and "
        f"found as {listed(others)}, so that its values cannot be compared"
    ]


def _row(name: str, own: str, true: float, found: tuple[float, float] | None) -> tuple[str, ...]:
    factor, unit = unit_in(_SHOWN, own)
    if found is None:
        return name, unit, figures(factor * true, 4), NO_VALUE, NO_VALUE
    value, half = factor * found[0], factor * _SURE * found[1]
    ends = f"{figures(value - half, 4)} to {figures(value + half, 4)}"
    return name, unit, figures(factor * true, 4), figures(value, 4), ends
