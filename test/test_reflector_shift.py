"""A reflector, or the tool that carries it, that is knocked in the middle of a session."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.estimation import chain_of
from delta_calibration.geometry import Frame
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

SCARA = load_robot("scara")
SHIFT = np.array([0.21e-3, -0.16e-3, 0.0])  # [m] in the platform


def knocked():
    """A fault-free SCARA; from 45 % of the session on, the reflector sits elsewhere.

    The platform of a SCARA is turned about z by the sum of its two joint angles.
    """
    machine = draw_machine(SCARA, 12)
    session = simulate_session(machine, make_plan("identify", SCARA, count=50, seed=12), 12)
    tracker, states = session.tracker, session.states
    begin, end = tracker.stamp_ns[0], tracker.stamp_ns[-1]
    at = begin + int(0.45 * (end - begin))
    angle = sum(np.interp(tracker.stamp_ns, states.stamp_ns, q) for q in states.position.T)
    frame = machine.chain.split(machine.theta)[2].rotation
    moved = Rotation.from_rotvec(np.outer(angle, [0.0, 0.0, 1.0])).apply(SHIFT) @ frame.T
    later = (tracker.stamp_ns > at)[:, None]
    tracker = replace(tracker, position=tracker.position + np.where(later, moved, 0.0))
    return replace(session, tracker=tracker), (at - begin) * 1e-9


def test_a_knock_is_found_with_its_time_and_its_way():
    """It had been the law of a tool that moves in proportion to time."""
    session, at = knocked()
    found = diagnose(survey(session, SCARA.joints.names, SCARA.commanded.joint_size), SCARA)
    (cause,) = found.verdict.findings
    assert cause.cause == "reflector_shift"
    assert cause.confidence > 0.95
    assert not found.verdict.unknown_structure.found
    assert cause.shape["step_at_s"].value == pytest.approx(at, abs=60.0)
    for axis, true in zip("xyz", SHIFT, strict=True):
        told = cause.parameters[f"shift_{axis}"]
        assert abs(told.value - true) < 4 * told.std
        assert told.std < 0.1 * np.linalg.norm(SHIFT)


@pytest.mark.parametrize("name", ["scara", "ur10", "five_axis", "cdpr8"])
def test_before_and_after_it_is_a_machine_with_two_reflectors(name):
    robot = load_robot(name)
    chain = chain_of(robot)
    model, rng = chain.mechanism, np.random.default_rng(2)
    effect = effect_named("reflector_shift", robot, model, {"step_at": 50.0})
    x = model.home + 0.02 * model.joint_size * rng.uniform(-1, 1, (6, model.joints))
    at = replace(at_rest(x), time=np.array([0.0, 20.0, 49.0, 50.0, 60.0, 900.0]))
    offset = np.array([0.05, -0.02, 0.08])
    frame = Frame.from_vector(np.array([0.3, -0.2, 1.9, -2.0, 1.0, 0.5]))
    two = [
        chain.predict(at, chain.join(model.parameters.nominal, o, frame))
        for o in (offset, offset + SHIFT)
    ]
    expected = np.where(at.time[:, None] < 50.0, *two)
    knocked = chain.with_effects((effect,))
    theta = knocked.join(model.parameters.nominal, offset, frame)
    theta[knocked.layout.effects] = SHIFT
    np.testing.assert_allclose(knocked.predict(at, theta), expected, atol=1e-10)

    step, jacobian = 1e-4 * np.eye(len(theta)), knocked.jacobian(at, theta)
    for column in range(len(theta))[knocked.layout.effects]:
        sides = [knocked.predict(at, theta + s * step[column]) for s in (1, -1)]
        np.testing.assert_allclose(jacobian[..., column], (sides[0] - sides[1]) / 2e-4, atol=1e-6)


@pytest.mark.parametrize("name", ["srbd", "linear_delta"])
def test_on_a_platform_that_does_not_turn_it_is_a_shift_of_the_tracker(name):
    robot = load_robot(name)
    with pytest.raises(
        InputError, match="does not turn: a shift of the reflector is the same as one"
    ):
        effect_named("reflector_shift", robot, robot.model(), {})
