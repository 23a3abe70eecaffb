"""A tracker that is pushed in the middle of a session: a rigid motion of millimetres, at once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated, diagnose
from delta_calibration.effects import effect_named
from delta_calibration.errors import DataError
from delta_calibration.estimation import same_robot
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")
SHIFT = np.array([6.0e-3, 6.4e-3, -4.8e-3])  # [m]
TURN = 2e-3 * np.array([0.3, -0.5, 0.8])  # [rad]


def pushed():
    """A fault-free machine, its readings moved from 45 % of the session on."""
    plan = make_plan("identify", ROBOT, count=80, seed=3)
    session = simulate_session(draw_machine(ROBOT, 3), plan, 3)
    tracker = session.tracker
    begin, end = tracker.stamp_ns[0], tracker.stamp_ns[-1]
    at = begin + int(0.45 * (end - begin))
    moved = Rotation.from_rotvec(TURN).apply(tracker.position) + SHIFT
    later = (tracker.stamp_ns > at)[:, None]
    tracker = replace(tracker, position=np.where(later, moved, tracker.position))
    return replace(session, tracker=tracker), (at - session.tracker.stamp_ns[0]) * 1e-9


def test_a_push_of_ten_millimetres_is_found_whole():
    """Within the bounds of a drift by heat it would be found only in part."""
    session, at = pushed()
    found = diagnose(survey(session, ROBOT.joints.names, ROBOT.commanded.joint_size), ROBOT)
    (cause,) = [f for f in found.verdict.findings if f.cause == "tracker_drift"]
    assert found.verdict.findings == (cause,)
    assert not found.verdict.unknown_structure.found
    assert cause.confidence > 0.95
    assert cause.shape["step_at_s"].value == pytest.approx(at, abs=60.0)
    for name, true in (("shift", SHIFT), ("turn", TURN)):
        for axis, value in zip("xyz", true, strict=True):
            told = cause.parameters[f"{name}_{axis}"]
            assert abs(told.value - value) < 4 * told.std
            assert told.std < 0.1 * np.linalg.norm(true)
    assert found.verdict.extended.held_out_rms_mm < 2 * found.verdict.noise_mm


def test_the_whole_session_in_one_frame_would_be_another_robot(monkeypatch):
    session, _ = pushed()
    monkeypatch.setattr(same_robot, "_fits_in_parts", lambda *_: False)
    with pytest.raises(DataError, match="is it the session of another robot"):
        calibrated(survey(session, ROBOT.joints.names, ROBOT.commanded.joint_size), ROBOT)


def test_only_a_push_may_be_large():
    """Heat moves a stand by 2 mm at most; a push is limited by the linear law of its turn."""
    drift = effect_named("tracker_drift", ROBOT, ROBOT.model(), {})
    most = {
        name: shape.parameters.bounds[1][0] * shape.parameters.prior[0]
        for name, shape in (("heat", drift), ("push", replace(drift, step_at=100.0)))
    }
    assert most == pytest.approx({"heat": 2e-3, "push": 50e-3})
