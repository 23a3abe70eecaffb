"""Tables as programs write them: encodings, preambles, decimal commas, workbooks, two files."""

from __future__ import annotations

import csv
import zipfile
from pathlib import Path

import numpy as np
import pytest
from openpyxl import Workbook
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from delta_calibration.cli.main import run
from delta_calibration.files import MOST_TEXT
from delta_calibration.recording import read_session
from import_bench import JOINTS, imported, mapping_of, measured, refused, stops

DEGREES = 180.0 / np.pi


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    return tmp_path_factory.mktemp("cell"), *measured()


@pytest.fixture(scope="module")
def plain(cell):
    """Session of the plain table; every other form has to give the same."""
    folder, _, poses = cell
    return read_session(imported(folder, *stops(poses), mapping_of()))


def bring(path: Path, mapping: dict, capsys, code: int = 0, robot: str = "srbd"):
    """Import an existing file; return the session and the output of the command."""
    yaml = path.with_suffix(".mapping.yaml")
    YAML(typ="safe").dump(mapping, yaml)
    out = path.with_suffix(".session")
    verb = ["import", str(path), "--mapping", str(yaml), "--robot", robot, "--out", str(out)]
    assert run(verb) == code
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    return (read_session(out) if code == 0 else None), said.out + said.err


def same(one, other) -> None:
    np.testing.assert_allclose(one.command.position, other.command.position, atol=1e-15)
    np.testing.assert_allclose(one.tracker.position, other.tracker.position, atol=1e-15)


def write(path: Path, lines: list[str], encoding: str = "utf-8") -> Path:
    path.write_bytes(("\r\n".join(lines) + "\r\n").encode(encoding))
    return path


def german(poses, parted: str = ".") -> list[str]:
    """Lines with `;` between values, decimal commas and a separator of thousands."""

    def number(text: str) -> str:
        whole, _, part = f"{float(text):,.12f}".partition(".")
        return whole.replace(",", parted) + "," + part

    head, rows = stops(poses)
    return [";".join(head), *(";".join(map(number, row)) for row in rows)]


COMMAS = {"delimiter": ";", "table": {"decimal": ",", "thousands": "."}}


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1", "cp1252"])
def test_an_instruments_own_export(cell, plain, tmp_path, capsys, encoding) -> None:
    """A preamble with umlauts in any encoding, decimal commas, separators of thousands."""
    _, _, poses = cell
    preamble = ["Messprotokoll;Prüfer: Jörg Müller;Gerät 12", "", "Ölstand 21,5 °C"]
    path = write(tmp_path / "export.csv", [*preamble, *german(poses)], encoding)
    found, said = bring(path, mapping_of(**COMMAS), capsys)
    np.testing.assert_allclose(found.tracker.position, plain.tracker.position, atol=1e-14)
    assert "the column names were found in line 4" in said
    assert ("detected as" in said) == (encoding in ("latin-1", "cp1252"))


def test_decimal_commas_are_not_guessed(cell, tmp_path, capsys) -> None:
    _, _, poses = cell
    path = write(tmp_path / "t.csv", german(poses))
    _, said = bring(path, mapping_of(delimiter=";"), capsys, 2)
    assert "is not a finite number; use a decimal point and no thousands" in said
    assert "in the mapping: `table: {decimal: ','}`" in said
    other = {"delimiter": ",", "table": {"decimal": ","}}
    _, said = bring(path, mapping_of(**other), capsys, 2)
    assert "table: decimal ',' is not allowed with delimiter ','" in said


@pytest.mark.parametrize(
    ("text", "number"),
    [("1.234.567,5", "1234567.5"), ("-0,25", "-0.25"), ("\u22123,5e-3", "-3.5e-3"), ("7", "7")],
)
def test_numbers_with_commas(text, number) -> None:
    from delta_calibration.recording.table_source import Form

    form = Form(delimiter=";", decimal=",", thousands=".")
    assert form.plain(text) == number
    for other in ("1.23,5", "12.5", "Pt.1", "1,2,3"):
        assert form.plain(other) == other


def test_a_workbook_is_read(cell, plain, tmp_path, capsys) -> None:
    _, _, poses = cell
    head, rows = stops(poses)
    book = Workbook()
    book.active.append(["nothing here"])
    sheet = book.create_sheet("Messung")
    for row in [["Protokoll"], [], head, *([float(v) for v in row] for row in rows)]:
        sheet.append(row)
    path = tmp_path / "data.xlsx"
    book.save(path)
    found, said = bring(path, mapping_of(table={"sheet": "Messung"}), capsys)
    same(found, plain)
    assert "the column names were found in line 3" in said
    _, said = bring(path, mapping_of(table={"sheet": "Mess"}), capsys, 2)
    assert "no sheet 'Mess'; choose from: ['Sheet', 'Messung']" in said
    path.write_bytes(path.read_bytes()[:500])
    _, said = bring(path, mapping_of(), capsys, 2)
    assert "is not a workbook (xlsx)" in said


