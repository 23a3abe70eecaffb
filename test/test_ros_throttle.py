"""Minimum time between repetitions of a message of a node."""

from __future__ import annotations

import pytest

pytest.importorskip("rclpy")
from delta_calibration.ros.throttle import Throttle


def test_what_is_said_at_the_rate_of_commands_is_let_through_once_in_a_while() -> None:
    throttle = Throttle(5.0)
    said = [k for k in range(12_000) if throttle.lets(100.0 + k * 1e-3)]
    assert said == [0, 5000, 10_000]


def test_each_has_its_own_time() -> None:
    one, other = Throttle(5.0), Throttle(5.0)
    assert one.lets(0.0)
    assert other.lets(1.0)
    assert not one.lets(4.9)
