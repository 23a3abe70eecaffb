"""Tests of a ballbar's length as a measurement: derivatives, table, circle test."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")

from delta_calibration.circle_test import (
    DIMENSIONS,
    CircleTest,
    ballbar_test,
    diagnose_ballbar,
    read_ballbar,
)
from delta_calibration.cli.main import run
from delta_calibration.data import Session, at_rest
from delta_calibration.diagnosis import Observed
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import Measured, PlacedMachine, RadiusMeasured
from delta_calibration.geometry import Frame
from delta_calibration.plans import make_plan, tool_points
from delta_calibration.robot import load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session

ROBOT = load_robot("scara")
SEED = 11
NOISE = 8e-6  # [m] noise of a length from the simulated tracker
PLAY = {"backlash": {"location": "joint_2", "value": "0.0006"}}
MISSED = np.array([2e-4, -1e-4, 5e-5])  # [m] position error of the pivot


def driven(causes: dict, scatter: float = 1.0, seed: int = SEED) -> tuple[Session, np.ndarray]:
    """A circle test, and the distances of the ball from a pivot on the table."""
    return driven_by(draw_machine(ROBOT, SEED, scatter, causes), seed)


def driven_by(machine: TrueMachine, seed: int) -> tuple[Session, np.ndarray]:
    plan = make_plan("circles", ROBOT)
    session = simulate_session(machine, plan, seed)
    way = tool_points(ROBOT, plan.paths[0].joint)
    pivot = (way.min(axis=0) + way.max(axis=0)) / 2 + MISSED
    frame = machine.chain.split(machine.theta)[2]
    assert session.tracker is not None
    return session, np.linalg.norm(frame.inverse().apply(session.tracker.position) - pivot, axis=1)


def lines_of(session: Session, radius: np.ndarray, by_points: bool = False) -> list[str]:
    """Lines of the table, header first."""
    assert session.command is not None
    time = (session.command.stamp_ns - session.command.stamp_ns[0]) * 1e-9
    what = session.command.position
    names: Sequence[str] = ROBOT.joints.names
    if by_points:
        what, names = 1e3 * tool_points(ROBOT, what), ("x_mm", "y_mm", "z_mm")
    rows = np.column_stack([time, 1e3 * radius, what])
    return [
        ",".join(("time_s", "radius_mm", *names)),
        *(",".join(f"{value:.9g}" for value in row) for row in rows),
    ]


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


def circles_of(path: Path) -> CircleTest:
    ballbar = read_ballbar(path, ROBOT)
    return ballbar_test(ballbar, ROBOT, diagnose_ballbar(ballbar, ROBOT, NOISE, 0))


@pytest.fixture(scope="module")
def lines() -> list[str]:
    return lines_of(*driven(PLAY))


@pytest.fixture(scope="module")
def table(lines: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("ballbar") / "ballbar.csv", lines)


def test_slopes_are_those_of_the_length() -> None:
    """Compared with finite differences; the rotation of the table's frame has no influence."""
    robot = load_robot("srbd")
    joint = np.array([[0.1, 0.3, -0.2], [0.4, -0.1, 0.2]])
    offset, frame = np.array([0.01, -0.02, 0.03]), Frame(np.eye(3), np.array([0.1, 0.05, 0.6]))
    machine = PlacedMachine.of(robot.detailed, robot.detailed.parameters.nominal, frame)
    bar = RadiusMeasured(joint, np.full(2, 0.3), offset, 1e-6)
    x = machine.chain.mechanism.forward(joint, machine.geometry)
    point = machine.chain.point(x, offset) + frame.translation
    np.testing.assert_allclose(bar.missed(machine)[:, 0], 0.3 - np.linalg.norm(point, axis=1))
    slope = bar.slopes(machine)
    turn = machine.chain.layout.turn
    assert not slope[..., turn].any()
    for k in np.setdiff1d(np.arange(len(machine.theta)), np.arange(turn.start, turn.stop)):
        ends = []
        for step in (1e-6, -1e-6):
            theta = machine.theta.copy()
            theta[k] += step
            ends.append(-bar.missed(PlacedMachine(machine.chain, theta)))
        np.testing.assert_allclose(slope[..., k], (ends[0] - ends[1]) / 2e-6, atol=1e-6)


def test_only_the_place_of_the_table_is_free_and_motion_stands_alone() -> None:
    joint = np.array([[1.0, 0.5], [1.1, 0.6], [1.2, 0.4]])
    bar = RadiusMeasured(joint, np.full(3, 0.2), np.zeros(3), 1e-6)
    one = Measured(bar, at_rest(joint), path=np.zeros(3, dtype=np.int64), repeatability=1e-5)
    with pytest.raises(InputError, match="in motion is not allowed beside others"):
        Observed.of(ROBOT.detailed, [one, one], Frame.identity())
    with pytest.raises(InputError, match="radius: offset"):
        RadiusMeasured(joint, np.full(3, 0.2), np.zeros(2), 1e-6)


