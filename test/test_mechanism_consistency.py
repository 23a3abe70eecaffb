"""Faults in a mechanism that a user wrote are told by name, before it computes wrong commands."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.errors import ConfigError
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.mechanisms.base import Limb
from delta_calibration.mechanisms.consistency import require_consistent
from delta_calibration.parameters import ParameterSet
from delta_calibration.robot import known_robots, load_robot
from hexapod import LEGS, Hexapod, write_robot


@pytest.mark.parametrize("name", known_robots())
def test_the_mechanisms_of_the_package_are_consistent(name):
    robot = load_robot(name)
    for model in (robot.model(), robot.commanded, robot.detailed):
        require_consistent(model)


class NoFreedom(Hexapod):
    freedoms = (0, 1, 2, 3, 4)


class OtherFreedom(Hexapod):
    freedoms = (1, 0, 2, 3, 4, 5)


class SwappedTurns(Hexapod):
    freedoms = (0, 1, 2, 4, 3, 5)


class TwiceTheSame(Hexapod):
    freedoms = (0, 1, 2, 3, 4, 4)


class MissingRow(Hexapod):
    limbs = (*Hexapod.limbs[:-1], Limb((5,), tuple(range(35, 42)), (4,)))


class IdleJoint(Hexapod):
    limbs = (*Hexapod.limbs[:-1], Limb((4,), tuple(range(35, 42)), (5,)))


class LostMass(Hexapod):
    def weights(self, masses):
        return np.zeros(1) if masses is None else np.array([masses.on_platform, 1.0])


class OtherTask(Hexapod):
    def task(self, position, turn):
        return np.concatenate([position, 0 * turn], axis=1)


class OtherPoint(Hexapod):
    @staticmethod
    def point(x, o):
        return 2 * x[0:3] + o


class NoSuchDimension(Hexapod):
    limbs = (*Hexapod.limbs[:-1], Limb((5,), (*range(35, 41), 42), (5,)))


class ShortLimb(Hexapod):
    limbs = (*Hexapod.limbs[:-1], Limb((5,), tuple(range(35, 41)), (5,)))


class NoTolerance(Hexapod):
    def __init__(self, dimensions, tolerances):
        super().__init__(dimensions, tolerances)
        first, *others = self.parameters.items
        self.parameters = ParameterSet((replace(first, prior=0.0), *others))


class NoParameters(Hexapod):
    def __init__(self, dimensions, tolerances):
        self.height = dimensions.height


class AskedForTruth(Hexapod):
    @staticmethod
    def equation(q, x, g, c):
        return q - x[0] if x[0] > 0 else q


class Endless(Hexapod):
    reaching = None

    @property
    def home(self):
        return self.inverse(self.home_pose[None], self.parameters.nominal)[0]


@pytest.fixture
def load(tmp_path, monkeypatch):
    path = tmp_path / "hexapod.yaml"
    with monkeypatch.context() as patch:
        patch.setitem(MECHANISMS._own, Hexapod.name, Hexapod)
        write_robot(path)

    def loaded(kind):
        monkeypatch.setitem(MECHANISMS._own, Hexapod.name, kind)
        return load_robot(path)

    return loaded


@pytest.mark.parametrize(
    ("kind", "told"),
    [
        (NoFreedom, r"freedoms: \(0, 1, 2, 3, 4\) is not allowed; 6 different ones of 0 to 5"),
        (OtherFreedom, "coordinate 1 of the pose is stated to be y, but moves and turns"),
        (SwappedTurns, "coordinate 4 of the pose is stated to be a turn about y, but moves"),
        (TwiceTheSame, r"freedoms: .* is not allowed; 6 different ones of 0 to 5"),
        (MissingRow, r"rows \[0, 1, 2, 3, 4\] of the closure are not allowed"),
        (IdleJoint, "no limb has joint 5"),
        (LostMass, r"weights gives 2 masses, weights\(None\) 1"),
        (OtherTask, "not the first 6 of the pose's coordinates"),
        (OtherPoint, "not the first 6 of the pose's coordinates"),
        (NoSuchDimension, "limb 6: dimensions: 42 is not allowed; 0 to 41"),
        (ShortLimb, "limb 6 has 6 dimensions, limb 1 has 7"),
        (NoTolerance, "prior 0 of parameter base_x_1 is not allowed; more than 0"),
        (NoParameters, "test_mechanism_consistency.py.*AttributeError: .*parameters"),
        (AskedForTruth, r"line \d+, in equation\): RuntimeError: "),
        (Endless, r"line \d+, in home\): RecursionError: "),
    ],
)
def test_a_fault_is_told(kind, told, load):
    with pytest.raises(ConfigError, match=rf"hexapod.yaml: mechanism hexapod.*{told}"):
        load(kind)


def test_a_home_pose_of_whole_numbers_is_one(load):
    """Starting values had been cut to whole metres with it."""

    class Whole(Hexapod):
        home_pose = (0, 0, 1, 0, 0, 0)

        @property
        def home(self):
            return self.inverse(np.array([[0, 0, 0.65, 0, 0, 0]]), self.parameters.nominal)[0]

    model = load(Whole).model()
    x = np.array([[0.05, -0.02, 0.7, 0.1, 0.05, -0.1]])
    start = model.start_joints(x, model.parameters.nominal)
    np.testing.assert_allclose(start, model.inverse(x, model.parameters.nominal), atol=1e-12)


def test_a_pose_of_two_numbers_has_no_turn(load):
    flat = load(Hexapod).model()
    flat.pose_size = 2
    assert np.array_equal(flat.turn(np.ones((3, 2))), np.zeros((3, 3)))
    assert len(flat.limbs) == LEGS
