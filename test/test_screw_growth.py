"""Screws that grow from their fixed bearing: the carriage, and what a session shows of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import JointStream, Session, at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

CAUSE, STEEL = "thermal_growth_screw", 11.5e-6
ROBOT = load_robot("linear_delta")
GROWTH, WARM_UP, FIXED = 400e-6, 1500.0, -0.05


def screwed(session: Session, share: np.ndarray) -> Session:
    """The session, with readings of screws that grow by a share of their length, one a joint."""
    assert session.command is not None
    begin = session.command.stamp_ns[0]

    def read(stream: JointStream) -> JointStream:
        warm = -np.expm1(-(stream.stamp_ns - begin) * 1e-9 / WARM_UP)
        longer = warm[:, None] * share
        return replace(stream, position=(stream.position + longer * FIXED) / (1 + longer))

    assert session.states is not None
    return replace(session, command=read(session.command), states=read(session.states))


def test_a_carriage_moves_by_the_screw_between_it_and_the_bearing() -> None:
    model = ROBOT.model()
    at = replace(
        at_rest(np.array([[0.1, 0.2, 0.3], [0.3, 0.1, 0.2]])),
        temperature_parts=("nut",),
        temperature=np.array([[30.0], [45.0]]),
    )
    own = effect_named(CAUSE, ROBOT, model, {"sensor": "nut", "bearing": FIXED, "alike": 0.0})
    moved = own.columns(at) @ np.full(3, STEEL)
    length = at.joint - model.drives.zero - model.drives.sense * FIXED
    warmer = at.temperature - 20.0
    np.testing.assert_allclose(moved, length * (np.exp(STEEL * warmer) - 1), rtol=3e-4)
    alike = effect_named(CAUSE, ROBOT, model, {"sensor": "nut", "bearing": FIXED})
    np.testing.assert_allclose(alike.columns(at) @ [STEEL], moved, rtol=1e-12)


def test_machines_with_sliders_have_screws() -> None:
    robots = {
        name: load_robot(name) for name in ("srbd", "ur10", "cdpr8", "five_axis", ROBOT.name)
    }
    have = {n for n, r in robots.items() if CAUSE in {e.cause for e in catalogue(r, r.model())}}
    assert have == {"five_axis", ROBOT.name}


@pytest.mark.parametrize("own", [(1.0, 1.0, 1.0), (0.0, 1.0, 0.0)], ids=["all", "one"])
def test_screws_that_warm_are_named(own: tuple[float, ...]) -> None:
    """Before, as rods that grow beside a wrong pitch, or as a zero that drifts."""
    plan = replace(make_plan("rich", ROBOT, count=50), paths=())
    clean = simulate_session(draw_machine(ROBOT, 6), plan, 6, period=60.0)
    seen = survey(screwed(clean, GROWTH * np.array(own)), ROBOT.joints.names, 0.3)
    (finding,) = diagnose(seen, ROBOT).verdict.findings
    assert finding.cause == CAUSE
    assert finding.location == (None if all(own) else "joint_2")
    value = finding.parameters["growth" if all(own) else "growth_2"]
    assert abs(value.value - GROWTH) < 3 * value.std
    for field, true in (("time_constant_s", WARM_UP), ("fixed_at_m", FIXED)):
        told = finding.shape[field]
        assert not isinstance(told, str)
        assert abs(told.value - true) < 3 * told.std
