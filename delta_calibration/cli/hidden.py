"""Table of the causes that a demonstration hid in its machine, with the values found."""

from __future__ import annotations

from pathlib import Path

from delta_calibration.cli.options import table
from delta_calibration.documents import load_schema, read_document
from delta_calibration.simulation import TrueMachine
from delta_calibration.wording import NO_VALUE, figures, spoken, unit_in

_SURE = 1.96  # standard errors either side of a 95 % interval
_SHOWN = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}


def hidden_and_found(machine: TrueMachine, extended: Path) -> str:
    """Table with a line per hidden value: true value, found value and its 95 % interval.

    Args:
        machine: simulated machine with the true values.
        extended: file of the calibration that was extended by the effects found.
    """
    data = read_document(extended, lambda _: load_schema("calibration"))
    found = {
        (effect["cause"], p["name"]): (float(p["value"]), float(p["std"]))
        for effect in data.get("effects", [])
        for p in effect["parameters"]
    }
    rows = []
    for effect, values in zip(
        machine.chain.effects, machine.chain.effect_values(machine.theta), strict=True
    ):
        for parameter, value in zip(effect.parameters, values.tolist(), strict=True):
            if value != parameter.nominal:
                told = found.get((effect.cause, parameter.name))
                name = f"{spoken(effect.cause)}, {spoken(parameter.name)}"
                rows.append(_row(name, effect.told_unit(parameter), value, told))
    return table(("hidden", "unit", "true", "found", "95 % interval"), rows)


def _row(name: str, own: str, true: float, found: tuple[float, float] | None) -> tuple[str, ...]:
    factor, unit = unit_in(_SHOWN, own)
    if found is None:
        return name, unit, figures(factor * true, 4), NO_VALUE, NO_VALUE
    value, half = factor * found[0], factor * _SURE * found[1]
    ends = f"{figures(value - half, 4)} to {figures(value + half, 4)}"
    return name, unit, figures(factor * true, 4), figures(value, 4), ends
