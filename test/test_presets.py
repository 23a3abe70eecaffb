"""`delta-cal import --preset`: tables in the formats of known programs, alone and joined."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.recording.presets import presets
from delta_calibration.recording.table_source import Form, _by_marks
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

PAGES = Path(__file__).parents[1] / "docs" / "presets.md"
ROBOT = load_robot("ur10")


@pytest.fixture(scope="module")
def measured() -> tuple[np.ndarray, np.ndarray]:
    plan = make_plan("identify", ROBOT, count=16, seed=4)
    poses = collect(simulate_session(draw_machine(ROBOT, 4), plan, 4), ROBOT.joints.names)
    return poses.command, poses.point


def lines(rows: list[str], head: str = "") -> str:
    return head + "".join(f"{row}\n" for row in rows)


def points(name: str, y: np.ndarray) -> str:
    """A table of points in the format of a program."""
    mm = 1e3 * y
    named = [(f"P{k + 1}", *row) for k, row in enumerate(mm.tolist())]
    if name == "spatialanalyzer":
        rows = [f"A,Main,{n},{x:.6f},{yy:.6f},{z:.6f}" for n, x, yy, z in named]
        return lines(rows, "// working frame: A::WORLD\n// X Y Z\n")
    mark = {"polyworks": ",", "leica": ";", "faro": "\t"}[name]
    rows = [mark.join((n, f"{x:.6f}", f"{yy:.6f}", f"{z:.6f}")) for n, x, yy, z in named]
    return lines(rows, mark.join(("Name", "X", "Y", "Z")) + "\n")


def joints(name: str, q: np.ndarray) -> str:
    """A list of joint values in the format of a controller."""
    deg = np.degrees(q).tolist()
    if name == "kuka":
        rows = [
            f"DECL E6AXIS P{k + 1}={{"
            + ",".join(f"A{j + 1} {v:.7f}" for j, v in enumerate(row))
            + ",E1 0.0,E2 0.0}"
            for k, row in enumerate(deg)
        ]
        return lines(rows, "DEFDAT MAIN\n")
    if name == "abb":
        rows = [
            f"    CONST jointtarget P{k + 1}:=[["
            + ",".join(f"{v:.7f}" for v in row)
            + "],[9E9,9E9,9E9,9E9,9E9,9E9]];"
            for k, row in enumerate(deg)
        ]
        return lines(rows, "MODULE Points\n")
    rows = [
        f"P[{k + 1}]{{\n   GP1:\n\tUF : 0, UT : 1,\n\t"
        + ",\n\t".join(f"J{j + 1}= {v:.7f} deg" for j, v in enumerate(row))
        + "\n};"
        for k, row in enumerate(deg)
    ]
    return lines(rows, "/PROG POINTS\n/POS\n")


def both(folder: Path, one: tuple[str, str], other: tuple[str, str], *options: str) -> int:
    """Import two tables, each a preset and its text, as one session."""
    for k, (_, text) in enumerate((one, other)):
        (folder / f"{k}.txt").write_text(text, encoding="utf-8")
    joined = ["--join", str(folder / "1.txt"), "--join-preset", other[0]]
    verb = ["import", str(folder / "0.txt"), "--preset", one[0], *joined, "--robot", "ur10"]
    return run([*verb, "--out", str(folder / "session"), *options])


def require_same(folder: Path, q: np.ndarray, y: np.ndarray) -> None:
    found = collect(read_session(folder / "session"), ROBOT.joints.names)
    np.testing.assert_allclose(found.command, q, atol=1e-6)
    np.testing.assert_allclose(found.point, y, atol=1e-6)


@pytest.mark.parametrize("by", ["kuka", "abb"])
@pytest.mark.parametrize("of", ["spatialanalyzer", "polyworks", "leica", "faro"])
def test_joints_and_points_are_joined_by_name(
    by: str, of: str, tmp_path: Path, measured: tuple[np.ndarray, np.ndarray]
) -> None:
    q, y = measured
    mixed = y[::-1]
    text = points(of, y)
    head = 2 if of == "spatialanalyzer" else 1
    order = text.splitlines()
    shuffled = "\n".join([*order[:head], *reversed(order[head:])]) + "\n"
    assert len(mixed) == len(order) - head
    assert both(tmp_path, (by, joints(by, q)), (of, shuffled), "--by", "name") == 0
    require_same(tmp_path, q, y)


@pytest.mark.parametrize("by", ["kuka", "abb", "fanuc"])
def test_a_guess_knows_a_program(
    by: str, tmp_path: Path, measured: tuple[np.ndarray, np.ndarray], capsys
) -> None:
    path = tmp_path / "points.dat"
    path.write_text(joints(by, measured[0]), encoding="utf-8")
    assert run(["import", str(path), "--robot", "ur10", "--guess"]) == 2
    said = capsys.readouterr().err
    assert f"the table has the format of preset {by}: use --preset {by} instead of --guess" in said
    assert said.count("--preset") == 1


def test_a_guess_names_the_option_of_the_second_table(
    tmp_path: Path, measured: tuple[np.ndarray, np.ndarray], capsys
) -> None:
    for name, text in (
        ("p.csv", points("leica", measured[1])),
        ("k.dat", joints("kuka", measured[0])),
    ):
        (tmp_path / name).write_text(text, encoding="utf-8")
    given = [str(tmp_path / "p.csv"), "--guess", "--join", str(tmp_path / "k.dat")]
    assert run(["import", *given, "--robot", "ur10"]) == 2
    assert (
        "k.dat: the table has the format of preset kuka: use --join-preset kuka"
        in capsys.readouterr().err
    )


def test_a_table_that_quotes_a_program_is_a_table(
    tmp_path: Path, measured: tuple[np.ndarray, np.ndarray], capsys
) -> None:
    q, y = measured
    rows = [",".join(f"{v:.6f}" for v in row) for row in np.hstack([np.degrees(q), 1e3 * y])]
    head = "# from DECL E6AXIS P1={A1 10.0,A2 -90.0}\nA1,A2,A3,A4,A5,A6,X,Y,Z\n"
    (tmp_path / "t.csv").write_text(lines(rows, head), encoding="utf-8")
    assert run(["import", str(tmp_path / "t.csv"), "--robot", "ur10", "--guess"]) == 0
    assert "columns A1, A2, A3, A4, A5, A6, by their names" in capsys.readouterr().out


@pytest.mark.parametrize("of", ["leica", "faro"])
def test_an_export_of_a_computer_with_decimal_commas(
    of: str, tmp_path: Path, measured: tuple[np.ndarray, np.ndarray], capsys
) -> None:
    q, y = measured
    text = points(of, y).replace(".", ",")
    assert both(tmp_path, ("kuka", joints("kuka", q)), (of, text), "--by", "name") == 0
    assert "decimals have a comma in it" in capsys.readouterr().out
    require_same(tmp_path, q, y)


def test_a_point_s_name_says_nothing_of_decimals(
    tmp_path: Path, measured: tuple[np.ndarray, np.ndarray]
) -> None:
    """1.1 to 1.16 are names of points; coordinates have decimal commas."""
    q, y = measured
    text = re.sub(r"(?m)^P(\d+)", r"1.\1", points("leica", y).replace(".", ","))
    assert both(tmp_path, ("kuka", joints("kuka", q)), ("leica", text), "--by", "row") == 0
    require_same(tmp_path, q, y)


@pytest.mark.parametrize("of", ["polyworks", "spatialanalyzer"])
def test_decimal_commas_between_columns_that_commas_part_are_refused(
    of: str, tmp_path: Path, measured: tuple[np.ndarray, np.ndarray], capsys
) -> None:
    """Extra columns are ignored, so whole millimetres would be read."""
    q, y = measured
    text = points(of, y).replace(".", ",")
    assert both(tmp_path, ("kuka", joints("kuka", q)), (of, text), "--by", "name") == 2
    assert "does it use commas both for decimals" in capsys.readouterr().err


@pytest.mark.parametrize("mixed", ["1,234", "0,5;1.25"])
def test_a_comma_that_may_be_another_mark_is_no_decimal_one(mixed: str) -> None:
    cells = ["7", "8", *mixed.split(";"), "9"]
    form = Form.of({"preset": "leica"}, ",", "mapping")
    assert form.either
    assert _by_marks(form, cells, Path("points.csv")) == (form, ())


def test_rows_of_a_fanuc_program_and_of_points_are_joined_in_order(
    tmp_path: Path, measured: tuple[np.ndarray, np.ndarray]
) -> None:
    q, y = measured
    first, second = ("polyworks", points("polyworks", y)), ("fanuc", joints("fanuc", q))
    assert both(tmp_path, first, second) == 0
    require_same(tmp_path, q, y)


def streams(q: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Streams at 10 Hz with two seconds per stop."""
    time = np.arange(20 * len(q)) / 10.0
    return time, np.repeat(q, 20, axis=0), np.repeat(y, 20, axis=0)


