"""Bounds of what a user can state about a machine's surroundings, on a command line or in code."""

from __future__ import annotations

from delta_calibration.errors import InputError

PAYLOAD = 0.0, 100_000.0  # [kg]
CELSIUS = -273.15, 10_000.0  # [deg C], from absolute zero on


def require_within(name: str, value: float, bounds: tuple[float, float], unit: str) -> None:
    """Refuse a number that is not finite or not within its bounds.

    Raises:
        InputError: names the quantity, its value and what is allowed.
    """
    low, high = bounds
    if not low <= value <= high:
        raise InputError(f"{name}: {value:g} {unit} is not allowed; {low:g} to {high:g}")
