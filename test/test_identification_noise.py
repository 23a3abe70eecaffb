"""The noise of a measured pose is estimated from repeats, using only comparable poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import collect
from delta_calibration.estimation import chain_of, identify, prepare
from delta_calibration.estimation.noise import estimate_noise
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from identification_bench import ROBOT, errors, slope_of
from six_rods import (
    PER_METRE,
    RADIAL,
    REPEATABILITY,
    TRANSVERSE,
    Cell,
    SixRods,
    workspace,
)

# A cubic in time whose coefficients are linear in the position, for three joints: 36 numbers
TIME = 3 * 4 * 3 // 3  # degrees of freedom (of three coordinates each) of this model
SIDES = 1 * 4 * 3 // 3  # the same for two sides of approach, shared by all joints


def test_known_noise_is_given_back_within_its_sampling_error():
    """400 poses of 11 readings: 4000 degrees of freedom along, 8000 across, 564 at rest."""
    rng = np.random.default_rng(1)
    q = np.repeat(workspace(200, rng), 2, axis=0)
    for factor, rest in ((1.0, 12e-6), (1.7, 25e-6)):
        poses = Cell(SixRods()).measure(q, rng, count=11, repeatability=rest, noise=factor)
        noise = estimate_noise(poses, slope_of(poses), ROBOT)
        assert noise.measured
        assert noise.degrees == 200 - TIME
        assert noise.radial_scale == pytest.approx(factor, rel=4 / np.sqrt(2 * 4000))
        assert noise.transverse_scale == pytest.approx(factor, rel=4 / np.sqrt(2 * 8000))
        assert noise.repeatability == pytest.approx(rest, rel=4 / np.sqrt(2 * 564) * 1.3)
        distance = np.linalg.norm(poses.point, axis=1)
        reading = (RADIAL**2 + 2 * (TRANSVERSE + PER_METRE * distance) ** 2) * factor**2 / 11
        motion = rest**2 * np.sum(slope_of(poses) ** 2, axis=(1, 2))
        assert noise.floor == pytest.approx(
            np.sqrt(np.mean(reading + motion)), rel=4 / np.sqrt(1128)
        )


def single_readings(scale: float, seed: int):
    """Repeats on a SCARA, one reading each, by a tracker `scale` times as noisy as filed."""
    robot, rng = load_robot("scara"), np.random.default_rng(seed)
    plan = make_plan("identify", robot, count=60, seed=seed)
    poses = collect(simulate_session(draw_machine(robot, seed), plan, seed), robot.joints.names)
    model, size = robot.model(), len(poses)
    x = model.forward(poses.command, model.parameters.nominal)
    slope = model.velocity_jacobian(poses.command, x, model.parameters.nominal)[:, :3]
    point = model.position(x) + np.array([1.0, -2.0, 0.5])  # from the tracker
    distance = np.linalg.norm(point, axis=1, keepdims=True)
    along, across = (each[:, None] for each in robot.tracker.sigmas(distance[:, 0]))
    off, beam = across * rng.standard_normal((size, 3)), point / distance
    off += beam * (along * rng.standard_normal((size, 1)) - np.sum(off * beam, 1, keepdims=True))
    rest = robot.joints.repeatability * rng.standard_normal(poses.joint.shape)
    moved = np.einsum("nij,nj->ni", slope, rest)
    one, none = np.ones(size, dtype=np.int64), np.zeros_like(poses.scatter)
    measured = point + scale * off + moved
    return replace(poses, joint=poses.command, point=measured, count=one, scatter=none), slope


@pytest.mark.parametrize("scale", [1.0, 2.0])
def test_repeats_of_single_readings_tell_of_a_noisy_tracker(scale: float):
    """No joint of a SCARA that stands still along z moves a reading up: the tracker does."""
    told = []
    for seed in range(8):
        poses, slope = single_readings(scale, seed)
        told.append(estimate_noise(poses, slope, load_robot("scara")))
    found = np.array([noise.radial_scale for noise in told])
    assert [noise.transverse_scale for noise in told] == found.tolist()
    if scale == 1.0:
        assert (found == 1.0).all()
    else:
        assert (np.abs(found - scale) < 0.5).all()
        assert np.mean(found) == pytest.approx(scale, rel=0.1)


def test_a_base_that_sinks_under_a_load_is_no_noise():
    """Every other visit is made with a load: up and down is what the tracker alone would do."""
    poses, slope = single_readings(1.0, 9)
    loaded = np.arange(len(poses)) % 2 == 1
    sunk = poses.point - np.outer(loaded, [0.0, 0.0, 60e-6])
    poses = replace(poses, point=sunk, payload=2.0 * loaded)
    noise = estimate_noise(poses, slope, load_robot("scara"))
    assert noise.radial_scale == 1.0


def test_covariance_of_a_reading_lies_along_and_across_the_beam():
    rng = np.random.default_rng(2)
    poses = Cell(SixRods()).measure(workspace(2, rng), rng)
    noise = replace(
        estimate_noise(poses, slope_of(poses), ROBOT), radial_scale=1, transverse_scale=1
    )
    covariance = noise.reading(poses.point, ROBOT.tracker)
    for point, matrix in zip(poses.point, covariance, strict=True):
        values, axes = np.linalg.eigh(matrix)
        across = TRANSVERSE + PER_METRE * np.linalg.norm(point)
        np.testing.assert_allclose(np.sqrt(values), [RADIAL, across, across])
        assert abs(axes[:, 0] @ point) == pytest.approx(np.linalg.norm(point))


def test_places_visited_once_tell_nothing_of_the_noise():
    """Beside 40 places visited four times: as without them."""
    rng = np.random.default_rng(3)
    again, once = np.repeat(workspace(40, rng), 4, axis=0), workspace(60, rng)
    order = np.concatenate([[0], 1 + rng.permutation(218), [219]])
    order = np.where(order == 219, 1, np.where(order == 1, 219, order))  # the last is a repeat
    q = np.concatenate([again, once])[order]
    poses = Cell(SixRods()).measure(q, rng, count=1)
    slope, repeated = slope_of(poses), np.flatnonzero(order < 160)
    every, some = (
        estimate_noise(poses.take(rows), slope[rows], ROBOT) for rows in (np.arange(220), repeated)
    )
    assert some.measured
    assert every.degrees == some.degrees == 120 - TIME
    assert every.repeatability == pytest.approx(some.repeatability, rel=1e-6)


@pytest.mark.parametrize("gap", [0.0, 1e-4])
@pytest.mark.parametrize("growth", [0.0, 4e-4])
def test_what_side_and_time_do_is_no_noise(gap, growth):
    """Backlash of 0.1 mrad, growth of 0.4 mrad over the session; the rest error is 12 urad."""
    rng = np.random.default_rng(3)
    q = np.repeat(workspace(40, rng), 4, axis=0)[rng.permutation(160)]
    place = np.unique(q, axis=0, return_inverse=True)[1].reshape(-1)
    side = rng.choice([-1.0, 1.0], (160, 1)) * np.ones(3)
    warm = 1 - np.exp(-np.linspace(0, 3, 160))[:, None]
    poses = Cell(SixRods()).measure(q - side * gap / 2 + growth * warm, rng, direction=side)
    poses = replace(poses, joint=q, command=q, place=place)
    noise = estimate_noise(poses, slope_of(poses), ROBOT)
    assert noise.degrees == 160 - 40 - TIME - SIDES
    assert noise.repeatability == pytest.approx(REPEATABILITY, rel=4 / np.sqrt(6 * noise.degrees))


def test_what_comes_by_chance_is_noise_however_large():
    """The same 0.1 mrad, with a side drawn at random for each move and not recorded."""
    rng = np.random.default_rng(3)
    q = np.repeat(workspace(60, rng), 4, axis=0)
    hidden = rng.choice([-0.5e-4, 0.5e-4], q.shape)
    poses = Cell(SixRods()).measure(q + hidden, rng)
    poses = replace(poses, joint=q, command=q, place=np.repeat(np.arange(60), 4))
    noise = estimate_noise(poses, slope_of(poses), ROBOT)
    expected = np.hypot(REPEATABILITY, 0.5e-4)
    assert noise.repeatability == pytest.approx(expected, rel=4 / np.sqrt(6 * noise.degrees))


def test_without_repeats_the_files_figures_are_taken_and_said():
    rng = np.random.default_rng(4)
    poses = Cell(SixRods()).measure(workspace(30, rng), rng, repeatability=50e-6)
    noise = estimate_noise(poses, slope_of(poses), ROBOT)
    assert not noise.measured
    assert noise.degrees == 0
    assert noise.repeatability == ROBOT.joints.repeatability
    alone = Cell(SixRods()).measure(workspace(30, rng), rng, count=1)
    noise = estimate_noise(alone, slope_of(alone), ROBOT)
    assert (noise.radial_scale, noise.transverse_scale) == (1.0, 1.0)


def test_one_knocked_repeat_is_not_noise():
    rng = np.random.default_rng(5)
    poses = Cell(SixRods()).measure(np.repeat(workspace(40, rng), 2, axis=0), rng)
    point = poses.point.copy()
    point[17, 1] += 2e-3
    knocked = replace(poses, point=point)
    clean, noise = (estimate_noise(p, slope_of(p), ROBOT) for p in (poses, knocked))
    assert clean.degrees == 40 - TIME
    assert noise.degrees == 39 - TIME
    assert noise.repeatability == pytest.approx(clean.repeatability, rel=0.1)
    assert noise.floor == pytest.approx(clean.floor, rel=0.1)


def test_a_gross_error_at_a_place_that_was_reached_from_both_sides_is_not_noise():
    """Three of 160 poses, off by 1 to 10 mm; no two poses have the same conditions."""
    rng = np.random.default_rng(6)
    q = np.repeat(workspace(40, rng), 4, axis=0)
    side = np.tile([[-1.0], [1.0], [-1.0], [1.0]], (40, 3))
    poses = Cell(SixRods()).measure(q - side * 0.5e-4, rng, direction=side)
    place = np.repeat(np.arange(40), 4)
    poses = replace(poses, joint=q, command=q, place=place, repeat=np.arange(160))
    point = poses.point.copy()
    point[[7, 90, 91]] += [[6e-3, -4e-3, 7e-3], [-1e-3, 0, 0], [0, 2e-3, 0]]
    wrong = replace(poses, point=point)
    clean, noise = (estimate_noise(p, slope_of(p), ROBOT) for p in (poses, wrong))
    assert clean.degrees - 6 <= noise.degrees < clean.degrees
    assert noise.repeatability == pytest.approx(clean.repeatability, rel=0.1)
    assert noise.floor == pytest.approx(clean.floor, rel=0.1)


@pytest.mark.parametrize("rest", [12e-6, 200e-6])
def test_a_rest_error_that_the_encoders_saw_is_no_noise(rest):
    """Repeats are compared at the joint angles of the encoders; only tracker noise is left."""
    rng = np.random.default_rng(6)
    command, place = np.repeat(workspace(120, rng), 2, axis=0), np.repeat(np.arange(120), 2)
    joint = command + rest * rng.standard_normal(command.shape)
    poses = Cell(SixRods(errors(rng))).measure(joint, rng, repeatability=0.0)
    poses = replace(poses, command=command, place=place, repeat=place)
    result = identify(poses, ROBOT)
    distance = np.linalg.norm(poses.point, axis=1)
    reading = (RADIAL**2 + 2 * (TRANSVERSE + PER_METRE * distance) ** 2) / 21
    assert result.noise.floor == pytest.approx(np.sqrt(reading.mean()), rel=4 / np.sqrt(6 * 104))
    assert result.noise.repeatability < 2e-6
    assert result.chi_square == pytest.approx(1, abs=4 * np.sqrt(2 / 600))


def test_what_places_and_conditions_take_is_not_counted_as_small():
    """40 places from both sides: time and side use up 48 of 120 differences, unevenly.

    The mean of 16 machines is known to 5 %. An estimate that spreads the lost degrees of freedom
    evenly over the directions is 24 % too large.
    """
    robot, found = load_robot("srbd"), []
    for seed in range(16):
        session = simulate_session(
            draw_machine(robot, seed), make_plan("identify", robot, count=40, seed=seed), seed
        )
        poses = collect(session, robot.joints.names, robot.commanded.joint_size)
        noise = prepare(poses, robot, chain_of(robot))[1]
        found.append((noise.repeatability / robot.joints.repeatability) ** 2)
    assert np.mean(found) == pytest.approx(1.0, abs=0.15)


def arm_visits(scale: float, seed: int, gap: float = 0.0):
    """An arm of six joints: 45 places once, 25 twice with sides of approach drawn at random.

    The places are drawn in a box of joint angles and computed with the arm's own forward
    kinematics; noise and play are added here.
    """
    robot, rng = load_robot("ur10"), np.random.default_rng(seed)
    model, count = robot.model(), 95
    nominal = model.parameters.nominal
    q = rng.uniform(-0.8, 0.8, (70, 6)) + model.home
    place = np.concatenate([np.arange(70), np.arange(25)])
    q = q[place]
    side = rng.choice([-1.0, 1.0], q.shape)
    x = model.forward(q, nominal)
    slope = model.velocity_jacobian(q, x, nominal)[:, :3]
    point = model.position(x) + np.array([2.0, -2.0, 0.5])  # from the tracker
    sigma = max(float(s.max()) for s in robot.tracker.sigmas(np.linalg.norm(point, axis=1)))
    rest = robot.joints.repeatability * rng.standard_normal(q.shape)
    off = np.einsum("nij,nj->ni", slope, scale * rest + gap / 2 * side)
    off += scale * sigma * rng.standard_normal(point.shape)
    poses = collect(
        simulate_session(
            draw_machine(robot, 0), make_plan("identify", robot, count=12, seed=0), 0
        ),
        robot.joints.names,
    )
    blank = {
        name: np.zeros((count, *v.shape[1:]))
        for name, v in vars(poses).items()
        if isinstance(v, np.ndarray) and len(v) == len(poses)
    }
    own = {
        "joint": q,
        "command": q,
        "point": point + off,
        "direction": side,
        "place": place,
        "repeat": np.arange(count),
        "count": np.ones(count, dtype=np.int64),
        "time": 10.0 * np.arange(count),
        "quaternion": None,
    }
    return replace(poses, **{**blank, **own}), slope, robot, sigma


@pytest.mark.parametrize("scale", [1.0, 3.0])
@pytest.mark.parametrize("gap", [0.0, 0.3e-3])
def test_a_few_visits_of_an_arm_tell_how_noisy_it_is(scale: float, gap: float):
    """25 visits cannot determine how six joints change with six sides; they tell one factor."""
    told, measured = [], []
    for seed in range(10):
        poses, slope, robot, sigma = arm_visits(scale, seed, gap)
        noise = estimate_noise(poses, slope, robot)
        measured.append(noise.measured)  # a little less does not refute the robot file
        assert noise.transverse_scale == pytest.approx(
            noise.repeatability / robot.joints.repeatability
        )
        told.append(noise.floor)
    expected = scale * np.sqrt(
        3 * sigma**2 + robot.joints.repeatability**2 * np.mean(np.sum(slope**2, axis=(1, 2)))
    )
    # 21 degrees of freedom of three coordinates each, ten times; the arm's own slope differs
    assert np.mean(told) == pytest.approx(expected, rel=0.1)
    assert all(measured) if scale > 1.0 else 1 < sum(measured) < 10
