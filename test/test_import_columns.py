"""`delta-cal import --guess` tells measured columns from intended ones, and units by names."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.documents import parse_yaml
from delta_calibration.recording.table_groups import joint_groups, kind_of, point_groups
from delta_calibration.recording.table_names import warm_name
from import_bench import SRBD, imported, mapping_of, measured, refused, stops


@pytest.fixture(scope="module")
def cell() -> dict[str, np.ndarray]:
    """Columns of 24 stops: joints [deg], encoders [deg], targets and points [mm]."""
    _, poses = measured()
    command, point = poses.command[::2], poses.point[::2]
    model, rng = SRBD.commanded, np.random.default_rng(1)
    target = model.position(model.forward(command, model.parameters.nominal))
    joint = np.degrees(command)
    return {
        "q": joint,
        "e": joint + rng.normal(0, 1e-3, joint.shape),
        "t": 1e3 * target,
        "p": 1e3 * point,
        "d": 1e3 * (point - target),
    }


def write(path: Path, cell: Mapping[str, np.ndarray], kinds: str, head: str, digits=4) -> Path:
    """Table with blocks of three columns, each named by a letter of `kinds`."""
    values = np.hstack([cell[kind] for kind in kinds])
    rows = [",".join(f"{v:.{digits}f}" for v in row) for row in values]
    path.write_text("\n".join([head] * bool(head) + rows) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def guess(tmp_path: Path, cell, capsys: pytest.CaptureFixture[str]):
    """Guess a table with blocks of columns; return code, mapping and what is printed."""

    def guess(kinds: str, head: str, digits: int = 4) -> tuple[int, dict, str]:
        table, mapping = tmp_path / "table.csv", tmp_path / "m.yaml"
        write(table, cell, kinds, head, digits)
        out = ["--out", str(tmp_path / "session"), "--mapping-out", str(mapping)]
        code = run(["import", str(table), "--guess", "--robot", "srbd", *out])
        assert (tmp_path / "session").exists() is (code == 0)
        read = parse_yaml(mapping.read_text(encoding="utf-8"), "mapping")
        return code, read, capsys.readouterr().out

    return guess


@pytest.mark.parametrize(
    ("kinds", "place", "point"),
    [
        ("qtp", "X_cmd,Y_cmd,Z_cmd,X_meas,Y_meas,Z_meas", "X_meas Y_meas Z_meas"),
        ("qtp", "X_soll,Y_soll,Z_soll,X_ist,Y_ist,Z_ist", "X_ist Y_ist Z_ist"),
        ("qtp", "x,y,z,x_tracker,y_tracker,z_tracker", "x_tracker y_tracker z_tracker"),
        ("qpt", "X,Y,Z,Xnom,Ynom,Znom", "X Y Z"),
        ("qtp", "fk_x,fk_y,fk_z,smr_x,smr_y,smr_z", "smr_x smr_y smr_z"),
        ("qtp", "TargetPosX,TargetPosY,TargetPosZ,PosX,PosY,PosZ", "PosX PosY PosZ"),
        ("qtpd", "X_cmd,Y_cmd,Z_cmd,X,Y,Z,dX,dY,dZ", "X Y Z"),
        (
            "qppd",
            "X_cmd,Y_cmd,Z_cmd,X_meas,Y_meas,Z_meas,dX,dY,dZ",
            "X_meas Y_meas Z_meas",
        ),
    ],
)
def test_words_tell_the_measured_point_from_the_target(guess, kinds, place, point) -> None:
    code, mapping, said = guess(kinds, f"q1,q2,q3,{place}")
    assert code == 0
    assert mapping["position"]["columns"] == point.split()
    rest = [name for name in place.split(",")[:6] if name not in point.split()]
    assert f"not used: {', '.join(rest)}" in said
    assert (" (targets)" in said) is (rest != ["x", "y", "z"])


@pytest.mark.parametrize(
    ("head", "point", "other"),
    [
        ("q1,q2,q3,tcp_x,tcp_y,tcp_z,X,Y,Z", "X, Y, Z", "tcp_x, tcp_y, tcp_z"),
        ("q1,q2,q3,ball_x,ball_y,ball_z,X,Y,Z", "X, Y, Z", "ball_x, ball_y, ball_z"),
        ("", "c7, c8, c9", "c4, c5, c6"),
    ],
)
def test_two_points_that_no_word_tells_apart_are_in_doubt(guess, head, point, other) -> None:
    """The nominal robot matches targets best, so that the closest columns are not the measured."""
    code, mapping, said = guess("qtp", head)
    assert code == 1
    assert mapping["position"]["columns"] == point.split(", ")
    assert f"in doubt: {point} are read as the measured point, but {other} match" in said
    assert f"in doubt: {other} match the nominal robot within the rounding of the dig" in said
    assert "they were probably computed" in said


def test_two_measured_points_are_in_doubt(guess) -> None:
    code, _, said = guess("qpp", "q1,q2,q3,x_leica,y_leica,z_leica,x_faro,y_faro,z_faro")
    assert code == 1
    assert "but x_faro, y_faro, z_faro match the robot as well: which of them" in said


@pytest.mark.parametrize(
    ("word", "digits", "how"),
    [("act", 4, "the rounding of the digits printed: "), ("act", 6, "0."), ("meas", 6, "0.")],
)
def test_a_point_that_is_called_actual_but_was_computed_is_in_doubt(
    guess, word, digits, how
) -> None:
    """A controller's actual position is computed: the point without such words may be measured."""
    code, _, said = guess("qtp", f"q1,q2,q3,x_{word},y_{word},z_{word},X,Y,Z", digits)
    assert code == 1
    assert f"in doubt: x_{word}, y_{word}, z_{word} match the nominal robot within {how}" in said
    assert "computed; were X, Y, Z measured?" in said


