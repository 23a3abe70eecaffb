"""A user's mechanism, as in the tutorial: two sliders that move a point in an upright plane.

Its joints command x and z. The tests of all robots have to use these two coordinates, not the
first two of three.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

import test_every_mechanism as every_robot
from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.data import at_rest
from delta_calibration.estimation import identify
from delta_calibration.mechanisms import MECHANISMS, Mechanism
from delta_calibration.model.symbols import column, sqrt, square
from delta_calibration.parameters import Parameter, ParameterSet
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.sections import length, place, tolerance
from delta_calibration.trial import true_misses
from test_mechanisms import (  # noqa: F401 (run on the mechanism below)
    test_closure_derivatives_against_complex_step,
    test_forward_meets_the_closure,
    test_inverse_undoes_forward,
)

PLANE = [0, 2, 1]  # the pose is x, z, y: commanded coordinates first


def _along(q, x, g):
    """Vectors from each slider to the point, symbolic."""
    place = column(x[0], x[2], x[1])
    return [place - g[3 * i : 3 * i + 3] - column(q[i], 0, 0) for i in (0, 1)]


class FiveBar(Mechanism):
    """|p - a_i - q_i e_x| = l_i, i = 1, 2, and y midway between the rails; joints q (n, 2) [m]."""

    @dataclass(frozen=True)
    class Dimensions:
        rails: np.ndarray = place(shape=(2, 3))  # [m]
        strut: float = length()  # [m]

    @dataclass(frozen=True)
    class Tolerances:
        rail: float = tolerance()  # [m]
        strut: float = tolerance()  # [m]

    name, joint_unit, limb, freedoms = "five_bar", "m", "slider", (0, 2)
    joints, pose_size, task_size = 2, 3, 2

    def __init__(self, dimensions, tolerances):
        self.dimensions = dimensions
        of_rail = tolerances.rail, "base_joint_position"
        rails = [
            Parameter(f"rail_{axis}_{i}", "m", float(value), *of_rail)
            for i, rail in enumerate(dimensions.rails, 1)
            for axis, value in zip("xyz", rail, strict=True)
        ]
        of_strut = dimensions.strut, tolerances.strut, "arm_length"
        struts = (Parameter(f"strut_{i}", "m", *of_strut) for i in (1, 2))
        self.parameters = ParameterSet((*rails, *struts))

    @property
    def home_pose(self):
        return self.dimensions.rails.mean(axis=0)[PLANE] - [0, 0.7 * self.dimensions.strut, 0]

    @staticmethod
    def equation(q, x, g, c):
        a, b = _along(q, x, g)
        return column(square(a) - g[6] ** 2, square(b) - g[7] ** 2, a[1] + b[1])

    @staticmethod
    def reaching(x, g, c):
        a, b = _along((0.0, 0.0), x, g)
        aside = [sqrt(s**2 - d[1] ** 2 - d[2] ** 2) for d, s in ((a, g[6]), (b, g[7]))]
        return column(a[0] - aside[0], b[0] + aside[1])

    @staticmethod
    def point(x, o):
        return column(x[0], x[2], x[1]) + o

    def task(self, position, turn):
        return position[:, [0, 2]]


@pytest.fixture
def by_hand():
    """Independent closure in numpy."""

    def closure(q, x, g):
        rails = np.broadcast_to(g[..., :6], (len(x), 6)).reshape(-1, 2, 3)
        along = x[:, None, PLANE] - rails - q[..., None] * np.eye(3)[0]
        struts = np.sum(along**2, axis=2) - g[..., 6:] ** 2
        return np.concatenate([struts, along[:, :, 1].sum(axis=1)[:, None]], axis=1)

    return closure


@pytest.fixture(scope="module")
def robot_file(tmp_path_factory):
    """Register the mechanism and write a robot file, with other sections from a linear Delta."""
    path = tmp_path_factory.mktemp("robot") / "five_bar.yaml"
    data = YAML(typ="safe").load(Path(load_robot("linear_delta").source))
    data |= {
        "name": "five_bar",
        "mechanism": "five_bar",
        "geometry": {"rails_mm": [[-500, 10, 800], [500, -10, 800]], "strut_mm": 700.0},
        "tolerances": {"rail_mm": 0.5, "strut_mm": 0.5},
        "workspace": {"centre_mm": [0, 0, 300], "size_mm": [300, 0, 200]},
    }
    sides = {"names": ["left", "right"], "lower_mm": [-350.0] * 2, "upper_mm": [350.0] * 2}
    data["joints"] |= sides
    YAML().dump(data, path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(MECHANISMS._own, FiveBar.name, FiveBar)
        yield str(path)


@pytest.fixture
def mechanism(robot_file):
    """Fixture of the shared tests of closure and inverse kinematics."""
    return load_robot(robot_file).model()


@pytest.mark.parametrize(
    "shared",
    [
        every_robot.test_plans_reach_what_they_say,
        every_robot.test_a_fit_predicts_to_the_noise,
        every_robot.test_what_the_data_do_not_set_does_not_show,
        every_robot.test_a_machine_measured_twice_has_not_moved,
    ],
)
def test_what_every_robot_passes(shared, robot_file):
    shared(robot_file)


def made(robot_file):
    """A machine, and its calibration from 40 poses."""
    robot, seen = every_robot.measured(robot_file, "", "identify", 40, 3)
    found = identify(seen.poses, robot)
    machine = every_robot.machine_of(robot, "", 3)
    return machine, from_identification(found, robot, seen.poses)


@pytest.mark.parametrize("method", ["newton", "apso"])
def test_x_and_z_are_put_right(method, robot_file):
    """By the true errors of the simulated machine; its plane stays off by a rail's tolerance."""
    machine, calibration = made(robot_file)
    nominal = make_plan("disc", machine.robot, count=12, both_sides=False).joint * 0.9
    done = JointCompensator(calibration, method).compensate(nominal)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    model = machine.robot.commanded
    meant = model.forward(nominal, model.parameters.nominal)
    before, _ = true_misses(calibration, machine, at_rest(nominal), meant, True)
    after, _ = true_misses(calibration, machine, at_rest(done.joint), meant, False)
    assert after.max() < 0.2 * before.max()


def test_commands_for_points(robot_file, tmp_path):
    targets, calibration = tmp_path / "targets.csv", tmp_path / "calibration.yaml"
    targets.write_text("x_mm,z_mm\n0,300\n50,250\n")
    robot, seen = every_robot.measured(robot_file, "", "identify", 40, 3)
    save_calibration(calibration, identify(seen.poses, robot), robot, seen.poses)
    command = ["compensate", "--robot", robot_file, "--calibration", str(calibration)]
    assert run([*command, str(targets), "--out", str(tmp_path / "out.csv")]) == 0
    assert (tmp_path / "out.csv").read_text().splitlines()[0] == (
        "x_mm,z_mm,nominal_left_mm,nominal_right_mm,left_mm,right_mm,status,u95_mm,error_mm"
    )


def test_its_looks_are_asked_for_in_words(robot_file, capsys):
    assert run(["urdf", "--robot", robot_file]) == 2
    assert "no drawing is known for a five_bar" in capsys.readouterr().err
