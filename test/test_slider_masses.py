"""Loads on sliding drives by masses, against the balance of forces, and springs found by them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.cli.main import run
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.effects.signals import GRAVITY, nominal
from delta_calibration.errors import InputError
from delta_calibration.mechanisms.five_axis import FiveAxisMasses, by_strut
from delta_calibration.mechanisms.linear_delta import LinearDeltaMasses
from delta_calibration.model.chain_constants import OF_WEIGHT
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

FREE_FALL = 9.80665
PRINTER = replace(load_robot("linear_delta"), masses=LinearDeltaMasses(0.6, 0.35, 0.05))
MACHINE = replace(load_robot("five_axis"), masses=FiveAxisMasses(60.0, 25.0, 8.0))


def loads(robot, pose, payload):
    """Loads of weight on the drives (n, m) [N] by the package, and their readings."""
    model = robot.model()
    joint = model.inverse(pose, model.parameters.nominal)
    at = replace(
        at_rest(joint),
        payload=np.full(len(joint), payload),
        payload_centre=np.zeros((len(joint), 3)),
    )
    return nominal(robot, model, at, OF_WEIGHT).of(GRAVITY), joint


def test_carriages_bear_what_the_rods_pass_on():
    """Three forces along the rods hold the platform, its payload and half of each rod."""
    d, m, payload = PRINTER.dimensions, PRINTER.masses, 0.4
    pose = np.array([[0.0, 0.0, 0.1], [0.05, -0.03, 0.15], [-0.06, 0.02, 0.05]])
    found, joint = loads(PRINTER, pose, payload)
    out = np.stack([np.cos(d.angles), np.sin(d.angles), 0 * d.angles], axis=1)
    top = d.height + np.sqrt(d.arm**2 - d.radius**2)
    for x, q, load in zip(pose, joint, found, strict=True):
        carriage = d.radius * out + (top - q)[:, None] * [0, 0, 1]
        upward = (carriage - x) / d.arm
        held = FREE_FALL * (m.platform + payload + 3 * m.rod)
        pull = np.linalg.solve(upward.T, [0.0, 0.0, held])
        bears = FREE_FALL * (m.carriage + m.rod) + pull * upward[:, 2]
        np.testing.assert_allclose(load, -bears, rtol=1e-9)  # weight pulls the carriages down


def test_sliders_bear_what_the_struts_pass_on():
    """Four forces along the struts balance weight in y, z and the moments of the two hinges."""
    m, model, payload = MACHINE.masses, MACHINE.model(), 5.0
    ends, length = by_strut(model.parameters.nominal)
    low = MACHINE.dimensions.height
    pose = np.array(
        [[0.0, low, 0.0, 0.0], [0.05, low - 0.04, 0.15, -0.1], [-0.04, low, -0.1, 0.2]]
    )
    found, joint = loads(MACHINE, pose, payload)
    step = 1e-6

    def joints_of(x):
        """Platform joints of the struts in the base, by scipy's rotations."""
        about = [Rotation.from_euler("XY", [x[2], turn * x[3]]) for turn in (1, 1, 0, 0)]
        own = np.array([r.apply(t) for r, t in zip(about, ends[:, :3], strict=True)])
        return own + np.array([0.0, x[0], x[1]])

    for x, q, load in zip(pose, joint, found, strict=True):
        at = joints_of(x)
        slider = ends[:, 3:6] + q[:, None] * [0, 0, 1]
        along = (at - slider) / length[:, None]
        moves = [(joints_of(x + s) - joints_of(x - s)) / (2 * step) for s in step * np.eye(4)]
        pushed = np.array([np.sum(move * along, axis=1) for move in moves])
        # work of half of each strut at its platform joint, and of platform and payload
        weight = FREE_FALL * np.array([m.strut / 2 * move[:, 2].sum() for move in moves])
        weight += FREE_FALL * np.array([0.0, m.platform + payload, 0.0, 0.0])
        push = np.linalg.solve(pushed, weight)
        bears = FREE_FALL * (m.slider + m.strut / 2) + push * along[:, 2]
        np.testing.assert_allclose(load, bears, rtol=1e-6)


@pytest.mark.parametrize(("robot", "metres_a_newton"), [(PRINTER, "1e-5"), (MACHINE, "1e-7")])
def test_drives_that_give_way_are_named(robot, metres_a_newton):
    hidden = {"joint_compliance": {"value": metres_a_newton}}
    machine, plan = draw_machine(robot, 3, hidden=hidden), make_plan("rich", robot, count=30)
    session = simulate_session(machine, plan, 3)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    found = diagnose(seen, robot).verdict
    (said,) = found.findings
    assert said.cause == "joint_compliance"
    for estimate in said.parameters.values():
        assert abs(estimate.value - float(metres_a_newton)) < 3.5 * estimate.std
    assert not found.unknown_structure.found


@pytest.mark.parametrize("robot", [PRINTER, MACHINE], ids=lambda r: r.name)
def test_without_masses_loads_are_not_known(robot):
    unweighed = replace(robot, masses=None)
    at = at_rest(np.tile(robot.model().home, (3, 1)))
    lacking = {e.cause: e.missing(at) for e in catalogue(unweighed, unweighed.model())}
    for cause in ("joint_compliance", "dynamic_deflection", "base_compliance"):
        assert lacking[cause] == "the robot file states no masses"
    with pytest.raises(InputError, match="joint_compliance: the robot file"):
        draw_machine(unweighed, 3, hidden={"joint_compliance": {}})


def test_a_plan_for_a_cause_that_needs_masses_asks_for_them(tmp_path, capsys):
    asked = ["--separate", "joint_compliance", "backlash", "--out", str(tmp_path / "plan.csv")]
    assert run(["plan", "--robot", "linear_delta", *asked]) == 2
    assert "cause 'joint_compliance': the robot file states no masses" in capsys.readouterr().err


def test_the_last_fit_finds_the_searched_fields_again():
    """Feet that a search left at half their depth; with the reflector's offset not known."""
    hidden = {"base_compliance": {"value": "4e-6", "depth": "1.2"}}
    machine, plan = draw_machine(PRINTER, 3, hidden=hidden), make_plan("rich", PRINTER, count=30)
    session = simulate_session(machine, plan, 3)
    seen = survey(session, PRINTER.joints.names, PRINTER.commanded.joint_size)
    robot = replace(PRINTER, tracker=replace(PRINTER.tracker, reflector_offset_prior=0.1))
    found = diagnose(seen, robot)
    (term,) = found.model.terms
    shallow = replace(term, effect=replace(term.effect, depth=term.effect.depth / 2))
    again = replace(found.model, terms=(shallow,), seen=None).rested()
    told = found.verdict.findings[0].shape["depth_m"]
    assert abs(told.value - 1.2) < 3.5 * told.std
    assert abs(again.terms[0].effect.depth - told.value) < told.std
