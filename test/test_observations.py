"""Kinds of observation: derivatives, recovery by a joint fit, redundancy, bad input."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.errors import DataError, InputError, ReachError
from delta_calibration.estimation.measurements import (
    DistanceBetween,
    HeightAtContact,
    PlacedMachine,
    PointMeasured,
    PoseMeasured,
)
from delta_calibration.estimation.mixed_measurements import fit_observations
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
from delta_calibration.mechanisms.linear_delta import (
    LinearDelta,
    LinearDeltaDimensions,
    LinearDeltaTolerances,
)
from delta_calibration.mechanisms.rotary_delta import RotaryDelta
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmTolerances
from delta_calibration.mechanisms.six_rod_delta import SixRodDelta
from delta_calibration.robot import load_robot

SRBD = DeltaDimensions(0.2, 0.055, 0.32, 0.85, 0.04)
TOLERANCES = DeltaTolerances(0.25e-3, 0.15e-3, 0.2e-3, 0.1e-3, 0.8e-3, 0.5e-3, 0.05e-3, 1e-3)
PRINTER = LinearDelta(
    LinearDeltaDimensions(0.160, np.radians([210.0, 330.0, 90.0]), 0.345, 0.415),
    LinearDeltaTolerances(1e-3, 5e-3, 3e-3, 1e-3),
)

UR10 = load_robot("ur10").dimensions
ARM = SerialArm(UR10, ArmTolerances(0.5e-3, 1e-3, 1e-3, 2e-3, 5e-3))
MACHINES = {
    "linear_delta": (PRINTER, (0.3, 0.42)),
    "serial_arm": (ARM, (-1.0, 1.0)),
    "rotary_delta": (RotaryDelta(SRBD, TOLERANCES), (0.0, 1.0)),
    "six_rod_delta": (SixRodDelta(SRBD, TOLERANCES), (0.0, 1.0)),
}
FRAME = Frame.from_vector(np.array([0.3, -0.8, 1.9, 1.5, -0.4, 0.7]))
OFFSET = np.array([0.03, -0.02, 0.05])


def built(mechanism, rng, frame=FRAME, scale=1.0):
    p = mechanism.parameters
    return PlacedMachine.of(
        mechanism, p.nominal + scale * p.prior * rng.standard_normal(len(p)), frame
    )


def measured(machine, low, high, n, rng, noise=0.0):
    """One observation of each kind for the poses of a machine, with scipy's rotations."""

    def joints():
        return rng.uniform(low, high, (n, machine.chain.mechanism.joints))

    q, other = joints(), joints()
    x, y = (machine.chain.mechanism.forward(each, machine.geometry) for each in (q, other))
    centre, there = machine.chain.mechanism.position(x), machine.chain.mechanism.position(y)
    rotation = machine.frame.rotation @ machine.chain.mechanism.rotation(x)
    point = centre @ machine.frame.rotation.T + machine.frame.translation + rotation @ OFFSET
    point = point + noise * rng.standard_normal((n, 3))
    turn = Rotation.from_rotvec(noise * rng.standard_normal((n, 3))).as_matrix()
    apart = np.sqrt(np.sum((centre - there) ** 2, axis=1)) + noise * rng.standard_normal(n)
    height = centre[:, 2] + noise * rng.standard_normal(n)
    sigma = noise or 1e-5
    return (
        PointMeasured(q, point, OFFSET, sigma),
        PoseMeasured(q, point, OFFSET, sigma, turn @ rotation, sigma),
        HeightAtContact(q, height, sigma),
        DistanceBetween(q, other, apart, sigma),
    )


@pytest.mark.parametrize("name", MACHINES)
def test_nothing_is_missed_of_the_machine_that_was_measured(name):
    mechanism, (low, high) = MACHINES[name]
    rng = np.random.default_rng(1)
    machine = built(mechanism, rng)
    for observation in measured(machine, low, high, 8, rng):
        assert np.abs(observation.missed(machine)).max() < 1e-9, observation.kind


@pytest.mark.parametrize("name", MACHINES)
def test_slopes_are_those_of_what_is_missed(name):
    """By differences of `missed` for each unknown."""
    mechanism, (low, high) = MACHINES[name]
    rng = np.random.default_rng(2)
    machine, h = built(mechanism, rng), 1e-6
    for observation in measured(machine, low, high, 4, rng):
        slopes = observation.slopes(machine)
        for k in range(slopes.shape[-1]):
            d = h * np.eye(slopes.shape[-1])[k]
            more, less = (replace(machine, theta=machine.theta + s * d) for s in (1, -1))
            slope = (observation.missed(less) - observation.missed(more)) / (2 * h)
            np.testing.assert_allclose(slopes[..., k], slope, atol=1e-7)


