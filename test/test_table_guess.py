"""`delta-cal import --guess`: a mapping of tables as people write them, and what is in doubt."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.documents import parse_yaml
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session


@dataclass(frozen=True)
class Written:
    """How somebody wrote a table of stops."""

    head: str  # what stands before the numbers, with the names of the columns where it has them
    row: Callable[[np.ndarray, np.ndarray, int], str]  # joints [rad or m], point [m], number
    encoding: str = "utf-8"
    robot: str = "srbd"


def numbers(values: np.ndarray, mark: str = ".", by: str = ",", digits: int = 6) -> str:
    return by.join(f"{v:.{digits}f}".replace(".", mark) for v in values)


def deg_mm(q: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.concatenate([np.degrees(q), 1e3 * y])


TABLES = {
    "plain": Written("q1,q2,q3,x,y,z\n", lambda q, y, k: numbers(deg_mm(q, y))),
    "radians and metres": Written(
        "joint_1,joint_2,joint_3,X,Y,Z\n",
        lambda q, y, k: numbers(np.concatenate([q, y]), digits=9),
    ),
    "German Excel": Written(
        "Punkt;Achse1 [°];Achse2 [°];Achse3 [°];X [mm];Y [mm];Z [mm]\n",
        lambda q, y, k: f"P{k};" + numbers(deg_mm(q, y), ",", ";"),
        "cp1252",
    ),
    "tabs, units in brackets": Written(
        "time (s)\tA1 (deg)\tA2 (deg)\tA3 (deg)\tx (m)\ty (m)\tz (m)\n",
        lambda q, y, k: f"{10 * k}\t" + numbers(np.r_[np.degrees(q), y], by="\t", digits=9),
    ),
    "a preamble": Written(
        "Instrument: tracker\nOperator: A, B\n\nno,axis 1,axis 2,axis 3,Pos X,Pos Y,Pos Z\n",
        lambda q, y, k: f"{k}," + numbers(deg_mm(q, y)),
    ),
    "capitals, other columns between": Written(
        "ID,TARGET_Q_0,TARGET_Q_1,TARGET_Q_2,ACTUAL_Q_0,ACTUAL_Q_1,ACTUAL_Q_2,MEAS_X,MEAS_Y,MEAS_Z\n",
        lambda q, y, k: f"{k}," + numbers(np.r_[q, q + 1e-6, 1e3 * y], digits=9),
    ),
    "Z in m beside X and Y in mm": Written(
        "q1 [deg],q2 [deg],q3 [deg],x [mm],y [mm],z [m]\n",
        lambda q, y, k: numbers(np.r_[np.degrees(q), 1e3 * y[:2], y[2]], digits=9),
    ),
    "where it was to go, beside where it was": Written(
        "goal_x,goal_y,goal_z,a,b,c,measurement_x,std_x,measurement_y,std_y,measurement_z,std_z\n",
        lambda q, y, k: numbers(
            np.r_[0.1, 0.2, 0.3 + k, np.degrees(q), np.c_[1e3 * y, [0.01] * 3].ravel()]
        ),
    ),
    "no names": Written("", lambda q, y, k: f"{k}," + numbers(deg_mm(q, y))),
    "points before joints": Written(
        "x|y|z|j1|j2|j3\n",
        lambda q, y, k: numbers(np.r_[1e3 * y, np.degrees(q)], by="|"),
    ),
    "inches": Written(
        "j1,j2,j3,x,y,z\n", lambda q, y, k: numbers(np.r_[np.degrees(q), y / 25.4e-3])
    ),
    "day and time, payload, a thermometer": Written(
        "Date,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm,load_g,temp_arm\n",
        lambda q, y, k: (
            f"2026-03-01 10:{k:02d}:00," + numbers(deg_mm(q, y)) + f",500,{20 + k / 10}"
        ),
    ),
    "day and time in digits": Written(
        "timestamp,q1,q2,q3,x,y,z\n",
        lambda q, y, k: f"2026030110{k:02d}00," + numbers(deg_mm(q, y)),
    ),
    "joints that slide": Written(
        "s1,s2,s3,x,y,z\n",
        lambda q, y, k: numbers(np.concatenate([1e3 * q, 1e3 * y])),
        robot="linear_delta",
    ),
    "blanks": Written("q1 q2 q3 x y z\n", lambda q, y, k: numbers(deg_mm(q, y), by=" ")),
}


def stops(robot_name: str) -> tuple[np.ndarray, np.ndarray]:
    robot = load_robot(robot_name)
    plan = make_plan("identify", robot, count=20, seed=3)
    session = simulate_session(draw_machine(robot, 3), plan, 3)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    return poses.command, poses.point


@pytest.fixture(scope="module")
def measured() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    return {name: stops(name) for name in ("srbd", "linear_delta")}


def write(folder: Path, written: Written, q: np.ndarray, y: np.ndarray) -> Path:
    rows = "".join(written.row(q[k], y[k], k) + "\n" for k in range(len(q)))
    file = folder / "table.csv"
    file.write_bytes((written.head + rows).encode(written.encoding))
    return file


def guess(file: Path, robot: str, *options: str) -> int:
    return run(["import", str(file), "--guess", "--robot", robot, *options])


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_as_it_was_meant(
    name: str, tmp_path: Path, measured: dict[str, tuple[np.ndarray, np.ndarray]]
) -> None:
    """Joints and points of the session that is written are those that were measured."""
    written = TABLES[name]
    q, y = measured[written.robot]
    file, out = write(tmp_path, written, q, y), tmp_path / "session"
    assert guess(file, written.robot, "--out", str(out)) == 0
    robot = load_robot(written.robot)
    found = collect(read_session(out), robot.joints.names, robot.commanded.joint_size)
    np.testing.assert_allclose(found.command, q, atol=1e-6)
    np.testing.assert_allclose(found.point, y, atol=1e-6)
    if "payload" in name:
        assert np.unique(found.payload).tolist() == [0.5]
        assert found.temperature_parts == ("arm",)


def test_ten_rows_and_reasons_are_shown_and_the_mapping_is_written(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    file = write(tmp_path, TABLES["German Excel"], *measured["srbd"])
    assert guess(file, "srbd", "--mapping-out", str(tmp_path / "mapping.yaml")) == 0
    said = capsys.readouterr().out
    assert "joints: columns Achse1 [°], Achse2 [°], Achse3 [°], by their names" in said
    assert "the drawing comes to lie on the points" in said
    shown = [line for line in said.splitlines() if re.match(r"-?\d", line)]
    assert len(shown) == 10
    mapping = parse_yaml((tmp_path / "mapping.yaml").read_text(encoding="utf-8"), "mapping")
    assert mapping["delimiter"] == ";"
    assert mapping["table"]["decimal"] == ","
    assert mapping["position"]["unit"] == "mm"


def test_what_is_in_doubt_is_not_written(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A joint that counts the other way: no reading of the columns fits the robot."""
    q, y = measured["srbd"]
    file = write(tmp_path, TABLES["plain"], q * [1, -1, 1], y)
    out = tmp_path / "session"
    assert guess(file, "srbd", "--out", str(out)) != 0
    both = capsys.readouterr()
    assert "in doubt: with no columns and units" in both.out
    assert "--mapping-out" in both.err
    assert not out.exists()


def test_columns_that_are_not_used_are_told_and_units_once(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    q, y = measured["srbd"]
    heads = ["Point", "J1 [deg]", "J2 [deg]", "J3 [deg]", "X [mm]", "Y [mm]", "Z [mm]", "Remark"]
    values = np.column_stack([np.arange(len(q)), np.degrees(q), 1e3 * y, np.zeros(len(q))])
    rows = [",".join(f"{v:.6f}" for v in row) for row in values]
    path = tmp_path / "table.csv"
    path.write_text("\n".join([",".join(heads), *rows]), encoding="utf-8")
    assert guess(path, "srbd") == 0
    said = capsys.readouterr().out
    assert "not used: Point, Remark\n" in said
    assert "[deg] [deg]" not in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a letter\nto somebody\n", "no table in it"),
        ("a,b,c,d\n1,2,3,4\n5,6,7,8\n", "no 3 columns of joints and 3 of a point"),
        ("", "no points in it"),
    ],
)
def test_a_file_that_is_no_table_is_refused(
    tmp_path: Path, text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text, encoding="utf-8")
    assert guess(file, "srbd") != 0
    assert said in capsys.readouterr().err
