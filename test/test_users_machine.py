"""Causes hidden in a machine whose mechanism a user wrote, simulated without the package."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.data import Paths, Survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import effect_named
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.robot import load_robot
from hexapod import LEGS, Hexapod, Machine, write_robot

GIVE, GROWTH, LONGER = 0.8e-6, 23e-6, 4e-3  # [m/N], [1/K], [m]


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    path = tmp_path_factory.mktemp("robot") / "hexapod.yaml"
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(MECHANISMS._own, Hexapod.name, Hexapod)
        write_robot(path)
        yield load_robot(path)


def verdict(robot, machine, rng, **plan):
    poses = machine.measured(rng, **plan)
    nothing = poses.conditions.take(np.arange(0))
    none = np.zeros(0, dtype=np.int64)
    return diagnose(Survey(poses, Paths(nothing, none, none)), robot).verdict


def values(finding):
    every = finding.parameters.values()
    return np.array([p.value for p in every]), np.array([p.std for p in every])


def test_legs_that_give_way_are_named(robot):
    """Balance of forces at the machine; the package has the gradient of the masses' energy."""
    rng = np.random.default_rng(1)
    said = verdict(robot, Machine(rng, give=GIVE), rng, payloads=(0.0, 15.0))
    (found,) = said.findings
    assert (found.cause, found.location) == ("joint_compliance", None)
    assert found.confidence > 0.9
    assert not said.unknown_structure.found
    value, std = values(found)
    assert np.all(np.abs(value - GIVE) < 3 * std)
    assert np.all(std < 0.15 * GIVE)
    assert {p.unit for p in found.parameters.values()} == {"m/N"}


def test_a_base_that_grows_is_named(robot):
    """Not legs that shrink, which moves the platform nearly alike."""
    rng = np.random.default_rng(2)
    said = verdict(robot, Machine(rng, growth=GROWTH), rng, places=80)
    (found,) = said.findings
    assert found.cause == "thermal_growth_base"
    (value,), (std,) = values(found)
    assert abs(value - 12 * GROWTH) < 3 * std  # 12 K in the end
    assert std < 6 * GROWTH
    assert found.confidence > 0.9
    assert not said.unknown_structure.found


@pytest.mark.parametrize("seed", [3, 4])
def test_a_leg_far_off_its_drawing_has_its_length(robot, seed):
    """The tolerance, a thirteenth of what it is off, must not pull the value to the drawing."""
    rng = np.random.default_rng(seed)
    machine = Machine(rng, longer=np.where(np.arange(LEGS) == 2, LONGER, 0.0))
    said = verdict(robot, machine, rng, places=80)
    (found,) = said.findings
    assert (found.cause, found.location) == ("arm_length", "joint_3")
    (value,), (std,) = values(found)
    nominal = robot.model().parameters.nominal[20]
    assert abs(value - (machine.leg[2] - nominal)) < 2.5 * std
    assert std < 0.2e-3


def test_loads_of_sliding_joints_are_forces(robot):
    """1 rad of a Delta's joint is 0.3 m here: 1 rad/(N m) is 0.09 m/N, and 1 N m 3.3 N."""
    delta = load_robot("srbd")
    for cause in ("joint_compliance", "dynamic_deflection"):
        ours, theirs = (effect_named(cause, r, r.model(), {}) for r in (robot, delta))
        first = theirs.parameters.items[0]
        for item in ours.parameters:
            assert item.prior == pytest.approx(0.09 * first.prior)
            assert item.upper == pytest.approx(0.09 * first.upper)
            assert item.unit == "m/N"
    play = effect_named("backlash", robot, robot.model(), {})
    assert play.unit_of("N m") == "N"


def test_nothing_is_named_where_nothing_is_wrong(robot):
    rng = np.random.default_rng(5)
    said = verdict(robot, Machine(rng), rng, payloads=(0.0, 15.0))
    assert not said.findings
    assert not said.unknown_structure.found