def test_poses_of_an_arm_are_recovered_inside_their_intervals():
    """30 of 36 combinations are identifiable; they predict poses that were not fitted."""
    rng = np.random.default_rng(3)
    machine = built(ARM, rng)
    _, pose, _, _ = measured(machine, -1.5, 1.5, 80, rng, 20e-6)
    start = Frame.from_vector(FRAME.vector() + 0.02 * rng.standard_normal(6))
    fit = fit_observations(ARM, [pose], start)
    assert fit.observability.rank == 30
    assert fit.told == pytest.approx(30, abs=2)
    assert fit.chi_square == pytest.approx(1.0, abs=0.2)
    q = rng.uniform(-1.5, 1.5, (50, 6))
    elsewhere = PointMeasured(q, np.zeros((50, 3)), OFFSET, 1.0)
    fresh, true = elsewhere.missed(fit.machine), elsewhere.missed(machine)
    assert np.sqrt(np.mean(np.sum((fresh - true) ** 2, axis=1))) < 30e-6
    off = np.append(fit.machine.geometry - machine.geometry, fit.machine.frame.vector())
    off[-6:] -= FRAME.vector()
    assert 0.6 < np.sqrt(np.mean((off / fit.std) ** 2)) < 1.5
    assert fit.rms(0, slice(0, 3)) == pytest.approx(20e-6 * np.sqrt(3), rel=0.2)


def test_heights_and_distances_set_a_printer_up_to_its_gauge():
    rng = np.random.default_rng(4)
    machine = built(PRINTER, rng, Frame.identity())
    _, _, height, distance = measured(machine, 0.3, 0.42, 40, rng, 10e-6)
    fit = fit_observations(PRINTER, [height, distance])
    assert fit.names == PRINTER.parameters.names  # no device and no frame
    assert fit.observability.rank == 9
    assert [r.parameter for r in fit.observability.redundancies] == ["tower_angle_3"]
    q = rng.uniform(0.3, 0.42, (50, 3))
    fresh, true = (PRINTER.forward(q, each.geometry) for each in (fit.machine, machine))
    np.testing.assert_allclose(fresh[:, 2], true[:, 2], atol=30e-6)
    apart = np.linalg.norm(np.diff(fresh, axis=0), axis=1)
    np.testing.assert_allclose(apart, np.linalg.norm(np.diff(true, axis=0), axis=1), atol=60e-6)


def test_few_heights_tell_little():
    """Three heights near the centre cannot determine nine parameters; the priors do."""
    rng = np.random.default_rng(5)
    machine = built(PRINTER, rng, Frame.identity())
    _, _, height, _ = measured(machine, 0.35, 0.36, 3, rng, 10e-6)
    fit = fit_observations(PRINTER, [height])
    assert fit.observability.rank == 3
    assert 0.0 < fit.told < 3.0
    assert (fit.std <= fit.prior * (1 + 1e-9)).all()
    with pytest.raises(DataError, match="3 measured numbers cannot set 10 unknowns"):
        fit_observations(PRINTER, [height], priors=False)


def test_what_is_held_stays_as_drawn():
    rng = np.random.default_rng(6)
    machine = built(PRINTER, rng, Frame.identity())
    _, _, height, distance = measured(machine, 0.3, 0.42, 40, rng)
    free = np.array([not n.startswith("arm") for n in PRINTER.parameters.names])
    fit = fit_observations(PRINTER, [height, distance], free=free)
    moved = fit.machine.geometry != PRINTER.parameters.nominal
    assert (moved == free).all()
    assert len(fit.names) == 7


def test_bad_input_is_refused_by_name():
    q = np.full((2, 3), 0.35)
    good = HeightAtContact(q, np.zeros(2), 1e-5)
    point = PointMeasured(q, np.zeros((2, 3)), np.zeros(3), 1e-5)
    with pytest.raises(InputError, match=r"height: height \(3,\) is not allowed; \(2,\), finite"):
        HeightAtContact(q, np.zeros(3), 1e-5)
    with pytest.raises(InputError, match="distance: distance"):
        DistanceBetween(q, q, np.array([0.0, np.nan]), 1e-5)
    with pytest.raises(InputError, match=r"height: noise \[0.\] is not allowed; over 0"):
        HeightAtContact(q, np.zeros(2), 0.0)
    with pytest.raises(InputError, match="observations: none"):
        fit_observations(PRINTER, [])
    with pytest.raises(InputError, match="frame: none is not allowed"):
        fit_observations(PRINTER, [good, point])
    with pytest.raises(ReachError, match="height: joints 1 "):
        fit_observations(PRINTER, [replace(good, joint=q + np.array([0.7, 0.0, 0.0]))])
