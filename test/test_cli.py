"""Tests of the command line: verbs on a simulated session, one clear line per mistake."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import survey
from delta_calibration.data.streams import JointStream, Session, TrackerStream
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, hideable_causes, standing

ROBOT = str(Path(__file__).parents[1] / "config" / "srbd.yaml")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A small session and the calibration fitted to it."""
    folder = tmp_path_factory.mktemp("cell")
    session, calibration = folder / "session", folder / "calibration.yaml"
    assert (
        run(
            [
                "simulate",
                "--robot",
                ROBOT,
                "--plan",
                "identify",
                "--count",
                "40",
                "--seed",
                "3",
                "--out",
                str(session),
            ]
        )
        == 0
    )
    assert run(["fit", str(session), "--robot", ROBOT, "--out", str(calibration)]) == 0
    return folder


def line_of_error(capsys, arguments, code):
    """The one line that is printed for a mistake."""
    assert run(arguments) == code
    text = capsys.readouterr().err.strip()
    assert "Traceback" not in text
    return text.splitlines()[-1]


def write_points(path, rows):
    path.write_text("x_mm,y_mm,z_mm\n" + "".join(f"{x},{y},{z}\n" for x, y, z in rows))
    return str(path)


def test_fit_says_what_it_found(cell, capsys):
    assert run(["fit", str(cell / "session"), "--robot", ROBOT, "-v"]) == 0
    said = capsys.readouterr().out
    assert "rank 38 of 75 parameters" in said
    assert "before: nominal + frame" in said
    assert "platform_radial_1 has the same effect as -1 base_radial_1" in said
    assert run(["fit", str(cell / "session"), "--robot", ROBOT, "--model", "rotary_delta"]) == 0
    assert "rank 24 of 33 parameters" in capsys.readouterr().out


