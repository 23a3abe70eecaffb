"""Tests of effects that go up and down with the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blind import hide
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cli.diagnose import describe
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.documents import check_document, load_schema, read_document
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.report.words import estimate
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

PERIOD, PHASE = 4000.0, 0.3


@pytest.mark.parametrize("part", ["arm", "base", "forearm"])
def test_growth_by_a_cycle_is_that_by_a_sensor_of_the_same_temperature(part: str) -> None:
    robot = load_robot("srbd")
    machine = robot.model()
    time = np.linspace(0.0, 7200.0, 50)
    warmth = 3.0 * np.cos(2 * np.pi * (time / PERIOD + PHASE - 0.25))
    at = replace(
        at_rest(np.full((len(time), machine.joints), 0.2)),
        time=time,
        temperature_parts=("room",),
        temperature=20.0 + (warmth - warmth[0])[:, None],
    )
    cause = f"thermal_growth_{part}"
    by_sensor = effect_named(cause, robot, machine, {"sensor": "room"})
    by_cycle = effect_named(cause, robot, machine, {"period": PERIOD, "phase": PHASE})
    columns = by_cycle.columns(at) * 3.0 * 12e-6
    assert np.abs(columns).max() > 1e-7
    np.testing.assert_allclose(columns, by_sensor.columns(at) * 12e-6, atol=1e-15)


@pytest.mark.parametrize("cause", ["tracker_drift", "joint_zero_drift", "thermal_growth_arm"])
def test_a_phase_without_a_period_is_refused(cause: str) -> None:
    robot = load_robot("srbd")
    with pytest.raises(InputError, match=r"phase: 0\.2 is not allowed without a period"):
        effect_named(cause, robot, robot.model(), {"phase": 0.2})


@pytest.mark.parametrize(
    ("robot", "cause", "shape", "units"),
    [
        ("srbd", "joint_zero_drift", {}, {"rad/h"}),
        ("srbd", "joint_zero_drift", {"time_constant": 2400.0}, {"rad"}),
        ("srbd", "joint_zero_drift", {"step_at": 0.0}, {"rad"}),
        ("srbd", "joint_zero_drift", {"period": PERIOD}, {"rad"}),
        ("linear_delta", "joint_zero_drift", {}, {"m/h"}),
        ("srbd", "tracker_drift", {}, {"m/h", "rad/h"}),
        ("srbd", "tracker_drift", {"step_at": 100.0}, {"m", "rad"}),
        ("srbd", "thermal_growth_arm", {}, {"1/h"}),
        ("srbd", "thermal_growth_arm", {"sensor": "arm"}, {"1/K"}),
        ("srbd", "thermal_growth_arm", {"period": PERIOD}, {"1"}),
        ("cdpr8", "pretension_loss", {}, {"1/h"}),
        ("cdpr8", "pretension_loss", {"time_constant": 2400.0}, {"1"}),
    ],
)
def test_values_of_a_ramp_alone_are_told_per_hour(robot, cause, shape, units) -> None:
    """Of every parameter; a calibration file holds the same unit in all shapes."""
    known = load_robot(robot)
    effect = effect_named(cause, known, known.model(), shape)
    assert {effect.told_unit(p) for p in effect.parameters} == units
    assert not any("/h" in p.unit for p in effect.parameters)


def test_a_zero_that_creeps_is_told_per_hour_and_kept_in_its_own_unit(tmp_path) -> None:
    robot = load_robot("srbd")
    drift = ("joint_zero_drift", {"location": "joint_2", "value": "4e-4"})
    plan = make_plan("identify", robot, count=60, seed=5)
    session = simulate_session(draw_machine(robot, 5, hidden=[drift]), plan, 5, period=60.0)
    seen = survey(session, robot.joints.names)
    tried = (effect_named("joint_zero_drift", robot, robot.model(), {}),)
    found = diagnose(seen, robot, effects=tried)
    (finding,) = found.verdict.findings
    value = finding.parameters["drift_2"]
    assert finding.shape == {}
    assert abs(value.value - 4e-4) < 4 * value.std
    told = found.verdict.as_dict()
    check_document(told, load_schema("verdict"), "verdict")
    assert told["findings"][0]["parameters"]["drift_2"]["unit"] == "rad/h"
    assert " urad/h\n" in describe(found.verdict)
    assert "µrad/h" in estimate("drift_2", value)
    path = tmp_path / "calibration.yaml"
    save_calibration(path, found.identification, robot, seen.poses)
    (kept,) = read_document(path, lambda _: load_schema("calibration"))["effects"]
    assert {p["unit"] for p in kept["parameters"]} == {"rad"}
    assert load_calibration(path, robot).chain.effects[0].cause == "joint_zero_drift"


@pytest.mark.slow
def test_a_stand_that_goes_up_and_down_with_the_room_is_one_cause_with_its_period() -> None:
    """The same session without it has no cause: as steps it would be two or three."""
    robot = load_robot("linear_delta")
    session = hide({}, 83001, robot="linear_delta").session
    tracker = session.tracker
    time = (tracker.stamp_ns - tracker.stamp_ns[0]) * 1e-9
    course = np.sin(2 * np.pi * (time / PERIOD + PHASE))[:, None]
    turned = Rotation.from_rotvec(course * [2e-6, -1e-6, 6e-6]).apply(tracker.position)
    moved = turned + course * [6e-6, -9e-6, 5e-6]
    swaying = replace(session, tracker=replace(tracker, position=moved))
    found = {
        name: diagnose(survey(one, robot.joints.names, robot.commanded.joint_size), robot).verdict
        for name, one in (("still", session), ("swaying", swaying))
    }
    assert not found["still"].findings
    (cause,) = found["swaying"].findings
    assert cause.cause == "tracker_drift"
    assert cause.confidence > 0.8
    period = cause.shape["period_s"]
    assert abs(period.value - PERIOD) < 4 * period.std < 0.3 * PERIOD
    assert not found["swaying"].unknown_structure.found


@pytest.mark.parametrize("coincides", [True, False])
def test_a_step_when_the_payload_changes_may_be_an_effect_of_the_payload(coincides: bool) -> None:
    """A stand that is pushed in mid-session, with the payload changed once: then, or elsewhere."""
    robot = load_robot("srbd")
    plan = replace(make_plan("rich", robot, count=40), paths=())
    heavy = np.arange(len(plan)) >= len(plan) // (2 if coincides else 4)
    plan = replace(plan, payload=np.where(heavy, 0.5, 0.0))

    def measured(hidden):
        session = simulate_session(draw_machine(robot, 3, hidden=hidden), plan, 3)
        return survey(session, robot.joints.names, robot.commanded.joint_size)

    time = measured({}).poses.time
    pushed = float(time[len(plan) // 2 - 1 : len(plan) // 2 + 1].mean())
    verdict = diagnose(measured({"tracker_drift": {"step_at": str(pushed)}}), robot).verdict
    (said,) = verdict.findings
    assert said.cause == "tracker_drift"
    assert (said.confidence < 0.5) == coincides
    told = [one for one in verdict.cannot_tell if "an effect of the payload" in one.between]
    assert len(told) == coincides
