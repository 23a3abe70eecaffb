"""The least-squares problem: its unknowns, its derivatives and its minimum."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import at_rest
from delta_calibration.errors import DataError
from delta_calibration.estimation import chain_of, solver
from delta_calibration.estimation import problem as module
from delta_calibration.estimation.fit import prepare
from delta_calibration.estimation.normal_equations import products
from delta_calibration.estimation.problem import Near
from delta_calibration.estimation.solver import _Loss, solve
from identification_bench import ROBOT, errors, found, rms
from six_rods import Cell, SixRods, workspace


def problem_of(poses, model=None):
    return prepare(poses, ROBOT, chain_of(ROBOT, model))[2]


@pytest.fixture(scope="module", name="problem")
def problem_fixture():
    return problem_of(found(0)[1])


def away(problem, rng):
    """Unknowns of a machine with errors and a reflector that is 20 mm off."""
    z = rng.standard_normal(len(problem.theta0))
    z[problem.offset_rows()] = 0.4 * rng.standard_normal(3)
    return z


def test_unknowns_and_parameters_turn_into_each_other(problem):
    z = away(problem, np.random.default_rng(1))
    np.testing.assert_allclose(problem.unknowns(problem.theta(z)), z, atol=1e-9)
    np.testing.assert_array_equal(problem.theta(0 * z), problem.theta0)


def test_slope_is_that_of_the_whitened_prediction(problem):
    part = problem.take(np.arange(0, 80, 16))
    z, h = away(part, np.random.default_rng(2)), 1e-4
    theta = part.theta(z)
    slope = part.linearized(theta).slope

    def residual(z):
        theta = part.theta(z)
        return part.linearized(theta).residual

    for k in range(len(z)):
        d = h * (np.arange(len(z)) == k)
        numeric = (residual(z - d) - residual(z + d)) / (2 * h)
        np.testing.assert_allclose(slope[..., k], numeric, atol=1e-4 * np.abs(slope).max())


def test_whitened_residuals_of_the_truth_have_unit_size():
    """With known noise and no fit, the whitened covariance is the identity."""
    rng = np.random.default_rng(3)
    cell = Cell(SixRods())
    poses = cell.measure(np.repeat(workspace(150, rng), 2, axis=0), rng)
    problem = problem_of(poses)
    missed = poses.point - cell.reading(poses.joint)
    white = (problem.whiten @ missed[..., None])[..., 0]
    covariance = white.T @ white / len(white)
    np.testing.assert_allclose(covariance, np.eye(3), atol=5 * np.sqrt(2 / len(white)))


def test_where_the_search_rests_does_not_depend_on_where_it_starts(problem):
    one = solve(problem)
    other = solve(problem, Near(away(problem, np.random.default_rng(4))))
    assert other.cost == pytest.approx(one.cost, abs=0.1)  # in units of chi square
    apart = points(one) - points(other)
    assert rms(apart) < 2e-7


def test_a_search_ends_at_a_minimum_that_is_known(problem):
    """It does not descend once more to where another search has been; elsewhere it goes on."""
    loss = _Loss(4.0)
    begin = solver._state(problem, away(problem, np.random.default_rng(4)), loss, None)
    there = solver._search(problem, loss, begin, solver.SETTLED)
    again = solver._search(problem, loss, begin, solver.SETTLED, [there])
    assert again.cost == there.cost
    assert again.evaluations < there.evaluations
    far = replace(there, z=there.z + 3.0)  # as if the known minimum were another one
    apart = solver._search(problem, loss, begin, solver.SETTLED, [far])
    assert apart.cost == there.cost
    assert apart.evaluations == there.evaluations


def test_a_platform_that_cannot_rotate_has_one_minimum_of_the_offset():
    """Three spheres: the offset is the frame's, so that no other one is tried, from anywhere."""
    problem = problem_of(found(1)[1], "rotary_delta")
    one = solve(problem)
    for side in (-1.0, 1.0):
        begin = Near(np.where(problem.offset_rows(), side, 0.0))
        other = solve(problem, begin, everywhere=True)
        assert other.cost == pytest.approx(one.cost, abs=0.1)
        assert rms(points(one) - points(other)) < 2e-7
        assert max(one.evaluations, other.evaluations) < 12  # eight starts would take twice that
    np.testing.assert_allclose(one.z[problem.offset_rows()], 0.0, atol=0.01)


def test_a_start_that_is_linearized_already_leads_to_the_same(problem):
    whole, some = solve(problem), np.arange(0, len(problem.at), 2)
    part = problem.take(some)
    known, sought = solve(part, whole.near(some)), solve(part, Near(whole.z))
    np.testing.assert_allclose(known.z, sought.z, atol=1e-6)
    assert known.cost == pytest.approx(sought.cost, abs=1e-6)


