"""Tests of the cable robot: closure, derivatives, redundancy, tensions, refusals."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.optimize import least_squares

from cables import (
    EIGHT_CABLES,
    FOUR_CABLES,
    TOLERANCES,
    ZEROS_FREE,
    Winches,
    built,
    geometry_of,
    workspace,
)
from closures_by_hand import BY_HAND
from delta_calibration.errors import ConfigError, ReachError
from delta_calibration.mechanisms import CableRobot
from machines import complex_step

BODY, POINT = CableRobot(EIGHT_CABLES, TOLERANCES), CableRobot(FOUR_CABLES, TOLERANCES)
SIX = CableRobot(  # as many cables as degrees of freedom: two of one edge left out
    replace(
        EIGHT_CABLES,
        **{
            name: getattr(EIGHT_CABLES, name)[[0, 1, 3, 4, 5, 7]]
            for name in ("anchors", "joints", "drum_radius", "gear", "tackle")
        },
    ),
    TOLERANCES,
)
FREE = CableRobot(EIGHT_CABLES, ZEROS_FREE)
ROBOTS = {"body": BODY, "point": POINT, "six": SIX, "free zeros": FREE}


@pytest.fixture(params=ROBOTS)
def robot(request):
    return ROBOTS[request.param]


def machine(robot, rng):
    parameters = robot.parameters
    return parameters.nominal + parameters.prior * rng.standard_normal(len(parameters))


def test_lengths_are_those_of_the_machine_written_apart(robot):
    rng = np.random.default_rng(1)
    offsets = rng.normal(0, 5e-3, robot.joints) if robot.free_zeros else 0.0
    real = built(robot.dimensions, rng, offsets=offsets)
    x, g = workspace(robot.dimensions, 20, rng), geometry_of(real, robot.free_zeros)
    assert len(g) == len(robot.parameters)
    np.testing.assert_allclose(robot.inverse(x, g), real.motors(x), rtol=0, atol=1e-10)
    np.testing.assert_allclose(robot.closure(real.motors(x), x, g), 0, atol=1e-13)


def test_closure_derivatives_against_complex_step(robot):
    rng = np.random.default_rng(2)
    g, x = machine(robot, rng), workspace(robot.dimensions, 7, rng)
    q = robot.inverse(x, g) + rng.standard_normal((7, robot.joints))
    by_hand = partial(BY_HAND["cable_robot"], robot)
    np.testing.assert_allclose(robot.closure(q, x, g), by_hand(q, x, g), atol=1e-14)
    for generated, function, at in (
        (robot.closure_by_pose(q, x, g), lambda v: by_hand(q, v, g), x),
        (robot.closure_by_joints(q, x, g), lambda v: by_hand(v, x, g), q),
        (robot.closure_by_geometry(q, x, g), lambda v: by_hand(q, x, v), g),
    ):
        exact = complex_step(function, at)
        np.testing.assert_allclose(generated, exact, atol=1e-12 * np.abs(exact).max())


def test_forward_undoes_inverse_and_geometry_may_change_by_sample(robot):
    rng = np.random.default_rng(3)
    x = workspace(robot.dimensions, 100, rng)
    each = np.stack([machine(robot, rng) for _ in x])
    q = robot.inverse(x, each)
    np.testing.assert_allclose(robot.forward(q, each), x, atol=1e-11)
    alone = robot.forward(q[5:6], each[5])
    np.testing.assert_allclose(alone, x[5:6], atol=1e-11)


def test_jacobians_are_slopes_of_the_direct_problem(robot):
    rng = np.random.default_rng(4)
    g, x = machine(robot, rng), workspace(robot.dimensions, 4, rng)
    q = robot.inverse(x, g)
    for pose, joints in zip(x, q, strict=True):
        at = pose[None], joints[None]
        for written, steps, function in (
            (
                robot.velocity_jacobian(at[1], at[0], g)[0],
                np.full(robot.joints, 1e-5),
                lambda d, q=joints: robot.forward(q + d, g),
            ),
            (
                robot.identification_jacobian(at[1], at[0], g)[0],
                1e-2 * robot.parameters.prior,
                lambda d, q=joints: robot.forward(np.tile(q, (len(d), 1)), g + d),
            ),
        ):
            d = np.diag(steps)
            slope = ((function(d) - function(-d)) / (2 * steps[:, None])).T
            np.testing.assert_allclose(written, slope, atol=1e-6 * np.abs(slope).max())


@pytest.mark.parametrize("robot", [BODY, POINT], ids=["body", "point"])
def test_lengths_that_fit_no_pose_give_that_of_least_squares(robot):
    """Compared with another solver; within tolerances the misfit is about a millimetre."""
    rng = np.random.default_rng(5)
    real, g = built(robot.dimensions, rng), robot.parameters.nominal
    q = real.motors(workspace(robot.dimensions, 8, rng))
    x = robot.forward(q, g)
    misfit = robot.closure(q, x, g)
    assert np.sqrt(np.mean(misfit**2)) > 0.5e-3
    drawn = Winches(*(getattr(robot.dimensions, n) for n in ("anchors", "joints", "gain", "home")))
    wanted = drawn.lengths(drawn.home) + q * drawn.gains
    for row, lengths in zip(x, wanted, strict=True):
        other = least_squares(
            lambda pose, lengths=lengths: drawn.lengths(pose) - lengths,
            robot.dimensions.home,
            xtol=1e-15,
            ftol=1e-15,
            gtol=1e-15,
        )
        np.testing.assert_allclose(row, other.x, atol=1e-7)


def test_normal_equations_are_good_enough():
    """Their loss against an orthogonal decomposition is rounding: f_x has condition 6 here."""
    rng = np.random.default_rng(6)
    g, x = machine(BODY, rng), workspace(EIGHT_CABLES, 100, rng)
    q = BODY.inverse(x, g)
    slope, by_geometry = BODY.closure_by_pose(q, x, g), BODY.closure_by_geometry(q, x, g)
    written = BODY.identification_jacobian(q, x, g)
    for row in range(len(x)):
        exact = np.linalg.lstsq(-slope[row], by_geometry[row], rcond=None)[0]
        np.testing.assert_allclose(written[row], exact, atol=1e-13 * np.abs(exact).max())
    assert np.linalg.cond(slope).max() < 6


def rank(jacobian):
    matrix = jacobian.reshape(-1, jacobian.shape[-1])
    values = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    clear = (values > 1e-11 * values[0]) & (values < 1e-6 * values[0])
    assert not clear.any()
    return int((values > 1e-9 * values[0]).sum())


@pytest.mark.parametrize(
    ("dimensions", "free", "parameters", "in_pose"),
    [
        (EIGHT_CABLES, False, 56, 56),
        (EIGHT_CABLES, True, 64, 63),
        (FOUR_CABLES, False, 16, 16),
        (FOUR_CABLES, True, 20, 20),
    ],
)
def test_every_parameter_shows_in_the_lengths(dimensions, free, parameters, in_pose):
    """7 m for a body, 4 m for a point, and m more with free zeros; the frame is known.

    By the pose alone one combination of the body's cannot be identified: changing the lengths of
    neighbouring corners by the same fraction in opposite senses is a self-stress of a box, which
    moves no platform.
    """
    robot = CableRobot(dimensions, ZEROS_FREE if free else TOLERANCES)
    x = workspace(dimensions, 150, np.random.default_rng(7))
    g = robot.parameters.nominal
    q = robot.inverse(x, g)
    assert len(robot.parameters) == parameters
    assert rank(robot.closure_by_geometry(q, x, g)) == parameters
    assert rank(robot.identification_jacobian(q, x, g)) == in_pose


def test_names_units_and_causes():
    items = {p.name: p for p in FREE.parameters}
    assert [p.name for p in FREE.parameters][8:16] == [
        *(f"anchor_{axis}_2" for axis in "xyz"),
        *(f"platform_{axis}_2" for axis in "xyz"),
        "gain_2",
        "zero_2",
    ]
    assert {p.location for p in FREE.parameters} == {f"cable_{i}" for i in range(1, 9)}
    gain = items["gain_3"]
    assert (gain.unit, gain.cause, gain.nominal) == ("m/rad", "drum_scale", pytest.approx(5e-3))
    assert gain.prior == pytest.approx(TOLERANCES.gain * gain.nominal)
    assert (items["zero_1"].unit, items["zero_1"].cause) == ("m", "joint_zero_offset")


# Tension


def test_tensions_carry_the_load_by_newton_and_euler():
    """Sum of forces and of moments about the platform's centre, cable by cable."""
    rng = np.random.default_rng(8)
    g, x, mass = BODY.parameters.nominal, workspace(EIGHT_CABLES, 20, rng), 20.0
    load = np.zeros_like(x)
    load[:, 2] = 9.81 * mass
    tension = BODY.tensions(x, g, load)
    BODY.require_taut(tension, 10.0)
    for pose, pulls in zip(x, tension, strict=True):
        arms = BODY.rotation(pose[None])[0] @ EIGHT_CABLES.joints.T
        lines = EIGHT_CABLES.anchors.T - pose[:3, None] - arms
        forces = pulls * lines / np.linalg.norm(lines, axis=0)
        np.testing.assert_allclose(forces.sum(axis=1), [0, 0, 9.81 * mass], atol=1e-9)
        np.testing.assert_allclose(np.cross(arms.T, forces.T).sum(axis=0), 0, atol=1e-9)


