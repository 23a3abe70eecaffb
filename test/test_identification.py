"""Machines of an independent six-rod model are identified within the claimed uncertainty."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, chi2

from delta_calibration.data import collect
from delta_calibration.errors import DataError
from delta_calibration.estimation import identify, parts_of
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, effect_options, simulate_session
from identification_bench import PARAMETERS, ROBOT, errors, found, prediction, rms
from six_rods import Cell, SixRods, drawing_joints, workspace

SESSIONS = Path(__file__).parents[2] / "shared" / "sessions"
MACHINES = 6
A_TENTH = (3, 17, 18, 41, 60, 66, 71, 79)


@pytest.mark.parametrize("seed", range(2))
def test_a_machine_is_found_where_it_was_not_measured(seed):
    """At new places the prediction errs by about 5 um, less than 0.7 of the noise floor.

    The frame alone leaves more than ten times the noise floor.
    """
    cell, _, result = found(seed)
    q = workspace(300, np.random.default_rng(100 + seed))
    assert rms(prediction(result, q) - cell.reading(q)) < 0.7 * result.noise.floor
    assert result.frame_only.held_out > 10 * result.noise.floor
    assert result.full.held_out < 1.3 * result.noise.floor
    assert result.full.in_sample < result.full.held_out < result.full.held_out_max
    # 38 identifiable combinations from 192 coordinates: the prediction error has 38 / 154 of the
    # variance of the noise
    assert result.full.held_out_whitened == pytest.approx(np.sqrt(1 + 38 / 154), abs=0.2)
    assert result.chi_square == pytest.approx(1, abs=0.25)


def combinations(cell, poses, result):
    """Errors of the 38 identifiable combinations, divided by their claimed standard errors.

    The combinations are the independent directions of the claimed covariance of the prediction at
    the measured places. The truth comes from the other model, so the gauge does not matter.
    """
    jacobian = result.chain.jacobian(poses.conditions, result.theta)
    jacobian = jacobian.reshape(-1, len(result.theta))
    values, axes = np.linalg.eigh(jacobian @ result.covariance @ jacobian.T)
    error = (prediction(result, poses.joint) - cell.reading(poses.joint)).reshape(-1)
    return (axes.T @ error)[-38:] / np.sqrt(values[-38:])


@pytest.mark.slow
def test_claimed_standard_errors_are_those_of_many_machines():
    z = np.array([combinations(*found(seed)) for seed in range(MACHINES)])
    inside = int((np.abs(z) < 1.96).sum())
    low, high = binom.interval(1 - 1e-4, z.size, 0.95)
    assert low <= inside <= high
    low, high = chi2.interval(1 - 1e-4, z.size)
    assert low <= np.sum(z**2) <= high


def test_what_the_data_do_not_set_stays_as_uncertain_as_before():
    """Base and platform joint moved together have no effect; a large misfit must not shrink that.

    Their common position keeps the standard deviation of its prior.
    """
    rng = np.random.default_rng(6)
    q = np.repeat(workspace(20, rng), 4, axis=0)
    side = np.tile([1.0, 1.0, -1.0, -1.0], 20)[:, None] * np.ones(3)
    poses = Cell(SixRods(errors(rng))).measure(q - side * 1.5e-4, rng, direction=side)
    poses = replace(poses, joint=q, command=q, place=np.repeat(np.arange(20), 4))
    result = identify(poses, ROBOT)
    assert result.chi_square > 20  # because of a backlash that is not in the model
    along = np.zeros(len(result.theta))
    along[[PARAMETERS.row("base_radial_1"), PARAMETERS.row("platform_radial_1")]] = np.sqrt(0.5)
    std = np.sqrt(along @ result.covariance @ along)
    assert std == pytest.approx(ROBOT.tolerances.joint_position, rel=0.02)
    assert result.std[PARAMETERS.row("joint_zero_1")] < 2 * ROBOT.tolerances.joint_zero


@pytest.mark.parametrize(
    ("rows", "size"),
    [((17,), 5e-4), ((17,), 20e-3), ((17,), 0.2), (A_TENTH, 5e-3)],
    ids=["half a millimetre", "twenty", "another reflector", "a tenth of the poses"],
)
def test_knocked_poses_are_set_aside_and_do_no_harm(rows, size):
    """The result is that of the other poses: same prediction, standard errors and chi square."""
    cell, poses, _ = found(0)
    point, rng = poses.point.copy(), np.random.default_rng(12)
    way = rng.standard_normal((len(rows), 3))
    point[list(rows)] += size * way / np.linalg.norm(way, axis=1, keepdims=True)
    result = identify(replace(poses, point=point), ROBOT)
    others = np.setdiff1d(np.arange(len(poses)), rows)
    without = identify(poses.take(others), ROBOT)
    assert (result.weight[list(rows)] == 0).all()
    assert (result.weight[others] > 0.5).all()
    q = workspace(200, np.random.default_rng(7))
    assert rms(prediction(result, q) - prediction(without, q)) < 0.5e-6
    assert rms(prediction(result, q) - cell.reading(q)) < 0.6 * result.noise.floor
    assert result.chi_square == pytest.approx(without.chi_square, abs=0.05)
    geometry = slice(len(PARAMETERS))
    np.testing.assert_allclose(result.std[geometry], without.std[geometry], rtol=0.1)


def test_frame_alone_is_the_nominal_machine_and_stands_beside():
    _, poses, result = found(1)
    nominal = PARAMETERS.nominal
    np.testing.assert_array_equal(result.frame_only_theta[:66], nominal)
    np.testing.assert_array_equal(result.frame_only_theta[66:69], 0)
    fitted = result.chain.predict(poses.conditions, result.frame_only_theta)
    assert rms(fitted - poses.point) == pytest.approx(result.frame_only.in_sample)
    assert result.frame_only.in_sample > 10 * result.full.in_sample


def test_the_same_data_give_the_same_answer_and_the_seed_is_of_the_folds_only():
    _, poses, _ = found(1)
    result, again, other = (identify(poses, ROBOT, "rotary_delta", seed) for seed in (0, 0, 1))
    np.testing.assert_array_equal(again.theta, result.theta)
    np.testing.assert_array_equal(other.theta, result.theta)
    assert again.full == result.full
    assert other.full.in_sample == result.full.in_sample
    assert other.full.held_out != result.full.held_out


def test_a_place_is_held_out_whole():
    """If one visit of a place were fitted and the other held out, the error would be too small."""
    _, poses, _ = found(1)
    part = parts_of(poses, 3)
    assert len(np.unique(poses.place)) < len(poses)
    assert all(len(np.unique(part[poses.place == place])) == 1 for place in poses.place)
    assert np.unique(part).tolist() == [0, 1, 2, 3, 4]
    assert (part != parts_of(poses, 4)).any()


def test_a_pose_that_does_not_count_is_not_in_the_error_left():
    _, poses, _ = found(1)
    fit = identify(poses, ROBOT, "rotary_delta")
    point = poses.point.copy()
    point[10] += [5e-3, 0.0, 0.0]
    result = identify(replace(poses, point=point), ROBOT, "rotary_delta")
    assert np.flatnonzero(result.weight == 0).tolist() == [10]
    assert result.full.held_out == pytest.approx(fit.full.held_out, rel=0.1)


# Refused or flagged


def test_a_wrong_model_is_flagged():
    """Rods that differ by 0.5 mm tilt the platform; the three-sphere model cannot describe it."""
    rng = np.random.default_rng(8)
    mismatch = {"rod_mismatch_1": 5e-4, "rod_mismatch_2": -5e-4, "rod_mismatch_3": 5e-4}
    cell = Cell(SixRods({**errors(rng), **mismatch}), (30e-3, 20e-3, 10e-3))
    poses = cell.measure(np.repeat(workspace(40, rng), 2, axis=0), rng)
    spheres, rods = identify(poses, ROBOT, "rotary_delta"), identify(poses, ROBOT, "six_rod_delta")
    assert spheres.chi_square > 5
    assert spheres.full.held_out_whitened > 2
    assert rods.chi_square < 1.5


@pytest.mark.parametrize("part", ["base_radius", "platform_radius"])
@pytest.mark.parametrize("by", [60e-3, -50e-3])
def test_another_robot_is_refused_in_words(part, by):
    _, poses, _ = found(0)
    sizes = ROBOT.dimensions
    other = replace(ROBOT, dimensions=replace(sizes, **{part: getattr(sizes, part) + by}))
    with pytest.raises(
        DataError, match=r"made: \d+\.\d mm .robust RMS. remain .* 'srbd' .* another robot"
    ):
        identify(poses, other)


def test_another_robot_is_refused_wherever_a_fit_would_put_the_reflector():
    """Rods of another robot: the fit would place the reflector metres away from the platform."""
    robot = load_robot("srbd")
    plan = make_plan("identify", robot, count=60, seed=7)
    poses = collect(simulate_session(draw_machine(robot, 7), plan, 7), robot.joints.names)
    short = replace(robot, dimensions=replace(robot.dimensions, rod=0.5))
    with pytest.raises(DataError, match=r"remain between .* another robot"):
        identify(poses, short)


def test_pulleys_make_no_other_robot():
    """They move it by more than four times what the tolerances do."""
    robot = load_robot("cdpr8")
    pulleys = effect_options("pulley_radius:value=0.12")
    plan = make_plan("identify", robot, count=24, seed=1)
    session = simulate_session(draw_machine(robot, 1, 0.3, [pulleys]), plan, 1)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    assert identify(poses, robot).frame_only.in_sample > 0.012
    with pytest.raises(DataError, match=r"remain between .* another robot"):
        identify(replace(poses, joint=poses.joint[:, ::-1]), robot)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda p: {"point": p.point * 1e3}, "another robot, .* units different"),
        (lambda p: {"joint": np.degrees(p.joint)}, "out of the robot's reach|units different"),
        (lambda p: {"joint": -p.joint}, "another robot"),
        (lambda p: {"joint": p.joint[:, [1, 0, 2]]}, "another robot"),
        (lambda p: {"point": 0 * p.point}, "points that do not lie on one line"),
    ],
    ids=["millimetres", "degrees", "sign", "order", "zeros"],
)
def test_data_of_another_form_are_refused_in_words(change, message):
    _, poses, _ = found(0)
    with pytest.raises(DataError, match=message):
        identify(replace(poses, **change(poses)), ROBOT)


def test_too_few_places_are_refused_however_often_measured():
    _, poses, _ = found(0)
    with pytest.raises(DataError, match="11 different poses at rest, 12 or more"):
        identify(
            poses.take(np.flatnonzero(np.isin(poses.place, np.unique(poses.place)[:11]))), ROBOT
        )


# Real sessions


@pytest.mark.skipif(
    not SESSIONS.exists(), reason="the five sessions are not beside this repository"
)
def test_kept_session_without_a_cause():
    poses = collect(read_session(SESSIONS / "none"), ROBOT.joints.names)
    six, three = identify(poses, ROBOT), identify(poses, ROBOT, "rotary_delta")
    for result, rank in ((six, 38), (three, 24)):
        assert 7.5e-6 < result.noise.floor < 9.5e-6
        assert result.full.held_out <= 1.2 * result.noise.floor
        assert result.observability.rank == rank
        assert result.frame_only.held_out > 1e-4


# Assumptions of the design


def test_the_papers_line_on_machines_with_a_real_ones_errors():
    """Median machine: mean error 0.84 mm on x = -y, z = -711 mm, largest 1.5, 95th percentile 2.9.

    Standard deviations: joint positions 0.25 mm per coordinate (hinge and platform joint
    together), arms 0.15 mm, rods 0.2 mm, zero offsets 0.8 mrad. The errors are those in the
    *nominal* frame. In the best-fit frame of the line less than a third of them is left, so the
    paper cannot mean that frame.
    """
    x = np.linspace(-0.45, 0.45, 61)
    line = np.stack([x, -x, np.full_like(x, -0.711)], axis=1)
    q, rng = drawing_joints(line), np.random.default_rng(9)
    sizes = dict.fromkeys(("base_radial", "base_tangential", "base_height"), 0.25e-3)
    sizes |= {"arm": 0.15e-3, "rod": 0.2e-3, "joint_zero": 0.8e-3}
    mean, largest, registered = [], [], []
    for _ in range(300):
        wrong = {
            f"{p}_{leg}": s * rng.standard_normal() for leg in (1, 2, 3) for p, s in sizes.items()
        }
        point = SixRods(wrong).point(q)
        error = np.linalg.norm(point - line, axis=1)
        meant, is_at = line - line.mean(axis=0), point - point.mean(axis=0)
        u, _, vt = np.linalg.svd(is_at.T @ meant)
        turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
        left = is_at - meant @ turn.T
        mean.append(error.mean())
        largest.append(error.max())
        registered.append(np.linalg.norm(left, axis=1).mean())
    assert np.median(mean) == pytest.approx(0.84e-3, rel=0.12)
    assert np.median(largest) == pytest.approx(1.5e-3, rel=0.15)
    assert np.percentile(largest, 95) == pytest.approx(2.9e-3, rel=0.2)
    assert np.median(registered) < np.median(mean) / 3