def test_a_sheet_of_a_text_is_refused(cell, tmp_path, capsys) -> None:
    head, rows = stops(cell[2])
    path = write(tmp_path / "t.csv", [",".join(head), *(",".join(row) for row in rows)])
    _, said = bring(path, mapping_of(table={"sheet": "Run 1"}), capsys, 2)
    assert "t.csv: sheet 'Run 1' of the mapping: the file is a text, not a workbook" in said


def test_a_workbook_that_unpacks_to_gigabytes_is_refused(tmp_path, capsys) -> None:
    path = tmp_path / "bomb.xlsx"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("xl/workbook.xml", b" " * (MOST_TEXT + 1))
    assert path.stat().st_size < MOST_TEXT / 100
    _, said = bring(path, mapping_of(), capsys, 2)
    assert f"unpacks to {MOST_TEXT + 1} bytes; {MOST_TEXT} are allowed" in said


FAR = {b'<row r="1"': b'<row r="999999999"', b"A1:B1": b"A1:B999999999"}


@pytest.mark.parametrize(
    ("forged", "told"),
    [
        (FAR, "has more than 1048576 lines or 50000000 cells"),
        ({b"</row>": b""}, "line 1 cannot be read"),
        ({b"<c ": b"<c><c "}, "line 1 cannot be read"),
        ({b"</worksheet>": b""}, "line 2 cannot be read"),
    ],
)
def test_a_damaged_workbook_is_refused_in_a_line(forged, told, tmp_path, capsys) -> None:
    sound, path, book = tmp_path / "sound.xlsx", tmp_path / "forged.xlsx", Workbook()
    book.active.append(["q1", "x"])
    book.save(sound)
    with zipfile.ZipFile(sound) as archive, zipfile.ZipFile(path, "w") as out:
        for name in archive.namelist():
            content = archive.read(name)
            for old, new in forged.items() if name.endswith("sheet1.xml") else ():
                assert old in content
                content = content.replace(old, new)
            out.writestr(name, content)
    _, said = bring(path, mapping_of(), capsys, 2)
    assert told in said


def test_columns_without_names_and_comments(cell, plain, tmp_path, capsys) -> None:
    _, _, poses = cell
    head, rows = stops(poses)
    lines = ["# exported", *(",".join(row) for row in rows), "# end"]
    path = write(tmp_path / "bare.csv", lines)
    found, _ = bring(path, mapping_of(table={"columns": head, "comment": "#"}), capsys)
    same(found, plain)
    table = {"columns": head, "header_line": 1}
    _, said = bring(path, mapping_of(table=table), capsys, 2)
    assert "header_line is for files that contain the column names" in said


# --- two files


def two(poses, folder: Path, order: np.ndarray) -> tuple[Path, Path]:
    """One file with joints; another one with points, names and times, in another order."""
    _, rows = stops(poses)
    robot, tracker = folder / "robot.csv", folder / "tracker.csv"
    with robot.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["point", "t", "q1", "q2", "q3"])
        writer.writerows([f"P{k}", 20 * k, *row[:3]] for k, row in enumerate(rows))
    with tracker.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["name", "clock", "x", "y", "z"])
        writer.writerows([f"P{k}", 20 * k + 107.02, *rows[k][3:]] for k in order)
    return robot, tracker


@pytest.mark.parametrize(
    "join",
    [
        {"by": "column", "left": "point", "right": "name"},
        {"by": "nearest", "left": "t", "right": "clock", "within": 0.1, "shift": -107.0},
        {"by": "row"},
    ],
)
def test_joints_and_readings_in_two_files(cell, plain, tmp_path, capsys, join) -> None:
    _, _, poses = cell
    order = np.arange(len(poses))
    if join["by"] != "row":
        np.random.default_rng(3).shuffle(order)
    robot, _ = two(poses, tmp_path, order)
    found, _ = bring(robot, mapping_of(join={"file": "tracker.csv", **join}), capsys)
    same(found, plain)


