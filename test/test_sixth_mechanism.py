"""A user's mechanism in a single class, registered here, passes the tests of all mechanisms."""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

import test_every_mechanism as every_robot
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.estimation import chain_of, identify, prepare
from delta_calibration.mechanisms import MECHANISMS, Mechanism
from delta_calibration.mechanisms.base import Limb
from delta_calibration.model.symbols import norm, square
from delta_calibration.papers import method_named
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.robot import load_robot
from delta_calibration.sections import length, tolerance
from export_bench import Compiled, commands, machine, needs_compiler
from test_mechanisms import (  # noqa: F401 (run on the mechanism below)
    test_closure_derivatives_against_complex_step,
    test_forward_meets_the_closure,
    test_geometry_may_change_from_sample_to_sample,
    test_inverse_undoes_forward,
    test_jacobians_are_slopes_of_the_direct_problem,
)

LINES = 50  # allowed for the class


class Tripod(Mechanism):
    """Three telescopic legs carry a point under their anchors: |x - a_i|^2 = (l_i + q_i)^2.

    Joints q (n, 3) [m], pose x (n, 3) [m]; parameters a_1..3 (9) [m] and l_1..3 [m].
    """

    @dataclass(frozen=True)
    class Dimensions:
        radius: float = length()  # [m] of the anchors about the z axis
        leg: float = length()  # [m] retracted

    @dataclass(frozen=True)
    class Tolerances:
        anchor: float = tolerance()  # [m]
        leg: float = tolerance()  # [m]

    name, joint_unit, joint_size = "tripod", "m", 0.5
    joints = pose_size = task_size = 3

    def __init__(self, dimensions, tolerances):
        turn = 2 * np.pi * np.arange(3) / 3
        at = dimensions.radius * np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
        self.parameters = ParameterSet(
            tuple(
                Parameter(f"anchor_{axis}_{leg}", "m", float(value), tolerances.anchor)
                for leg, place in enumerate(at, 1)
                for axis, value in zip("xyz", place, strict=True)
            )
            + tuple(
                Parameter(f"leg_{leg}", "m", dimensions.leg, tolerances.leg, "joint_zero_offset")
                for leg in (1, 2, 3)
            )
        )

    home = np.full(3, 0.5)
    home_pose = np.array([0.0, 0.0, -1.0])
    limbs = tuple(Limb((i,), (3 * i, 3 * i + 1, 3 * i + 2, 9 + i), (i,)) for i in range(3))

    @staticmethod
    def equation(q, x, g, c):
        return square(x - g[0:3]) - (g[3] + q) ** 2

    @staticmethod
    def reaching(x, g, c):
        return norm(x - g[0:3]) - g[3]


@pytest.fixture
def by_hand():
    """Independent closure in numpy."""

    def closure(q, x, g):
        legs = x[:, None] - g[..., :9].reshape(*g.shape[:-1], 3, 3)
        return np.sum(legs**2, axis=-1) - (g[..., 9:] + q) ** 2

    return closure


@pytest.fixture(scope="module")
def robot_file(tmp_path_factory):
    """Register the mechanism and write a robot file, with other sections from a linear Delta."""
    path = tmp_path_factory.mktemp("robot") / "tripod.yaml"
    data = YAML(typ="safe").load(Path(load_robot("linear_delta").source))
    data |= {
        "name": "tripod",
        "mechanism": "tripod",
        "geometry": {"radius_mm": 600.0, "leg_mm": 500.0},
        "tolerances": {"anchor_mm": 3.0, "leg_mm": 3.0},
        "workspace": {"centre_mm": [0, 0, -800], "size_mm": [400, 400, 300]},
    }
    data["joints"] |= {"lower_mm": [0.0] * 3, "upper_mm": [1200.0] * 3}
    YAML().dump(data, path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(MECHANISMS._own, Tripod.name, Tripod)
        patch.setitem(every_robot.HIDDEN, str(path), ("slider_pitch", "identify"))
        yield str(path)


@pytest.fixture
def mechanism(robot_file):
    """Fixture of the shared tests of closure, derivatives and inverse kinematics."""
    return load_robot(robot_file).model()


def test_the_class_is_short():
    assert len(inspect.getsource(Tripod).splitlines()) < LINES


@pytest.mark.parametrize(
    "shared",
    [
        every_robot.test_plans_reach_what_they_say,
        every_robot.test_a_fit_predicts_to_the_noise,
        every_robot.test_what_the_data_do_not_set_does_not_show,
        every_robot.test_a_cause_of_its_own_is_named,
    ],
)
def test_what_every_robot_passes(shared, robot_file):
    shared(robot_file)


def test_its_machine_is_found(robot_file):
    """The place of the base belongs to the frame; distances between the anchors are found."""
    robot = load_robot(robot_file)
    truth = every_robot.machine_of(robot, "", 3)
    _, seen = every_robot.measured(robot_file, "", "identify", 40, 3)
    found = identify(seen.poses, robot)
    drawing, real, fitted = (
        sides(theta) for theta in (found.frame_only_theta, truth.theta, found.theta)
    )
    assert np.abs(fitted - real).max() < 0.1 * np.abs(drawing - real).max()


@needs_compiler
def test_it_is_exported_as_c(robot_file, tmp_path):
    calibration = machine(load_robot(robot_file))
    made = Compiled(calibration, tmp_path)
    q = commands(calibration.robot, calibration.chain.mechanism, 200, 0)
    expected = JointCompensator(calibration).compensate(q)
    out, verdicts = made.correct(q)
    assert verdicts == list(expected.verdicts)
    assert CommandStatus.CORRECTED in verdicts
    np.testing.assert_allclose(out, expected.joint, rtol=0, atol=1e-10)


def sides(theta):
    """Sides of the triangle of anchors, (3,) [m]."""
    anchors = theta[:9].reshape(3, 3)
    return np.linalg.norm(anchors - np.roll(anchors, 1, axis=0), axis=1)


@pytest.mark.parametrize("method", ["least_squares", "alternating", "stepwise_qpso"])
def test_the_methods_fit_it(method, robot_file):
    robot, seen = every_robot.measured(robot_file, "", "identify", 20, 3)
    start, _, problem = prepare(seen.poses, robot, chain_of(robot))
    before = problem.linearized(start).residual
    fit = method_named(method).fit(problem, np.random.default_rng(0), lambda _: None)
    assert np.abs(fit.solution.residual).max() < 0.1 * np.abs(before).max()
