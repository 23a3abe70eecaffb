"""Chances far out: sums of squares with weights of either sign, and likeness of neighbours."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated, diagnose
from delta_calibration.diagnosis import residual_tests as tested
from delta_calibration.diagnosis.tails import chance_above
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session


@pytest.mark.parametrize("shift", [0.0, 0.2, 0.35, 0.5])
def test_the_chance_is_that_of_draws(shift: float) -> None:
    rng = np.random.default_rng(3)
    weights = rng.standard_normal(60) - shift
    drawn = rng.standard_normal((400_000, 60)) ** 2 @ weights > 0
    error = np.sqrt(drawn.mean() / len(drawn))
    assert chance_above(weights) == pytest.approx(drawn.mean(), rel=0.1, abs=3 * error)


def test_the_middle_and_the_ends() -> None:
    assert chance_above(np.array([1.0, -1.0])) == pytest.approx(0.5)
    near = [chance_above(np.array([1.0] * 20 + [-x] * 20)) for x in np.linspace(0.98, 1.02, 9)]
    assert all(one > other for one, other in pairwise(near))
    assert chance_above(np.array([1.0, 2.0])) == 1.0
    assert chance_above(np.array([-1.0, 0.0])) == 0.0


def test_likeness_of_neighbours_in_the_tail_is_that_of_many_draws() -> None:
    """Of a SCARA's stops: 2000 draws have as much in the share that is told."""
    robot = load_robot("scara")
    plan = make_plan("identify", robot, count=16, seed=1)
    seen = survey(simulate_session(draw_machine(robot, 1), plan, 1), robot.joints.names)
    evidence = calibrated(seen, robot).evidence
    rows = np.flatnonzero(evidence.believed[: evidence.poses])
    near = tested._neighbourhoods(evidence, rows)["direction"]
    rng = np.random.default_rng(2)
    drawn = evidence.weigh(evidence.draw(8000, rng)).reshape(*evidence.residual.shape, -1)[rows]
    likeness = tested._moran(drawn, near)
    usual = float(np.mean(np.sum(drawn**2, axis=(0, 1))))
    number = int(np.argsort(likeness)[-80])  # one in a hundred has as much
    left = drawn[:, :, number]
    own = likeness[number] - (tested.SLIGHT * usual / np.sum(left**2)) ** 2
    p = tested._in_the_tail(evidence, rows, left, near)
    assert p == pytest.approx(np.mean(likeness >= own), rel=0.35)


def test_a_reflector_on_the_wrong_floor_makes_no_structure() -> None:
    """The poses have it 11 cm off; with the readings in motion it is where the file says."""
    robot, seed = load_robot("srbd"), 300_090
    session = simulate_session(draw_machine(robot, seed), make_plan("circles", robot), seed)
    found = diagnose(survey(session, robot.joints.names), robot)
    offset = found.model.theta[found.model.layout.offset]
    assert np.abs(offset - robot.tracker.reflector_offset).max() < 0.02
    assert not found.verdict.unknown_structure.found
