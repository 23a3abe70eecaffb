"""Motion of the joints and effects that depend on it, compared with known derivatives."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from delta_calibration.chain import Chain
from delta_calibration.data import (
    Conditions,
    JointStream,
    PayloadStream,
    Session,
    Stroke,
    TrackerStream,
    at_rest,
    joined,
    motion_of,
    survey,
)
from delta_calibration.data.motion import TURNED
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from six_rods import SixRods

ROBOT = load_robot("srbd")
NAMES = ("joint_1", "joint_2", "joint_3")
MACHINE = SixRods()


def there_and_back(corners, step=1e-4):
    """Angles from corner to corner, distance from the last corner, and direction, each (n,)."""
    legs = []
    for a, b in pairwise(corners):
        angle = np.linspace(a, b, round(abs(b - a) / step), endpoint=False)
        legs.append([angle, np.abs(angle - a), np.full(len(angle), np.sign(b - a))])
    return np.concatenate(legs, axis=1)


def strokes_of(angle, rate=100.0):
    """Direction and travel of one joint."""
    motion = motion_of(np.arange(len(angle)) / rate, np.asarray(angle, dtype=float)[:, None])
    return motion.direction[:, 0], motion.travel[:, 0]


@pytest.mark.parametrize("rate", [10.0, 50.0, 200.0, 1000.0])
def test_speed_and_acceleration_are_the_derivatives(rate: float) -> None:
    """Exact for a line and a parabola up to the ends, and approximate for a sine."""
    time = np.arange(0.0, 3.0, 1 / rate)
    swing = 0.3 * np.sin(3 * time)
    motion = motion_of(time, np.column_stack([0.7 * time, 0.4 - 0.5 * time**2, swing]))
    np.testing.assert_allclose(motion.velocity[:, 0], 0.7, atol=1e-9)
    np.testing.assert_allclose(motion.velocity[:, 1], -time, atol=1e-9)
    np.testing.assert_allclose(motion.acceleration[:, :2], [[0.0, -1.0]] * len(time), atol=1e-5)
    inner = slice(8, -8)
    np.testing.assert_allclose(motion.velocity[inner, 2], 0.9 * np.cos(3 * time)[inner], atol=2e-3)
    np.testing.assert_allclose(motion.acceleration[inner, 2], -9 * swing[inner], atol=2e-2)


@pytest.mark.parametrize("lost", [0.02, 0.1, 0.3])
def test_a_lost_message_changes_no_speed(lost: float) -> None:
    """Speeds follow from the stamps; a missing message does not make the motion faster."""
    rng, time = np.random.default_rng(1), np.arange(0.0, 4.0, 0.02)
    time = time[rng.random(len(time)) >= lost]
    motion = motion_of(time, np.column_stack([0.7 * time, -0.1 * time, 0 * time]))
    np.testing.assert_allclose(motion.velocity, [[0.7, -0.1, 0.0]] * len(time), atol=1e-6)
    np.testing.assert_allclose(motion.acceleration, 0.0, atol=1e-4)


@pytest.mark.parametrize("n", range(1, 9))
def test_a_stretch_of_a_few_samples_has_finite_speeds_or_none(n: int) -> None:
    time = np.arange(n) * 0.05
    motion = motion_of(time, (0.3 * time)[:, None] * np.ones(3))
    np.testing.assert_allclose(motion.velocity, 0.3 if n >= 3 else 0.0, atol=1e-9)
    np.testing.assert_allclose(motion.acceleration, 0.0, atol=1e-6)


def test_no_speed_leads_across_a_pause_and_the_side_is_kept() -> None:
    time = np.r_[np.arange(20) * 0.02, 5 + np.arange(20) * 0.02]
    angle = np.r_[0.5 * time[:20], 0.8 - 0.5 * (time[20:] - 5)]
    motion = motion_of(time, angle[:, None])
    np.testing.assert_allclose(motion.velocity[:, 0], [0.5] * 20 + [-0.5] * 20, atol=1e-9)
    np.testing.assert_allclose(motion.acceleration, 0.0, atol=1e-6)
    assert motion.direction[19, 0] == motion.direction[20, 0] == 1.0  # the angle reached 0.8
    assert motion.direction[-1, 0] == -1.0
    assert motion.travel[-1, 0] == pytest.approx(0.8 - angle[-1])


def test_direction_and_travel_of_a_way_there_and_back() -> None:
    angle, gone, way = there_and_back([0.1, 0.3, 0.25, 0.4, 0.39, 0.6, 0.0])
    direction, travel = strokes_of(angle)
    gone_on, first = gone > 1e-9, np.arange(len(angle)) < 2000
    np.testing.assert_array_equal(direction[gone_on & ~first], way[gone_on & ~first])
    np.testing.assert_allclose(travel[gone_on & ~first], gone[gone_on & ~first], atol=1e-12)
    assert np.isinf(travel[first]).all()  # the previous reversal is not known
    np.testing.assert_array_equal(direction[first], gone[first] > TURNED - 1e-9)


def test_a_joint_that_never_moves_has_no_side() -> None:
    for angle in (np.full(50, 0.2), 0.2 + 0.4 * TURNED * np.sin(np.arange(50.0))):
        direction, travel = strokes_of(angle)
        assert not direction.any()
        assert np.isinf(travel).all()


@pytest.mark.parametrize(("back", "turned"), [(0.9 * TURNED, False), (1.1 * TURNED, True)])
def test_a_joint_has_turned_beyond_the_noise_of_its_encoder(back: float, turned: bool) -> None:
    """The threshold counts from the farthest point, however that was reached."""
    rng = np.random.default_rng(2)
    angle = np.r_[np.linspace(0, 0.1, 300) - rng.uniform(0, 0.9 * TURNED, 300), 0.1, 0.1 - back]
    direction, travel = strokes_of(angle)
    assert (direction[30:-1] == 1.0).all()
    assert direction[-1] == (-1.0 if turned else 1.0)
    assert travel[-1] == (pytest.approx(back) if turned else np.inf)


def test_the_side_depends_on_the_way_and_not_on_the_samples() -> None:
    """More samples, repeated samples, another zero and a mirror image make no difference.

    A live stream knows the samples so far only and may see a reversal later, by up to TURNED.
    """
    rng = np.random.default_rng(3)
    corners = np.cumsum(rng.normal(0, 2e-3, 200))
    direction, travel = strokes_of(corners)
    fine = np.concatenate([np.linspace(a, b, 7, endpoint=False) for a, b in pairwise(corners)])
    for other, share in ((fine, 7), (np.repeat(corners, 3), 3)):
        ends = slice(None, None, share)
        count = len(other[ends])
        np.testing.assert_array_equal(strokes_of(other)[0][ends], direction[:count])
        np.testing.assert_allclose(strokes_of(other)[1][ends], travel[:count], atol=1e-12)
    mirrored, moved = strokes_of(-corners), strokes_of(corners + 0.5)
    np.testing.assert_array_equal(mirrored[0], -direction)
    np.testing.assert_allclose(moved[1], travel, atol=1e-12)
    stroke, later = Stroke(float(corners[0])), 0
    for row, angle in enumerate(corners.tolist()):
        stroke = stroke.moved(angle)
        if (stroke.direction, stroke.travel(angle)) != (direction[row], travel[row]):
            later += 1
            assert travel[row] <= TURNED
            assert direction[row] == -stroke.direction
    assert 0 < later < 50
    assert len(np.unique(direction)) == 3


def test_a_turn_begins_at_the_farthest_point_and_not_where_it_shows() -> None:
    """Samples after the turning point belong to the new direction before it is certain."""
    angle = np.r_[0.0, 0.05, 0.1, 0.1, 0.1 - 0.3 * TURNED, 0.1 - 0.9 * TURNED, 0.1 - 2 * TURNED]
    direction, travel = strokes_of(angle)
    np.testing.assert_array_equal(direction, [0, 1, 1, 1, -1, -1, -1])
    np.testing.assert_allclose(travel[4:], [0.3 * TURNED, 0.9 * TURNED, 2 * TURNED], atol=1e-12)
    unfinished = strokes_of(angle[:-1])
    np.testing.assert_array_equal(unfinished[0], [0, 1, 1, 1, 1, 1])  # it may go on


def test_between_samples_the_last_side_holds_and_speed_changes_by_the_acceleration() -> None:
    time = np.arange(40) * 0.1
    angle = np.r_[0.5 * time[:20], 0.5 * time[19] - 0.5 * (time[20:] - time[19])]
    motion = motion_of(time, angle[:, None])
    velocity, _, direction, travel = motion.at(np.array([-3.0, 1.0, 1.96, 1.99, 30.0]))
    assert direction[:, 0].tolist() == [0.0, 1.0, 1.0, 1.0, -1.0]
    bends = motion.acceleration[20] * [[-0.04], [-0.01]]
    assert np.abs(bends).max() > 0.01
    np.testing.assert_array_equal(velocity[[0, 1, 4]], motion.velocity[[0, 10, 39]])
    np.testing.assert_allclose(velocity[2:4], motion.velocity[20] + bends, atol=1e-12)
    assert travel[-1, 0] == motion.travel[-1, 0] == pytest.approx(1.0)
    assert motion.at(np.array([2.0]))[2][0, 0] == motion.direction[20, 0] == -1.0


# Sessions


def made(**streams):
    """Stops on both sides of a sweep; a smooth function of the joints is read at 10 Hz."""
    corners = [0.1, 0.1, 0.4, 0.4, 0.05, 0.05, 0.3, 0.3]
    angle = np.concatenate([np.linspace(a, b, 30, endpoint=False) for a, b in pairwise(corners)])
    q = angle[:, None] * [1.0, -0.5, 0.25]
    stamps = 10**18 + (np.arange(len(q)) * 10**8).astype(np.int64)
    noise = 1e-6 * np.random.default_rng(4).standard_normal(q.shape)
    point = [3.0, 0.0, 0.0] + 0.4 * q[:, [1, 2, 0]] + noise
    parts = dict(
        command=JointStream(stamps, NAMES, q),
        states=JointStream(stamps, NAMES, q + noise),
        tracker=TrackerStream(stamps, point),
        payload=PayloadStream(stamps[[100, 150]], np.array([0.5, 1.5]), np.zeros((2, 3))),
    )
    return Session("made", **{**parts, **streams})


def taken(stream, rows):
    """Rows of a stream, in this order."""
    n = len(stream.stamp_ns)
    own = {f.name: getattr(stream, f.name) for f in fields(stream)}
    arrays = {k: v[rows] for k, v in own.items() if isinstance(v, np.ndarray) and len(v) == n}
    return replace(stream, **arrays)


def same(one: Conditions, other: Conditions) -> None:
    for f in fields(Conditions):
        if f.name not in ("_kept", "temperature_parts"):
            a, b = getattr(one, f.name), getattr(other, f.name)
            np.testing.assert_allclose(a, b, atol=1e-12, err_msg=f.name)


def test_messages_out_of_order_or_twice_are_of_the_same_motion() -> None:
    plain, rng = made(), np.random.default_rng(5)
    whole = survey(plain, NAMES)
    assert len(whole.poses) >= 3
    assert len(whole.paths) > 50
    for name in ("command", "states", "tracker"):
        stream = getattr(plain, name)
        n = len(stream.stamp_ns)
        twice = np.sort(np.r_[np.arange(n), rng.integers(0, n, 40)])
        for rows in (rng.permutation(n), twice, rng.permutation(twice)):
            same(survey(made(**{name: taken(stream, rows)}), NAMES).conditions, whole.conditions)


def test_no_sample_of_a_path_is_of_two_directions() -> None:
    """Backlash has opposite signs on both sides of a turn; a mean would be wrong for both."""
    time = np.arange(0.0, 30.0, 0.02)
    phase = 0.3 * np.clip(time - 5.0, 0.0, None)[:, None] + [0.0, 2.0, 4.0]
    q = 0.2 + 0.1 * np.sin(phase)
    stamps = 10**18 + np.round(time * 1e9).astype(np.int64)
    stream, side = JointStream(stamps, NAMES, q), np.sign(np.diff(q, axis=0, prepend=q[:1]))
    alive = 1e-9 * np.random.default_rng(6).standard_normal(q.shape)
    tracker = TrackerStream(stamps, [3.0, 0.0, 0.0] + 0.4 * q - 1e-3 * side + alive)
    paths = survey(made(command=stream, states=stream, tracker=tracker), NAMES).paths
    seen = paths.conditions
    behind = [3.0, 0.0, 0.0] + 0.4 * seen.joint - seen.reading
    assert len(paths) > 100
    np.testing.assert_allclose(np.abs(behind), 1e-3, rtol=1e-4)
    np.testing.assert_array_equal(np.sign(behind), seen.direction)
    assert (np.diff(seen.direction, axis=0) != 0).sum() >= 6


def test_conditions_of_a_path_are_those_of_its_motion() -> None:
    """Speed, side and travel follow from the commands; the payload is NaN until it is stated."""
    paths = survey(made(), NAMES).paths.conditions
    speed = {1.0: 0.3 / 3, -1.0: -0.35 / 3, 0.0: 0.25 / 3}
    way = np.sign(paths.velocity[:, 0])
    inner = np.abs(paths.acceleration[:, 0]) < 1e-3
    assert inner.sum() > 30
    up = paths.velocity[inner, 0]
    assert set(np.round(up, 4)) <= {round(v, 4) for v in speed.values()}
    np.testing.assert_array_equal(paths.direction[inner, 0], way[inner])
    np.testing.assert_array_equal(paths.direction[inner, 1], -way[inner])
    back = inner & (way < 0)
    np.testing.assert_allclose(paths.travel[back, 0], 0.4 - paths.joint[back, 0], atol=0.02)
    known = paths.time >= 10.0
    assert np.isnan(paths.payload[~known]).all()
    mass = np.where(paths.time < 15.0, 0.5, 1.5)
    np.testing.assert_array_equal(paths.payload[known], mass[known])


def test_samples_are_taken_and_joined_as_rows() -> None:
    whole = survey(made(), NAMES).conditions
    order = np.random.default_rng(6).permutation(len(whole))
    mixed = whole.take(order)
    same(mixed.take(np.argsort(order)), whole)
    same(joined(whole.take(slice(0, 7)), whole.take(slice(7, None))), whole)
    assert mixed.fingerprint() != whole.fingerprint()
    assert replace(whole, time=whole.time + 5).fingerprint() == whole.fingerprint()


# Effects that depend on motion


def predicted(effects, values, at):
    """Centre of the platform by the chain with effects of these sizes, (n, 3) [m]."""
    chain = Chain(ROBOT.model(), np.zeros(3), 0.05, tuple(effects))
    theta = chain.join(chain.mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    theta[chain.layout.effects] = values
    return chain.predict(at, theta)


def effect(cause):
    return effect_named(cause, ROBOT, ROBOT.model(), {})


def delayed(cause, times):
    """The effect in the shape that follows from these times."""
    return effect(cause).refined(np.array(times))


MIDDLE, SIZE = np.array([0.3, 0.2, 0.4]), np.array([0.2, 0.15, 0.1])
RATE, PHASE = np.array([2.0, 2.6, 1.4]), np.array([0.0, 1.0, 2.0])
TIMES = np.linspace(0.0, 6.0, 41)


def swing(t):
    """Joint values of a smooth motion at one time or several."""
    return MIDDLE + SIZE * np.sin(np.asarray(t)[..., None] * RATE + PHASE)


def swinging():
    turn = TIMES[:, None] * RATE + PHASE
    speed, pull = SIZE * RATE * np.cos(turn), -SIZE * RATE**2 * np.sin(turn)
    return replace(at_rest(swing(TIMES)), time=TIMES, velocity=speed, acceleration=pull)


@pytest.mark.parametrize("latency", [-8e-3, 4e-3, 8e-3])
def test_a_late_stamp_is_the_place_of_a_moment_before(latency: float) -> None:
    """To third order; without the shape that follows from its value, to second."""

    def missed(late, plain=False):
        shape = effect("timestamp_latency") if plain else delayed("timestamp_latency", [late])
        return predicted([shape], [late], swinging()) - MACHINE.point(swing(TIMES - late))

    now, h = MACHINE.point(swing(TIMES)), 1e-3
    ends = MACHINE.point(swing(TIMES + h)) + MACHINE.point(swing(TIMES - h))
    curve = (ends - 2 * now) / h**2 * latency**2 / 2
    np.testing.assert_allclose(missed(latency, plain=True), -curve, atol=0.1 * np.abs(curve).max())
    whole, half = (np.abs(missed(each)).max() for each in (latency, latency / 2))
    assert whole < 0.02 * np.abs(curve).max()
    assert whole / half == pytest.approx(8, rel=0.1)
    late = delayed("timestamp_latency", [latency])
    resting = predicted([late], [latency], at_rest(swing(TIMES)))
    np.testing.assert_allclose(resting, now, atol=1e-12)


def test_a_servo_of_first_order_trails_by_its_time_constant() -> None:
    """T dq/dt = command - q after the transient, to third order in T."""
    at, left = swinging(), []
    for lag in (4e-3, 2e-3):
        servo = solve_ivp(
            lambda t, x, lag=lag: (swing(t) - x) / lag,
            (0, 6),
            swing(0.0),
            method="Radau",
            t_eval=TIMES,
            rtol=1e-10,
            atol=1e-12,
        ).y.T
        lags = np.full(3, lag)
        told = at.joint + delayed("joint_lag", lags).columns(at) @ lags
        left.append(np.abs(told - servo)[1:].max())
        assert left[-1] < 0.02 * lag**2 * np.abs(at.acceleration).max()
    assert left[0] / left[1] == pytest.approx(8, rel=0.1)


@pytest.mark.parametrize("cause", ["joint_lag", "timestamp_latency"])
def test_other_ways_to_trail_are_compared_only_where_the_motion_shows_them(cause: str) -> None:
    count = len(effect(cause).parameters)
    quick, slow = (delayed(cause, [late] * count) for late in (4e-3, 1e-4))
    assert {shape.second_order for shape in quick.refinements(swinging())} == {0.0, 0.5, 1.0}
    assert [shape.second_order for shape in slow.refinements(swinging())] == [slow.second_order]
    assert [shape.second_order for shape in effect(cause).refinements(swinging())] == [
        slow.second_order
    ]
    assert all(shape.times == quick.times for shape in quick.refinements(swinging()))


@pytest.mark.parametrize("times", [(1e-3, 2e-3, 3e-3, 4e-3), (np.nan,), (np.inf,)])
def test_a_delay_has_a_number_for_each_value(times: tuple[float, ...]) -> None:
    told = re.escape(f"settings.times: {times} is not allowed; none, or 1 of them")
    with pytest.raises(InputError, match=told):
        effect_named("timestamp_latency", ROBOT, ROBOT.model(), {"times": times})


def test_a_burst_of_held_up_commands_is_survived() -> None:
    """Ten delayed commands arrive within 20 us; speeds away from them stay correct."""
    time = np.arange(200) * 0.01
    joint = np.column_stack([0.3 * np.sin(time), 0.2 * time, np.full(200, 0.1)])
    held = time.copy()
    held[80:90] = time[90] + 2e-6 * (np.arange(10) - 10)
    motion = motion_of(held, joint)
    assert np.isfinite(motion.velocity).all()
    assert np.isfinite(motion.acceleration).all()
    apart = np.r_[0:70, 100:200]
    np.testing.assert_allclose(motion.velocity[apart, 0], 0.3 * np.cos(time[apart]), atol=1e-5)
    np.testing.assert_allclose(motion.velocity[apart, 1], 0.2, atol=1e-9)
    assert (motion.velocity[:, 2] == 0).all()
