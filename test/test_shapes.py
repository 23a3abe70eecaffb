"""Searched fields of an effect are found between the points of the search, with intervals."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated, diagnose
from delta_calibration.diagnosis.candidates import Candidate, shape_columns
from delta_calibration.diagnosis.extension import covariance_of
from delta_calibration.diagnosis.findings import shape_of, spread_of
from delta_calibration.diagnosis.fitted import gains_of
from delta_calibration.diagnosis.set_aside import like_neighbours
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.diagnosis.verdict import Estimate, Finding
from delta_calibration.effects import effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("linear_delta")
CYCLES = 2 * np.pi / 0.0123  # a screw with a pitch of 12.3 mm [rad/m]


@pytest.fixture(scope="module")
def machine():
    hidden = {"transmission_error": {"strength": "1.0", "cycles": str(CYCLES)}}
    return draw_machine(ROBOT, 3, hidden=hidden)


@pytest.fixture(scope="module")
def fitted(machine):
    """The session of the machine, fitted from a slightly wrong shape."""
    plan = make_plan("identify", ROBOT, seed=3)
    seen = survey(
        simulate_session(machine, plan, 3), ROBOT.joints.names, ROBOT.commanded.joint_size
    )
    start = calibrated(seen, ROBOT)
    shape = {"cycles": CYCLES + 1.0}
    effect = effect_named("transmission_error", ROBOT, start.bare.mechanism, shape)
    every = tuple(range(len(effect.parameters)))
    return start.fitted((Candidate("transmission_error", effect.kind, None, effect, every),))


def test_a_frequency_is_found_between_the_points_of_the_search(fitted):
    """To a hundredth of the spacing of points in the last zoom, by the vertex of a parabola."""
    (term,) = fitted.terms
    assert isinstance(term.effect.cycles, float)
    assert term.effect.cycles == pytest.approx(CYCLES, abs=0.1)


def test_what_a_frequency_leaves_open_is_in_the_intervals(fitted, machine):
    own = fitted.layout.effects
    error = fitted.theta[own] - machine.theta[machine.chain.layout.effects]
    std = np.sqrt(np.diag(covariance_of(fitted))[own])
    assert np.abs(error / std).max() < 3.5


def test_the_order_of_a_slider_is_told_in_cycles_per_metre(fitted):
    (term,) = fitted.terms
    spread = spread_of(fitted.evidence, fitted, term)[1]
    shape = shape_of(term, spread)
    order, ((_, low, high),) = shape["order"], term.effect.bounded_intervals()
    assert order.unit == "1/m"
    assert order.value == pytest.approx(term.effect.cycles / (2 * np.pi), rel=1e-12)
    assert abs(order.value - 1 / 0.0123) < 4 * order.std
    assert order.std == pytest.approx(spread[0] * (high - low) / 12**0.5 / (2 * np.pi))
    sizes = dict.fromkeys(("confidence", "rms_before_mm", "gain", "gain_low", "gain_high"), 1.0)
    sizes |= dict.fromkeys(("p_value", "rms_after_mm", "signal"), 0.0)
    (told,) = Finding(term.cause, None, "drive", (), None, {}, **sizes, shape=shape).shape_told()
    assert re.fullmatch(r"order 81\.3\d+ \+- 0\.\d+ cycles per m \(period 12\.\d+ mm\)", told)


def test_the_order_of_a_joint_that_turns_is_told_in_cycles_per_turn():
    robot = load_robot("srbd")
    effect = effect_named("transmission_error", robot, robot.model(), {"cycles": 66.0})
    term = Candidate("transmission_error", effect.kind, None, effect, (0,))
    assert shape_of(term, np.zeros(1)) == {"order": Estimate(66.0, 0.0, "1")}


def test_positions_go_by_amplitude_and_frequency_together(fitted, machine):
    """By true errors at the poses. Amplitudes, stated at zero of the scale, are less certain."""
    chain, theta, at = fitted.extended.chain, fitted.theta, fitted.survey.poses.conditions
    missed = machine.reflector_points(at) - chain.predict(at, theta)
    true = np.mean(np.sum(missed**2, axis=1))
    jacobian = chain.jacobian(at, theta)
    near, wide = (
        np.einsum("nij,jk,nik->n", jacobian, covariance_of(fitted, shapes), jacobian).mean()
        for shapes in (False, True)
    )
    assert 0.4 < true / near < 2.0
    assert wide > 1.4 * near


def test_columns_of_a_field_are_differences_of_the_signal(fitted):
    """Compared with a coarser difference, in units of the spread of a uniform distribution."""
    (term,) = fitted.terms
    evidence, scaled = fitted.evidence, fitted.scaled(term)
    ((name, low, high),) = term.effect.intervals()
    assert name == "cycles"
    h = 0.2

    def signal(cycles):
        effect = effect_named("transmission_error", ROBOT, fitted.bare.mechanism, {name: cycles})
        return evidence.columns(effect) @ scaled

    slope = (signal(term.effect.cycles + h) - signal(term.effect.cycles - h)) / (2 * h)
    expected = slope * (high - low) / np.sqrt(12)
    found = shape_columns(term, evidence, scaled)
    assert found.shape == (evidence.size, 1)
    np.testing.assert_allclose(found[:, 0], expected, atol=2e-2 * np.abs(expected).max())


def hidden_and_fitted(name, cause, seed, hidden, plan="identify", period=0.0, shape=None):
    """A machine and its session, fitted with the true cause in the chain."""
    robot = load_robot(name)
    machine = draw_machine(robot, seed, hidden={cause: {"strength": "1.0", **hidden}})
    session = simulate_session(machine, make_plan(plan, robot, seed=seed), seed, period=period)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    start = calibrated(seen, robot, machine.chain.mechanism.name)
    (own,) = machine.chain.effects
    effect = effect_named(cause, robot, start.bare.mechanism, {**own.settings, **(shape or {})})
    rows = tuple(range(len(effect.parameters)))
    return machine, start, start.fitted((Candidate(cause, effect.kind, None, effect, rows),))


def test_what_a_time_constant_leaves_open_is_in_the_growth():
    """Eight minutes hardly show more than growth over time constant, which is forty minutes.

    By the intervals of the verdict and by those of the calibration.
    """
    cause, z = "thermal_growth_forearm", []
    for seed in (41, 42, 43, 44):
        machine, _, model = hidden_and_fitted("srbd", cause, seed, {}, "rich")
        (term,), own = model.terms, model.layout.effects
        (error,) = model.theta[own] - machine.theta[machine.chain.layout.effects]
        told = spread_of(model.evidence, model, term)[0] * term.effect.parameters.prior
        kept = np.sqrt(np.diag(covariance_of(model)[own, own]))
        assert kept == pytest.approx(told, rel=0.05)
        z.append(float(error / told[0]))
    assert np.abs(z).max() < 2.3


def test_a_time_constant_is_not_sought_where_the_growth_is_implausible():
    """Two and a half minutes show only growth over time constant; chance decides between shapes.

    By chi square alone three of six growths would be over three times the usual one.
    """
    size = []
    for seed in range(61, 67):
        _, start, model = hidden_and_fitted("scara", "thermal_growth_link", seed, {})
        (term,) = model.terms
        effect = replace(term.effect, time_constant=0.0)
        shapes = [replace(term, effect=each) for each in effect.shapes(start.evidence.at)]
        best = shapes[int(np.argmax(gains_of(Shapes.of(start.evidence), shapes)))]
        found = start.fitted((best,))
        size.append(abs(found.scaled(found.terms[0])[0]))
    assert max(size) < 2


@pytest.fixture(scope="module")
def stepped():
    """All joints lose their zeros at one moment, between two stops that are a minute apart."""
    hidden, tried = {"strength": "2.0", "step_at": "2500"}, {"step_at": 2371.0}
    return hidden_and_fitted("srbd", "joint_zero_drift", 41, hidden, "rich", 60.0, tried)


def test_the_moment_of_a_step_is_told_as_surely_as_stops_lie_about_it(stepped):
    """Within the gap the moment cannot be determined; beyond it, every sample determines it."""
    _, _, model = stepped
    (term,) = model.terms
    time = np.sort(model.survey.poses.time)
    after = int(np.searchsorted(time, 2500.0))
    gap = time[after] - time[after - 1]
    assert time[after - 1] < term.effect.step_at < time[after]
    of_shape = spread_of(model.evidence, model, term)[1]
    said = shape_of(term, of_shape)["step_at_s"]
    assert 0.2 * gap < said.std < 0.5 * gap  # 0.29 if all moments in it are equally likely
    assert abs(said.value - 2500.0) < 1.96 * said.std


def test_a_moment_is_sought_with_the_poses_that_a_fit_without_it_sets_aside(stepped):
    """With the smaller noise, these poses are gross errors for the model without the cause."""
    _, start, model = stepped
    quiet = start.quieter(model)
    assert quiet.floor < 0.5 * start.floor
    assert (quiet.cell.weight == 0).sum() > 4
    again = quiet.fitted(model.terms)
    assert (again.cell.weight > 0).all()
    assert again.terms[0].effect.step_at == pytest.approx(model.terms[0].effect.step_at, abs=30.0)


@pytest.mark.parametrize("early", [620.0, 1240.0])
def test_a_joint_that_slipped_early_is_named_and_its_few_poses_are_no_outliers(early):
    """Ten or twenty of two hundred poses are measured before joints slip by 0.5 to 0.7 mrad."""
    robot, hidden = load_robot("srbd"), {"strength": "6.0", "step_at": str(early)}
    machine = draw_machine(robot, 41, hidden={"joint_zero_drift": hidden})
    session = simulate_session(machine, make_plan("rich", robot, seed=41), 41, period=60.0)
    found = diagnose(survey(session, robot.joints.names), robot)
    (finding,) = found.verdict.findings
    assert finding.cause == "joint_zero_drift"
    said = finding.shape["step_at_s"]
    assert abs(said.value - early) < 1.96 * said.std
    assert not found.verdict.unknown_structure.found
    assert found.verdict.session.rejected["unlike_the_model"] == 0
    true = machine.theta[machine.chain.layout.effects]
    told = [finding.parameters[f"drift_{i}"] for i in (1, 2, 3)]
    assert max(abs(t.value - v) / t.std for t, v in zip(told, true, strict=True)) < 4


def test_a_gross_error_beside_them_stays_out():
    """A single wrong reading must not decide how the poses before a slip are explained."""
    robot, hidden = load_robot("srbd"), {"strength": "6.0", "step_at": "1240"}
    machine = draw_machine(robot, 41, hidden={"joint_zero_drift": hidden})
    session = simulate_session(machine, make_plan("rich", robot, seed=41), 41, period=60.0)
    seen = survey(session, robot.joints.names)
    wrong, point = [100, 150], seen.poses.point.copy()
    point[wrong] += [[0.006, -0.004, 0.007], [-0.001, 0.002, 0.001]]
    found = diagnose(replace(seen, poses=replace(seen.poses, point=point)), robot)
    assert [f.cause for f in found.verdict.findings] == ["joint_zero_drift"]
    out = found.verdict.session.rejected["unlike_the_model"]
    assert out == seen.poses.count[wrong].sum()  # number of readings


def test_outliers_like_their_neighbours_are_told_from_others():
    rng = np.random.default_rng(5)
    joint = rng.uniform(-0.5, 0.5, (12, 3))
    missed = 50.0 + 15.0 * joint  # a slip of the joints, depending on the place
    missed[3], missed[7] = [-40.0, 60.0, -45.0], [400.0, 380.0, 420.0]
    expected = np.ones(12, dtype=bool)
    expected[[3, 7]] = False
    np.testing.assert_array_equal(like_neighbours(missed, joint), expected)
    scattered = like_neighbours(rng.standard_normal((40, 3)), rng.uniform(-0.5, 0.5, (40, 3)))
    assert scattered.mean() < 0.4
    assert not like_neighbours(missed[:4], joint[:4]).any()  # too few to decide


def test_an_outlier_visited_twice_is_not_its_own_neighbour():
    """Of the four next to the second, two miss the same way."""
    joint = np.array([0.0, 0.0, 0.1, 0.2, 0.3, 5.0])[:, None]
    missed = np.array([-50.0, 50.0, 50.0, 50.0, -50.0, 50.0])[:, None] * np.eye(3)[0]
    assert not like_neighbours(missed, joint)[1]


def test_outliers_that_are_alike_and_no_cause_explains_stay_out():
    """A reflector that was off its nest by a centimetre for ten poses; no joint explains that."""
    robot = load_robot("srbd")
    machine = draw_machine(robot, 41)
    session = simulate_session(machine, make_plan("rich", robot, seed=41), 41, period=60.0)
    seen = survey(session, robot.joints.names)
    point = seen.poses.point.copy()
    point[60:70] += [0.004, -0.008, 0.005]
    seen = replace(seen, poses=replace(seen.poses, point=point))
    found = diagnose(seen, robot)
    out = found.verdict.session.rejected["unlike_the_model"]
    assert out == seen.poses.count[60:70].sum()  # number of readings
    assert found.verdict.findings == ()


def test_a_search_stays_within_what_a_file_may_hold():
    """The load of a SCARA hardly moves, so the depth of its feet cannot be determined."""
    machine, _, model = hidden_and_fitted("scara", "base_compliance", 90001, {})
    (term,), own = model.terms, model.layout.effects
    assert term.effect.wrong() == ""
    (error,) = model.theta[own] - machine.theta[machine.chain.layout.effects]
    told = spread_of(model.evidence, model, term)[0] * term.effect.parameters.prior
    assert abs(error) < 2.3 * told[0]  # with the shape held fixed, give would be 16 std off