@pytest.mark.parametrize("of", ["optitrack", "vrpn"])
def test_streams_of_joints_and_points_are_joined_by_time(
    of: str, tmp_path: Path, measured: tuple[np.ndarray, np.ndarray]
) -> None:
    q, y = (each[::2] for each in measured)  # each place once
    time, joint, place = streams(q, y)
    names = [f"{kind}_q_{k}" for kind in ("target", "actual") for k in range(6)]
    rng = np.random.default_rng(1)
    rows = [
        " ".join(f"{v:.8f}" for v in (t, *row, *(row + 1e-6 * rng.standard_normal(6))))
        for t, row in zip(time, joint, strict=True)
    ]
    log = lines(rows, "timestamp " + " ".join(names) + "\n")
    turn = (0.0, 0.0, 0.0, 1.0)
    noise = 1e-6 * rng.standard_normal(place.shape)
    if of == "vrpn":
        seen = [
            ",".join(f"{v:.8f}" for v in (t + 0.003, 0, *p, *turn))
            for t, p in zip(time, place + noise, strict=True)
        ]
        text = lines(seen, "time,sensor,x,y,z,qx,qy,qz,qw\n")
    else:
        seen = [
            ",".join(f"{v:.8f}" for v in (k, t + 0.003, *turn, *(1e3 * p), 0.1, 7.0))
            for k, (t, p) in enumerate(zip(time, place + noise, strict=True))
        ]
        text = lines(seen, "Format Version,1.23\n\nType\nName\nID\nRotation\nFrame,Time\n")
    assert both(tmp_path, ("ur_rtde", log), (of, text), "--by", "nearest") == 0
    found = collect(read_session(tmp_path / "session"), ROBOT.joints.names)
    np.testing.assert_allclose(found.command, q, atol=1e-6)
    np.testing.assert_allclose(found.point, y, atol=5e-6)