def test_a_jacobian_that_is_computed_again_leads_to_the_same(problem, monkeypatch):
    """Too many numbers to keep: blocks of 32 samples, for the fit and for its held-out parts."""
    one, some = solve(problem), np.arange(1, len(problem.at), 3)
    part = solve(problem.take(some), one.near(some))
    monkeypatch.setattr(module, "_KEPT", 0)
    monkeypatch.setattr(module, "_BLOCK", 32)
    other, begin = solve(replace(problem)), one.at.rows  # a copy, with blocks of its own
    assert isinstance(other.at.jacobian, module.Recomputed)
    assert len(list(other.at.jacobian.blocks())) == 3
    np.testing.assert_allclose(other.at.rows, begin, atol=1e-4 * np.abs(begin).max())
    np.testing.assert_allclose(other.z, one.z, atol=1e-6)
    assert other.cost == pytest.approx(one.cost, abs=1e-6)
    again = solve(problem.take(some), other.near(some))
    np.testing.assert_allclose(again.z, part.z, atol=1e-6)


@pytest.mark.parametrize("share", [0.1, 0.9])
def test_products_of_mostly_empty_rows_are_those_of_all(share):
    """Of 150 unknowns, with weights."""
    rng = np.random.default_rng(6)
    shape = 40, 3, 150
    rows = rng.standard_normal(shape) * (rng.random((40, 1, 150)) < share)
    residual, weight = rng.standard_normal(shape[:2]), rng.random(40)
    inner, along = products(residual, rows.reshape(-1, 150), weight, 0.7)
    heavy = rows * weight[:, None, None] / 0.49
    np.testing.assert_allclose(inner, np.einsum("ndk,ndl->kl", heavy, rows), atol=1e-12)
    np.testing.assert_allclose(along, np.einsum("ndk,nd->k", heavy, residual), atol=1e-12)


def test_fixed_parameters_stay(problem):
    free = np.arange(len(problem.theta0)) % 2 == 0
    solution = solve(problem.only(free))
    moved = np.linalg.solve(problem.basis, solution.theta - problem.theta0)
    np.testing.assert_allclose(moved[~free], 0, atol=1e-9)
    assert np.abs(moved[free]).max() > 0.1


def test_a_machine_as_drawn_stays_as_drawn():
    """Noise moves no part by more than two tolerances, and the prediction by less than 8 um."""
    rng = np.random.default_rng(5)
    cell = Cell(SixRods())
    poses = cell.measure(np.repeat(workspace(30, rng), 2, axis=0), rng)
    solution = solve(problem_of(poses))
    chain, theta = solution.problem.chain, solution.theta
    assert np.abs(solution.z[chain.layout.geometry]).max() < 2
    q = workspace(100, rng)
    assert rms(chain.predict(at_rest(q), theta) - cell.reading(q)) < 8e-6


def test_loss_by_distance():
    """Quadratic, then linear, then constant, and continuous; the weight is rho' / 2 d."""
    loss, d = _Loss(4.0, 12.0), np.array([0.0, 3.0, 4.0, 8.0, 12.0, 12.1, 1e4])
    rho, weight = judged(loss, d)
    np.testing.assert_allclose(rho, [0, 9, 16, 48, 80, 80, 80])
    np.testing.assert_allclose(weight, [1, 1, 1, 0.5, 1 / 3, 0, 0])
    h, d = 1e-6, np.linspace(0.5, 11.7, 30)
    slope = (judged(loss, d + h)[0] - judged(loss, d - h)[0]) / (2 * h)
    np.testing.assert_allclose(slope, 2 * d * judged(loss, d)[1], rtol=1e-6)
    plain, believed = judged(_Loss(), d)
    np.testing.assert_allclose(plain, d**2)
    np.testing.assert_array_equal(believed, 1)


def judged(loss, distance):
    """Loss and weight of single poses at these whitened distances."""
    way = np.array([0.6, 0.0, 0.8])
    weight, cost = zip(*(loss.judge(d * way[None]) for d in distance), strict=True)
    return np.array(cost) * loss.spread**2, np.concatenate(weight)


def test_a_little_far_is_believed_less_and_far_not_at_all(problem):
    clean, missed = solve(problem), np.array([0.6, 0.0, 0.8])
    weights, moved = [], []
    for far in (25e-6, 10e-3, 20e-3):
        (poses,) = problem.measured
        y = problem.y.copy()
        y[40] += far * missed
        astray = replace(poses, observation=replace(poses.observation, point=y))
        solution = solve(replace(problem, measured=(astray,)))
        weights.append(solution.weight[40])
        moved.append(rms(points(solution) - points(clean)))
    assert 0 < weights[0] < 1
    assert weights[1:] == [0, 0]
    assert moved[1] == pytest.approx(moved[2], abs=1e-8)
    assert max(moved) < 5e-6


def points(solution):
    problem = solution.problem
    return problem.chain.predict(problem.at, solution.theta)


def test_a_start_out_of_reach_is_refused_by_pose():
    rng = np.random.default_rng(6)
    poses = Cell(SixRods(errors(rng))).measure(workspace(20, rng), rng)
    problem = problem_of(poses, "rotary_delta")
    z = np.zeros(len(problem.theta0))
    for leg in (1, 2, 3):
        z[problem.chain.parameters.row(f"rod_{leg}")] = -3500.0  # 0.7 m too short
    with pytest.raises(DataError, match=r"pose 1 of 20 cannot be reached .* joints .* rad"):
        solve(problem, Near(z))