def test_a_ballbar_names_the_cause_and_foretells_the_repair(table: Path) -> None:
    found = circles_of(table)
    named = [f for f in found.verdict.findings if f.cause == "backlash"]
    assert [f.location for f in named] == ["joint_2"]
    assert named[0].parameters["gap_2"].value == pytest.approx(6e-4, rel=0.03)
    for m in found.circles:
        assert sum(s.size for s in m.shares) == pytest.approx(m.deviation, rel=1e-6)
    repaired = circles_of(written(table.with_name("repaired.csv"), lines_of(*driven({}, seed=12))))
    assert found.without("backlash", "joint_2") == pytest.approx(repaired.deviation, rel=0.1)
    assert not [f for f in repaired.verdict.findings if f.kind != "geometry"]
    if (DIMENSIONS, None) in found.circles[0].without:
        as_drawn = lines_of(*driven(PLAY, scatter=0.0, seed=13))
        drawn = circles_of(written(table.with_name("drawn.csv"), as_drawn))
        assert found.without(DIMENSIONS, None) == pytest.approx(drawn.deviation, rel=0.1)


def test_points_say_the_same_as_joints(lines: list[str], table: Path) -> None:
    by_joints = read_ballbar(table, ROBOT)
    points = written(table.with_name("points.csv"), lines_of(*driven(PLAY), by_points=True))
    by_points = read_ballbar(points, ROBOT)
    np.testing.assert_allclose(by_points.at.joint, by_joints.at.joint, atol=1e-7)
    np.testing.assert_array_equal(by_points.at.direction, by_joints.at.direction)
    assert len(by_points.circles) == 12


def test_the_command_takes_the_table(
    table: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, page = tmp_path / "circles.json", tmp_path / "page.html"
    arguments = ["--robot", "scara", "--noise-um", "8", "--json", str(out), "--report", str(page)]
    assert run(["circle", str(table), *arguments]) == 0
    assert "lengths on 12 circles" in capsys.readouterr().out
    told = json.loads(out.read_text())
    assert "backlash" in [f["cause"] for f in told["findings"]]
    assert len(told["circles"]) == 12
    assert "ballbar.csv" in page.read_text()
    assert "(scara.yaml)" in page.read_text()  # without the folder
    assert run(["circle", str(table), "--robot", "scara", "--model", "serial_arm"]) == 2
    assert run(["circle", str(tmp_path), "--robot", "scara", "--noise-um", "1"]) == 2


def test_what_is_wrong_in_a_table_is_named(lines: list[str], tmp_path: Path) -> None:
    def refused(changed: list[str], says: str, kind: type[Exception] = InputError) -> None:
        with pytest.raises(kind, match=says):
            read_ballbar(written(tmp_path / "bad.csv", changed), ROBOT)

    def with_line(number: int, column: int, text: str) -> list[str]:
        values = lines[number].split(",")
        values[column] = text
        return [*lines[:number], ",".join(values), *lines[number + 1 :]]

    refused([lines[0].replace("radius_mm", "length"), *lines[1:]], "column radius_mm missing")
    refused(with_line(5, 1, "nan"), "line 6: radius_mm: 'nan' is not a finite number")
    refused(with_line(5, 0, "0"), "line 6: time_s: '0' is not allowed; later than")
    refused(with_line(7, 2, "57.3"), "line 8: 3283.* degrees for joint_1; .*rad or m are expected")
    refused(lines[:30], "no circle in it", DataError)
    off = [lines[0], *(",".join((t, "500", *q)) for t, _, *q in (x.split(",") for x in lines[1:]))]
    refused(off, "radius_mm: '500' is not allowed; the command has radius 200.0 mm")
    with pytest.raises(InputError, match="cannot be read"):
        read_ballbar(tmp_path / "none.csv", ROBOT)


def test_where_joints_came_to_rest_is_no_error_of_the_machine(tmp_path: Path) -> None:
    """A motion keeps its rest error, which is many times a good ballbar's scatter."""
    tracker = replace(ROBOT.tracker, radial=3e-7, transverse=3e-7, transverse_per_metre=0.0)
    machine = draw_machine(replace(ROBOT, tracker=tracker), SEED)
    path = written(tmp_path / "quiet.csv", lines_of(*driven_by(machine, SEED)))
    ballbar = read_ballbar(path, ROBOT)
    verdict = diagnose_ballbar(ballbar, ROBOT, 5e-7, 0).verdict
    assert not [f for f in verdict.findings if f.kind != "geometry"]
    assert not verdict.unknown_structure.found
