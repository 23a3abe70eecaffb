"""Identification by swarms: update laws, stepwise searches, residual of measured poses."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import observe
from delta_calibration.mechanisms import RotaryDelta, SixRodDelta
from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
from delta_calibration.papers import (
    Apso,
    Box,
    LinearResidual,
    PoseResidual,
    Pso,
    Qpso,
    Settled,
    SwarmSettings,
    all_singular,
    in_rounds,
    least_squares,
    minimise,
    stepwise,
    stepwise_singular,
)
from delta_calibration.papers.swarm import Swarm
from delta_calibration.robot import load_robot

LAWS = (Qpso(), Pso(), Apso())
each_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
UNIT = Box.about_zero(np.ones(3))
SRBD = DeltaDimensions(0.2, 0.055, 0.32, 0.85, 0.04)
PARTS = DeltaTolerances(0.25e-3, 0.15e-3, 0.2e-3, 0.1e-3, 0.8e-3, 0.5e-3, 0.05e-3, 1e-3)


def mechanisms():
    built = [RotaryDelta(SRBD, PARTS), SixRodDelta(SRBD, PARTS)]
    return [*built, load_robot("five_axis").model()]


each_mechanism = pytest.mark.parametrize("mechanism", mechanisms(), ids=lambda m: m.name)


def rng(seed=0):
    return np.random.default_rng(seed)


def bowl(centre):
    return lambda x: np.linalg.norm(x - centre, axis=1)


def swarm_at(x, own, norm, v=None):
    return Swarm(x, np.zeros_like(x) if v is None else v, own, norm)


@each_law
def test_every_law_finds_the_bottom_of_a_bowl(law):
    centre = np.array([0.3, -2.0, 0.05])
    box = Box(np.array([-1.0, -5.0, 0.0]), np.array([1.0, 1.0, 0.2]))
    found = minimise(bowl(centre), box, SwarmSettings(law=law), rng())
    np.testing.assert_allclose(found.best, centre, atol=1e-5)
    assert found.norm == bowl(centre)(found.best[None])[0]
    assert found.evaluations == 80 * 300
    assert len(found.history) == 300
    assert (np.diff(found.history) <= 0).all()


@each_law
def test_chance_comes_from_the_generator_alone(law):
    settings = SwarmSettings(10, 20, law)
    first, again, other = (
        minimise(bowl(np.full(3, 0.2)), UNIT, settings, rng(seed)).best for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(first, again)
    assert (first != other).all()


@each_law
def test_no_particle_leaves_the_box(law):
    asked = []

    def far_outside(x):
        asked.append(x)
        return np.linalg.norm(x - 9.0, axis=1)

    found = minimise(far_outside, UNIT, SwarmSettings(20, 60, law), rng())
    assert np.abs(np.concatenate(asked)).max() == 1.0
    np.testing.assert_allclose(found.best, 1.0)
    assert {len(x) for x in asked} == {20}  # all particles in one call


def test_a_given_start_is_never_lost():
    start = np.array([0.1, 0.2, 0.3])
    found = minimise(bowl(start), UNIT, SwarmSettings(5, 2), rng(), start)
    np.testing.assert_allclose(found.best, start, atol=1e-15)


def test_quantum_moves_are_exponential_about_the_attractor():
    """With all bests at c the move is to c +- a |c - x| ln(1/u), where a falls from 1 to 0.5."""
    n = 200_000
    own, x = np.full((n, 1), 0.2), np.full((n, 1), -0.1)
    swarm = swarm_at(x, own, np.ones(n))
    for progress, contraction in ((0.0, 1.0), (0.5, 0.75), (1.0, 0.5)):
        there = x + Qpso().move(swarm, progress, rng(3)) - 0.2
        assert np.abs(there).mean() == pytest.approx(0.3 * contraction, rel=0.02)
        assert np.mean(there > 0) == pytest.approx(0.5, abs=0.01)
        # exponential distribution: standard deviation equals mean
        assert np.abs(there).std() == pytest.approx(0.3 * contraction, rel=0.02)


def test_quantum_attractors_lie_evenly_between_own_best_and_leader():
    n = 100_000
    own = np.full((n, 1), 0.8)
    own[0] = -0.4
    mean = own.mean()
    swarm = swarm_at(np.full((n, 1), mean), own, np.r_[0.0, np.ones(n - 1)])  # |c - x| is zero
    there = (swarm.x + Qpso().move(swarm, 0.0, rng(4)))[1:]
    assert (there.min(), there.max()) == pytest.approx((-0.4, 0.8), abs=1e-3)
    assert there.mean() == pytest.approx(0.2, abs=0.01)
    assert there.std() == pytest.approx(1.2 / np.sqrt(12), rel=0.02)


def test_inertia_falls_by_the_clock_or_with_the_swarm():
    x, v = np.zeros((16, 2)), np.full((16, 2), 0.01)
    together = swarm_at(x, x, np.ones(16), v)  # no attraction: inertia only
    for progress, w in ((0.0, 0.9), (1.0, 0.4)):
        np.testing.assert_allclose(Pso().move(together, progress, rng()), w * v)
    np.testing.assert_allclose(Apso().move(together, 0.0, rng()), 0.4 * v)
    evenly = np.tile((np.arange(16) + 0.5) / 8 - 1, (2, 1)).T
    spread = swarm_at(evenly, evenly, np.ones(16), v)
    still = Apso(cognitive=0.0, social=0.0).move(spread, 0.0, rng())
    np.testing.assert_allclose(still, 1 / (1 + 1.5 * np.exp(-2.6)) * v, rtol=1e-12)


@pytest.mark.parametrize("law", LAWS[1:], ids=["Pso", "Apso"])
def test_speed_is_bounded(law):
    x = rng(5).uniform(-1, 1, (50, 4))
    moves = law.move(swarm_at(x, -x, np.arange(50.0)), 0.0, rng())
    assert np.abs(moves).max() == pytest.approx(0.2)  # a tenth of the box


def test_places_out_of_reach_are_never_remembered():
    def half(x):
        return np.where(x[:, 0] < 0, np.nan, np.linalg.norm(x + 0.5, axis=1))

    found = minimise(half, UNIT, SwarmSettings(), rng())
    np.testing.assert_allclose(found.best, [0.0, -0.5, -0.5], atol=1e-3)
    with pytest.raises(DataError, match="no particle of the swarm reached parameters with which"):
        minimise(lambda x: np.full(len(x), np.nan), UNIT, SwarmSettings(5, 5), rng())


def test_settings_that_cannot_be_are_refused():
    with pytest.raises(InputError, match="particles is 1; it has to be a whole number"):
        SwarmSettings(particles=1)
    with pytest.raises(InputError, match=r"iterations is 1\.5; .* at least 1"):
        SwarmSettings(iterations=1.5)
    with pytest.raises(InputError, match=r"parameter 2 goes from 1 to 1; .*the second larger"):
        Box(np.array([0.0, 1.0]), np.ones(2))
    with pytest.raises(InputError, match="parameter 1 goes from -inf to inf; both must be"):
        Box.about_zero(np.array([np.inf]))
    with pytest.raises(InputError, match=r"settled in a window of 1 within 0\.1"):
        Settled(window=1, tolerance=0.1)


def ill(condition=500.0, size=8, seed=7):
    """A linear residual with this condition number in random directions, and its solution."""
    draws = rng(seed)
    u, v = (np.linalg.qr(draws.standard_normal((size, size)))[0] for _ in range(2))
    factor = u * np.geomspace(1.0, 1.0 / condition, size) @ v
    truth = draws.uniform(-0.6, 0.6, size)
    return LinearResidual(factor, factor @ truth, 0.0), truth


def test_stepwise_frees_parameters_one_by_one_and_then_all():
    residual, truth = ill(condition=1.5)
    moving = []

    def watched(x):
        moving.append(int((np.ptp(x, axis=0) > 0).sum()))
        return residual(x)

    box = Box.about_zero(np.ones(8))
    found = stepwise(watched, box, SwarmSettings(), rng(), Settled(20, 1e-2))
    np.testing.assert_allclose(found.best, truth, atol=1e-3)
    order = [m for m, last in zip(moving, [0, *moving], strict=False) if m != last]
    assert order == [8, 7, 6, 5, 4, 3, 2, 1, 8]
    assert found.evaluations == 80 * len(moving) == 80 * len(found.history)
    assert found.norm == pytest.approx(residual(found.best[None])[0], abs=1e-15)
    assert found.evaluations <= 9 * 80 * 300


def test_the_parameter_that_settled_is_frozen_and_the_last_search_begins_from_all_of_them():
    weight, truth = np.array([1e-3, 1.0, 1e-6]), np.array([0.3, -0.4, 0.5])
    asked = []

    def watched(x):
        asked.append(x)
        return np.linalg.norm(weight * (x - truth), axis=1)

    stepwise(watched, UNIT, SwarmSettings(), rng(), Settled(30, 1e-3))
    frozen = [tuple(np.flatnonzero(np.ptp(x, axis=0) == 0)) for x in asked]
    order = [f for f, last in zip(frozen, [None, *frozen], strict=False) if f != last]
    assert order == [(), (1,), (0, 1), ()]  # the strongest parameter first
    last = max(k for k, f in enumerate(frozen) if f == (0, 1))
    np.testing.assert_array_equal(asked[last][0, :2], asked[last + 1][0, :2])


def test_a_parameter_has_settled_when_its_best_value_stays():
    trace = np.zeros((30, 2))
    trace[:, 0] = np.linspace(0, 1, 30)
    trace[:12, 1] = 0.5
    rule = Settled(window=10, tolerance=0.01)
    assert not rule.by_any(trace[:9])  # too early
    assert rule.by_any(trace[:11])
    assert not rule.by_any(trace[:14])  # it has just moved by a quarter of the box
    assert rule.by_any(trace)
    np.testing.assert_allclose(rule.moved(trace), [9 / 29 / 2, 0.0])


def test_singular_directions_one_by_one_do_not_mind_the_condition():
    residual, truth = ill()
    box = Box.about_zero(np.ones(8))
    settings = SwarmSettings(iterations=120)
    turned = stepwise_singular(residual, residual.factor, box, settings, rng())
    np.testing.assert_allclose(turned.best, truth, atol=1e-6)
    assert turned.evaluations == 8 * 80 * 120
    together = all_singular(residual, residual.factor, box, SwarmSettings(), rng())
    np.testing.assert_allclose(together.best, truth, atol=1e-4)
    raw = stepwise(residual, box, SwarmSettings(), rng())
    assert np.abs(raw.best - truth).max() > 0.01


def test_boxes_off_zero_and_of_unequal_sides():
    residual, truth = ill(condition=30.0)
    width = np.geomspace(1.0, 3.0, 8)
    box = Box(truth - 0.7 * width, truth + 0.4 * width)
    for search in (stepwise_singular, all_singular):
        found = search(residual, residual.factor, box, SwarmSettings(), rng())
        np.testing.assert_allclose(found.best, truth, atol=1e-3)


def test_a_direction_that_moves_nothing_stays_in_the_middle_of_the_box():
    factor = np.diag([1.0, 0.5, 0.0])
    residual = LinearResidual(factor, factor @ np.array([0.3, -0.4, 0.0]), 0.0)
    box = Box(np.array([-1.0, -1.0, 0.0]), np.array([1.0, 1.0, 0.5]))
    found = stepwise_singular(residual, factor, box, SwarmSettings(iterations=120), rng())
    np.testing.assert_allclose(found.best, [0.3, -0.4, 0.25], atol=1e-9)


def measured(mechanism, size=0.1, n=40, seed=0):
    """Residual of the poses of a machine with small errors, and the true errors."""
    draws = rng(seed)
    middle = np.array([0.3, 0.3, 0.3]) if mechanism.joints == 3 else mechanism.home
    reach = 0.4 if mechanism.joints == 3 else 0.05
    joint = middle + draws.uniform(-reach, reach, (n, mechanism.joints))
    nominal, prior = mechanism.parameters.nominal, mechanism.parameters.prior
    names = mechanism.parameters.names
    drawn = mechanism.forward(joint, nominal)
    jacobian = mechanism.identification_jacobian(joint, drawn, nominal)
    hidden = {r.parameter for r in observe(jacobian, prior, names).redundancies}
    hidden |= {p.name for p in mechanism.parameters if not p.drawn}
    free = np.array([row for row, name in enumerate(names) if name not in hidden])
    truth = size * prior[free] * draws.standard_normal(len(free))
    actual = nominal.copy()
    actual[free] += truth
    pose = mechanism.forward(joint, actual)
    k = mechanism.pose_size
    weight = np.broadcast_to(np.diag(1.0 + np.arange(k)), (n, k, k))
    return PoseResidual(mechanism, joint, pose, weight, free), truth


@each_mechanism
def test_pose_residual_is_zero_at_the_truth_and_the_pose_error_elsewhere(mechanism):
    residual, truth = measured(mechanism)
    nowhere = residual(np.zeros((1, len(truth))))[0]
    assert residual(truth[None])[0] < 1e-9 * nowhere
    drawn = mechanism.forward(residual.joint, mechanism.parameters.nominal)
    np.testing.assert_allclose(
        residual.errors(np.zeros((1, len(truth)))).reshape(drawn.shape),
        (1.0 + np.arange(mechanism.pose_size)) * (residual.pose - drawn),
        atol=2e-3 * np.abs(residual.pose - drawn).max(),
    )


@each_mechanism
def test_the_error_model_is_the_residual_s_slope(mechanism):
    residual, truth = measured(mechanism, size=1.0)
    about, step = 0.5 * truth, 1e-3 * truth
    model = residual.linear(about)
    np.testing.assert_allclose(model(about[None]), residual(about[None]), rtol=1e-9)
    for sign in (1, -1):
        near = (about + sign * step)[None]
        np.testing.assert_allclose(model(near), residual(near), rtol=1e-6)
    jacobian = mechanism.identification_jacobian(
        residual.joint, residual.pose, mechanism.parameters.nominal
    )
    weighted = (residual.weight @ jacobian)[..., residual.free]
    own = residual.jacobian(np.zeros(len(truth)))
    np.testing.assert_allclose(own, weighted.reshape(own.shape), atol=1e-10)


@each_mechanism
def test_rounds_of_least_squares_end_where_the_residual_is_zero(mechanism):
    residual, truth = measured(mechanism, size=1.0)
    box = Box.about_zero(10 * np.abs(truth))
    once, thrice = (in_rounds(residual, box, least_squares, rounds) for rounds in (1, 3))
    assert thrice.norm < 1e-7 * residual(np.zeros((1, len(truth))))[0]
    assert thrice.norm < 1e-2 * once.norm  # one round leaves the squares of the errors
    np.testing.assert_allclose(thrice.best, truth, rtol=1e-3)
    assert (once.evaluations, thrice.evaluations) == (1, 3)


def test_a_swarm_may_ask_the_residual_itself():
    """Without a linear error model nothing is neglected; each particle evaluates the poses."""
    residual, truth = measured(load_robot("five_axis").model(), size=1.0, n=20)
    box = Box.about_zero(np.full(len(truth), 0.1e-3))
    slope = residual.jacobian(np.zeros(len(truth)))
    found = stepwise_singular(residual, slope, box, SwarmSettings(20, 80), rng())
    np.testing.assert_allclose(found.best, truth, atol=0.02 * np.abs(truth).max())
    assert found.norm == pytest.approx(residual(found.best[None])[0], rel=1e-6, abs=1e-12)


def test_noise_that_no_parameter_explains_stays_in_the_error_model():
    residual, truth = measured(load_robot("five_axis").model())
    noisy = PoseResidual(
        residual.mechanism,
        residual.joint,
        residual.pose + 1e-5 * rng(9).standard_normal(residual.pose.shape),
        residual.weight,
        residual.free,
    )
    model = noisy.linear(np.zeros(len(truth)))
    assert model.rest > 1e-5
    np.testing.assert_allclose(model(truth[None]), noisy(truth[None]), rtol=1e-3)


def test_measurements_that_do_not_fit_are_refused():
    residual, _ = measured(load_robot("five_axis").model(), n=8)
    parts = (residual.joint, residual.pose, residual.weight, residual.free)
    kind = residual.mechanism
    with pytest.raises(InputError, match=r"poses \(8, 3\) .* of five_axis; \(8, 4\)"):
        PoseResidual(kind, parts[0], parts[1][:, :3], parts[2], parts[3])
    with pytest.raises(DataError, match="4 poses of 4 coordinates do not set 20 parameters"):
        PoseResidual(kind, *(part[:4] for part in parts[:3]), parts[3])
    lost = parts[1].copy()
    lost[2, 1] = np.nan
    with pytest.raises(InputError, match="measured pose 3 are not finite"):
        PoseResidual(kind, parts[0], lost, parts[2], parts[3])
