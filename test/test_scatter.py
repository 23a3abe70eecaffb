"""False alarm rates of dimensions that stand out from the scatter of the machine."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import binom

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.geometry import scatter_of
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

DRAWS, LEVELS = 300, (0.05, 0.01)


def built(name, scatter, rng):
    """Evidence of machines with random errors of all parts, `scatter` times their tolerance."""
    robot = load_robot(name)
    session = simulate_session(draw_machine(robot, 5), make_plan("identify", robot, count=20), 5)
    seen = calibrated(survey(session, robot.joints.names), robot).evidence
    parts, shape = seen.geometry, seen.residual.shape
    for _ in range(DRAWS):
        off = scatter * rng.standard_normal(parts.shape[1])
        residual = parts @ off + rng.standard_normal(seen.size)
        yield replace(seen, residual=residual.reshape(shape))


@pytest.mark.parametrize("name", ["linear_delta", "scara"])
@pytest.mark.parametrize("scatter", [1.0, 0.02])
def test_chance_says_that_a_part_is_out_of_line_as_often_as_it_is_said_to(name, scatter) -> None:
    """Machines of few parts, with a scatter far above the noise and with one below it."""
    rng = np.random.default_rng([7, len(name), round(1 / scatter)])
    every = [scatter_of(one) for one in built(name, scatter, rng)]
    one = np.array([s.outlier.log_p for s in every])
    for level in LEVELS:  # parts are not tested one by one, so there may be fewer false alarms
        assert np.sum(one < np.log(level)) <= binom.ppf(0.999, DRAWS, level)


@pytest.mark.parametrize("name", ["linear_delta", "scara"])
def test_chance_says_that_all_are_too_large_as_often_as_it_is_said_to(name) -> None:
    """With parts whose errors are as large as their tolerances."""
    rng = np.random.default_rng([8, len(name)])
    size = np.array([scatter_of(one).log_p for one in built(name, 1.0, rng)])
    for level in LEVELS:
        assert np.sum(size < np.log(level)) <= binom.ppf(0.999, DRAWS, level)