def test_points_in_another_unit_are_read_by_it_and_refused_without(
    tmp_path: Path,
    measured: tuple[np.ndarray, np.ndarray],
    capsys: pytest.CaptureFixture[str],
) -> None:
    q, y = measured
    tables = ("polyworks", points("polyworks", y / 25.4)), ("kuka", joints("kuka", q))
    assert both(tmp_path, *tables) != 0
    assert "likely inch" in capsys.readouterr().err
    assert both(tmp_path, *tables, "--unit", "inch") == 0
    require_same(tmp_path, q, y)


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--preset", "kuka"], "points are missing"),
        (["--preset", "nobody"], "preset 'nobody' is not known; choose from: abb"),
        (["--preset", "kuka", "--join", "1.txt", "--join-preset", "abb"], "both give joints"),
        (["--preset", "kuka", "--join", "1.txt"], "must be given together"),
        (["--preset", "kuka", "--guess"], "one of --mapping, --preset and --guess"),
        ([], "one of --mapping, --preset and --guess"),
    ],
)
def test_what_does_not_go_together_is_refused(
    options: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "0.txt").write_text("x\n", encoding="utf-8")
    verb = ["import", str(tmp_path / "0.txt"), "--robot", "srbd", "--out", str(tmp_path / "s")]
    assert run([*verb, *options]) != 0
    assert said in capsys.readouterr().err


def test_a_list_that_is_another_programs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    q, y = np.zeros((3, 6)), np.zeros((3, 3))
    assert both(tmp_path, ("kuka", joints("abb", q)), ("faro", points("faro", y))) != 0
    assert "nothing in the file has the format of the preset" in capsys.readouterr().err


def test_the_second_file_is_named_as_it_lies(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With the path that was given, not with one relative to the folder of an internal mapping."""
    q, y = np.zeros((8, 6)), np.zeros((8, 3))
    other = points("faro", y).replace("P", "S")
    assert both(tmp_path, ("kuka", joints("kuka", q)), ("faro", other), "--by", "name") != 0
    said = capsys.readouterr().err
    assert f"rows has a partner in {tmp_path / '1.txt'} (by column)" in said


def test_they_are_listed_and_each_has_its_paragraph(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["import", "--presets"]) == 0
    said, page = capsys.readouterr().out, PAGES.read_text(encoding="utf-8")
    for name, each in presets().items():
        assert name in said
        assert re.search(rf"^## `{name}`$", page, re.MULTILINE), name
        assert each["known"] in ("documented", "example", "assumed")
        assert each["source"]
