"""The demonstration with robots that need no ROS, and the camera above the plane of a SCARA."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cell.positioning import Positioning
from delta_calibration.cli.camera_demo import positioned_by_camera
from delta_calibration.cli.main import run
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.errors import InputError
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, standing


def test_a_scara_is_driven_right_by_a_camera(capsys) -> None:
    robot = load_robot("scara")
    figures = positioned_by_camera(draw_machine(robot, 7), robot.camera, 7)
    before, after = figures["before"], figures["after"]
    assert after["mean_mm"] < 0.15 * before["mean_mm"]
    assert after["max_mm"] < 0.1  # a step of 0.01 degree is up to 0.17 mm at 1 m
    assert figures["moves_mean"] < 40
    assert "no model" in capsys.readouterr().out


def lattice(robot: Robot) -> GridSettings:
    joints = robot.joints
    unit = np.full(len(joints.names), robot.commanded.joint_size * np.pi / 18000)
    return GridSettings(unit, joints.lower, joints.upper, robot.limits.correction)


def test_a_scara_is_positioned_by_a_tracker() -> None:
    robot = load_robot("scara")
    machine, rng = draw_machine(robot, 3), np.random.default_rng(3)
    targets = make_plan("disc", robot, count=3, both_sides=False).target
    way = Positioning(robot, targets, lattice(robot), 2, 5, 12)
    while not way.done:
        at = standing((way.step + machine.rest_error(rng))[None])
        way.tell(np.mean([machine.readings(at, rng)[0] for _ in range(5)], axis=0))
    assert all(outcome.after < 0.06e-3 for outcome in way.outcomes)


@pytest.mark.parametrize("name", ["cdpr8", "five_axis", "ur10"])
def test_a_tool_that_is_turned_is_not_positioned_by_its_place(name: str) -> None:
    robot = load_robot(name)
    targets = make_plan("disc", robot, count=2, both_sides=False).target
    with pytest.raises(InputError, match=f"robot {name}: . joints .* command . coordinates"):
        Positioning(robot, targets, lattice(robot), 2, 5, 12)


RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹−", "-0123456789-", "\u202f")


def hidden_values(said: str) -> list[list[float]]:
    """True value, found value and both ends of the interval, for each value in the output."""
    rows = said.partition("95 % interval\n")[2].partition("\n\n")[0].splitlines()
    cells = (re.split(r" {2,}| to ", row)[2:] for row in rows)
    return [[float(c.translate(RAISED).replace(" × 10", "e")) for c in row] for row in cells]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "cause", "gain"),
    [("five_axis", "slider_pitch", 0.5), ("scara", "reducer_compliance", 0.05)],
)
def test_a_demonstration(name: str, cause: str, gain: float, tmp_path: Path, capsys) -> None:
    file = tmp_path / "a robot.yaml"
    file.write_bytes(Path(load_robot(name).source).read_bytes())
    assert run(["demo", "--robot", str(file), "--out", str(tmp_path / "demo")]) == 0
    said = capsys.readouterr().out
    assert f"hidden: {cause}; found: {cause}" in said
    assert (
        f"to repeat this run: delta-cal demo --robot '{file}' --seed 7 --method newton\n" in said
    )
    page = tmp_path / "demo" / "report.html"
    assert not page.exists() or f"open {page} in a browser" in said.splitlines()[-1]
    assert len(set(re.findall(r"\((\d+) moments\)", said.partition("second act")[2]))) == 1
    left = {path.name for path in (tmp_path / "demo").iterdir()}
    assert {"session", "session_2", "calibration.yaml", "extended.yaml", "verdict.json"} <= left
    summary = json.loads((tmp_path / "demo" / "summary.json").read_text())
    second = summary["second_act"]
    assert second["right"]
    assert second["extended"]["after"]["mean_mm"] < 0.3 * second["calibrated"]["after"]["mean_mm"]
    first = summary["first_act"]
    assert first["after"]["mean_mm"] < gain * first["before"]["mean_mm"]
    assert hidden_values(said)
    for true, value, low, high in hidden_values(said):
        assert low < value < high
        assert abs(true - value) < high - low  # four standard errors


def test_a_method_that_is_not_for_the_robot_is_refused(tmp_path: Path, capsys) -> None:
    given = ["demo", "--robot", "cdpr8", "--method", "apso", "--out", str(tmp_path / "demo")]
    assert run(given) == 2
    assert "method 'apso' is not for robot cdpr8" in capsys.readouterr().err
