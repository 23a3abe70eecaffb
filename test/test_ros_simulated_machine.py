"""Effects in the live machine, compared with the machine without effects at other joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.errors import ReachError
from delta_calibration.robot import Robot, load_robot
from delta_calibration.ros.simulated_machine import SimulatedMachine, without_noise
from delta_calibration.simulation import Climate, draw_machine, effect_options

ROBOT = load_robot("srbd")
A, B = np.array([[0.1, 0.2, 0.3], [0.4, 0.1, -0.1]])


def with_effects(*texts: str, robot: Robot | None = None) -> SimulatedMachine:
    """A nominal machine with these effects, without noise."""
    quiet = robot or without_noise(ROBOT)
    drawn = draw_machine(quiet, 3, 0.0, [effect_options(text) for text in texts])
    return SimulatedMachine(drawn, np.random.default_rng(5), 0.0, Climate(drawn.warms, 600.0))


def at(simulated: SimulatedMachine, joint: np.ndarray, now: float) -> np.ndarray:
    simulated.command(joint, now)
    return simulated.measure(now).position


def seen_at(joint: np.ndarray) -> np.ndarray:
    """Reading of the machine without effects, which does not depend on the path."""
    return at(with_effects(), joint, 1.0)


def drive(
    simulated: SimulatedMachine, way: list[np.ndarray], begin: float, step: float = 0.02
) -> float:
    """Send commands one after another; return the time of the last."""
    for k, joint in enumerate(way):
        simulated.command(joint, begin + k * step)
    return begin + (len(way) - 1) * step


def test_play_is_half_the_gap_behind_the_way_it_came() -> None:
    gap = 1e-3
    simulated = with_effects(f"backlash:value={gap}")
    now = 0.0
    for side in (1.0, -1.0, 1.0):
        way = [A - side * share * np.full(3, 0.02) for share in (1.0, 0.6, 0.3, 0.0)]
        now = drive(simulated, way, now + 1.0)
        behind = seen_at(A - side * gap / 2)
        np.testing.assert_allclose(simulated.measure(now).position, behind, atol=1e-9)
        # it stays there without further commands
        np.testing.assert_allclose(simulated.measure(now + 9.0).position, behind, atol=1e-9)


@pytest.mark.parametrize("effect", ["joint_lag", "timestamp_latency"])
def test_in_motion_it_is_seen_where_it_was_a_moment_before(effect: str) -> None:
    moment, step = 0.004, 0.02
    simulated = with_effects(f"{effect}:value={moment}")
    speed = np.array([0.3, -0.2, 0.1])
    way = [A + speed * step * k for k in range(20)]
    now = drive(simulated, way, 1.0, step)
    position = simulated.measure(now).position
    assert np.linalg.norm(position - seen_at(way[-1])) > 2e-4
    np.testing.assert_allclose(position, seen_at(way[-1] - moment * speed), atol=3e-6)
    simulated.command(way[-1], now + step)  # it stands still
    np.testing.assert_allclose(simulated.measure(now + step).position, seen_at(way[-1]), atol=1e-9)


def test_speeds_are_those_of_the_senders_clock() -> None:
    """Late commands that arrive in a burst do not move faster."""
    simulated = with_effects("joint_lag:value=0.01")
    speed = np.array([0.3, -0.2, 0.1])
    for k in range(10):
        simulated.command(A + speed * 0.02 * k, 5.0 + 0.001 * k, stamp=70.0 + 0.02 * k)
    want = seen_at(A + speed * 0.18 - 0.01 * speed)
    np.testing.assert_allclose(simulated.measure(5.01).position, want, atol=1e-8)


def test_a_payload_bends_the_drives() -> None:
    simulated = with_effects("joint_compliance:value=4e-5")
    empty = at(simulated, A, 1.0)
    np.testing.assert_array_equal(simulated.measure(1.5).position, empty)
    simulated.carry(2.0, np.array([0.0, 0.0, -0.03]))
    sag = np.linalg.norm(simulated.measure(2.0).position - empty)
    assert 2e-5 < sag < 3e-4
    simulated.carry(0.0, np.zeros(3))
    np.testing.assert_array_equal(simulated.measure(2.5).position, empty)


def test_it_grows_as_warm_as_it_says() -> None:
    simulated = with_effects("thermal_growth_arm:value=2e-5")
    cold = at(simulated, A, 0.0)
    assert simulated.temperatures(0.0) == {"arm": 20.0, "base": 20.0}
    said = simulated.temperatures(600.0)
    assert said["arm"] == pytest.approx(20 + 13 * (1 - np.exp(-1.0)))
    longer = replace(ROBOT.dimensions, arm=0.32 * (1 + 2e-5 * (said["arm"] - 20.0)))
    drawn = with_effects(robot=without_noise(replace(ROBOT, dimensions=longer)))
    warm = simulated.measure(600.0).position
    assert np.linalg.norm(warm - cold) > 1e-5
    np.testing.assert_allclose(warm, at(drawn, A, 1.0), atol=1e-12)
    assert with_effects("backlash").temperatures(1e4) == {"arm": 20.0, "base": 20.0}


def test_what_it_does_not_follow_has_not_moved_it() -> None:
    """A command out of reach does not affect the backlash."""
    short = replace(ROBOT.dimensions, rod=0.5)
    wide = replace(ROBOT.joints, lower=np.full(3, -4.0), upper=np.full(3, 4.0))
    robot = without_noise(replace(ROBOT, dimensions=short, joints=wide))
    simulated = with_effects("backlash:value=1e-3", robot=robot)
    drive(simulated, [B, A + 0.1, A], 1.0)
    before = simulated.measure(1.1).position
    simulated.command(np.array([-1.6, -2.4, -0.4]), 2.0)
    with pytest.raises(ReachError):
        simulated.measure(2.0)
    np.testing.assert_allclose(simulated.measure(2.1).position, before, atol=1e-15)
