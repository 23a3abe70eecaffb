"""Tests of effects that go up and down with the room."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from blind import hide
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.robot import load_robot

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
