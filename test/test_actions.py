"""Tests of recommended actions and predicted residuals, by carrying them out in the simulator."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.diagnose import calibrated
from delta_calibration.diagnosis.findings import HeldOutModels, error_left
from delta_calibration.documents import check_document, load_schema
from delta_calibration.effects import EFFECTS, effect_named
from delta_calibration.effects.remedy import ADJUST, COMPENSATE, MEASURE, REPAIR
from delta_calibration.plans import make_plan
from delta_calibration.report.verdict_file import verdict_of
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")
CAUSES = {"backlash": "1.5", "joint_zero_drift": "2"}
TRIED = tuple(effect_named(name, ROBOT, ROBOT.model(), {}) for name in (*CAUSES, "joint_lag"))
SEED = 41
PLAN = make_plan("identify", ROBOT, count=90, seed=SEED)


def measured(causes):
    hidden = [(name, {"strength": CAUSES[name]}) for name in causes]
    machine = draw_machine(ROBOT, SEED, 1.0, hidden)
    session = simulate_session(machine, PLAN, SEED, period=38.0)
    return survey(session, ROBOT.joints.names)


@pytest.fixture(scope="module", name="found")
def found_fixture():
    return diagnose(measured(CAUSES), ROBOT, effects=TRIED).verdict


def test_what_is_left_after_one_repair_is_what_was_foretold(found):
    """Two causes; after each single repair the machine is measured again and calibrated."""
    assert {f.cause for f in found.findings} == set(CAUSES)
    for finding in found.findings:
        rest = [name for name in CAUSES if name != finding.cause]
        held = HeldOutModels(calibrated(measured(rest), ROBOT))
        left = held.mm(held.terms((), held.sectors))
        assert finding.action.held_out_rms_after_mm == pytest.approx(left, rel=0.15)


def test_what_was_searched_is_told_with_its_errors(found):
    (drift,) = (f for f in found.findings if f.cause == "joint_zero_drift")
    told = found.as_dict()
    check_document(told, load_schema("verdict"), "verdict")
    (said,) = (f for f in told["findings"] if f["cause"] == "joint_zero_drift")
    assert said["shape"].keys() <= {"time_constant_s", "step_at_s"}
    for name, value in said["shape"].items():
        assert said["shape_std"][name] > 0
        assert value == drift.shape[name].value
    again = verdict_of(told)
    assert [f.as_dict() for f in again.findings] == told["findings"]


def test_a_step_is_told_with_its_moment():
    """Half way through the session one joint's zero jumps: value, time, place are reported."""
    machine = draw_machine(
        ROBOT,
        SEED,
        1.0,
        [("joint_zero_drift", {"location": "joint_2", "value": "3e-4", "step_at": "2500"})],
    )
    session = simulate_session(machine, PLAN, SEED, period=38.0)
    found = diagnose(survey(session, ROBOT.joints.names), ROBOT, effects=TRIED).verdict
    first = found.findings[0]
    assert first.cause == "joint_zero_drift"
    moment = first.shape["step_at_s"]
    assert abs(moment.value - 2500.0) < max(4 * moment.std, 60.0)
    assert first.action.do == ADJUST
    assert any("step at 2" in line for line in first.found_in_full())


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=EFFECTS)
def test_every_effect_says_what_to_do(effect):
    assert effect.remedy.do in (ADJUST, REPAIR, COMPENSATE, MEASURE)
    for words in (effect.remedy.part, effect.remedy.how, effect.remedy.confirm):
        assert words == words.strip() != ""
        assert not words.endswith(".")


@pytest.mark.parametrize(
    ("in_motion", "with_it", "left"),
    [(False, 0.3, 0.3), (True, 0.3, 0.2), (True, 0.1, 0.1)],
)
def test_what_shows_in_motion_only_is_not_corrected_at_rest_to_its_harm(in_motion, with_it, left):
    """A pose is 0.2 mm off without the cause's correction."""
    held = SimpleNamespace(
        sectors=(),
        terms=lambda terms, sectors: with_it if terms else 0.2,
        foretells=lambda fewer, terms: with_it <= 0.2,
        mm=lambda error: error,
    )
    assert error_left(held, SimpleNamespace(), in_motion) == left
