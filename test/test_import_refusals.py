"""`delta-cal import` refuses wrong tables by line, column, value and, if known, likely unit."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.recording import read_session
from import_bench import JOINTS, SRBD, imported, mapping_of, measured, refused, stops


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder, a session and its poses at rest."""
    return tmp_path_factory.mktemp("cell"), *measured()


def wrong_cell(row, column, value):
    return lambda head, rows: rows[row].__setitem__(head.index(column), value)


TABLES = {
    "empty": (wrong_cell(3, "y", ""), {}, "line 5: y: '' is missing; `missing: skip`"),
    "nan": (wrong_cell(3, "y", "NaN"), {}, "line 5: y: 'NaN' is missing"),
    "of a spreadsheet": (wrong_cell(3, "y", "#N/A"), {}, "line 5: y: '#N/A' is missing"),
    "underscore": (wrong_cell(0, "q2", "31_49.0"), {}, "q2: '31_49.0' is not a finite number;"),
    "thousands": (
        wrong_cell(0, "x", "1,234.5"),
        {},
        "'1,234.5' is not a finite number; use a decimal point and no thousands separator: ",
    ),
    "text": (wrong_cell(0, "q2", "12,5"), {}, "line 2: q2: '12,5' is not a finite number"),
    "infinite": (wrong_cell(0, "q2", "inf"), {}, "line 2: q2: 'inf' is not a finite number"),
    "twice": (
        lambda head, rows: rows.insert(4, rows[3]),
        {},
        "and the rest of this row repeats line 5 to the last digit; `repeated: skip`",
    ),
    "one value in m": (
        lambda head, rows: rows[7].__setitem__(3, repr(float(rows[7][3]) / 1e3)),
        {},
        "cannot be in mm",
    ),
    "joint in rad": (
        lambda head, rows: rows[7].__setitem__(1, repr(float(np.radians(float(rows[7][1]))))),
        {},
        "cannot be in deg",
    ),
}


@pytest.mark.parametrize("name", TABLES)
def test_bad_cells_are_named(cell, capsys, name):
    folder, _, poses = cell
    spoil, changes, said = TABLES[name]
    head, rows = stops(poses)
    spoil(head, rows)
    assert said in refused(capsys, folder, head, rows, mapping_of(**changes))


def test_a_row_in_metres_among_millimetres(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    for row in (3, 9, 20):
        rows[row][3:] = [repr(float(v) / 1e3) for v in rows[row][3:]]
    said = refused(capsys, folder, head, rows, mapping_of())
    assert f"line 5: x: {rows[3][3]!r} and those of y, z cannot be in mm" in said
    assert said.endswith("likely m, as in lines 5, 11, 22, 3 of 48 rows; the others can be in mm")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"position": {"columns": ["x", "y", "z"], "unit": "m"}}, "likely mm, as in all rows"),
        ({"position": {"columns": ["x", "y", "z"], "unit": "um"}}, "likely mm, as in all rows"),
    ],
)
def test_a_whole_column_in_another_unit(cell, capsys, changes, said):
    folder, _, poses = cell
    head, rows = stops(poses)
    assert said in refused(capsys, folder, head, rows, mapping_of(**changes))


@pytest.mark.parametrize(
    ("unit", "said"),
    [
        ("parsec", "position.unit: 'parsec' is not allowed; choose from: um, mm, cm, m, inch"),
        (["mm", "mm"], "position.unit: 2 values found, 3 are expected"),
    ],
)
def test_a_unit_that_there_is_not(cell, capsys, unit, said):
    """A single unit or a list of three; the message depends on which of them was given."""
    folder, _, poses = cell
    head, rows = stops(poses)
    position = {"columns": ["x", "y", "z"], "unit": unit}
    assert said in refused(capsys, folder, head, rows, mapping_of(position=position))


def in_radians(columns):
    """Mapping of the joints in which these columns are declared to be in radians."""
    return [
        {"joint": j, "column": c, "unit": "rad" if c in columns else "deg"}
        for j, c in zip(SRBD.joints.names, JOINTS, strict=True)
    ]


def test_degrees_said_to_be_radians_are_beyond_the_limits(cell, capsys):
    """With so few rows the measured points are not compared with the reach of the robot."""
    folder, _, poses = cell
    head, rows = stops(poses.take(np.arange(5)))
    said = refused(capsys, folder, head, rows, mapping_of(commands=in_radians(["q2"])))
    assert "line 2: q2: " in said
    assert "beyond the limits of joint_2" in said
    assert said.endswith("likely deg")