@pytest.mark.parametrize("robot", [BODY, POINT], ids=["body", "point"])
def test_tensions_are_the_nearest_to_the_pretension(robot):
    """Compared with numpy's pseudoinverse of the cable directions, for different geometries."""
    rng = np.random.default_rng(11)
    x = workspace(robot.dimensions, 8, rng)
    g = robot.parameters.nominal + 1e-3 * rng.standard_normal((8, len(robot.parameters)))
    load = rng.uniform(-50, 50, x.shape)
    wished = robot.dimensions.pretension * np.ones((8, robot.joints, 1))
    structure = robot.closure_by_pose(np.zeros((8, robot.joints)), x, g).swapaxes(1, 2)
    missed = -load[..., None] - structure @ wished
    expected = (wished + np.linalg.pinv(structure) @ missed)[..., 0]
    np.testing.assert_allclose(robot.tensions(x, g, load), expected, rtol=0, atol=1e-9)
    x[3] = np.nan
    assert np.isnan(robot.tensions(x, g, load)).all(axis=1).tolist() == [k == 3 for k in range(8)]


def test_tension_of_one_plumb_line():
    """A point below its upper cable, no pretension: the others get negative tension, are slack."""
    robot = CableRobot(replace(FOUR_CABLES, pretension=0.0), TOLERANCES)
    x, load = np.array([[0.0, 0.0, 1.0]]), np.array([[0.0, 0.0, 50.0]])
    pull = robot.tensions(x, robot.parameters.nominal, load)
    along = FOUR_CABLES.anchors - x
    along /= np.linalg.norm(along, axis=1)[:, None]
    np.testing.assert_allclose(pull @ along, load, atol=1e-9)  # the pulls balance the load
    assert (pull[0, :3] < 0).all()
    assert pull[0, 3] > 0
    with pytest.raises(ReachError, match=r"pose 1: cable_1 is slack: -\d.* of 0 N, more than 0 N"):
        robot.require_taut(pull)


