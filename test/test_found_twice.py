"""The same cause more than once: a stand bumped twice, two gears, a step on top of a warm-up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from blind import hide
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.data import survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.extension import extended
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("srbd")
FIRST = (3000.0, (1e-4, -5e-5, 3e-5), (3e-5, 2e-5, -4e-5))  # [s], [m], [rad]
SECOND = (5200.0, (-3e-5, 9e-5, 5e-5), (-2e-5, 3e-5, 3e-5))


def bumped(point, time, bumps):
    """Readings of a tracker that was pushed at some moments, each time about its own origin."""
    for moment, shift, turn in bumps:
        moved = Rotation.from_rotvec(turn).apply(point) + shift
        point = np.where((time >= moment)[:, None], moved, point)
    return point


def session(seed, bumps=(), joint=lambda q: q, motions=True):
    """A clean machine of the blind generator, its readings and encoder angles as given."""
    seen = survey(hide({}, seed).session, ROBOT.joints.names)
    poses, at = seen.poses, seen.paths.conditions
    poses = replace(poses, point=bumped(poses.point, poses.time, bumps), joint=joint(poses.joint))
    at = replace(at, reading=bumped(at.reading, at.time, bumps))
    paths = replace(seen.paths, conditions=at)
    if not motions:
        none = paths.path[:0]
        paths = replace(paths, conditions=at.take(none), count=none, path=none)
    return replace(seen, poses=poses, paths=paths)


def moments(verdict):
    return sorted(f.shape["step_at_s"].value for f in verdict.findings)


def test_a_stand_that_was_bumped_twice_is_told_with_both_moments():
    seen = session(9900, [FIRST, SECOND])
    said = diagnose(seen, ROBOT, seed=1).verdict
    assert [f.cause for f in said.findings] == ["tracker_drift", "tracker_drift"]
    assert not said.unknown_structure.found
    time = np.sort(seen.poses.time)
    for told, (bump, _, _) in zip(moments(said), (FIRST, SECOND), strict=True):
        row = np.searchsorted(time, bump)
        assert time[row - 1] <= told <= time[row]
    assert said.extended.held_out_rms_mm < 1.1 * said.noise_mm


def test_a_bump_in_the_middle_of_a_motion_is_told_with_its_moment():
    seen = session(9901)
    path = np.bincount(seen.paths.path).argmax()  # the longest
    time = seen.paths.conditions.time[seen.paths.path == path]
    bump = float(np.quantile(time, 0.3))
    said = diagnose(session(9901, [(bump, *FIRST[1:])]), ROBOT, seed=1).verdict
    assert [f.cause for f in said.findings] == ["tracker_drift"]
    assert not said.unknown_structure.found
    (told,) = said.findings[0].shape.values()
    assert abs(told.value - bump) < 4 * told.std < 2.0


def test_each_joint_can_have_a_gear_of_its_own(tmp_path):
    """Waves of 33 cycles a turn in one encoder, of 50 and 100 in another, added to its reading."""

    def wave(q):
        third = 2e-4 * np.cos(50 * q[:, 2]) + 1e-4 * np.sin(100 * q[:, 2])
        return np.stack([0 * third, 2e-4 * np.sin(33 * q[:, 1]), third], axis=1)

    def geared(q):
        """What encoders read if the joints are at q: the waves are those of the readings."""
        read = q
        for _ in range(8):
            read = q - wave(read)
        return read

    found = diagnose(session(9903, joint=geared, motions=False), ROBOT, seed=1)
    said = found.verdict
    assert {f.cause for f in said.findings} == {"transmission_error"}
    told = [
        turns * f.shape["order"].value
        for f in said.findings
        for turns in ((1, 2) if "second_order" in f.shape else (1,))
    ]
    np.testing.assert_allclose(sorted(told), [33.0, 50.0, 100.0], atol=0.2)
    assert not said.unknown_structure.found
    path = tmp_path / "extended.yaml"
    save_calibration(path, extended(found.model, 1), ROBOT, found.model.survey.poses)
    chain = load_calibration(path, ROBOT).chain
    assert len(chain.effects) == len(said.findings) > 1
    assert len(set(chain.parameters.names)) == len(chain.parameters)


def test_a_joint_that_loses_its_zero_while_all_drift_is_told_apart():
    """The step is in the middle of a motion; the drifts of all joints go on before and after."""
    hidden = [
        ("joint_zero_drift", {"step_at": "600", "location": "joint_2", "strength": "1"}),
        ("joint_zero_drift", {"time_constant": "1200", "strength": "1"}),
    ]
    machine = draw_machine(ROBOT, 3, hidden=hidden)
    session = simulate_session(machine, make_plan("rich", ROBOT, count=80), 3)
    said = diagnose(survey(session, ROBOT.joints.names), ROBOT).verdict
    assert not said.unknown_structure.found
    assert {(f.cause, f.location) for f in said.findings} == {
        ("joint_zero_drift", "joint_2"),
        ("joint_zero_drift", None),
    }
    step = next(f for f in said.findings if f.location)
    assert abs(step.shape["step_at_s"].value - 600) < 4 * step.shape["step_at_s"].std < 1.0
    (true,) = (v[1] for e, v in zip(*told(machine), strict=True) if e.step_at > 0)
    value = step.parameters["drift_2"]
    assert abs(value.value - true) < 4 * value.std


def told(machine):
    """Effects of a machine, and their values."""
    return machine.chain.effects, machine.chain.effect_values(machine.theta)


def test_one_leg_whose_rods_warm_is_no_drift_of_its_joint():
    hidden = [("thermal_growth_forearm", {"alike": "0", "location": "joint_3", "value": "2e-4",
                                          "time_constant": "1500"})]  # fmt: skip
    machine = draw_machine(ROBOT, 3, hidden=hidden)
    session = simulate_session(machine, make_plan("rich", ROBOT, count=80), 3, period=30.0)
    (finding,) = diagnose(survey(session, ROBOT.joints.names), ROBOT).verdict.findings
    assert (finding.cause, finding.location) == ("thermal_growth_forearm", "joint_3")