@pytest.mark.parametrize("columns", [["q2"], ["q1", "q2", "q3"]])
def test_radians_said_to_be_degrees(cell, capsys, columns):
    """The angles are within the limits, but the measured points are too far apart for them."""
    folder, _, poses = cell
    head, rows = stops(poses)
    for name in columns:
        k = head.index(name)
        for row in rows:
            row[k] = repr(float(np.radians(float(row[k]))))
    said = refused(capsys, folder, head, rows, mapping_of())
    assert f"line 2: {columns[0]}: " in said
    assert said.endswith("likely rad, as in all rows")


def test_a_knocked_reflector_is_no_unit(cell):
    """An outlier is accepted; the fit sets it aside."""
    folder, _, poses = cell
    head, rows = stops(poses)
    rows[6][3] = repr(float(rows[6][3]) + 80.0)
    imported(folder, head, rows, mapping_of())


def test_times_have_to_rise(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    head = ["t", *head]
    timed = mapping_of(time={"column": "t", "unit": "min"})

    def at(times):
        return [[t, *row] for t, row in zip(times, rows, strict=False)]

    said = refused(capsys, folder, head, at([1, 2, 4, 3, 5]), timed)
    assert "line 5: t: '3' is before that of line 4, '4'; rows must be in order" in said
    said = refused(capsys, folder, head, at([1, 2, 2, 3]), timed)
    assert "line 4: t: '2' is the same as line 3, '2'" in said
    said = refused(capsys, folder, head, at([1, 2, -3]), timed)
    assert "line 4: t: '-3' is -180 s" in said
    fast = mapping_of(time={"column": "t", "unit": "ms"})
    said = refused(capsys, folder, head, at([1, 2, 3]), fast)
    assert "line 3: t: '2' is 0.001 s after line 2; stops are 1.1 s apart or more" in said
    formed = mapping_of(time={"column": "t", "unit": "format", "format": "%H:%M"})
    assert "is not of the form '%H:%M'" in refused(capsys, folder, head, at([1, 2]), formed)
    formed["time"]["format"] = "%d.%d"  # the day twice
    assert "is not of the form '%d.%d'" in refused(capsys, folder, head, at([1, 2]), formed)


def test_gaps_and_repeats_may_be_left_out(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    rows[2][0] = ""
    rows.insert(10, list(rows[9]))
    out = imported(folder, head, rows, mapping_of(missing="skip", repeated="skip"))
    said = capsys.readouterr().out
    assert f"1 of {len(rows)} rows have gaps and were left out" in said
    assert "1 rows repeat the one before" in said
    assert len(read_session(out).tracker.stamp_ns) == len(rows) - 2


def test_repeats_of_another_command_and_impossible_marks(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)

    def said(name, values, **changes):
        more = [[*row, value] for row, value in zip(rows, values, strict=False)]
        return refused(capsys, folder, [*head, name], more, mapping_of(**changes))

    n = len(rows)
    text = said("pose", ["1", "1", *range(2, n)], same_command="pose")
    assert "line 3: q" in text
    assert "which has the same pose '1'" in text
    text = said("side", [2] * n, direction=["side"])
    assert "line 2: side: '2' is not allowed; allowed: -1, 0, 1" in text
    text = said("kg", [1, -1] * n, payload={"column": "kg", "unit": "kg"})
    assert "line 3: kg: '-1' is negative" in text
    warm = [{"part": "arm", "column": "T", "unit": "K"}]
    assert "likely in another unit (degC, degF, K)" in said("T", [21.5] * n, temperature=warm)


def test_no_row_at_rest(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    table = [[*row, state] for row, state in zip(rows, ["go", "halt"] * len(rows), strict=False)]
    moving = {"column": "state", "at_rest": ["stop", "rest"]}
    said = refused(capsys, folder, [*head, "state"], table, mapping_of(moving=moving))
    assert "state: no row is at rest; moving.at_rest has 'stop', 'rest', the column has" in said
    assert said.endswith("'go', 'halt'")


def test_a_header_with_blanks_behind_its_names(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    blanks = [name + " " for name in head]
    imported(folder, blanks, rows, mapping_of())
    said = {"position": {"columns": ["x ", "y ", "z "], "unit": "mm"}}
    imported(folder, blanks, rows, mapping_of(**said))
    assert "column q1 is given twice" in refused(
        capsys, folder, [*blanks, "q1"], [[*row, "0"] for row in rows], mapping_of()
    )


def test_a_table_with_another_delimiter(cell, capsys):
    folder, _, poses = cell
    head, rows = stops(poses)
    table = [[";".join(row)] for row in rows]
    said = refused(capsys, folder, [";".join(head)], table, mapping_of())
    assert said.endswith("found q1;q2;q3;x;y;z; ',' is expected between two, not ';'")


ENCODINGS = {
    "utf-16": "is in UTF-16; save it as UTF-8",
    "utf-16-le": "line 1: a zero byte; the file is in UTF-16 or is not a text: save it as",
    "latin-1": "line 1: byte 0xe4 is not UTF-8; the file is in another encoding, such as Latin-1",
}


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_other_encodings_of_a_mapping_are_named(cell, capsys, encoding):
    folder, _, poses = cell
    number = len(list(folder.iterdir()))
    out = imported(folder, *stops(poses), mapping_of())
    file = folder / f"{number}.yaml"
    file.write_bytes(("# wärme\n" + file.read_text()).encode(encoding))
    verb = ["import", str(folder / f"{number}.csv"), "--robot", "srbd", "--out", f"{out}_again"]
    assert run([*verb, "--mapping", str(file)]) == 2
    assert f"{file.name}: {ENCODINGS[encoding]}" in capsys.readouterr().err


MAPPINGS = {
    "a column of two axes": (
        {"position": {"columns": ["x", "y", "x"], "unit": "mm"}},
        "position.columns[2]: column 'x' is already used for position.columns[0]; each",
    ),
    "a column of two joints": (
        {"commands": [{"joint": f"joint_{k}", "column": "q1", "unit": "deg"} for k in (1, 2, 3)]},
        "commands: joint_2: column 'q1' is already used for commands: joint_1",
    ),
    "a joint that is a coordinate": (
        {"position": {"columns": ["x", "q2", "z"], "unit": "mm"}},
        "position.columns[1]: column 'q2' is already used for commands: joint_2",
    ),
    "a part's temperature twice": (
        {"temperature": [{"part": "arm", "column": c, "unit": "degC"} for c in ("t1", "t2")]},
        "temperature: part 'arm' is given twice; one column per part",
    ),
    "scale of nothing": (
        {
            "commands": [
                {"joint": f"joint_{k}", "column": f"q{k}", "unit": "deg", "scale": k - 1}
                for k in (1, 2, 3)
            ]
        },
        "commands[0].scale: 0 is not allowed; anything but 0 is",
    ),
    "no unit": (
        {"position": {"columns": ["x", "y", "z"]}},
        "position: missing key unit",
    ),
    "unknown unit": (
        {"position": {"columns": ["x", "y", "z"], "unit": "ft"}},
        "position.unit: 'ft' is not",
    ),
    "unknown key": ({"units": "mm"}, "unknown key units; allowed: schema, rows"),
    "joints": (
        {"commands": [{"joint": "joint_1", "column": "q1", "unit": "deg"}]},
        "commands: joints joint_1 are not allowed; each of joint_1, joint_2, joint_3 once",
    ),
    "length of a joint that turns": (
        {"commands": [{"joint": f"joint_{k}", "column": "q1", "unit": "mm"} for k in (1, 2, 3)]},
        "joint_1: unit 'mm' is not allowed; the joint turns: urad, mrad, rad, deg, turn",
    ),
    "microsteps of no size": (
        {
            "commands": [
                {"joint": f"joint_{k}", "column": "q1", "unit": "microsteps"} for k in (1, 2, 3)
            ]
        },
        "unit microsteps with no step is not allowed; step_deg goes with microsteps",
    ),
    "stream without time": ({"rows": "stream"}, "missing key time"),
    "format": (
        {"time": {"column": "t", "unit": "s", "format": "%S"}},
        "a format, such as",
    ),
    "angles": (
        {"rotation": {"columns": ["x", "y", "z"], "form": "rpy", "unit": "deg"}},
        "rotation: missing key axes with form rpy",
    ),
    "one axis twice in a row": (
        {
            "rotation": {
                "columns": ["x", "y", "z"],
                "form": "euler",
                "unit": "deg",
                "axes": "ZZX",
            }
        },
        "rotation.axes: 'ZZX' is not allowed; three of x, y and z, or of X, Y and Z, no two alike",
    ),
    "quaternion of three": (
        {"rotation": {"columns": ["x", "y", "z"], "form": "quaternion_xyzw"}},
        "rotation.columns: 3 values found, 4 are expected",
    ),
    "column": (
        {"position": {"columns": ["x", "y", "up"], "unit": "mm"}},
        "column up missing; expected q1, q2, q3, x, y, up, found q1, q2, q3, x, y, z",
    ),
}


@pytest.mark.parametrize("name", MAPPINGS)
def test_mappings_that_cannot_be(cell, capsys, name):
    folder, _, poses = cell
    changes, said = MAPPINGS[name]
    assert said in refused(capsys, folder, *stops(poses), mapping_of(**changes))
