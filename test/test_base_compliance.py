"""A base on soft mounts: what of it shows, how it is found, what is said where it cannot be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

CAUSE = "base_compliance"


def hidden(name: str, seed: int, plan: str, count: int):
    """Robot, session and true values by name of a machine on mounts twice as soft as usual."""
    robot = load_robot(name)
    machine = draw_machine(robot, seed, 1.0, {CAUSE: {"strength": "2"}})
    session = simulate_session(machine, make_plan(plan, robot, count=count, seed=seed), seed)
    chain = machine.chain
    names = [n.split(".")[1] for n in chain.parameters.names[chain.layout.base.stop :]]
    true = dict(zip(names, machine.theta[chain.layout.effects], strict=True))
    return robot, survey(session, robot.joints.names), true


@pytest.mark.slow
@pytest.mark.parametrize("name", ["srbd", "scara"])
def test_it_is_named_with_its_figures(name: str) -> None:
    robot, seen, true = hidden(name, 3, "rich", 14)
    verdict = diagnose(seen, robot, seed=3).verdict
    assert [f.cause for f in verdict.findings] == [CAUSE]
    assert not verdict.unknown_structure.found
    for part, found in verdict.findings[0].parameters.items():
        assert abs(found.value - true[part]) < 3 * found.std, part
    assert verdict.findings[0].parameters["tilt"].std < 0.1 * true["tilt"]
    assert verdict.extended.held_out_rms_mm < 0.6 * verdict.calibrated.held_out_rms_mm


def test_what_shows_at_rest_is_fitted_there_beside_what_shows_in_motion_only() -> None:
    """Nothing is left to gain: all were held where one step led, up to three deviations off."""
    robot = load_robot("srbd")
    machine = draw_machine(robot, 9, 1.0, {CAUSE: {"strength": "2"}})
    plan = make_plan("identify", robot, count=40, seed=9)
    model = calibrated(survey(simulate_session(machine, plan, 9), robot.joints.names), robot)
    effect = effect_named(CAUSE, robot, model.bare.mechanism, {})
    fitted = model.fitted((Candidate(CAUSE, effect.kind, None, effect, tuple(range(5))),))
    step = (fitted.ahead(fitted.misfit) - fitted.theta)[fitted.layout.effects]
    columns = fitted.evidence.columns(effect)
    known = np.diag(fitted.evidence.information(columns)) + 1 / 25
    assert (np.abs(step) < 0.1 * effect.parameters.prior / np.sqrt(known)).all()


def test_what_never_changes_is_the_frame_s() -> None:
    """One place and one payload: its signal is that of a base that stands elsewhere."""
    robot = load_robot("srbd")
    effect = effect_named(CAUSE, robot, robot.model(), {})
    n = 6
    at = replace(
        at_rest(np.full((n, 3), 0.3)), payload=np.ones(n), payload_centre=np.zeros((n, 3))
    )
    columns = effect.columns(at)
    assert np.ptp(columns, axis=0).max() == 0.0
    assert np.abs(columns).max() > 1.0
    lighter = effect.columns(replace(at, payload=np.zeros(n)))
    assert np.abs(lighter - columns).max() == pytest.approx(9.80665)  # [N] of the payload


def test_a_robot_without_masses_is_told_so() -> None:
    arm, cables = load_robot("ur10"), load_robot("cdpr8")
    effect = effect_named(CAUSE, arm, arm.model(), {})
    lacking = effect.missing(at_rest(arm.model().home[None]))
    assert lacking == "the robot file states no masses"
    assert "mass_kg" in effect.remedied(lacking)
    assert effect.remedied("the payload is not known") == "record it: payload"
    assert CAUSE not in {e.cause for e in catalogue(cables, cables.model())}