def test_rows_without_a_partner_are_left_out_and_told(cell, plain, tmp_path, capsys) -> None:
    _, _, poses = cell
    kept = np.arange(len(poses))[3:]
    robot, _ = two(poses, tmp_path, kept)
    join = {"file": "tracker.csv", "by": "column", "left": "point", "right": "name"}
    found, said = bring(robot, mapping_of(join=join), capsys)
    assert (
        f"3 of {len(poses)} rows of robot.csv have no partner in tracker.csv and were left out"
        in said
    )
    np.testing.assert_array_equal(found.tracker.position, plain.tracker.position[3:])
    _, said = bring(robot, mapping_of(join={"file": "tracker.csv", "by": "row"}), capsys, 2)
    assert f"has {len(poses)} rows" in said
    near = {"by": "nearest", "left": "t", "right": "clock", "within": 0.1}
    _, said = bring(robot, mapping_of(join={"file": "tracker.csv", **near}), capsys, 2)
    assert "rows has a partner in" in said or "rows of robot.csv have no partner" in said


def test_what_is_wrong_in_the_second_file_is_named_there(cell, tmp_path, capsys) -> None:
    _, _, poses = cell
    robot, tracker = two(poses, tmp_path, np.arange(len(poses)))
    join = {"file": "tracker.csv", "by": "column", "left": "point", "right": "name"}
    text = tracker.read_text().splitlines()
    text[4] = text[4].rsplit(",", 1)[0] + ",oops"
    tracker.write_text("\n".join(text) + "\n")
    _, said = bring(robot, mapping_of(join=join), capsys, 2)
    assert f"{tracker}: line 5: z: 'oops' is not a finite number" in said
    text[4] = text[3]
    tracker.write_text("\n".join(text) + "\n")
    _, said = bring(robot, mapping_of(join=join), capsys, 2)
    assert "line 5: name: 'P2' is in line 4 as well" in said
    _, said = bring(
        robot, mapping_of(join={"file": "tracker.csv", "by": "row", "left": "t"}), capsys, 2
    )
    assert "join: unknown key left with by: row" in said
    _, said = bring(robot, mapping_of(join={"file": "no.csv", "by": "row"}), capsys, 2)
    assert "no.csv: cannot be read" in said


def test_two_rows_that_want_one_are_refused(cell, tmp_path, capsys) -> None:
    _, _, poses = cell
    robot, _ = two(poses, tmp_path, np.arange(0, len(poses), 2))
    near = {"by": "nearest", "left": "t", "right": "clock", "within": 30.0, "shift": -107.0}
    _, said = bring(robot, mapping_of(join={"file": "tracker.csv", **near}), capsys, 2)
    assert "are both nearest to line" in said


# --- columns


def test_sums_of_columns_and_units_of_their_own(cell, plain, tmp_path, capsys) -> None:
    """A coupled joint, a target plus its deviation, heights in metres."""
    _, _, poses = cell
    joint, point = DEGREES * poses.joint, 1e3 * poses.point
    target = np.round(point)
    head = ["a", "b", "c", "tx", "ty", "tz", "dx", "dy", "dz"]
    other = np.column_stack([joint[:, 0], joint[:, 1] - 0.5 * joint[:, 0], joint[:, 2]])
    scale = np.array([1.0, 1.0, 1e-3])
    table = np.hstack([other, target * scale, (point - target) * scale])
    path = write(
        tmp_path / "s.csv", [",".join(head), *(",".join(map(repr, r)) for r in table.tolist())]
    )
    commands = [
        {"joint": "joint_1", "column": "a", "unit": "deg"},
        {
            "joint": "joint_2",
            "column": "b",
            "unit": "deg",
            "plus": [{"column": "a", "scale": 0.5}],
        },
        {"joint": "joint_3", "column": "c", "unit": "deg"},
    ]
    position = {
        "columns": ["tx", "ty", "tz"],
        "plus": ["dx", "dy", "dz"],
        "unit": ["mm", "mm", "m"],
    }
    found, _ = bring(path, mapping_of(commands=commands, position=position), capsys)
    np.testing.assert_allclose(found.command.position, plain.command.position, atol=1e-12)
    np.testing.assert_allclose(found.tracker.position, plain.tracker.position, atol=1e-12)


