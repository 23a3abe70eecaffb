"""Readings matched by stamp, poses at rest, and the conditions of a pose."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.data import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
    collect,
    match,
    require_poses,
)
from delta_calibration.errors import DataError, RecordingError
from delta_calibration.recording import read_session

NAMES = ("joint_1", "joint_2", "joint_3")
START = 1_700_000_000_000_000_000
SESSIONS = Path(__file__).parents[2] / "shared" / "sessions"
KEPT = ("none", "arm_length", "backlash", "thermal_growth_arm", "unknown")


def ns(seconds):
    return START + np.round(np.asarray(seconds) * 1e9).astype(np.int64)


def seen(q):
    """A smooth function of the joints in place of the platform position."""
    return np.array([3.0, 0.0, 0.0]) + 0.4 * np.asarray(q) @ np.array(
        [[0, 1, 0], [0, 0, 1], [1, 0, 0]]
    )


def session(time, q, *, point=None, encoder=0.0, rng=None, **streams):
    rng = rng or np.random.default_rng(0)
    q = np.asarray(q, dtype=float)
    states = JointStream(ns(time), NAMES, q + encoder * rng.standard_normal(q.shape))
    point = seen(q) if point is None else point
    parts = {"command": JointStream(ns(time), NAMES, q), "states": states}
    return Session("made", **{**parts, "tracker": TrackerStream(ns(time), point), **streams})


def stops(goals, dwell=1.0, rate=20.0, way=0.5):
    """Times and joints of a motion from stop to stop in straight lines."""
    here, joints = np.asarray(goals[0], dtype=float), []
    for goal in goals:
        share = np.linspace(0, 1, int(way * rate), endpoint=False)[:, None]
        joints += [here + share * (np.asarray(goal) - here), np.tile(goal, (int(dwell * rate), 1))]
        here = np.asarray(goal, dtype=float)
    q = np.concatenate(joints)
    return np.arange(len(q)) / rate, q


def noisy(q, rng):
    """Tracker readings with noise of 3 um along the beam (here x) and 8 um across."""
    return seen(q) + [3e-6, 8e-6, 8e-6] * rng.standard_normal((len(q), 3))


GOALS = [[0.1, 0.2, 0.3], [0.4, 0.0, 0.1], [0.1, 0.5, -0.1], [0.1, 0.2, 0.3]]


# Readings


def test_joints_are_interpolated_at_the_readings_own_stamps():
    """Joints at 10 Hz in fast motion; the nearest message would be wrong by up to 50 mrad."""
    time, late = np.arange(0, 2, 0.1), np.arange(0, 1.9, 0.037)

    def angle(t):
        return np.stack([t, 0.5 - t, 0.2 * t], axis=1)

    made = session(time, angle(time), tracker=TrackerStream(ns(late), seen(angle(late))))
    readings = match(made, NAMES)
    np.testing.assert_allclose(readings.joint, angle(late), atol=1e-9)
    np.testing.assert_allclose(readings.command, angle(late), atol=1e-9)
    nearest = angle(time[np.abs(late[:, None] - time).argmin(axis=1)])
    assert np.abs(nearest - angle(late)).max() > 0.04  # an error that this test would find


def test_streams_may_come_out_of_order():
    time, q = stops(GOALS)
    made = session(time, q)
    mixed = np.random.default_rng(1).permutation(len(time))
    shuffled = Session(
        "made",
        JointStream(ns(time)[mixed], NAMES, q[mixed]),
        JointStream(ns(time)[mixed[::-1]], NAMES, q[mixed[::-1]]),
        TrackerStream(ns(time)[mixed], seen(q)[mixed]),
    )
    one, other = match(made, NAMES), match(shuffled, NAMES)
    np.testing.assert_array_equal(one.joint, other.joint)
    np.testing.assert_array_equal(one.point, other.point)
    assert (np.diff(other.time) > 0).all()


def test_readings_without_joints_near_them_are_counted():
    """A gap of 2 s in motion: only readings within 50 ms of a message are used."""
    time = np.arange(0, 6, 0.02)
    there = (time < 2.0) | (time > 4.0)
    q = np.stack([0.1 * time, 0 * time, 0 * time], axis=1)
    states = JointStream(ns(time[there]), NAMES, q[there])
    made = Session("made", None, states, TrackerStream(ns(time), seen(q)))
    readings = match(made, NAMES)
    lost = ~there & (np.abs(time - 1.98) > 0.0501) & (np.abs(time - 4.02) > 0.0501)
    assert readings.rejected.unmatched == lost.sum() > 80
    assert len(readings.time) == len(time) - lost.sum()
    held = Session(
        "made", None, JointStream(states.stamp_ns, NAMES, 0 * q[there] + 0.1), made.tracker
    )
    assert match(held, NAMES).rejected.unmatched == 0  # joints cannot have moved


def test_no_overlap_in_time_says_both_spans():
    time, q = stops(GOALS)
    made = session(time, q, tracker=TrackerStream(ns(time + 1000), seen(q)))
    with pytest.raises(
        DataError, match=r"made: no tracker reading .* 1700000000\.000 to .* tracker 17000010"
    ):
        match(made, NAMES)


def test_columns_are_taken_by_name():
    time, q = stops(GOALS)
    order = ("gripper", "joint_3", "joint_1", "joint_2")
    turned = JointStream(ns(time), order, np.column_stack([0 * time, q[:, 2], q[:, 0], q[:, 1]]))
    made = session(
        time, q, states=turned, command=turned, point=noisy(q, np.random.default_rng(1))
    )
    readings = match(made, NAMES)
    np.testing.assert_array_equal(readings.joint, q)
    np.testing.assert_array_equal(readings.command, q)
    poses = collect(made, NAMES)
    np.testing.assert_allclose(poses.joint[1], GOALS[1])
    assert poses.direction[1].tolist() == [1, -1, -1]


def test_another_robots_names_are_refused_with_both():
    time, q = stops(GOALS)
    other = JointStream(ns(time), ("a1", "a2", "a3"), q)
    with pytest.raises(RecordingError, match=r"joints a1, a2, a3 recorded, .* joint_1, joint_2"):
        match(session(time, q, states=other), NAMES)


@pytest.mark.parametrize(
    ("lacks", "message"),
    [
        ({"tracker": None}, "no tracker readings"),
        ({"states": None, "command": None}, "no joint angles"),
    ],
)
def test_what_is_missing_is_named(lacks, message):
    time, q = stops(GOALS)
    with pytest.raises(RecordingError, match=f"made: {message} in this session"):
        match(session(time, q, **lacks), NAMES)


def test_without_encoders_the_command_is_taken_and_said():
    time, q = stops(GOALS)
    made = session(time, q, states=None, point=noisy(q, np.random.default_rng(1)))
    readings = match(made, NAMES)
    np.testing.assert_array_equal(readings.joint, q)
    assert any("no joint_states" in note for note in readings.notes)
    assert collect(made, NAMES).direction[1].tolist() == [1, -1, -1]


@pytest.mark.parametrize(("rate", "said"), [(20.0, False), (10.0, True)])
def test_commands_too_far_apart_to_show_a_turn_are_said(rate, said):
    notes = match(session(*stops(GOALS, rate=rate)), NAMES).notes
    assert any("commands 0.1 s apart" in note for note in notes) is said


def test_repeated_stamps_and_frozen_runs_are_counted():
    rng = np.random.default_rng(2)
    time, q = stops(GOALS)
    point = noisy(q, rng)
    point[30:35] = point[29]  # five more of the same: frozen
    point[50] = point[49]  # only one more: may be chance, or a tracker that rounds
    again = np.r_[np.arange(len(time)), [7, 7, 9]]
    made = session(time, q, tracker=TrackerStream(ns(time)[again], point[again]))
    readings = match(made, NAMES)
    assert readings.rejected.repeated == 3
    assert readings.rejected.frozen == 5
    assert len(readings.time) == len(time) - 5


# Poses at rest


def test_each_stop_is_one_pose_and_its_mean():
    rng = np.random.default_rng(3)
    time, q = stops(GOALS)
    point = noisy(q, rng)
    poses = collect(session(time, q, point=point, encoder=3e-6, rng=rng), NAMES)
    assert len(poses) == 4
    np.testing.assert_allclose(poses.joint, GOALS, atol=5e-6)
    np.testing.assert_allclose(poses.command, GOALS, atol=1e-12)
    rows = np.flatnonzero(np.abs(q - GOALS[1]).max(axis=1) == 0)
    np.testing.assert_allclose(poses.point[1], point[rows].mean(axis=0), atol=1e-15)
    np.testing.assert_allclose(poses.scatter[1], np.cov(point[rows].T), atol=1e-18)
    assert poses.count[1] == len(rows) == 21
    assert poses.place.tolist() == [0, 1, 2, 0]
    assert poses.rejected.counts() == dict.fromkeys(poses.rejected.counts(), 0)
    assert poses.readings == len(time)


def test_a_command_that_stops_coming_still_belongs_to_its_stop():
    """A plan has ended, or the recorder started late: the joints rest, but commands are missing.

    The joints are compensated, a milliradian from the command, and their encoders are noisy.
    """
    rng = np.random.default_rng(4)
    time, q = stops(GOALS)
    whole = session(time, q + 1e-3, point=noisy(q, rng), encoder=3e-6, rng=rng)
    gone = (time > time[-1] - 0.7) | (time < 2.0)  # most of the last stop, all of the first
    command = JointStream(ns(time[~gone]), NAMES, q[~gone])
    poses = collect(replace(whole, command=command), NAMES)
    assert len(poses) == 4
    np.testing.assert_allclose(poses.command[1:], GOALS[1:], atol=1e-12)
    np.testing.assert_allclose(poses.command[0], poses.joint[0], atol=1e-12)


def test_outliers_are_set_aside_from_six_sigma_on():
    """With 8 um of noise 65 um is an outlier; 500 readings of pure noise have none."""
    rng = np.random.default_rng(4)
    time, q = stops(GOALS, dwell=6.0)
    point = noisy(q, rng)
    assert collect(session(time, q, point=point), NAMES).rejected.outlier == 0
    for row, size in ((60, 65e-6), (80, -65e-6), (200, 3e-3)):
        point[row, 1] += size
    poses = collect(session(time, q, point=point), NAMES)
    assert poses.rejected.outlier == 3
    np.testing.assert_allclose(poses.point, seen(GOALS), atol=4e-6)


def test_settling_is_left_out_and_counted_apart():
    rng = np.random.default_rng(5)
    time, q = stops(GOALS[:2])
    point = noisy(q, rng)
    arrived = np.flatnonzero(np.abs(q - GOALS[1]).max(axis=1) == 0)[:5]
    point[arrived, 2] += 1e-3 * np.exp(-np.arange(5))
    poses = collect(session(time, q, point=point), NAMES)
    assert poses.rejected.settling in (3, 4)  # the last ones are within the noise
    assert poses.rejected.outlier == 0
    np.testing.assert_allclose(poses.point[1], seen(GOALS[1]), atol=8e-6)


@pytest.mark.parametrize("speed", [2e-3, 0.03, 0.3])
def test_a_sweep_at_constant_speed_is_not_still(speed):
    """Even if the session is a single sweep, whose equal steps could be taken for noise."""
    time = np.arange(0, 10, 0.05)
    q = np.stack([speed * time, 0 * time, 0 * time], axis=1)
    with pytest.raises(DataError, match=r"no pose at rest: every reading was taken in motion$"):
        collect(session(time, q, encoder=3e-6), NAMES)


def test_a_sweep_after_stops_adds_no_pose():
    rng = np.random.default_rng(6)
    time, q = stops(GOALS)
    sweep = q[-1] + 0.01 * np.arange(1, 400)[:, None] / 20 * [1, 0, 0]
    time, q = np.arange(len(q) + len(sweep)) / 20, np.concatenate([q, sweep])
    assert len(collect(session(time, q, point=noisy(q, rng), encoder=3e-6), NAMES)) == 4


def test_encoder_noise_does_not_cut_a_moment():
    rng = np.random.default_rng(7)
    time, q = stops(GOALS)
    for encoder in (0.0, 3e-6, 15e-6):
        assert len(collect(session(time, q, point=noisy(q, rng), encoder=encoder), NAMES)) == 4


def test_one_message_a_pose():
    rng = np.random.default_rng(8)
    q = rng.uniform(-0.2, 0.8, (15, 3))
    made = session(np.arange(15) * 3.0, q)
    poses = collect(made, NAMES)
    assert len(poses) == 15
    assert (poses.count == 1).all()
    np.testing.assert_allclose(poses.point, seen(q))
    np.testing.assert_allclose(poses.joint, q)


def test_a_pause_parts_two_moments_of_one_place():
    rng = np.random.default_rng(9)
    time = np.r_[np.arange(20) / 20, 5 + np.arange(20) / 20]
    q = np.tile(GOALS[0], (40, 1))
    poses = collect(session(time, q, point=noisy(q, rng)), NAMES)
    assert len(poses) == 2
    assert poses.place.tolist() == [0, 0]


# Conditions


def test_direction_is_that_of_the_last_motion_from_both_sides():
    goal = np.array([0.2, 0.2, 0.2])
    side = np.array([1.0, -1.0, 1.0])
    walk = [
        goal - 0.1,
        goal - 0.01 * side,
        goal,
        goal + 0.01 * side,
        goal,
        goal + 0.05 * np.eye(3)[0],
    ]
    rng = np.random.default_rng(10)
    time, q = stops(walk)
    poses = collect(session(time, q, point=noisy(q, rng), encoder=3e-6, rng=rng), NAMES)
    assert poses.direction[2].tolist() == side.tolist()
    assert poses.direction[4].tolist() == (-side).tolist()
    assert poses.place[2] == poses.place[4]
    assert poses.repeat[2] != poses.repeat[4]
    # two joints were not moved: their backlash is as the previous move has left it
    assert poses.direction[5].tolist() == [1.0, *(-side).tolist()[1:]]
    assert (poses.direction[0] == 0).all()  # the motion before is not known


def test_a_turn_beyond_the_goal_counts_not_the_long_way_before_it():
    """Upwards past the goal and back to it: the last motion was down."""
    way = np.r_[np.full(20, 0.1), np.linspace(0.1, 0.22, 20), np.linspace(0.22, 0.2, 8)]
    way = np.r_[way, np.full(20, 0.2)]
    q = way[:, None] * np.ones(3)
    made = session(np.arange(len(q)) / 20, q, point=noisy(q, np.random.default_rng(15)))
    assert collect(made, NAMES).direction[-1].tolist() == [-1, -1, -1]


def test_payload_holds_until_the_next_and_parts_repeats():
    rng = np.random.default_rng(11)
    walk = [GOALS[0], GOALS[1]] * 4
    time, q = stops(walk)
    change = np.array([time[35], time[95]])
    centre = np.array([[0, 0, -0.1], [0, 0, -0.2]])
    payload = PayloadStream(ns(change[::-1]), np.array([2.0, 0.5])[::-1], centre[::-1])
    poses = collect(session(time, q, point=noisy(q, rng), payload=payload), NAMES)
    known = np.where(poses.time < change[0], np.nan, np.where(poses.time < change[1], 0.5, 2.0))
    assert len({*known[~np.isnan(known)]}) == 2
    np.testing.assert_array_equal(poses.payload, np.where(np.isnan(known), np.nan, 2.5 - known))
    assert np.isnan(poses.payload_centre[0]).all()
    same = poses.repeat[:, None] == poses.repeat
    held = np.nan_to_num(poses.payload, nan=-1)
    assert (held[:, None] == held)[same].all()


def test_temperature_is_interpolated_a_part():
    rng = np.random.default_rng(12)
    time, q = stops(GOALS)
    arm = TemperatureStream("arm", ns([0.0, 10.0]), np.array([20.0, 30.0]))
    base = TemperatureStream("base", ns([0.0, 10.0]), np.array([25.0, 20.0]))
    poses = collect(session(time, q, point=noisy(q, rng), temperature=(arm, base)), NAMES)
    assert poses.temperature_parts == ("arm", "base")
    np.testing.assert_allclose(poses.temperature[:, 0], 20 + poses.time, atol=1e-6)
    np.testing.assert_allclose(poses.temperature[:, 1], 25 - poses.time / 2, atol=1e-6)


def test_quaternions_of_either_sign_have_one_mean():
    rng = np.random.default_rng(13)
    time, q = stops(GOALS[:2])
    turn = np.tile([0.0, 0.0, 0.6, 0.8], (len(time), 1)) * rng.choice([-1, 1], (len(time), 1))
    poses = collect(session(time, q, tracker=TrackerStream(ns(time), noisy(q, rng), turn)), NAMES)
    np.testing.assert_allclose(np.abs(poses.quaternion @ [0, 0, 0.6, 0.8]), 1)


def test_too_few_places_are_refused_with_both_numbers():
    rng = np.random.default_rng(14)
    time, q = stops(GOALS)
    poses = collect(session(time, q, point=noisy(q, rng)), NAMES)
    require_poses(poses, 3)
    with pytest.raises(DataError, match="made: 3 different poses at rest, 4 or more are needed"):
        require_poses(poses, 4)
    assert len(poses.take(np.array([0, 2]))) == 2
    with pytest.raises(DataError, match="1 different"):
        require_poses(poses.take(np.array([0, 3])), 2)  # one place, twice


@pytest.mark.skipif(
    not SESSIONS.exists(), reason="the five sessions are not beside this repository"
)
@pytest.mark.parametrize("name", KEPT)
def test_kept_sessions(name):
    """190 stops of the plan; the ends of sweeps and circles are poses at rest as well."""
    poses = collect(read_session(SESSIONS / name), NAMES)
    planned = slice(0, 190)  # then the sweeps and circles follow
    places, times = np.unique(poses.place[planned], return_counts=True)
    assert len(places) == 40
    assert times.min() == 4  # from both sides with both payloads
    assert sorted(times)[-10:] == [7] * 10  # ten places three times more
    assert 190 < len(poses) <= 210
    assert np.median(poses.count) == pytest.approx(21, abs=1)
    assert 0 < poses.rejected.outlier < 40
    assert poses.rejected.unmatched == 0
    assert np.abs(poses.direction[1:190]).all()
    assert len(np.unique(poses.payload)) == 2


def test_a_session_is_not_changed():
    time, q = stops(GOALS)
    made = session(time, q, point=noisy(q, np.random.default_rng(1)))
    before = replace(made.tracker, position=made.tracker.position.copy())
    collect(made, NAMES)
    np.testing.assert_array_equal(made.tracker.position, before.position)


def test_frozen_readings_are_said_where_nothing_else_is_left():
    time, q = stops(GOALS)
    with pytest.raises(DataError, match=r"taken in motion; \d+ were set aside as frozen"):
        collect(session(time, q), NAMES)  # noise-free readings repeat at every stop
