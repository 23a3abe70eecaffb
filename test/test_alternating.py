"""Tests of residuals in joint coordinates; paper 002's procedure against a simultaneous fit.

The machines are those of `cables.py` and `six_rods.py`, which share no code with the package.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from cables import (
    EIGHT_CABLES,
    FOUR_CABLES,
    TOLERANCES,
    ZEROS_FREE,
    built,
    geometry_of,
    workspace,
)
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import whitening
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import CableRobot, RotaryDelta, SixRodDelta
from delta_calibration.papers import JointProblem, alternate, fit_together, joint_covariance
from identification_bench import ROBOT

TURN, PLACE = np.array([0.2, -0.1, 1.0]), np.array([3.0, 0.5, -0.2])
POSE, ENCODER = 50e-6, 1e-3  # noise: [m] and [rad] of the measuring device, [rad] of a motor


@lru_cache
def measured(cables=8, free_zeros=False, priors=False, noise=1.0, seed=0):
    """A problem, and the true parameters of the machine on which it was measured."""
    rng = np.random.default_rng(seed)
    dimensions = {8: EIGHT_CABLES, 4: FOUR_CABLES}[cables]
    offsets = rng.normal(0, 5e-3, cables) if free_zeros else 0.0
    real = built(dimensions, rng, offsets=offsets)
    x = workspace(dimensions, 40, rng)
    q = real.motors(x) + noise * rng.normal(0, ENCODER, (40, cables))
    y = real.seen_from(TURN, PLACE, x) + noise * rng.normal(0, POSE, x.shape)
    robot = CableRobot(dimensions, ZEROS_FREE if free_zeros else TOLERANCES)
    covariance = joint_covariance(robot, x, POSE**2 * np.eye(x.shape[1]), ENCODER)
    return JointProblem(robot, q, y, whitening(covariance), priors), geometry_of(real, free_zeros)


def apart(problem, one, other) -> float:
    """Largest difference of two fits, in expected sizes."""
    frame = (one.frame.inverse() @ other.frame).vector()
    change = np.append(one.geometry - other.geometry, frame)
    return np.abs(change / problem.scale).max()


def test_residual_is_zero_for_the_machine_written_apart():
    problem, truth = measured(noise=0.0)
    frame = Frame(Rotation.from_rotvec(TURN).as_matrix(), PLACE)
    np.testing.assert_allclose(problem.residual(truth, frame), 0, atol=1e-9)
    fit = fit_together(problem)
    np.testing.assert_allclose((fit.geometry - truth) / problem.scale[:-6], 0, atol=1e-6)


@pytest.mark.parametrize("cables", [8, 4])
def test_slopes_are_those_of_the_residual(cables):
    problem, truth = measured(cables, True)
    frame = Frame(Rotation.from_rotvec(TURN).as_matrix(), PLACE)
    slopes = problem.slopes(truth, frame)

    def residual(change):
        moved = frame @ Frame.from_vector(change[-6:])
        return problem.residual(truth + change[:-6], moved)

    for k, d in enumerate(np.diag(1e-2 * problem.scale)):
        numeric = (residual(-d) - residual(d)) / (2 * d[k])
        np.testing.assert_allclose(slopes[..., k], numeric, atol=1e-5 * np.abs(numeric).max())


@pytest.mark.parametrize("priors", [False, True])
def test_in_turn_and_at_once_give_the_same_answer_at_other_costs(priors):
    """Eight cables, counters zero at home: no gauge freedom, all 62 unknowns are identifiable."""
    problem, truth = measured(priors=priors)
    both, turns = fit_together(problem), alternate(problem)
    assert apart(problem, both, turns) < 1e-4
    assert turns.cost == pytest.approx(both.cost, abs=1e-4)
    assert (both.observability.rank, both.observability.columns) == (62, 62)
    assert not both.observability.redundancies
    assert (both.rounds, turns.rounds) == (1, pytest.approx(45, abs=15))
    assert turns.evaluations > 15 * both.evaluations
    assert turns.slopes > 15 * both.slopes
    nominal = problem.mechanism.parameters.nominal
    missed = np.abs((both.geometry - truth) / problem.scale[:-6])
    assert missed.max() < 0.2 < np.abs((nominal - truth) / problem.scale[:-6]).max()


def test_chi_square_is_that_of_the_noise():
    """To first order residuals are the pose noise in the joints: 320 residuals, 62 unknowns."""
    low, high = chi2.interval(1 - 1e-4, 8 * 40 - 62)
    assert low < fit_together(measured()[0]).cost < high


@pytest.mark.parametrize(
    ("cables", "free", "rank", "columns"),
    [(8, True, 64, 70), (4, False, 19, 22), (4, True, 20, 26)],
)
def test_rank_and_gauge_with_the_frame(cables, free, rank, columns):
    """Free zeros: the whole frame is gauge. A point with known home: a turn about home is."""
    problem, _ = measured(cables, free)
    seen = fit_together(problem).observability
    assert (seen.rank, seen.columns) == (rank, columns)
    assert len(seen.redundancies) == columns - rank
    assert all(r.parameter.startswith("robot_") for r in seen.redundancies)


def test_a_gauge_stays_where_it_was_in_turn_and_the_prediction_is_the_same():
    """The frame never moves: the geometry absorbs its whole error, and both stop at once."""
    problem, _ = measured(8, True)
    both, turns = fit_together(problem), alternate(problem)
    assert turns.rounds <= 3
    assert turns.cost == pytest.approx(both.cost, abs=1e-3)
    assert apart(problem, both, turns) > 0.05
    start = problem.start_frame()
    assert np.abs((start.inverse() @ turns.frame).vector()).max() < 1e-6
    np.testing.assert_allclose(turns.residual, both.residual, atol=1e-5)


def test_in_turn_says_where_it_does_not_come_to_rest():
    """Only priors fix the gauge, so slowly that no number of rounds is sufficient."""
    with pytest.raises(DataError, match=r"still move by .* after 5 rounds; under 1e-06"):
        alternate(measured(8, True, True)[0], rounds=5)


def test_a_far_frame_is_found_as_well():
    """Start half a metre and twenty degrees off, as if measured by hand."""
    problem, _ = measured()
    near = fit_together(problem)
    far = near.frame @ Frame.from_vector(np.array([0.2, -0.2, 0.2, 0.3, -0.3, 0.3]))
    assert apart(problem, near, fit_together(problem, far)) < 1e-6


def test_any_mechanism_with_an_explicit_inverse_problem():
    """A three-sphere Delta: all of its 24 parameters are identifiable and include the frame."""
    rng = np.random.default_rng(3)
    delta = RotaryDelta(ROBOT.dimensions, ROBOT.tolerances)
    parameters, q = delta.parameters, rng.uniform(-0.2, 1.0, (50, 3))
    truth = parameters.nominal + parameters.prior * rng.standard_normal(len(parameters))
    y = delta.forward(q, truth) @ Rotation.from_rotvec(TURN).as_matrix().T + PLACE
    problem = JointProblem(delta, q, y, np.tile(np.eye(3) / 1e-5, (50, 1, 1)))
    both, turns = fit_together(problem), alternate(problem, still=1e-3)
    assert both.rms < 1e-6  # remaining influence of the priors at 1e-5 rad of noise
    assert turns.rms < 1e-6
    assert (both.observability.rank, both.observability.columns) == (24, 30)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"mechanism": SixRodDelta(ROBOT.dimensions, ROBOT.tolerances)},
            "six_rod_delta: 6 closures for 3 joints and 6 coordinates .* one closure a joint",
        ),
        ({"pose": np.zeros((40, 3))}, r"pose: \(40, 3\) is not allowed; \(40, 6\), finite"),
        ({"joint": np.full((40, 8), np.nan)}, r"joint: \(40, 8\) is not allowed; .* finite"),
    ],
)
def test_what_has_no_residual_is_refused(change, message):
    problem, _ = measured()
    parts = {n: getattr(problem, n) for n in ("mechanism", "joint", "pose", "whiten")}
    with pytest.raises(InputError, match=message):
        JointProblem(**{**parts, **change})


def test_too_few_poses_are_refused():
    problem, _ = measured()
    few = JointProblem(problem.mechanism, problem.joint[:7], problem.pose[:7], problem.whiten[:7])
    with pytest.raises(DataError, match=r"7 measured poses of 8 joints .* 62 unknowns; 8 or more"):
        fit_together(few)


def test_joints_out_of_reach_are_refused_by_number():
    problem, _ = measured()
    joint = problem.joint.copy()
    joint[4, 0] += 400.0
    torn = JointProblem(problem.mechanism, joint, problem.pose, problem.whiten)
    with pytest.raises(DataError, match=r"recorded joint command 5 .* out of the robot's reach"):
        fit_together(torn)
