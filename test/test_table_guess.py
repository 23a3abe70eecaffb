"""`delta-cal import --guess`: mappings of typical tables, and doubts."""

from __future__ import annotations

import json
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
from delta_calibration.simulation import draw_machine, effect_options, simulate_session


@dataclass(frozen=True)
class Written:
    """Format of a user's table of stops."""

    head: str  # text before the numbers, including the column names if there are any
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
    "units in a line of their own, marks between thousands": Written(
        "Name;q1;q2;q3;X;Y;Z\n;deg;deg;deg;mm;mm;mm\n",
        lambda q, y, k: (
            f"P{k};"
            + ";".join(f"{v:,.6f}".translate(str.maketrans(",.", ".,")) for v in deg_mm(q, y))
        ),
        "utf-16",
    ),
    "Z in m, which no name says": Written(
        "q1,q2,q3,x,y,z\n",
        lambda q, y, k: numbers(np.r_[np.degrees(q), 1e3 * y[:2], y[2]], digits=9),
    ),
    "a column without a name, another twice": Written(
        ",q1,q2,q3,x,y,z,rms,rms\n",
        lambda q, y, k: f"{k}," + numbers(np.r_[deg_mm(q, y), 0.01, 0.02]),
    ),
    "a day without a time": Written(
        "Date;A1;A2;A3;X;Y;Z\n",
        lambda q, y, k: "26.11.2026;" + numbers(deg_mm(q, y), ",", ";"),
    ),
    "a time with parts of a second and a zone": Written(
        "time,A1,A2,A3,X,Y,Z\n",
        lambda q, y, k: f"2026-11-26T08:{k:02d}:00.250Z," + numbers(deg_mm(q, y)),
    ),
    "seconds that no unit says": Written(
        "Time,q1,q2,q3,x,y,z\n", lambda q, y, k: f"{20 * k}," + numbers(deg_mm(q, y))
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
    name: str,
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The session has the measured joints and points."""
    written = TABLES[name]
    q, y = measured[written.robot]
    file, out = write(tmp_path, written, q, y), tmp_path / "session"
    assert guess(file, written.robot, "--out", str(out)) == 0
    robot = load_robot(written.robot)
    found = collect(read_session(out), robot.joints.names, robot.commanded.joint_size)
    np.testing.assert_allclose(found.command, q, atol=1e-6)
    np.testing.assert_allclose(found.point, y, atol=1e-6)
    if "payload" in name:
        said = capsys.readouterr().out
        assert "time Date (%Y-%m-%d %H:%M:%S), payload load_g (g), temperature of arm" in said
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
    assert "the nominal robot matches the points" in said
    shown = [line for line in said.splitlines() if re.match(r" *-?\d", line)]
    assert len(shown) == 10
    mapping = parse_yaml((tmp_path / "mapping.yaml").read_text(encoding="utf-8"), "mapping")
    assert mapping["delimiter"] == ";"
    assert mapping["table"]["decimal"] == ","
    assert mapping["position"]["unit"] == "mm"


@pytest.mark.parametrize(
    ("place", "written"), [("X,Y,Z", False), ("X [mm],Y [mm],Height Z [m]", True)]
)
def test_heights_that_hardly_vary_in_mm_are_read_in_m_or_in_doubt(
    place: str, written: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Heights in m beside x and y in mm; 24 of 45 stops have the same height."""
    lines = (Path(__file__).parents[1] / "bags" / "srbd_plain.csv").read_text().splitlines()
    cells = [line.split(",") for line in lines[4:]]
    rows = [",".join([*row[1:6], f"{float(row[6]) / 1e3:.7f}"]) for row in cells]
    file, out = tmp_path / "table.csv", tmp_path / "session"
    file.write_text("\n".join([f"A1,A2,A3,{place}", *rows, ""]), encoding="utf-8")
    assert guess(file, "srbd", "--out", str(out)) == int(not written)
    said = capsys.readouterr().out
    assert ("in doubt: X, Y, Z in mm, mm, m match better than all in mm" in said) is not written
    assert ("in deg, the point in mm, mm, m: " in said) is written
    assert out.exists() is written


def test_programs_read_what_is_proposed(
    tmp_path: Path, measured: dict[str, tuple[np.ndarray, np.ndarray]]
) -> None:
    file = write(tmp_path, TABLES["German Excel"], *measured["srbd"])
    out, mapping = tmp_path / "guess.json", tmp_path / "mapping.yaml"
    assert guess(file, "srbd", "--json", str(out), "--mapping-out", str(mapping)) == 0
    told = json.loads(out.read_text(encoding="utf-8"))
    assert list(told) == ["schema", "mapping", "sure", "doubts", "rows"]
    assert len(told["rows"]) == 10
    assert told["mapping"] == parse_yaml(mapping.read_text(encoding="utf-8"), "mapping")
    wrong = ["import", str(file), "--mapping", str(mapping), "--robot", "srbd"]
    assert run([*wrong, "--json", str(out), "--mapping-out", str(mapping)]) == 2


def test_what_is_in_doubt_is_not_written(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A joint counts the other way: no choice of columns and units fits the robot."""
    q, y = measured["srbd"]
    file = write(tmp_path, TABLES["plain"], q * [1, -1, 1], y)
    out = tmp_path / "session"
    assert guess(file, "srbd", "--out", str(out)) != 0
    both = capsys.readouterr()
    assert "in doubt: no choice of columns and units" in both.out
    assert re.search("read like this: .*likely q2 with the opposite sign", both.out)
    assert "--mapping-out" in both.err
    assert not out.exists()


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_from_one_other_zero_are_proposed_with_scale_and_offset(
    sign: float,
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Motors read 90 degrees with level arms. The zero is proposed and works, but is in doubt."""
    q, y = measured["srbd"]
    file = write(tmp_path, TABLES["plain"], np.pi / 2 + sign * q, y)
    mapping, out = tmp_path / "mapping.yaml", tmp_path / "session"
    assert guess(file, "srbd", "--out", str(out)) == 1
    assert guess(file, "srbd", "--mapping-out", str(mapping)) == 0
    said = capsys.readouterr().out
    assert "and read 90 deg where the robot file has 0" in said
    assert "compare them with the drives' settings" in said
    assert not out.exists()
    assert (
        run(["import", str(file), "--mapping", str(mapping), "--robot", "srbd", "--out", str(out)])
        == 0
    )
    found = collect(read_session(out), load_robot("srbd").joints.names)
    np.testing.assert_allclose(found.command, q, atol=1e-6)


def test_a_column_that_is_not_used_has_no_gaps(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """An empty column of remarks is no reason to leave rows out."""
    q, y = measured["srbd"]
    written = Written(
        "A1 [deg];A2 [deg];A3 [deg];X [mm];Y [mm];Z [mm];remark\n",
        lambda q, y, k: numbers(deg_mm(q, y), ",", ";") + ";",
    )
    guess(write(tmp_path, written, q, y), "srbd")
    assert "gaps" not in capsys.readouterr().out


def test_times_that_would_be_too_far_apart_are_in_doubt(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Milliseconds without a unit: 20000 s from stop to stop are not likely."""
    q, y = measured["srbd"]
    rows = [f"{20_000 * k}," + numbers(deg_mm(q[k], y[k])) + "\n" for k in range(len(q))]
    file = tmp_path / "table.csv"
    file.write_text("Time,q1,q2,q3,x,y,z\n" + "".join(rows), encoding="utf-8")
    assert guess(file, "srbd", "--out", str(tmp_path / "session")) != 0
    assert "in doubt: Time: is this a time in seconds" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        (lambda k: str(10.0 * (k if k != 5 else 3.5)), "Time: goes back at row 6 of the table"),
        (lambda k: f"2020-07-14 16:{59 - k % 50:02d}:04", "Time: goes back at row 2 of the table"),
        (lambda _: "2.02011E+13", "Time: is the same in all rows"),
    ],
)
def test_times_that_tell_no_order_of_the_rows_are_left_out(
    stamps: Callable[[int], str],
    said: str,
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """If they were proposed, the table would be refused."""
    q, y = measured["srbd"]
    rows = [f"{stamps(k)}," + numbers(deg_mm(q[k], y[k])) + "\n" for k in range(len(q))]
    file = tmp_path / "table.csv"
    file.write_text("Time,q1,q2,q3,x,y,z\n" + "".join(rows), encoding="utf-8")
    assert guess(file, "srbd", "--out", str(tmp_path / "session")) == 0
    assert f"{said}; it is left out" in capsys.readouterr().out


def test_a_probe_on_a_stalk_is_no_doubt(tmp_path: Path) -> None:
    """An arm rotates its probe in all directions, 90 mm and 200 mm from the flange.

    Errors of the probe position and of the base compensate each other in part.
    """
    robot, rng = load_robot("ur10"), np.random.default_rng(4)
    model = robot.commanded
    q = make_plan("identify", robot, count=60, both_sides=False, seed=4).joint
    q = q + rng.uniform(-0.6, 0.6, q.shape) * [0.2, 0.2, 0.2, 1, 1, 1]
    x = model.forward(q, model.parameters.nominal)
    for stalk in (0.09, 0.2):
        y = model.position(x) + model.rotation(x) @ [0.0, 0.0, stalk]
        y = y + rng.normal(0, 5e-4, y.shape)
        written = Written("q1,q2,q3,q4,q5,q6,x,y,z\n", lambda q, y, k: numbers(deg_mm(q, y)))
        file = write(tmp_path, written, q, y[:, [2, 0, 1]] + [1.0, 2.0, 0.5])
        assert guess(file, "ur10", "--out", str(tmp_path / f"session_{stalk}")) == 0


@pytest.mark.parametrize(
    ("place", "doubted"), [("x_t,y_t,z_t", True), ("meas_x,meas_y,meas_z", False)]
)
def test_a_target_beside_its_differences_is_in_doubt(
    place: str,
    doubted: bool,
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The nominal machine fits targets better than measured points."""
    q, y = measured["srbd"]
    rows = [numbers(np.r_[deg_mm(q[k], y[k]), 0.3, -0.2, 0.1]) + "\n" for k in range(len(q))]
    file = tmp_path / "table.csv"
    file.write_text(f"q1,q2,q3,{place},x_dif,y_dif,z_dif\n" + "".join(rows), encoding="utf-8")
    assert guess(file, "srbd", "--out", str(tmp_path / "session")) == int(doubted)
    said = "x_dif, y_dif, z_dif have to be added"
    assert (said in capsys.readouterr().out) is doubted


def test_rows_with_gaps_and_lines_below_the_table_are_left_out(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Two stops without a tracker reading; a line with a mean below."""
    q, y = measured["srbd"]
    rows = [
        f"P{k};" + numbers(deg_mm(q[k], y[k]), ",", ";") + "\n"
        if k not in (4, 5)
        else f"P{k};;;;;;\n"
        for k in range(len(q))
    ]
    text = "Punkt;q1;q2;q3;X;Y;Z\n" + "".join(rows) + "Mittelwert;;;;1,0;2,0;3,0\nEnde\n"
    file, out = tmp_path / "table.csv", tmp_path / "session"
    file.write_text(text, encoding="utf-8")
    assert guess(file, "srbd", "--out", str(out)) == 0
    assert "rows have gaps and are left out" in capsys.readouterr().out
    found = collect(read_session(out), ("joint_1", "joint_2", "joint_3"))
    np.testing.assert_allclose(found.point, np.delete(y, (4, 5), axis=0), atol=1e-6)


def test_the_sheet_with_the_numbers_is_found(
    tmp_path: Path, measured: dict[str, tuple[np.ndarray, np.ndarray]]
) -> None:
    """A cover sheet, then a sheet with a title, numbers and a nearly empty column of remarks."""
    workbook = pytest.importorskip("openpyxl").Workbook()
    workbook.active.append(["Messprotokoll"])
    sheet = workbook.create_sheet("Werte")
    sheet.append(["Halle 2"])
    sheet.append(
        ["Nr", *("A1 [deg]", "A2 [deg]", "A3 [deg]"), *("X [mm]", "Y [mm]", "Z [mm]"), "R"]
    )
    q, y = measured["srbd"]
    for k in range(len(q)):
        sheet.append([k, *deg_mm(q[k], y[k]).tolist(), "again" if k == 7 else None])
    file, out = tmp_path / "table.xlsx", tmp_path / "session"
    workbook.save(file)
    assert guess(file, "srbd", "--out", str(out)) == 0
    found = collect(read_session(out), ("joint_1", "joint_2", "joint_3"))
    np.testing.assert_allclose(found.point, y, atol=1e-6)


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
        ("a letter\nto somebody\n", "contains no table"),
        ("a,b,c,d\n1,2,3,4\n5,6,7,8\n", "no 3 columns of joints and 3 of a point"),
        ("", "contains no points"),
    ],
)
def test_a_file_that_is_no_table_is_refused(
    tmp_path: Path, text: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "table.csv"
    file.write_text(text, encoding="utf-8")
    assert guess(file, "srbd") != 0
    assert said in capsys.readouterr().err


@pytest.mark.parametrize("side", [True, False])
def test_sides_that_are_not_in_a_table_are_asked_for(
    side: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With backlash the points depend on the side: a column states it, or a warning asks."""
    robot = load_robot("srbd")
    plan = make_plan("identify", robot, count=50, seed=3)
    play = effect_options("backlash:location=joint_2,value=0.0008")
    session = simulate_session(draw_machine(robot, 3, hidden=[play]), plan, 3)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    head = "q1,q2,q3,x,y,z" + ",side" * side
    rows = [
        numbers(deg_mm(q, y)) + f",{d[0]:.0f}" * side
        for q, y, d in zip(poses.command, poses.point, poses.direction, strict=True)
    ]
    file, out = tmp_path / "table.csv", tmp_path / "session"
    file.write_text("\n".join([head, *rows]) + "\n", encoding="utf-8")
    assert guess(file, "srbd", "--out", str(out)) == 0
    assert run(["fit", str(out), "--robot", "srbd"]) == 0
    said = capsys.readouterr().out
    assert ("from which side each stop was approached" in said) != side
    if side:
        found = collect(read_session(out), robot.joints.names)
        np.testing.assert_array_equal(found.direction, poses.direction)


# --- two files


def half(cells: np.ndarray, keys: list[str], head: str, order: np.ndarray) -> str:
    """Lines with a name or time and numbers, with semicolons and decimal commas."""
    rows = [f"{keys[k]};" + numbers(cells[k], ",", ";") + "\n" for k in order]
    return head + "".join(rows)


@pytest.mark.parametrize("key", ["name", "row", "nearest", "time"])
def test_joints_and_points_in_two_files_are_put_together(
    key: str, tmp_path: Path, measured: dict[str, tuple[np.ndarray, np.ndarray]]
) -> None:
    """A robot log, and a tracker export in another order or with another clock."""
    q, y = measured["srbd"]
    n, by = len(q), "nearest" if key == "time" else key
    order = np.arange(n) if by == "row" else np.random.default_rng(2).permutation(n)[3:]
    names = [f"P{k:03d}" for k in range(n)]
    late = [f"{10 * k + 0.02:.2f}".replace(".", ",") for k in range(n)]
    late_ms = [f"{10000 * k + 20}" for k in range(n)]
    own, other, first, second = {
        "name": (names, names, "Punkt", "Name"),
        "row": (names, [f"S{k}" for k in range(n)], "Punkt", "Name"),
        "nearest": ([f"{10 * k}" for k in range(n)], late, "Time [s]", "Time [s]"),
        "time": ([f"{10000 * k}" for k in range(n)], late_ms, "t_ms", "time (ms)"),
    }[key]
    log, points = tmp_path / "log.csv", tmp_path / "points.csv"
    head = f"Halle 2\n\n{first};A1 [°];A2 [°];A3 [°]\n"
    joints = half(np.degrees(q), own, head, np.arange(n))
    log.write_bytes(joints.encode("latin-1"))
    points.write_text(half(1e3 * y, other, f"{second};X [mm];Y [mm];Z [mm]\n", order), "utf-8")
    out, chosen = tmp_path / "session", [] if by == "name" else ["--by", by]
    assert guess(log, "srbd", "--join", str(points), *chosen, "--out", str(out)) == 0
    found = collect(read_session(out), ("joint_1", "joint_2", "joint_3"))
    kept = np.sort(order)
    np.testing.assert_allclose(found.command, q[kept], atol=1e-6)
    np.testing.assert_allclose(found.point, y[kept], atol=1e-6)


def test_two_files_that_do_not_go_together_are_refused(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Other names and fewer rows; for a log alone, the second file is asked for."""
    q, y = measured["srbd"]
    log, points = tmp_path / "log.csv", tmp_path / "points.csv"
    names = [f"P{k}" for k in range(len(q))]
    log.write_text(half(np.degrees(q), names, "no;A1;A2;A3\n", np.arange(len(q))), "utf-8")
    points.write_text(half(1e3 * y, ["S" + n for n in names], "id;X;Y;Z\n", np.arange(9)), "utf-8")
    assert guess(log, "srbd", "--join", str(points)) == 2
    assert "rows cannot be matched by name, row or time" in capsys.readouterr().err
    assert guess(log, "srbd") == 2
    assert "--join FILE" in capsys.readouterr().err
    assert guess(log, "srbd", "--join", str(points), "--by", "row") == 2
    assert "if the first 9 rows of both belong together" in capsys.readouterr().err


def test_times_in_two_units_are_not_joined(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    q, y = measured["srbd"]
    log, points = tmp_path / "log.csv", tmp_path / "points.csv"
    own = [f"{10 * k}" for k in range(len(q))]
    log.write_text(half(np.degrees(q), own, "t_s;A1;A2;A3\n", np.arange(len(q))), "utf-8")
    points.write_text(half(1e3 * y, own, "minute;X;Y;Z\n", np.arange(9)), "utf-8")
    assert guess(log, "srbd", "--join", str(points), "--by", "nearest") == 2
    assert "column minute is in another unit than t_s" in capsys.readouterr().err


def test_times_that_are_too_far_apart_are_told_with_what_would_join_them(
    tmp_path: Path,
    measured: dict[str, tuple[np.ndarray, np.ndarray]],
    capsys: pytest.CaptureFixture[str],
) -> None:
    q, y = measured["srbd"]
    every, late = np.arange(len(q)), [f"{10 * k},3" for k in range(len(q))]
    log, points = tmp_path / "log.csv", tmp_path / "points.csv"
    own = [f"{10 * k}" for k in range(len(q))]
    log.write_text(half(np.degrees(q), own, "t;A1;A2;A3\n", every), "utf-8")
    points.write_text(half(1e3 * y, late, "Time;X;Y;Z\n", every[2:]), "utf-8")
    assert guess(log, "srbd", "--join", str(points)) == 2
    said = capsys.readouterr().err
    assert "is 0.3 s (median) from the nearest" in said
    assert "--within" in said
    out = str(tmp_path / "session")
    assert guess(log, "srbd", "--join", str(points), "--within", "0.4", "--out", out) == 0
