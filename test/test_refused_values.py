"""Values that once gave a traceback, a NaN or a number from beyond the end of an array."""

from __future__ import annotations

import os

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import JointCompensator, load_table
from delta_calibration.data import at_rest
from delta_calibration.errors import ConfigError, DataError, InputError
from delta_calibration.estimation.measurements import DistanceBetween
from delta_calibration.estimation.noise import Noise
from delta_calibration.estimation.observability import observe
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from delta_calibration.uncertainty import radius95
from delta_calibration.wording import NO_VALUE, figures, measured

ROBOT = load_robot("srbd")
MECHANISM = ROBOT.model("rotary_delta")
CHAIN = Chain(MECHANISM, np.zeros(3), 0.05)
THETA = CHAIN.join(MECHANISM.parameters.nominal, np.zeros(3), Frame.identity())


def calibration() -> Calibration:
    corners = np.array(np.meshgrid(*2 * [[-0.2, 0.2]], [-0.9, -0.6])).reshape(3, -1).T
    lower, upper = ROBOT.joints.lower, ROBOT.joints.upper
    region = Region.of(corners)
    return Calibration(ROBOT, CHAIN, THETA, region, lower, upper, 1e-5, "made", "c" * 64)


def test_conditions_of_other_commands_are_refused():
    compensator, q = JointCompensator(calibration()), np.full((3, 3), 0.3)
    for count in (1, 2):
        with pytest.raises(InputError, match=f"conditions of {count} commands for 3"):
            compensator.compensate(q, at_rest(q[:count]))
    assert len(compensator.compensate(q, at_rest(q)).joint) == 3


def test_a_machine_of_another_number_of_parameters_is_refused():
    at = at_rest(np.full((2, 3), 0.3))
    assert np.isfinite(CHAIN.predict(at, THETA)).all()
    for wrong in (THETA[:-3], np.append(THETA, 0.0)):
        with pytest.raises(InputError, match="theta has shape"):
            CHAIN.predict(at, wrong)


def test_a_distance_of_a_position_from_itself_is_refused():
    joint = np.array([[0.1, 0.2, 0.3], [0.4, 0.2, 0.3]])
    other = joint + np.array([[0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    with pytest.raises(InputError, match="distance 2: both positions have the same joints"):
        DistanceBetween(joint, other, np.array([0.1, 0.0]), 1e-5)


def test_a_reading_at_the_device_itself_is_refused():
    noise = Noise(1.0, 1.0, 1e-5, 1e-5, 0, False)
    point = np.array([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0]])
    assert np.isfinite(noise.reading(point[:1], ROBOT.tracker)).all()
    with pytest.raises(DataError, match=r"pose 2: .* place of the measuring device itself"):
        noise.reading(point, ROBOT.tracker)


def test_readings_that_depend_on_nothing_are_refused():
    with pytest.raises(DataError, match="nothing is identifiable"):
        observe(np.zeros((4, 3, 2)), np.ones(2), ("a", "b"))


def test_a_pipe_in_place_of_a_table_is_refused(tmp_path):
    pipe = tmp_path / "table.npz"
    os.mkfifo(pipe)
    with pytest.raises(ConfigError, match="is a pipe, a device or a socket"):
        load_table(pipe, calibration())


def test_a_name_that_no_file_can_have_is_no_robot():
    with pytest.raises(ConfigError, match=r"no robot 'a+'"):
        load_robot("a" * 300)


def test_no_spread_is_certain():
    none = np.zeros((1, 3, 3))
    assert radius95(none, doubt=np.zeros(1)) == 0.0
    assert radius95(none + np.eye(3), doubt=np.zeros(1)) == pytest.approx(
        radius95(none + np.eye(3))
    )


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_number_that_is_not_finite_is_told_as_none(value: float):
    assert figures(value) == NO_VALUE
    assert NO_VALUE in measured(1.0, np.inf, "rad")
    assert "nan" not in measured(1.0, value, "rad")
