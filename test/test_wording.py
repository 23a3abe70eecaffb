"""Numbers formatted for readers."""

from __future__ import annotations

import pytest

from delta_calibration.data.readings import Rejected
from delta_calibration.wording import measured, plain, set_aside


@pytest.mark.parametrize(
    ("value", "std", "unit", "told"),
    [
        (2.708e-4, 1.2e-6, "rad", "270.8 +- 1.2 urad"),
        (-0.01234, 4e-5, "rad", "-12.340 +- 0.040 mrad"),
        (0.0175, 9e-5, "m", "17.500 +- 0.090 mm"),
        (2.4e-4, 1e-6, "rad/kg", "240.0 +- 1.0 urad/kg"),
        (2.31e-5, 4.1e-7, "1/K", "2.310e-05 +- 4.1e-07 1/K"),
        (-5.625e-4, 2.9e-4, "1", "-0.00056 +- 0.00029"),
        (0.5, None, "1", "0.5000"),
        (33.0, 0.0, "s", "33.00 s"),
        (-8.1e-9, 1.9e-6, "rad", "0.0 +- 1.9 urad"),
    ],
)
def test_a_value_is_told_to_the_figures_that_hold(value, std, unit, told) -> None:
    assert plain(measured(value, std, unit)) == told


def test_readings_set_aside_are_told_with_the_reason_in_words() -> None:
    counts = {"repeated": 0, "outlier": 6, "on_the_way": 229}
    said = "6 far from the others of the same stop and 229 on the way of a motion"
    assert set_aside(counts) == said
    assert set_aside({"frozen": 0}) == ""


def test_every_reason_for_setting_readings_aside_has_words() -> None:
    for reason in (*Rejected().counts(), "on_the_way", "unlike_the_model"):
        assert set_aside({reason: 1}) != f"1 {reason}"
