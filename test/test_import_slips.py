"""Mistakes in a mapping are found by the reach of the robot: columns, rows and likely cause.

The tables are those of simulated robots, each with one mistake.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from delta_calibration.data import collect
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from import_bench import imported, refused

ROBOTS = ("srbd", "linear_delta", "ur10")
N = 48


@pytest.fixture(scope="module", params=ROBOTS)
def cell(request, tmp_path_factory):
    """A folder, the robot, and its table (48, m + 3) in degrees or millimetres."""
    robot = load_robot(request.param)
    plan = make_plan("identify", robot, count=24, seed=5)
    poses = collect(simulate_session(draw_machine(robot, 5), plan, 5), robot.joints.names)
    assert len(poses) == N
    factor = 180 / np.pi if robot.joints.unit == "rad" else 1e3
    return (
        tmp_path_factory.mktemp("slips"),
        robot,
        np.hstack([factor * poses.joint, 1e3 * poses.point]),
    )


def head_of(robot):
    return [*(f"q{k + 1}" for k in range(len(robot.joints.names))), "x", "y", "z"]


def mapping_of(robot, unit=""):
    unit = unit or ("deg" if robot.joints.unit == "rad" else "mm")
    return {
        "schema": 1,
        "rows": "stops",
        "commands": [
            {"joint": joint, "column": f"q{k + 1}", "unit": unit}
            for k, joint in enumerate(robot.joints.names)
        ],
        "position": {"columns": ["x", "y", "z"], "unit": "mm"},
    }


def said(capsys, cell, table, unit=""):
    folder, robot, _ = cell
    rows = [[*map(repr, row)] for row in table.tolist()]
    return refused(capsys, folder, head_of(robot), rows, mapping_of(robot, unit), robot.name)


def spoilt(table, rows, columns, factor):
    other = table.copy()
    other[np.ix_(rows, columns)] *= factor
    return other


WHERE = {
    "all": (np.arange(N), "as in all rows"),
    "half": (np.arange(N // 2, N), "as in lines 26 to 49, 24 of 48 rows; the others can be in"),
    "in turns": (np.arange(0, N, 2), "as in lines 2, 4, 6, 8, 10, 12 and 18 more, 24 of 48 rows"),
    "last": (np.arange(36, N), "as in lines 38 to 49, 12 of 48 rows; the others can be in"),
    "most": (np.arange(12, N), "as in lines 14 to 49, 36 of 48 rows; the others can be in"),
    "one": (np.array([7]), "as in line 9, 1 of 48 rows; the others can be in"),
}


@pytest.mark.parametrize("where", WHERE)
def test_points_in_another_unit(cell, capsys, where):
    _, robot, table = cell
    rows, place = WHERE[where]
    unit = "inch" if where == "in turns" else "um" if where == "most" else "m"
    factor = {"m": 1e-3, "um": 1e3, "inch": 1 / 25.4}[unit]
    m = len(robot.joints.names)
    text = said(capsys, cell, spoilt(table, rows, [m, m + 1, m + 2], factor))
    assert f"line {rows[0] + 2}: x: " in text
    assert "and those of y, z cannot be in mm" in text
    assert f"likely {unit}, {place}" in text


@pytest.mark.parametrize("where", ["all", "most", "one"])
def test_a_column_of_the_points_in_another_unit(cell, capsys, where):
    _, robot, table = cell
    rows, place = WHERE[where]
    text = said(capsys, cell, spoilt(table, rows, [len(robot.joints.names) + 1], 1e-3))
    assert f"line {rows[0] + 2}: y: " in text
    assert "' cannot be in mm" in text
    assert f"likely m, {place}" in text


@pytest.mark.parametrize("where", ["all", "half", "one"])
@pytest.mark.parametrize("columns", ["all", "q2"])
@pytest.mark.parametrize("large", [True, False])
def test_joints_in_another_unit(cell, capsys, where, columns, large):
    """Radians declared as degrees, metres declared as millimetres, and vice versa."""
    _, robot, table = cell
    turns = robot.joints.unit == "rad"
    small, units = (np.pi / 180, ("deg", "rad")) if turns else (1e-3, ("mm", "m"))
    m = len(robot.joints.names)
    joints = [*range(m)] if columns == "all" else [1]
    rows, place = WHERE[where]
    if large:
        kept = spoilt(table, np.arange(N), [*range(m)], small)
        text = said(capsys, cell, spoilt(kept, rows, joints, 1 / small), units[1])
        assert f"cannot be in {units[1]}" in text
        assert f"likely {units[0]}, {place}" in text
    else:
        text = said(capsys, cell, spoilt(table, rows, joints, small))
        assert f"cannot be in {units[0]}" in text
        assert f"likely {units[1]}, {place}" in text
    assert f": q{joints[0] + 1}: " in text
    assert "inf" not in text


def test_heights_in_another_unit_that_a_plane_of_most_rows_hides(capsys, tmp_path):
    """In m, declared as mm. 24 of 45 rows are at one height, so they fit with either unit."""
    robot = load_robot("srbd")
    lines = (Path(__file__).parents[1] / "bags" / "srbd_plain.csv").read_text().splitlines()
    table = np.array([[float(cell) for cell in line.split(",")[1:]] for line in lines[4:]])
    spoiled = spoilt(table, np.arange(len(table)), [5], 1e-3)
    message = said(capsys, (tmp_path, robot, table), spoiled)
    assert "line 2: z: " in message
    assert "cannot be in mm: the measured point is 99." in message
    assert "likely m, as in all rows" in message


def test_a_left_handed_frame(cell, capsys):
    """Swapping two axes and negating one are equivalent, because the tracker frame is free."""
    _, robot, table = cell
    m = len(robot.joints.names)
    swapped, negated = table.copy(), table.copy()
    swapped[:, [m, m + 1]] = table[:, [m + 1, m]]
    negated[:, m + 2] *= -1
    for other in (swapped, negated):
        text = said(capsys, cell, other)
        assert "mm (median) from where the robot can be; likely x, y, z in a left-handed" in text


def test_joints_of_another_sign_or_swapped(cell, capsys):
    _, _, table = cell
    reversed_, swapped = table.copy(), table.copy()
    reversed_[:, 0] *= -1
    assert "likely q1 with the opposite sign (`scale: -1`)" in said(capsys, cell, reversed_)
    swapped[:, [0, 1]] = table[:, [1, 0]]
    assert "q1 and q2 swapped" in said(capsys, cell, swapped)


def test_all_units_wrong_at_once(cell, capsys):
    """No single mistake explains the points; the limits give the unit of joints that all slide."""
    folder, robot, table = cell
    turns = robot.joints.unit == "rad"  # some angles are within their limits in either unit
    mapping = mapping_of(robot, "rad" if turns else "m")
    mapping["position"]["unit"] = "m"
    rows = [[*map(repr, row)] for row in table.tolist()]
    text = refused(capsys, folder, head_of(robot), rows, mapping, robot.name)
    assert "beyond the limits of" in text
    assert turns or text.endswith("likely mm")


def test_columns_shifted_by_one_are_beyond_the_limits(cell, capsys):
    _, robot, table = cell
    joint = robot.joints.names[-1]
    text = said(capsys, cell, np.roll(table, -1, axis=1))
    assert f"beyond the limits of {joint}" in text
    assert text.endswith("as in 48 of 48 rows; is it another column, zero, sign or robot?")


def test_what_nothing_explains_is_noted(cell, capsys):
    """Each row has the joints of the previous row."""
    folder, robot, table = cell
    m = len(robot.joints.names)
    late = np.hstack([np.roll(table[:, :m], 1, axis=0), table[:, m:]])
    rows = [[*map(repr, row)] for row in late.tolist()]
    imported(folder, head_of(robot), rows, mapping_of(robot), robot.name)
    assert "note: with the columns of this mapping, the measured points are" in (
        capsys.readouterr().out
    )


def test_too_few_rows_to_judge_by_the_reach_are_noted(cell, capsys):
    folder, robot, table = cell
    rows = [[*map(repr, row)] for row in table[:5].tolist()]
    imported(folder, head_of(robot), rows, mapping_of(robot), robot.name)
    assert "note: 5 rows at rest: too few to check the units" in capsys.readouterr().out


def test_good_tables_of_many_machines_pass(cell):
    """Machines with typical errors, in any tracker frame."""
    folder, robot, _ = cell
    for seed in range(3):
        plan = make_plan("identify", robot, count=12, seed=seed)
        session = simulate_session(draw_machine(robot, seed, scatter=3.0), plan, seed)
        poses = collect(session, robot.joints.names)
        factor = 180 / np.pi if robot.joints.unit == "rad" else 1e3
        good = np.hstack([factor * poses.joint, 1e3 * poses.point])
        rows = [[*map(repr, row)] for row in good.tolist()]
        imported(folder, head_of(robot), rows, mapping_of(robot), robot.name)