def test_a_simulation_without_noise_is_noted(guess) -> None:
    code, _, said = guess("qt", "q1,q2,q3,x,y,z")
    assert code == 0
    assert "\nx, y, z match the nominal robot within the rounding of the digits" in said


def test_coarse_digits_of_commands_do_not_make_a_point_computed(tmp_path, cell, capsys) -> None:
    """Commands of whole hundredths of a degree are exact; a good robot deviates by less."""
    model, rng = SRBD.commanded, np.random.default_rng(3)
    q = np.round(cell["q"], 2)
    point = model.position(model.forward(np.radians(q), model.parameters.nominal))
    point = 1e3 * point + rng.normal(0, 5e-3, point.shape)
    rows = [
        ",".join([*(f"{v:.2f}" for v in a), *(f"{v:.4f}" for v in b)])
        for a, b in zip(q, point, strict=True)
    ]
    table = tmp_path / "table.csv"
    table.write_text("\n".join(["q1,q2,q3,x,y,z", *rows]), encoding="utf-8")
    assert run(["import", str(table), "--guess", "--robot", "srbd"]) == 0
    assert "computed" not in capsys.readouterr().out


def test_targets_alone_are_in_doubt(guess) -> None:
    code, mapping, said = guess("qt", "q1,q2,q3,X_cmd,Y_cmd,Z_cmd")
    assert code == 1
    assert mapping["position"]["columns"] == ["X_cmd", "Y_cmd", "Z_cmd"]
    assert "by their names these are intended positions; no columns of measured ones" in said


def test_points_rounded_to_the_digits_printed_are_computed(tmp_path, cell, capsys) -> None:
    """Digits of 0.1 mm hide the noise; the rounding alone explains the difference."""
    rounded = {**cell, "t": np.round(cell["t"], 1)}
    rows = [
        ",".join([*(f"{v:.4f}" for v in q), *(f"{v:.1f}" for v in t), *(f"{v:.4f}" for v in p)])
        for q, t, p in zip(rounded["q"], rounded["t"], rounded["p"], strict=True)
    ]
    table = tmp_path / "table.csv"
    table.write_text("\n".join(["q1,q2,q3,tcp_x,tcp_y,tcp_z,X,Y,Z", *rows]), encoding="utf-8")
    assert run(["import", str(table), "--guess", "--robot", "srbd"]) == 0
    said = capsys.readouterr().out
    assert "tcp_x, tcp_y, tcp_z match the nominal robot within the rounding of the digits" in said
    assert "in doubt: X, Y, Z are read as the measured point" in said