# Impossible input


@pytest.mark.parametrize("robot", [BODY, POINT], ids=["body", "point"])
def test_torn_cables_give_no_pose_and_say_which_joints(robot):
    """Least squares also finds a pose for an error of a metre, which no cable could bear."""
    g, x = robot.parameters.nominal, workspace(robot.dimensions, 3, np.random.default_rng(9))
    q = robot.inverse(x, g)
    q[1, 2] += 200.0
    found = robot.forward(q, g)
    assert np.isfinite(found[[0, 2]]).all()
    assert np.isnan(found[1]).all()
    with pytest.raises(ReachError, match=r"joint command 2 .* out of the robot's reach"):
        robot.require_reach(found, q, "joint command")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"home_turn": np.zeros(3)}, "anchors_mm: 4 cables are not allowed; 6 or more"),
        ({"joints": np.full((4, 3), 0.1)}, r"joints_mm: \[\[100, 100, .*; 0, as a point"),
        ({"gear": np.array([10.0, 10.0, 0.0, 10.0])}, r"gear: \[10, 10, 0, 10\] .*; each above 0"),
        ({"tackle": np.ones(3)}, r"tackle: \[1, 1, 1\] is not allowed; 4 finite"),
        ({"anchors": np.full((4, 3), np.nan)}, "anchors_mm: .*nan.*; 4 times 3 finite numbers"),
        ({"pretension": -1.0}, "pretension_n: -1 is not allowed; 0 or more"),
    ],
)
def test_a_drawing_that_is_no_cable_robot_is_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        replace(FOUR_CABLES, **change)