@pytest.mark.parametrize("method", ["apso", "newton"])
def test_compensated_commands_bring_the_true_machine_to_the_targets(cell, method):
    """The commands are read from the CSV and sent to the machine of the session."""
    robot = load_robot(ROBOT)
    targets = make_plan("line", robot, count=9, both_sides=False).target
    points = write_points(cell / f"targets_{method}.csv", 1e3 * targets)
    out = cell / f"commands_{method}.csv"
    arguments = [
        "--robot",
        ROBOT,
        "--calibration",
        str(cell / "calibration.yaml"),
        "--method",
        method,
    ]
    assert run(["compensate", *arguments, points, "--out", str(out)]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    joints = [f"joint_{k}" for k in (1, 2, 3)]
    nominal_joints = [f"nominal_{name}" for name in joints]
    places = ["x_mm", "y_mm", "z_mm"]
    assert list(rows[0]) == [*places, *nominal_joints, *joints, "status", "u95_mm", "error_mm"]
    assert {row["status"] for row in rows} == {"corrected"}
    assert max(float(row["error_mm"]) for row in rows) < 1e-3
    q = np.array([[float(row[f"joint_{k}"]) for k in (1, 2, 3)] for row in rows])
    machine = draw_machine(robot, 3)
    nominal = make_plan("line", robot, count=9, both_sides=False).joint

    def shape_error(joints):
        """Errors of the distances between points, independent of the calibration's frame."""
        reached = machine.tool_points(standing(joints))
        return np.abs(
            np.linalg.norm(reached[1:] - reached[0], axis=1)
            - np.linalg.norm(targets[1:] - targets[0], axis=1)
        )

    assert shape_error(nominal).max() > 0.2e-3
    assert shape_error(q).max() < 0.02e-3


def test_iso9283_writes_every_criterion(tmp_path, capsys):
    session, out = tmp_path / "cycles", tmp_path / "iso.json"
    assert (
        run(
            [
                "simulate",
                "--robot",
                ROBOT,
                "--plan",
                "iso9283",
                "--seed",
                "1",
                "--out",
                str(session),
            ]
        )
        == 0
    )
    assert run(["iso9283", str(session), "--robot", ROBOT, "--json", str(out)]) == 0
    found = json.loads(out.read_text())
    assert [v["symbol"] for v in found["values"]] == ["AP", "RP"] * 5 + [
        "AD",
        "RD",
        "AT",
        "RT",
        "AT",
        "RT",
    ]
    assert {v["cycles"] for v in found["values"]} == {30, 10}
    assert found["left_out"] == []
    assert run(["iso9283", str(session), "--robot", ROBOT, "--conditions", "delta_paper"]) == 0
    assert "Delta paper" in capsys.readouterr().out


def test_too_few_cycles_cannot_be_judged(tmp_path, capsys):
    session = tmp_path / "few"
    run(
        [
            "simulate",
            "--robot",
            ROBOT,
            "--plan",
            "iso9283",
            "--count",
            "5",
            "--seed",
            "1",
            "--out",
            str(session),
        ]
    )
    line = line_of_error(capsys, ["iso9283", str(session), "--robot", ROBOT], 1)
    assert "was reached 5 times; ISO 9283:1998 asks for 30" in line


def test_info_lists_topics_and_provenance(cell, capsys):
    assert run(["info", str(cell / "session")]) == 0
    said = capsys.readouterr().out
    assert "/joint_command" in said
    assert "plan: identify" in said


def test_same_seed_same_fit(cell, tmp_path):
    again = tmp_path / "again.yaml"
    assert run(["fit", str(cell / "session"), "--robot", ROBOT, "--out", str(again)]) == 0
    assert again.read_bytes() == (cell / "calibration.yaml").read_bytes()


def test_a_wrong_key_is_refused_with_its_path(tmp_path, cell, capsys):
    robot = tmp_path / "robot.yaml"
    robot.write_text(Path(ROBOT).read_text().replace("  arm_mm: 320.0", "  arm_mm: -320.0"))
    line = line_of_error(capsys, ["fit", str(cell / "session"), "--robot", str(robot)], 2)
    assert line.startswith("delta-cal: ")
    assert "geometry.arm_mm: -320.0 is not allowed; more than 0" in line


def test_no_such_robot_session_or_plan(cell, tmp_path, capsys):
    session = str(cell / "session")
    assert "srbd" in line_of_error(capsys, ["fit", session, "--robot", "nobody"], 2)
    assert "nowhere" in line_of_error(capsys, ["fit", "nowhere", "--robot", ROBOT], 2)
    out = str(tmp_path / "s")
    line = line_of_error(
        capsys, ["simulate", "--robot", ROBOT, "--plan", "spiral", "--out", out], 2
    )
    assert "'spiral'" in line
    assert "identify" in line


def test_output_folder_is_checked_before_the_work(cell, tmp_path, capsys):
    (tmp_path / "file").touch()
    line = line_of_error(
        capsys,
        [
            "fit",
            str(cell / "session"),
            "--robot",
            ROBOT,
            "--out",
            str(tmp_path / "file" / "c.yaml"),
        ],
        2,
    )
    assert "file is not a folder" in line


def test_missing_topic(cell, capsys):
    line = line_of_error(
        capsys,
        ["fit", str(cell / "session"), "--robot", ROBOT, "--topic", "tracker_point=/elsewhere"],
        2,
    )
    assert "/elsewhere" in line or "tracker" in line


def test_empty_bag(tmp_path, capsys):
    (tmp_path / "empty").mkdir()
    assert "empty" in line_of_error(capsys, ["fit", str(tmp_path / "empty"), "--robot", ROBOT], 2)
    (tmp_path / "empty" / "empty_0.mcap").write_bytes(b"")
    assert "empty" in line_of_error(capsys, ["fit", str(tmp_path / "empty"), "--robot", ROBOT], 2)


def session_of(names, scale=1.0):
    """A session at rest in some places, one message per pose."""
    stamp = np.arange(40, dtype=np.int64) * 10**10
    joint = np.random.default_rng(0).uniform(0, 0.8, (40, 3))
    point = scale * np.random.default_rng(1).uniform(-1, 1, (40, 3)) + [3.0, 0, 0]
    return Session(
        "made",
        JointStream(stamp, names, joint),
        JointStream(stamp, names, joint),
        TrackerStream(stamp, point),
    )


def test_bag_of_another_robot(tmp_path, capsys):
    write_session(tmp_path / "names", session_of(("axis_a", "axis_b", "axis_c")), {})
    line = line_of_error(capsys, ["fit", str(tmp_path / "names"), "--robot", ROBOT], 2)
    assert "axis_a, axis_b, axis_c" in line
    assert "wrong robot" in line
    write_session(tmp_path / "shape", session_of(("joint_1", "joint_2", "joint_3")), {})
    for verb in ("fit", "diagnose"):
        line = line_of_error(capsys, [verb, str(tmp_path / "shape"), "--robot", ROBOT], 1)
        assert "another robot" in line


def test_calibration_of_another_robot(cell, tmp_path, capsys):
    robot = tmp_path / "longer.yaml"
    robot.write_text(Path(ROBOT).read_text().replace("  arm_mm: 320.0", "  arm_mm: 330.0"))
    points = write_points(tmp_path / "p.csv", [(0, 0, -711)])
    arguments = ["--robot", str(robot), "--calibration", str(cell / "calibration.yaml")]
    line = line_of_error(
        capsys, ["compensate", *arguments, points, "--out", str(tmp_path / "c.csv")], 2
    )
    assert "made for 'srbd' with hash" in line


@pytest.mark.parametrize(
    ("point", "code", "said"),
    [
        ((2000, 0, -711), 1, "point 2: out of reach of the nominal robot"),
        ((0, 0, -1130), 1, "point 2: outside the calibrated region"),
        ((0, 0, "deep"), 2, "line 3: z_mm: 'deep' is not a finite number"),
        ((0, 0, "nan"), 2, "line 3: z_mm: 'nan' is not a finite number"),
    ],
)
def test_targets_that_cannot_be_served(cell, tmp_path, capsys, point, code, said):
    points = write_points(tmp_path / "p.csv", [(0, 0, -711), point])
    out = tmp_path / "commands.csv"
    arguments = ["--robot", ROBOT, "--calibration", str(cell / "calibration.yaml")]
    order = ["compensate", *arguments, points, "--out", str(out), "--outside", "refuse"]
    assert run(order) == code
    told = capsys.readouterr().err
    assert said in told
    assert ("1 of 2 points cannot be corrected, and nothing was written" in told) == (code == 1)
    assert not out.exists()


def test_what_lies_outside_is_told_where_inside_is(cell, tmp_path, capsys):
    """The box is that of the places in the calibration file, in the columns of targets."""
    points = write_points(tmp_path / "p.csv", [(0, 0, -1130)])
    arguments = ["--robot", ROBOT, "--calibration", str(cell / "calibration.yaml")]
    out = str(tmp_path / "c.csv")
    assert run(["compensate", *arguments, points, "--out", out]) == 1
    line = capsys.readouterr().err.strip().splitlines()[-1]
    box = re.search(r"within x (\S+) to (\S+), y (\S+) to (\S+), z (\S+) to (\S+) mm", line)
    places = 1e3 * load_calibration(cell / "calibration.yaml", load_robot(ROBOT)).region.vertices
    sides = np.array(box.groups(), dtype=float).reshape(3, 2)
    assert np.allclose(sides, np.array([places.min(axis=0), places.max(axis=0)]).T, atol=0.51)


def test_singular_pose_is_refused(cell, tmp_path, capsys):
    """With a strict limit every pose away from home counts as too near a singularity."""
    robot_text = Path(ROBOT).read_text().replace("  condition: 20.0", "  condition: 1.01")
    (tmp_path / "strict.yaml").write_text(robot_text)
    calibration = tmp_path / "c.yaml"
    robot = str(tmp_path / "strict.yaml")
    assert run(["fit", str(cell / "session"), "--robot", robot, "--out", str(calibration)]) == 0
    points = write_points(tmp_path / "p.csv", [(300, 0, -711)])
    arguments = [
        "--robot",
        robot,
        "--calibration",
        str(calibration),
        points,
        "--out",
        str(tmp_path / "o.csv"),
    ]
    assert run(["compensate", *arguments]) == 1
    assert "point 1: left nominal: near a singularity" in capsys.readouterr().err


def test_effect_options_are_checked(tmp_path, capsys):
    arguments = ["simulate", "--robot", ROBOT, "--out", str(tmp_path / "s"), "--effect"]
    assert "arm_length" in line_of_error(capsys, [*arguments, "arm_lenght"], 2)
    assert "location" in line_of_error(capsys, [*arguments, "arm_length:leg=3"], 2)
    assert "not a finite number" in line_of_error(capsys, [*arguments, "arm_length:value=much"], 2)
    assert "key=value" in line_of_error(capsys, [*arguments, "arm_length:value"], 2)


@pytest.mark.parametrize(
    ("effect", "said"),
    [
        ("backlash:width=1", "effect backlash: unknown option width; allowed: location, value"),
        ("backlash:value=-1", "gap_1 = -1 rad is not possible; allowed: 0 to 0.05"),
        ("backlash:location=joint_9", "no location 'joint_9'; allowed: joint_1, joint_2, joint_3"),
        ("thermal_growth_arm:sensor=oven", "no sensor 'oven'; allowed: arm, base"),
        ("transmission_error:cycles=0", "cycles 0 is not allowed; more than 0"),
        ("slack", "effect slack cannot be hidden; causes: geometry, base_joint_position"),
    ],
)
def test_effects_that_cannot_be_are_one_line_and_2(tmp_path, capsys, effect, said):
    out = tmp_path / "s"
    arguments = ["simulate", "--robot", ROBOT, "--out", str(out), "--effect", effect]
    assert run(arguments) == 2
    text = capsys.readouterr().err.strip()
    assert len(text.splitlines()) == 1
    assert said in text
    assert not out.exists()


def test_effects_are_in_the_session_that_is_written(tmp_path, capsys):
    """The same seed gives the same session, which differs by the effects only."""
    hidden = ["--effect", "backlash:value=3e-4", "--effect", "tracker_scale:value=5e-5"]
    arguments = ["simulate", "--robot", ROBOT, "--plan", "line", "--count", "9", "--seed", "4"]
    sessions = []
    for name, more in (("plain", []), ("hidden", hidden), ("again", hidden)):
        assert run([*arguments, *more, "--out", str(tmp_path / name)]) == 0
        sessions.append(read_session(tmp_path / name).tracker.position)
    plain, first, again = sessions
    np.testing.assert_array_equal(first, again)
    moved = np.linalg.norm(first - plain, axis=1)
    assert 1e-4 < np.sqrt(np.mean(moved**2)) < 4e-4
    capsys.readouterr()
    assert run(["info", str(tmp_path / "hidden")]) == 0
    assert "effects: backlash:value=3e-4 tracker_scale:value=5e-5" in capsys.readouterr().out


def test_a_rich_session_warms_up_for_two_hours_and_can_be_read_back(tmp_path):
    out = tmp_path / "rich"
    arguments = ["simulate", "--robot", ROBOT, "--count", "4", "--rate", "10", "--out", str(out)]
    assert run([*arguments, "--effect", "thermal_growth_arm"]) == 0
    session = read_session(out)
    seconds = (session.tracker.stamp_ns[-1] - session.tracker.stamp_ns[0]) * 1e-9
    assert seconds > 28 * 38.0
    arm, base = session.temperature
    assert (arm.part, base.part) == ("arm", "base")
    share = 1 - np.exp(-seconds / 2400.0)
    assert arm.celsius[-1] - arm.celsius[0] == pytest.approx(13 * share, rel=0.1)
    assert sorted(set(session.payload.mass)) == [0.0, 2.0]
    found = survey(session, load_robot(ROBOT).joints.names)
    assert len(found.poses) >= 28
    assert len(set(found.paths.path)) >= 6


def test_every_cause_is_in_the_help(capsys):
    assert run(["simulate", "--help"]) == 0
    said = capsys.readouterr().out.split()
    causes = hideable_causes(load_robot(ROBOT), draw_machine(load_robot(ROBOT), 0).chain)
    assert [cause for cause in causes if cause not in said] == []


def test_an_existing_session_is_not_overwritten(cell, capsys):
    arguments = ["simulate", "--robot", ROBOT, "--plan", "line", "--out", str(cell / "session")]
    assert "exists" in line_of_error(capsys, arguments, 2)


def test_usage_errors_leave_with_2(capsys):
    assert run(["fit"]) == 2
    assert run(["no_such_verb"]) == 2
    assert run(["fit", "x", "--robot", ROBOT, "--seed", "-1"]) == 2


@pytest.mark.parametrize(
    "verb",
    ["simulate", "fit", "compensate", "export", "iso9283", "replay", "info", "urdf", "demo"],
)
def test_every_verb_explains_itself(verb, capsys):
    assert run([verb, "--help"]) == 0
    assert "Usage: delta-cal" in capsys.readouterr().out


def test_a_mistyped_verb_gets_the_nearest(capsys):
    assert "Did you mean 'simulate'?" in line_of_error(capsys, ["simulte"], 2)
    assert line_of_error(capsys, ["qqq"], 2).endswith("No such command 'qqq'.")


def test_a_file_of_another_kind_is_called_what_it_is(cell, capsys):
    session, calibration = str(cell / "session"), str(cell / "calibration.yaml")
    said = line_of_error(capsys, ["fit", session, "--robot", calibration], 2)
    assert said.endswith("calibration.yaml: is a calibration file; a robot file is expected")
    points = write_points(cell / "kinds.csv", [(0, 0, -750)])
    arguments = ["compensate", points, "--robot", ROBOT, "--out", str(cell / "kinds_out.csv")]
    said = line_of_error(capsys, [*arguments, "--calibration", ROBOT], 2)
    assert said.endswith("srbd.yaml: is a robot file; a calibration file is expected")
    assert run(["diagnose", session, "--robot", ROBOT, "--json", str(cell / "v.json")]) == 0
    capsys.readouterr()
    said = line_of_error(capsys, [*arguments, "--calibration", str(cell / "v.json")], 2)
    assert said.endswith("v.json: is a verdict; a calibration file is expected")