@pytest.mark.parametrize(
    ("kinds", "heads", "own"),
    [
        ("qep", ("{} cmd (deg)", "{} act (deg)"), "joint_"),
        ("eqp", ("enc{}", "q{}_soll"), ""),
        ("qep", ("{}", "{}_state"), "joint_"),
    ],
)
def test_commands_and_encoders_are_not_mixed(guess, kinds, heads, own) -> None:
    blocks = [[head.format(f"{own}{k}") for k in (1, 2, 3)] for head in heads]
    code, mapping, said = guess(kinds, ",".join([*blocks[0], *blocks[1], "X", "Y", "Z"]))
    commands, encoders = blocks if kinds[0] == "q" else blocks[::-1]
    assert code == 0
    assert [entry["column"] for entry in mapping["commands"]] == commands
    assert [entry["column"] for entry in mapping["encoders"]] == encoders
    assert f"encoders of the joints: columns {', '.join(encoders)}" in said


def test_columns_that_differ_from_the_commands_are_no_encoders(guess) -> None:
    code, mapping, said = guess("qtp", "q1,q2,q3,enc1,enc2,enc3,X,Y,Z")
    assert code == 0
    assert "encoders" not in mapping
    assert "not used: enc1, enc2, enc3" in said


def test_groups_have_the_same_words_around_axis_and_joint() -> None:
    names = ["X_cmd", "Y_cmd", "Z_cmd", "X_meas", "Y_meas", "dX", "dY", "dZ", "std_x"]
    assert [group.columns for group in point_groups(names)] == [("X_cmd", "Y_cmd", "Z_cmd")]
    heads = ["J1 act", "J2 act", "J2 cmd", "J1 cmd", "J1 torque", "J2 torque"]
    assert [group.columns for group in joint_groups(heads, ["J1", "J2"])[::2]] == [
        ("J1 cmd", "J2 cmd"),
        ("J1 act", "J2 act"),
    ]
    assert [kind_of(name) for name in ("Xnom", "ActualX", "Y", "target_actual_x")] == [
        "",
        "read",
        "",
        "",
    ]


# --- temperatures


@pytest.mark.parametrize(
    ("name", "found"),
    [
        ("T_F", ("machine", "degF")),
        ("T_arm_F", ("arm", "degF")),
        ("Temp_F", ("machine", "degF")),
        ("TempF", ("machine", "degF")),
        ("temp [degF]", ("machine", "degF")),
        ("temp arm (°F)", ("arm", "degF")),
        ("temperature_K", ("machine", "K")),
        ("T_C", ("machine", "degC")),
        ("Temperature [°C]", ("machine", "degC")),
        ("T1 [C]", ("sensor_1", "degC")),
        ("temp_arm", ("arm", "")),
        ("Temp_F (2)", ("machine", "degF")),
        ("t", None),
        ("t_ms", None),
        ("t_x", None),
        ("T1", None),
        ("load_f", None),
    ],
)
def test_the_unit_of_a_temperature_is_no_part(name, found) -> None:
    assert warm_name(name) == found


def with_column(tmp_path: Path, cell, name: str, values: list[str], unit: str = "") -> Path:
    head = ["q1", "q2", "q3", "x", "y", "z", name]
    units = ["deg", "deg", "deg", "mm", "mm", "mm", unit]
    numbers = np.hstack([cell["q"], cell["p"]])
    rows = [
        ",".join([*(f"{v:.4f}" for v in row), value])
        for row, value in zip(numbers, values, strict=True)
    ]
    table = tmp_path / "table.csv"
    lines = [",".join(head), *([",".join(units)] if unit else []), *rows]
    table.write_text("\n".join(lines), encoding="utf-8")
    return table


