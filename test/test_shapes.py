"""Searched fields of an effect: found between the points of the search, and how sure it is."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.candidates import Candidate, shape_columns
from delta_calibration.diagnosis.extension import covariance_of
from delta_calibration.effects import effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("linear_delta")
CYCLES = 2 * np.pi / 0.0123  # a screw that was cut by eye [rad/m]


@pytest.fixture(scope="module")
def machine():
    hidden = {"transmission_error": {"strength": "1.0", "cycles": str(CYCLES)}}
    return draw_machine(ROBOT, 3, hidden=hidden)


@pytest.fixture(scope="module")
def fitted(machine):
    """The machine's session, fitted from a shape a little beside the true one."""
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
    """To a hundredth of what the points lie apart in the last zoom, by the parabola's top."""
    (term,) = fitted.terms
    assert isinstance(term.effect.cycles, float)
    assert term.effect.cycles == pytest.approx(CYCLES, abs=0.1)


def test_what_a_frequency_leaves_open_is_in_the_intervals(fitted, machine):
    own = fitted.layout.effects
    error = fitted.theta[own] - machine.theta[machine.chain.layout.effects]
    std = np.sqrt(np.diag(covariance_of(fitted))[own])
    assert np.abs(error / std).max() < 3.5


def test_positions_go_by_amplitude_and_frequency_together(fitted, machine):
    """By true errors at the poses; amplitudes, told at zero of the scale, are less sure."""
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
    """Against a coarser difference, in units of a uniform distribution's spread."""
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


def test_what_a_time_constant_leaves_open_is_in_the_growth():
    """Two hours tell a growth by the clock and its time constant apart only roughly."""
    robot, cause, z = load_robot("srbd"), "thermal_growth_forearm", []
    for seed in (41, 42, 43, 44):
        machine = draw_machine(robot, seed, hidden={cause: {"strength": "1.0"}})
        plan = make_plan("rich", robot, seed=seed)
        seen = survey(simulate_session(machine, plan, seed), robot.joints.names)
        start = calibrated(seen, robot, machine.chain.mechanism.name)
        (hidden,) = machine.chain.effects
        effect = effect_named(cause, robot, start.bare.mechanism, hidden.settings)
        model = start.fitted((Candidate(cause, effect.kind, None, effect, (0,)),))
        own = model.layout.effects
        error = model.theta[own] - machine.theta[machine.chain.layout.effects]
        z.append(float(error[0] / np.sqrt(covariance_of(model)[own, own][0, 0])))
    assert np.abs(z).max() < 2.3
