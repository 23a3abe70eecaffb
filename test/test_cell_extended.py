"""Tests of a desk with an extended calibration: effects of motion, payload and temperature."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.command_path import HOLD, PASS_THROUGH
from delta_calibration.cell.health import Level
from delta_calibration.compensation import CommandStatus
from delta_calibration.data import Poses, collect
from delta_calibration.estimation import Identification, identify
from delta_calibration.plans import make_plan, nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from extended_bench import Effects, with_effects

ROBOT = load_robot("srbd")
GAP, LAG = 4e-4, 5e-3
Q = nominal_joints(ROBOT, np.array([[0.05, -0.02, -0.75]]))[0]
AWAY = np.full(3, 0.02)
PERIOD_NS = 10_000_000


@pytest.fixture(scope="module", name="fitted")
def fitted_fixture() -> tuple[Identification, Poses]:
    plan = make_plan("identify", ROBOT, count=15, dwell=0.4, both_sides=False)
    session = simulate_session(draw_machine(ROBOT, 5), plan, 5)
    poses = collect(session, ROBOT.joints.names)
    return identify(poses, ROBOT, "rotary_delta"), poses


class Bench:
    """A compensating desk with effects in its calibration, and the clock of its commands."""

    def __init__(
        self, fitted: tuple[Identification, Poses], folder: Path, effects: Effects, **settings: Any
    ) -> None:
        path = folder / "extended.yaml"
        save_calibration(path, with_effects(fitted[0], ROBOT, effects), ROBOT, fitted[1])
        self.path = path
        self.desk = CalibrationSession(
            Settings("srbd", calibration=str(path), ramp_s=0.0, **settings)
        )
        self.desk.enable(True)
        self.tick = 0

    def give(self, q: np.ndarray) -> np.ndarray:
        """Output for a command, at 100 Hz, minus the command."""
        self.tick += 1
        sent = self.desk.send(q, self.tick * PERIOD_NS, self.tick * 0.01, False)
        self.desk.keep(q, self.tick * PERIOD_NS, False)
        assert sent is not None
        return np.asarray(sent.joint - q)

    def come(self, begin: np.ndarray) -> np.ndarray:
        """The correction at Q after a move from `begin` and a rest."""
        for share in np.linspace(0.0, 1.0, 20):
            self.give(begin + share * (Q - begin))
        return [self.give(Q) for _ in range(30)][-1]


def test_a_play_is_corrected_by_the_way_the_joints_came(fitted: Any, tmp_path: Path) -> None:
    bench = Bench(fitted, tmp_path, {"backlash": ({}, GAP)})
    unknown = bench.give(Q)
    up, down = bench.come(Q - AWAY), bench.come(Q + AWAY)
    np.testing.assert_allclose(up - down, GAP, atol=1e-8)
    np.testing.assert_allclose(unknown, (up + down) / 2, atol=1e-8)
    mixed = bench.come(Q + AWAY * [1, -1, 1])
    np.testing.assert_allclose(mixed, np.where([1, 0, 1], down, up), atol=1e-8)
    bench.desk.reset()
    bench.desk.enable(True)
    np.testing.assert_allclose(bench.give(Q), unknown, atol=1e-8)


def test_the_way_is_known_from_before_it_is_switched_on(fitted: Any, tmp_path: Path) -> None:
    bench = Bench(fitted, tmp_path, {"backlash": ({}, GAP)})
    up = bench.come(Q - AWAY)
    bench.desk.enable(False)
    np.testing.assert_allclose(bench.come(Q + AWAY), 0.0, atol=1e-15)
    bench.desk.enable(True)
    np.testing.assert_allclose(up - bench.give(Q), GAP, atol=1e-8)


def test_the_way_is_known_from_before_there_is_a_calibration(fitted: Any, tmp_path: Path) -> None:
    bench = Bench(fitted, tmp_path, {"backlash": ({}, GAP)})
    up = bench.come(Q - AWAY)
    bench.desk = CalibrationSession(Settings("srbd", ramp_s=0.0))
    np.testing.assert_array_equal(bench.come(Q - AWAY), 0.0)
    bench.desk.reload(str(bench.path))
    bench.desk.enable(True)
    np.testing.assert_allclose(bench.give(Q), up, atol=1e-8)


def test_a_lag_is_corrected_by_the_speed_of_the_commands(fitted: Any, tmp_path: Path) -> None:
    bench = Bench(fitted, tmp_path, {"joint_lag": ({}, LAG)})
    speed = np.array([0.5, -0.2, 0.1])
    moving = [bench.give(Q + speed * 0.01 * (k - 20)) for k in range(21)][-1]
    standing = [bench.give(Q) for _ in range(30)][-1]
    np.testing.assert_allclose(moving - standing, LAG * speed, atol=1e-8)


@pytest.mark.parametrize("on_failure", [PASS_THROUGH, HOLD])
def test_a_load_is_corrected_once_the_payload_is_known(
    fitted: Any, tmp_path: Path, on_failure: str
) -> None:
    bench = Bench(
        fitted,
        tmp_path,
        {"joint_compliance": ({}, 4e-5)},
        on_failure=on_failure,
        payload_timeout_s=1.0,
    )
    if on_failure == HOLD:
        assert bench.desk.send(Q, 1, 0.0, False) is None
    else:
        np.testing.assert_array_equal(bench.give(Q), 0.0)
    said = f"{CommandStatus.MISSING_CONDITION.value}: the payload is not known"
    assert bench.desk.path.trouble == said
    corrections = []
    for mass in (0.0, 3.0):
        bench.desk.carries(0, mass, np.zeros(3), bench.tick * 0.01)
        corrections.append(bench.give(Q))
        assert bench.desk.path.trouble is None
    assert (corrections[1] < corrections[0] - 1e-5).all()  # a smaller angle is a higher arm
    bench.tick += 200
    if on_failure == PASS_THROUGH:
        np.testing.assert_array_equal(bench.give(Q), 0.0)
    else:  # the last valid one
        np.testing.assert_allclose(bench.give(Q + 0.01) + 0.01, corrections[1], atol=1e-9)
    assert bench.desk.path.trouble == said


def test_growth_is_corrected_by_a_sensor_that_is_heard(fitted: Any, tmp_path: Path) -> None:
    effects: Effects = {"thermal_growth_arm": ({"sensor": "arm"}, 23e-6)}
    bench = Bench(fitted, tmp_path, effects, temperature_timeout_s=5.0)
    bench.desk.is_warm("base", 0, 30.0, 0.0)
    np.testing.assert_array_equal(bench.give(Q), 0.0)
    assert bench.desk.path.trouble is not None
    assert bench.desk.path.trouble.endswith("the temperature of part 'arm' is not known")
    corrections = []
    for celsius in (20.0, 40.0):
        bench.desk.is_warm("arm", 0, celsius, bench.tick * 0.01)
        corrections.append(bench.give(Q))
        assert bench.desk.path.trouble is None
    assert np.abs(corrections[1] - corrections[0]).max() > 1e-5
    bench.tick += 600
    np.testing.assert_array_equal(bench.give(Q), 0.0)


def test_a_cycle_by_a_sessions_clock_is_said_to_be_left_out(fitted: Any, tmp_path: Path) -> None:
    cycle: dict[str, object] = {"period": 900.0}
    effects: Effects = {"backlash": ({}, GAP), "joint_zero_drift": (cycle, 1e-4)}
    desk = Bench(fitted, tmp_path, effects).desk
    values = desk.health(0.0, 1.0).values
    assert values["effects compensated"] == "backlash"
    left = "joint_zero_drift: found in the session but not compensated"
    assert str(values["effects left out"]).startswith(left)
    assert left in desk.reload(str(tmp_path / "extended.yaml"))
    assert values["effects by the clock"] == ""
    plain = Bench(fitted, tmp_path, {}).desk
    assert plain.left_out == ""
    assert plain.health(0.0, 1.0).values["effects compensated"] == ""
    assert plain.health(0.0, 1.0).level is Level.OK


def test_a_slip_by_a_sessions_clock_is_corrected_as_at_its_end(
    fitted: Any, tmp_path: Path
) -> None:
    slip: dict[str, object] = {"step_at": 1.0}
    bench = Bench(fitted, tmp_path, {"joint_zero_drift": (slip, 1e-3)})
    values = bench.desk.health(0.0, 1.0).values
    assert (values["effects compensated"], values["effects left out"]) == ("joint_zero_drift", "")
    told = "joint_zero_drift: compensated as at the end of the session"
    assert str(values["effects by the clock"]).startswith(told)
    plain = Bench(fitted, tmp_path, {})
    np.testing.assert_allclose(bench.give(Q) - plain.give(Q), -1e-3, atol=1e-5)