@pytest.mark.parametrize(
    ("name", "unit", "first", "said", "code"),
    [
        ("T_F", "", 68.0, "temperature of machine T_F (degF)", 0),
        ("Temp", "F", 68.0, "temperature of machine Temp [F] (degF)", 0),
        ("T_arm_K", "", 293.0, "temperature of arm T_arm_K (K)", 0),
        ("T_arm", "", 20.0, "temperature of arm T_arm (degC)", 0),
        ("T_arm", "", 68.0, "in doubt: T_arm: is this a temperature in degC? It would be 68", 1),
    ],
)
def test_temperatures_have_the_unit_of_their_name(
    tmp_path, cell, capsys, name, unit, first, said, code
) -> None:
    values = [f"{first + 0.02 * k:.2f}" for k in range(len(cell["q"]))]
    table, out = with_column(tmp_path, cell, name, values, unit), tmp_path / "session"
    verb = ["import", str(table), "--guess", "--robot", "srbd", "--out", str(out)]
    assert run(verb) == code
    assert said in capsys.readouterr().out


# --- what is not used, and what is refused


@pytest.mark.parametrize(
    ("head", "columns"),
    [("q1,q2,q3,x,y,z,roll,pitch,yaw", "roll, pitch, yaw"), ("q1,q2,q3,x,y,z,A,B,C", "A, B, C")],
)
def test_rotations_that_only_a_mapping_can_read_are_named(guess, head, columns) -> None:
    code, _, said = guess("qpe", head)
    assert code == 0
    assert f"not used: {columns}\n" in said
    assert f"{columns} look like a rotation, which a mapping can read: `rotation`" in said


def test_unused_columns_of_a_table_without_names_are_named(tmp_path, cell, capsys) -> None:
    turn = np.random.default_rng(2).normal(size=(len(cell["q"]), 4))
    turn /= np.linalg.norm(turn, axis=1, keepdims=True)
    rows = np.hstack([cell["q"], cell["p"], turn])
    table = tmp_path / "table.txt"
    np.savetxt(table, rows, fmt="%.6f")
    assert run(["import", str(table), "--guess", "--robot", "srbd"]) == 0
    said = capsys.readouterr().out
    assert "not used: c7, c8, c9, c10\n" in said
    assert "c7, c8, c9, c10 look like a rotation" in said


def test_a_doubtful_mapping_is_written_if_asked_for(tmp_path, cell, capsys) -> None:
    table = write(tmp_path / "table.csv", cell, "qpp", "q1,q2,q3,x_a,y_a,z_a,x_b,y_b,z_b")
    out, mapping = tmp_path / "session", tmp_path / "m.yaml"
    verb = ["import", str(table), "--guess", "--robot", "srbd", "--out", str(out)]
    assert run(verb) == 1
    assert "write the mapping with --mapping-out" in capsys.readouterr().err
    assert run([*verb, "--mapping-out", str(mapping)]) == 1
    told = capsys.readouterr()
    assert f"written: {mapping}" in told.out
    assert f"correct the mapping {mapping}, and import with --mapping" in told.err
    assert "--mapping-out" not in told.err
    assert mapping.exists()
    assert not out.exists()


def test_a_side_that_is_no_number_is_refused_with_what_is_allowed(tmp_path, capsys) -> None:
    _, poses = measured()
    head, rows = stops(poses)
    sides = [[*row, "+-"[k % 2]] for k, row in enumerate(rows)]
    said = refused(capsys, tmp_path, [*head, "side"], sides, mapping_of(direction=["side"]))
    assert "line 2: side: '+' is not allowed; allowed: -1, 0, 1" in said
    signs = [[*row, "-1" if k % 2 else "1"] for k, row in enumerate(rows)]
    imported(tmp_path, [*head, "side"], signs, mapping_of(direction=["side"]))


@pytest.mark.parametrize("end", ["npy", "npz", "mat"])
def test_files_of_arrays_are_refused_by_what_is_expected(tmp_path, capsys, end) -> None:
    file = tmp_path / f"log.{end}"
    if end == "mat":
        pytest.importorskip("scipy.io").savemat(file, {"q": np.zeros((9, 6))})
    else:
        save = np.save if end == "npy" else np.savez
        save(file, np.zeros((9, 6)))
    assert run(["import", str(file), "--guess", "--robot", "srbd"]) == 2
    said = capsys.readouterr().err
    assert f"{file}: .{end} is no table" in said
    assert "a text (such as CSV) or an xlsx file is expected" in said
