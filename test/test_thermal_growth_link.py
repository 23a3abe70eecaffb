"""Growth of an arm's links, with a column that grows as well or stays as it is."""

from __future__ import annotations

import pytest

from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects.thermal_growth_link import ThermalGrowthLink
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("ur10")


def test_a_column_that_stays_is_the_first_links_offset() -> None:
    """127.3 mm from the drawing of the UR10; no other length changes."""
    every, some = (ThermalGrowthLink(ROBOT, ROBOT.model(), column=c).lengths() for c in (1.0, 0.0))
    column = ROBOT.model().parameters.names.index("offset_1")
    assert every[column] == pytest.approx(0.1273)
    assert some[column] == 0.0
    some[column] = every[column]
    assert (some == every).all()


def test_both_columns_are_tried_from_either_shape() -> None:
    """Also when another shape is sought for a growth without the column."""
    at = at_rest(ROBOT.model().home[None])
    every = [
        list(ThermalGrowthLink(ROBOT, ROBOT.model(), column=c).shapes(at)) for c in (1.0, 0.0)
    ]
    for shapes in every:
        assert {shape.settings["column"] for shape in shapes} == {0.0, 1.0}
    assert [s.settings for s in every[0]] == [s.settings for s in every[1]]


@pytest.mark.parametrize("column", ["0.0", "1.0"])
def test_it_is_named_alone_whether_the_column_grows_or_not(column: str) -> None:
    """A column that stays as it is was a tracker that drifts, 95 % sure."""
    shape = {"strength": "4", "time_constant": "1200.0", "column": column}
    hidden = {"thermal_growth_link": shape}
    plan = make_plan("identify", ROBOT, count=40, dwell=40.0, seed=3)  # an hour
    session = simulate_session(draw_machine(ROBOT, 3, hidden=hidden), plan, 3, period=0.5)
    verdict = diagnose(survey(session, ROBOT.joints.names), ROBOT, seed=3).verdict
    (finding,) = verdict.findings
    assert finding.cause == "thermal_growth_link"
    assert ("column" in finding.shape) == (column == "0.0")
