"""Axes outside the model (passed through): on the command path, in tables, in the robot file."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML

from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.command_path import HOLD
from delta_calibration.cell.joint_bytes import Bytes, Layout
from delta_calibration.cell.trajectory import Points
from delta_calibration.cell.usual import MARK
from delta_calibration.cli.main import run
from delta_calibration.data import JointStream, collect
from delta_calibration.errors import ConfigError, InputError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import Robot, load_robot, robot_document, robot_from
from delta_calibration.simulation import draw_machine, simulate_session

PLAIN = load_robot("srbd")
NAMES = PLAIN.joints.names
TURN = "joint_4"
Q = make_plan("line", PLAIN, count=5).joint[4]
T0_NS = 1_700_000_000_000_000_000


def document(*beside: str) -> dict:
    data = robot_document("srbd")[1]
    return {**data, "joints": {**data["joints"], "passed_through": list(beside)}}


def written(folder: Path, *beside: str) -> Path:
    path = folder / "cell.yaml"
    with path.open("w", encoding="utf-8") as file:
        YAML().dump(document(*beside), file)
    return path


@pytest.fixture(scope="module", name="session")
def session_fixture():
    plan = make_plan("identify", PLAIN, count=15, dwell=0.4, both_sides=False)
    return simulate_session(draw_machine(PLAIN, 5), plan, 5)


@pytest.fixture(scope="module", name="files")
def files_fixture(tmp_path_factory, session) -> tuple[Path, Path]:
    """A robot file with a fourth axis, and a calibration made without that axis."""
    folder = tmp_path_factory.mktemp("passed")
    poses = collect(session, NAMES)
    calibration = folder / "calibration.yaml"
    save_calibration(calibration, identify(poses, PLAIN, "rotary_delta"), PLAIN, poses)
    return written(folder, TURN), calibration


def desk_of(files: tuple[Path, Path], **settings) -> CalibrationSession:
    desk = CalibrationSession(
        Settings(str(files[0]), calibration=str(files[1]), ramp_s=0.0, **settings)
    )
    desk.enable(True)
    return desk


def test_a_calibration_does_not_depend_on_it(files) -> None:
    robot = load_robot(files[0])
    assert robot.joints.passed_through == (TURN,)
    assert robot.machine_hash == PLAIN.machine_hash
    assert load_calibration(files[1], robot).robot is robot


@pytest.mark.parametrize(
    ("beside", "message"),
    [
        (["joint_2"], r"cell\.yaml: joints\.passed_through: joint_2 is not allowed; it is one of"),
        ([TURN, TURN], r"joints\.passed_through"),
        ([""], r"joints\.passed_through\[0\]"),
    ],
)
def test_names_that_cannot_be_are_refused(beside, message) -> None:
    with pytest.raises(ConfigError, match=message):
        robot_from(document(*beside), "cell.yaml")


def test_its_value_goes_on_with_the_corrected_command(files) -> None:
    desk, plain = desk_of(files), desk_of(("srbd", files[1]))
    turn = 12.345678901234567
    sent = desk.send(np.append(Q, turn), T0_NS, 1.0, False)
    known = plain.send(Q, T0_NS, 1.0, False)
    assert np.abs(known.joint - Q).max() > 1e-5
    np.testing.assert_array_equal(sent.whole, np.append(known.joint, turn))
    np.testing.assert_array_equal(desk.nominal(sent.whole, 1.0)[3:], [turn])
    np.testing.assert_allclose(desk.nominal(sent.whole, 1.0)[:3], Q, atol=1e-15)
    without = desk.send(Q + 0.01, T0_NS + 1, 1.1, False)
    assert without.whole.shape == (3,)
    assert desk.nominal(sent.joint, 1.0).shape == (3,)


def test_the_short_way_does_as_the_long_way(files) -> None:
    """Bytes in and out, with the fourth axis first, in the middle, last, and missing."""
    short, long = desk_of(files), desk_of(files)
    orders = [(3, 0, 1, 2), (0, 3, 2, 1), (0, 1, 2, 3), (0, 1, 2)]
    every, went = (*NAMES, TURN), 0
    for k in range(200):
        order = orders[(k // 25) % len(orders)]
        q = np.append(Q + 0.02 * np.sin(0.05 * k + np.arange(3)), 100.0 * np.sin(k))
        told = Bytes([every[i] for i in order], "given" + "x" * len(order))
        message = told.message(q[list(order)], (k, 0))
        q = q[: len(order)]
        now_s, stamp_ns = 1e-3 * k, k * 1_000_000_000
        expected = long.send(q, stamp_ns, now_s, False)
        out = short.follow(message, now_s)
        if out is None:
            short.usual.learn(Layout.of(message), message)
            sent = short.send(q, stamp_ns, now_s, False, 0.0, short.usual.seen)
        else:
            went += 1
            command, stamp, sent = short.usual.went()
            layout = Layout.of(out)
            assert (layout.names, layout.frame_id) == (every[: len(order)], MARK)
            np.testing.assert_array_equal(layout.read(out), expected.whole)
            np.testing.assert_array_equal(command, q)
            assert stamp == stamp_ns
        np.testing.assert_array_equal(sent.whole, expected.whole)
        np.testing.assert_array_equal(sent.carried, q[3:])
    assert went > 190
    assert short.path.counts == long.path.counts


def test_in_a_hold_it_is_held_and_comes_back_without_a_jump(files) -> None:
    desk = desk_of(files, on_failure=HOLD)
    first = desk.send(np.append(Q, 1.0), T0_NS, 0.0, False)
    outside = np.full(3, 1.2)
    held = desk.send(np.append(outside, 9.0), T0_NS + 1, 0.01, False)
    np.testing.assert_array_equal(held.whole, first.whole)
    refused = desk.path.refuse("no message")
    np.testing.assert_array_equal(refused.whole, first.whole)
    back = [
        desk.send(np.append(Q, 9.0), T0_NS + 2 + k, 0.02 + 0.1 * k, False).carried[0]
        for k in range(200)
    ]
    speed = PLAIN.joints.speed
    assert np.abs(np.diff([1.0, *back])).max() < 0.11 * speed
    assert back[-1] == 9.0
    assert back[0] < 2.0


def test_a_part_of_several_is_refused(tmp_path: Path, files) -> None:
    desk = CalibrationSession(
        Settings(str(written(tmp_path, "turn", "grip")), calibration=str(files[1]))
    )
    made = Bytes((*NAMES, "grip")).message(np.append(Q, 1.0), (0, 0))
    message = r"passed-through axes \(turn, grip\) are expected once each, .*; found .*grip"
    with pytest.raises(InputError, match=message):
        desk.usual.learn(Layout.of(made), made)


def test_trajectories_carry_it(files) -> None:
    desk = desk_of(files)
    turn = np.array([[0.5], [700.0]])
    points = Points(
        np.array([1.0, 2.0]), np.stack([Q, Q + 0.01]), np.full((2, 3), 0.1), False, turn, 3 * turn
    )
    sent = desk.trajectories.send(points, 0.0)
    assert np.abs(sent.joint - points.joint).max() > 1e-5
    joint, velocity = sent.whole
    np.testing.assert_array_equal(joint[:, 3:], turn)
    np.testing.assert_array_equal(velocity[:, 3:], 3 * turn)
    assert joint.shape == velocity.shape == (2, 4)


def carrying(stream: JointStream) -> JointStream:
    """Insert the fourth axis after the first."""
    turn = np.linspace(0.0, 500.0, len(stream.position))[:, None]
    names = (stream.names[0], TURN, *stream.names[1:])
    position = np.hstack([stream.position[:, :1], turn, stream.position[:, 1:]])
    return replace(stream, names=names, position=position)


def test_fit_diagnosis_and_check_leave_it_out(session, files, tmp_path: Path) -> None:
    both = replace(session, command=carrying(session.command), states=carrying(session.states))
    write_session(tmp_path / "with", both)
    write_session(tmp_path / "plain", session)
    assert read_session(tmp_path / "with").command.names == (NAMES[0], TURN, *NAMES[1:])
    robot = ["--robot", str(files[0])]
    values = []
    for name in ("with", "plain"):
        out = tmp_path / f"{name}.yaml"
        assert run(["fit", str(tmp_path / name), *robot, "--out", str(out)]) == 0
        values.append(load_calibration(out, load_robot(files[0])).theta)
        assert run(["check", str(tmp_path / name), *robot]) == 0
    np.testing.assert_array_equal(*values)


def test_info_lists_it_by_its_own_name(session, files, tmp_path: Path, capsys) -> None:
    gripping = replace(session.states, names=("joint_1", "joint_2", "gripper"))
    both = replace(session, command=carrying(session.command), states=gripping)
    write_session(tmp_path / "with", both)
    assert run(["info", str(tmp_path / "with"), "--robot", str(files[0])]) == 0
    said = capsys.readouterr().out
    assert "/joint_command: joints joint_1, joint_2, joint_3; passed through joint_4\n" in said
    others = "/joint_states: joints joint_1, joint_2; not the robot's gripper; missing joint_3\n"
    assert others in said
    assert run(["info", str(tmp_path / "with")]) == 0
    assert "passed through" not in capsys.readouterr().out


def test_compensate_hands_its_column_on(files, tmp_path: Path) -> None:
    targets, out = tmp_path / "targets.csv", tmp_path / "commands.csv"
    head = "name,x_mm,joint_4_deg,y_mm,z_mm"
    targets.write_text(f"{head}\na,0,007.50,10,-750\nb,20,-1e2,0,-760\n", encoding="utf-8")
    given = ["--calibration", str(files[1]), str(targets), "--out", str(out)]
    assert run(["compensate", "--robot", str(files[0]), *given]) == 0
    with out.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    columns = list(rows[0])
    assert columns[columns.index("joint_3") + 1] == "joint_4_deg"
    assert [row["joint_4_deg"] for row in rows] == ["007.50", "-1e2"]
    assert columns.count("joint_4_deg") == 1
    before = [rows[0][name] for name in NAMES]
    targets.write_text("x_mm,y_mm,z_mm\n0,10,-750\n", encoding="utf-8")
    assert run(["compensate", "--robot", str(files[0]), *given]) == 0
    with out.open(encoding="utf-8") as file:
        (row,) = csv.DictReader(file)
    assert [row[name] for name in NAMES] == before


@pytest.mark.parametrize(
    ("robot", "text", "said"),
    [
        ("file", "x_mm,y_mm,z_mm,joint_4\n0,0,-750,much\n", "line 2: joint_4: 'much' is not a"),
        ("file", "x_mm,y_mm,z_mm,joint_5\n0,0,-750,1\n", "column joint_5 is not known"),
        ("srbd", "x_mm,y_mm,z_mm,joint_4\n0,0,-750,1\n", "column joint_4 is not known"),
    ],
)
def test_columns_that_are_none_are_refused(robot, text, said, files, tmp_path, capsys) -> None:
    targets = tmp_path / "targets.csv"
    targets.write_text(text, encoding="utf-8")
    name = str(files[0]) if robot == "file" else robot
    given = ["--calibration", str(files[1]), str(targets), "--out", str(tmp_path / "c.csv")]
    assert run(["compensate", "--robot", name, *given]) == 2
    assert said in capsys.readouterr().err


def test_robot_check_names_it(files, capsys) -> None:
    run(["robot", "check", str(files[0])])
    assert "passed through: joint_4" in capsys.readouterr().out


def test_a_robot_without_has_none() -> None:
    assert isinstance(PLAIN, Robot)
    assert PLAIN.joints.passed_through == ()
