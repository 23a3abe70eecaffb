"""The same cause more than once: a stand bumped twice, two gears, a step on top of a warm-up."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

from blind import hide
from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.candidates import subsets
from delta_calibration.diagnosis.extension import extended
from delta_calibration.diagnosis.scan import _of_effects
from delta_calibration.effects import effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, effect_options, simulate_session

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


def candidates(cause, **shape):
    """The effect of all joints, then of each joint."""
    return list(subsets(effect_named(cause, ROBOT, ROBOT.model(), shape)))


def test_a_second_occasion_has_a_number_of_its_own():
    early, also, late, cycle = (
        candidates("tracker_drift", **shape)[0]
        for shape in ({"step_at": 900.0}, {"step_at": 950.0}, {"step_at": 2000.0}, {"period": 9e3})
    )
    assert also.beside([early]).again == 0
    second = late.beside([early])
    assert (second.again, cycle.beside([early, second]).again) == (1, 2)
    assert early.beside([second]).again == 0
    assert also.same_cause(early)
    assert not second.same_cause(early)
    assert second.same_name(early)
    assert late.same_cause(second)  # another number, but the same moment
    once = candidates("thermal_growth_arm", time_constant=900.0)[0]
    assert candidates("thermal_growth_arm", time_constant=9e3)[0].beside([once]).again == 0


def test_shapes_are_compared_only_if_they_are_of_the_same_joints():
    """Near the order of one gear its joint is taken, near that of another gear another joint."""
    first = candidates("transmission_error", cycles=50.0)[2]
    second = candidates("transmission_error", cycles=54.0)[3].beside([first])
    gear = effect_named("transmission_error", ROBOT, ROBOT.model(), {})
    at = at_rest(np.linspace([-0.5, -0.5, -0.5], [1.0, 1.0, 1.0], 40))
    questions = list(_of_effects(SimpleNamespace(at=at), [gear], [first, second]))
    assert len(questions) > 2
    for groups in questions:
        assert len({tuple(c.rows for c in group) for group in groups}) == 1
        assert len({c.again for group in groups for c in group}) == 1


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
    bump = float(np.quantile(time, 0.75))
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
    step = "joint_zero_drift:step_at=600,location=joint_2,strength=1"
    drift = "joint_zero_drift:time_constant=1200,strength=1"
    machine = draw_machine(ROBOT, 3, hidden=[effect_options(text) for text in (step, drift)])
    session = simulate_session(machine, make_plan("rich", ROBOT, count=80), 3)
    said = diagnose(survey(session, ROBOT.joints.names), ROBOT).verdict
    assert not said.unknown_structure.found
    assert {(f.cause, f.location) for f in said.findings} == {
        ("joint_zero_drift", "joint_2"),
        ("joint_zero_drift", None),
    }
    found = next(f for f in said.findings if f.location)
    moment, size = found.shape["step_at_s"], found.parameters["drift_2"]
    assert abs(moment.value - 600) < 4 * moment.std < 1.0
    true = machine.chain.effect_values(machine.theta)[0][1]
    assert abs(size.value - true) < 4 * size.std


def test_one_leg_whose_rods_warm_is_no_drift_of_its_joint():
    rods = "thermal_growth_forearm:alike=0,location=joint_3,value=2e-4,time_constant=1500"
    machine = draw_machine(ROBOT, 3, hidden=[effect_options(rods)])
    session = simulate_session(machine, make_plan("rich", ROBOT, count=80), 3, period=30.0)
    (finding,) = diagnose(survey(session, ROBOT.joints.names), ROBOT).verdict.findings
    assert (finding.cause, finding.location) == ("thermal_growth_forearm", "joint_3")
