"""Sessions in which no place was visited twice, and a robot file that claims too little noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blind import hide
from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated, diagnose
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
FOLLOW_NOTHING = "times as large as the noise in the robot file allows, but follow nothing"


def claimed(factor):
    """The robot whose file states its noise too small by a factor."""
    tracker, joints = ROBOT.tracker, ROBOT.joints
    less = {
        name: getattr(tracker, name) / factor
        for name in ("radial", "transverse", "transverse_per_metre")
    }
    joints = replace(joints, repeatability=joints.repeatability / factor)
    return replace(ROBOT, tracker=replace(tracker, **less), joints=joints)


def visited_once(trial):
    """The first visit of each place, the mean of its readings, as a table of points gives it."""
    seen = survey(trial.session, ROBOT.joints.names)
    first = np.sort(np.unique(seen.poses.place, return_index=True)[1])
    poses, none = seen.poses.take(first), seen.paths.path[:0]
    poses = replace(poses, count=np.ones(len(poses), int), scatter=0 * poses.scatter)
    paths = replace(seen.paths, conditions=seen.paths.conditions.take(none), count=none, path=none)
    return replace(seen, poses=poses, paths=paths)


@pytest.mark.parametrize("seed", [8700, 8701])
def test_noise_that_the_file_claims_too_small_is_no_error(seed):
    told = diagnose(visited_once(hide({}, seed)), claimed(3.0), seed=seed)
    assert not told.verdict.unknown_structure.found
    assert not told.verdict.findings
    assert any(FOLLOW_NOTHING in text for text in told.doubts)


def test_noise_is_not_reduced_below_what_the_file_states():
    start = calibrated(visited_once(hide({}, 8702)), ROBOT)
    back = start.louder(3.0).louder(0.2)
    for own, measured in zip(start.problem.measured, back.problem.measured, strict=True):
        np.testing.assert_allclose(measured.whiten, own.whiten)
    assert back.cell.noise.raised == 1.0
    assert back.floor == pytest.approx(start.floor)


def test_noise_that_the_file_claims_right_is_believed():
    told = diagnose(visited_once(hide({}, 8702)), ROBOT, seed=8702)
    assert not told.verdict.unknown_structure.found
    assert not any(FOLLOW_NOTHING in text for text in told.doubts)


def test_a_cause_is_named_in_noise_that_was_claimed_too_small():
    told = diagnose(visited_once(hide({"tracker_drift": 1.0}, 8703)), claimed(3.0), seed=8703)
    assert [f.cause for f in told.verdict.findings] == ["tracker_drift"]
    assert not told.verdict.unknown_structure.found


def test_visits_that_agree_support_what_the_file_claims():
    """Each place has an error of its own that visits repeat: no noise."""
    seen, rng = visited_once(hide({}, 8704)), np.random.default_rng(4)
    own = rng.normal(0.0, 15e-6, seen.poses.point.shape)
    first, again = np.arange(len(own)), np.arange(6)
    rows = np.concatenate([first, again])
    poses = seen.poses.take(rows)
    point = (seen.poses.point + own)[rows]
    point[len(own) :] += rng.normal(0.0, 5e-6, (len(again), 3))
    time = poses.time + 60.0 * (np.arange(len(rows)) >= len(own)) * (1 + np.ptp(poses.time) / 60)
    told = diagnose(replace(seen, poses=replace(poses, point=point, time=time)), ROBOT, seed=8704)
    assert told.verdict.unknown_structure.found
    assert not any(FOLLOW_NOTHING in text for text in told.doubts)