@pytest.mark.parametrize("form", ["matrix", "euler", "rotation_vector", "quaternion_xyzw"])
def test_rotations_in_any_form(cell, tmp_path, capsys, form) -> None:
    _, _, poses = cell
    turn = Rotation.random(len(poses), random_state=4)
    values, more = {
        "matrix": (turn.as_matrix().reshape(-1, 9), {}),
        "euler": (turn.as_euler("ZXZ", degrees=True), {"axes": "ZXZ", "unit": "deg"}),
        "rotation_vector": (turn.as_rotvec(), {"unit": "rad"}),
        "quaternion_xyzw": (turn.as_quat(), {}),
    }[form]
    head, rows = stops(poses)
    names = [f"r{k}" for k in range(values.shape[1])]
    lines = [",".join([*row, *map(repr, r)]) for row, r in zip(rows, values.tolist(), strict=True)]
    path = write(tmp_path / "r.csv", [",".join([*head, *names]), *lines])
    mapping = mapping_of(rotation={"columns": names, "form": form, **more})
    found, _ = bring(path, mapping, capsys)
    off = Rotation.from_quat(found.tracker.quaternion) * turn.inv()
    assert off.magnitude().max() < 1e-12
    if form == "matrix":
        bad = [",".join([*row, *["1"] * 9]) for row in rows]
        path = write(tmp_path / "b.csv", [",".join([*head, *names]), *bad])
        _, said = bring(path, mapping, capsys, 2)
        assert "do not form a rotation matrix" in said


PLACES = np.array([[0.0, 0.0, 0.0], [60.0, 0.0, 10.0], [0.0, 55.0, -5.0], [-40.0, -35.0, 0.0]])


def reflected(turn: Rotation, poses) -> tuple[list[str], np.ndarray]:
    """Names and coordinates [mm] of four reflectors on a platform that rotates."""
    names = [f"{axis}{k}" for k in range(4) for axis in "xyz"]
    point = 1e3 * poses.point[:, None, :]
    each = point + np.stack([turn.apply(place) for place in PLACES], axis=1)
    return names, each.reshape(len(poses.point), -1)


def with_reflectors(names: list[str], places: np.ndarray = PLACES) -> dict:
    columns = [names[3 * k : 3 * k + 3] for k in range(len(places))]
    entries = [
        {"columns": c, "unit": "mm", "place_mm": p.tolist()}
        for c, p in zip(columns, places, strict=True)
    ]
    return mapping_of(position=entries[0], reflectors=entries[1:])


def test_several_reflectors_tell_the_turn_of_the_platform(cell, tmp_path, capsys) -> None:
    """The first reflector gives the point; one that is off by more than 0.5 mm is refused."""
    _, _, poses = cell
    turn = Rotation.random(len(poses.point), np.random.default_rng(3))
    names, each = reflected(turn, poses)
    mapping = with_reflectors(names)
    head, joint = [*JOINTS, *names], np.degrees(poses.joint)
    rows = [[*map(repr, row)] for row in np.hstack([joint, each]).tolist()]
    out = imported(tmp_path, head, rows, mapping)
    seen = read_session(out).tracker
    np.testing.assert_allclose(seen.position, poses.point, atol=1e-9)
    difference = Rotation.from_quat(seen.quaternion) * turn.inv()
    assert difference.magnitude().max() < 1e-7
    each[4, 6] += 3.0
    rows = [[*map(repr, row)] for row in np.hstack([joint, each]).tolist()]
    said = refused(capsys, tmp_path, head, rows, mapping)
    assert "line 6" in said
    assert "0.5 mm are allowed" in said


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"reflectors": None}, "position.place_mm needs further reflectors"),
        (
            {"rotation": {"columns": ["a", "b", "c"], "form": "rotation_vector", "unit": "rad"}},
            "rotation is not allowed together with them",
        ),
    ],
)
def test_reflectors_that_tell_no_turn_are_refused(cell, tmp_path, capsys, change, said) -> None:
    _, _, poses = cell
    names, each = reflected(Rotation.identity(len(poses.point)), poses)
    rows = [[*map(repr, row)] for row in np.hstack([np.degrees(poses.joint), each]).tolist()]
    full = {k: v for k, v in {**with_reflectors(names), **change}.items() if v is not None}
    assert said in refused(capsys, tmp_path, [*JOINTS, *names], rows, full)


def test_reflectors_on_one_line_are_refused(cell, tmp_path, capsys) -> None:
    _, _, poses = cell
    names, each = reflected(Rotation.identity(len(poses.point)), poses)
    rows = [[*map(repr, row)] for row in np.hstack([np.degrees(poses.joint), each]).tolist()]
    line = np.outer(np.arange(4.0), [10.0, 20.0, 0.0])
    said = refused(capsys, tmp_path, [*JOINTS, *names], rows, with_reflectors(names, line))
    assert "the places lie on one line" in said
