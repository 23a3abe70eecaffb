"""Tests of `delta-cal compensate` with a calibration that contains effects."""

from __future__ import annotations

import csv
import io
import time
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.calibration_file import (
    from_identification,
    load_calibration,
    save_calibration,
)
from delta_calibration.cli.main import run
from delta_calibration.cli.options import steadily
from delta_calibration.commands import _uncommanded
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import at_rest, collect
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan, nominal_joints
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from extended_bench import Effects, with_effects

ROBOT = load_robot("srbd")
GAP = 4e-4
POINTS = np.array(
    [[0.0, 0.0, -711.0], [50.0, 0.0, -711.0], [100.0, 0.0, -711.0], [50.0, 0.0, -711.0]]
)
EFFECTS: Effects = {
    "backlash": ({}, GAP),
    "joint_compliance": ({}, 4e-5),
    "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),
    "joint_zero_drift": ({}, 1e-4),
}


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """Files of a fit, of the same with effects, and of the targets."""
    folder = tmp_path_factory.mktemp("cell")
    plan = make_plan("identify", ROBOT, count=15, dwell=0.4, both_sides=False)
    poses = collect(simulate_session(draw_machine(ROBOT, 5), plan, 5), ROBOT.joints.names)
    found = identify(poses, ROBOT, "rotary_delta")
    for name, effects in (
        ("plain", {}),
        ("play", {"backlash": EFFECTS["backlash"]}),
        ("all", EFFECTS),
    ):
        save_calibration(
            folder / f"{name}.yaml", with_effects(found, ROBOT, effects), ROBOT, poses
        )
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in POINTS)
    (folder / "targets.csv").write_text("x_mm,y_mm,z_mm\n" + rows)
    return folder


def arguments(cell: Path, name: str, *more: str) -> list[str]:
    return [
        "compensate",
        "--robot",
        "srbd",
        "--calibration",
        str(cell / f"{name}.yaml"),
        "--method",
        "newton",
        str(cell / "targets.csv"),
        "--out",
        str(cell / f"{name}.csv"),
        *more,
    ]


def commands(cell: Path, name: str, *more: str) -> np.ndarray:
    assert run(arguments(cell, name, *more)) == 0
    with (cell / f"{name}.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert max(float(row["error_mm"]) for row in rows) < 1e-3
    return np.array([[float(row[name]) for name in ROBOT.joints.names] for row in rows])


def test_a_long_first_part_shows_a_bar(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without it a single part of work, or code that is compiled first, would be silent."""

    class Screen(io.StringIO):
        def isatty(self) -> bool:
            return True

    screen = Screen()
    monkeypatch.setattr("sys.stderr", screen)
    parts = steadily(["only"], 1, "part")
    assert next(parts) == "only"
    time.sleep(1.5)
    assert "0/1" in screen.getvalue()
    assert list(parts) == []


def test_play_is_taken_back_by_the_point_before(cell):
    shift = commands(cell, "play") - commands(cell, "plain")
    joint = nominal_joints(ROBOT, POINTS * 1e-3)
    way = np.sign(np.diff(joint, axis=0, prepend=joint[:1]))
    assert set(way.ravel()) == {-1.0, 0.0, 1.0}
    np.testing.assert_allclose(shift, GAP / 2 * way, atol=1e-8)


def test_payload_and_temperature_are_asked_for_and_taken_part(cell, capsys):
    for given, missing in (
        ([], "the payload is not known; the temperature of part 'arm' is not known"),
        (["--payload", "2"], "the temperature of part 'arm' is not known"),
        (["--temperature", "arm=20", "--temperature", "base=20"], "the payload is not known"),
    ):
        assert run(arguments(cell, "all", *given)) == 2
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert f"effects that need a condition: {missing}; give it by" in said
        assert not (cell / "all.csv").exists()
    cold = commands(cell, "all", "--payload", "0", "--temperature", "arm=20")
    told = capsys.readouterr().out
    assert "not compensated" not in told
    assert "joint_zero_drift: compensated as at the end of the session, " in told
    assert "what changed since is in neither the commands nor u95" in told
    heavy = commands(cell, "all", "--payload", "3", "--temperature", "arm=20")
    warm = commands(cell, "all", "--payload", "0", "--temperature", "arm=45")
    assert (heavy < cold - 1e-5).all()  # a smaller angle is a higher arm
    assert np.abs(warm - cold).max() > 1e-5


@pytest.mark.parametrize("text", ["arm", "arm=", "arm=warm", "=20", "arm=nan"])
def test_a_temperature_that_is_none_is_refused(cell, capsys, text):
    assert run(arguments(cell, "all", "--temperature", text)) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert "'--temperature': " in said
    formed = text in ("arm=warm", "arm=nan")
    assert ("PART=DEGREES is expected, such as arm=27.5" in said) != formed


def test_a_temperature_of_a_part_that_there_is_not_is_refused(cell, capsys):
    """Earlier, it was ignored without a message, and the growth was taken as zero."""
    warm = ["--payload", "0", "--temperature", "arm=30"]
    assert run(arguments(cell, "all", *warm, "--temperature", "wing=30")) == 2
    said = capsys.readouterr().err
    assert "robot srbd has no part 'wing' that grows; there are: arm, base, forearm" in said
    assert run(arguments(cell, "all", *warm, "--temperature", "arm=31")) == 2
    assert "--temperature arm=31: arm was already given as 30" in capsys.readouterr().err


def test_a_temperature_that_nothing_goes_by_is_said(cell, capsys):
    assert run(arguments(cell, "all", "--payload", "0", "--temperature", "arm=30")) == 0
    assert "changes nothing" not in capsys.readouterr().err
    assert run(arguments(cell, "plain", "--temperature", "base=30")) == 0
    said = "the calibration has no growth of base: --temperature base=30 changes nothing"
    assert said in capsys.readouterr().err


def test_columns_of_a_plan_are_said_to_be_left_out(cell, capsys):
    (cell / "plan.csv").write_text("x_mm,y_mm,z_mm,direction,payload_kg\n0,0,-711,1,2\n")
    order = [str(cell / "plan.csv") if "targets" in a else a for a in arguments(cell, "plain")]
    assert run(order) == 0
    said = capsys.readouterr().err
    assert "plan.csv: not used: direction, payload_kg (columns of a plan)" in said


def test_what_the_margin_leaves_is_said_of_every_point(cell, capsys):
    """Half way through the margin half of the correction is left out; earlier, silently."""
    made, margin = load_calibration(cell / "plain.yaml", ROBOT), ROBOT.limits.region_margin
    way = np.linspace(0.0, 0.8, 20001)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, -0.75]
    beyond = made.region.outside(way)
    inside, half, late = (way[np.argmin(np.abs(beyond - k * margin))] for k in (-1.0, 0.5, 0.9))
    rows = "".join(f"{x},{y},{z}\n" for x, y, z in 1e3 * np.array([inside, half, *[late] * 11]))
    (cell / "margin.csv").write_text("x_mm,y_mm,z_mm\n" + rows)
    order = [str(cell / "margin.csv") if "targets" in a else a for a in arguments(cell, "plain")]
    assert run(order) == 0
    said = capsys.readouterr().err.splitlines()
    assert "margin.csv: 12 of 13 points are in the margin outside the calibrated region" in said[0]
    with (cell / "plain.csv").open() as file:
        left = [float(row["error_mm"]) for row in csv.DictReader(file)]
    for k, share in ((1, 50), (2, 10)):
        expected = (
            f"  point {k + 1}: {share} % of its correction, remaining error {left[k]:.3f} mm"
        )
        assert said[k] == f"{expected} according to the model"
    assert said[-1] == f"  and 2 more: error_mm in {cell / 'plain.csv'}"
    # The remaining error is the error without a correction, in proportion.
    joint = nominal_joints(ROBOT, np.array([half, late]))
    there = made.chain.point(made.chain.mechanism.forward(joint, made.geometry), ROBOT.tool_offset)
    whole = 1e3 * np.linalg.norm(there - [half, late], axis=1)
    np.testing.assert_allclose(left[1:3], whole * [0.5, 0.9], rtol=0.02)
    assert left[1] > 0.05
    commands(cell, "plain")  # there is no message if all points are inside
    assert "margin" not in capsys.readouterr().err


def test_a_payload_below_nothing_is_refused(cell, capsys):
    assert run(arguments(cell, "all", "--payload", "-1")) == 2
    assert "--payload" in capsys.readouterr().err


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_every_target_has_a_row_with_what_became_of_it(cell, capsys):
    """Inside, in the margin, beyond it and out of reach: in order, each reported once."""
    made, margin = load_calibration(cell / "plain.yaml", ROBOT), ROBOT.limits.region_margin
    way = np.linspace(0.0, 0.8, 20001)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, -0.75]
    beyond = made.region.outside(way)
    inside, half, past = (way[np.argmin(np.abs(beyond - k * margin))] for k in (-1.0, 0.5, 1.5))
    names = ("first", "half", "past", "far")
    places = 1e3 * np.array([inside, half, past, [2.0, 0.0, -0.7]])
    lines = [f"{name},{x},{y},{z}" for name, (x, y, z) in zip(names, places, strict=True)]
    (cell / "every.csv").write_text("\n".join(["name,x_mm,y_mm,z_mm", *lines]) + "\n")
    order = [str(cell / "every.csv") if "targets" in a else a for a in arguments(cell, "plain")]
    assert run(order) == 1
    said = capsys.readouterr().err
    rows = rows_of(cell / "plain.csv")
    assert [row["name"] for row in rows] == list(names)
    status = ["corrected", "blended", "outside_region", "out_of_reach"]
    assert [row["status"] for row in rows] == status
    np.testing.assert_allclose([float(row["x_mm"]) for row in rows], places[:, 0])
    joints = nominal_joints(ROBOT, places[:3] * 1e-3)
    for row, joint in zip(rows, joints, strict=False):
        nominal = [float(row[f"nominal_{name}"]) for name in ROBOT.joints.names]
        np.testing.assert_allclose(nominal, joint, atol=1e-8)
    past_row, far = rows[2], rows[3]
    for name in ROBOT.joints.names:
        assert past_row[name] == past_row[f"nominal_{name}"]
        assert far[name] == far[f"nominal_{name}"] == ""
    sent = np.array([[float(rows[0][name]) for name in ROBOT.joints.names]])
    u95 = 1e3 * made.identified.radius(at_rest(sent))[0]
    assert float(rows[0]["u95_mm"]) == pytest.approx(u95, rel=1e-2)
    assert 0.3 < u95 / (1.614e3 * made.held_out) < 2.0
    assert float(rows[1]["u95_mm"]) > float(rows[0]["u95_mm"])
    assert past_row["u95_mm"] == far["u95_mm"] == ""
    assert said.count("point 3 (past): left nominal: outside the calibrated region") == 1
    assert said.count("point 4 (far): no command: out of reach of the nominal robot") == 1
    assert "2 of 4 points are not corrected; the calibrated region lies within x " in said


def test_outside_may_be_left_nominal_from_the_edge_on(cell):
    made, margin = load_calibration(cell / "plain.yaml", ROBOT), ROBOT.limits.region_margin
    way = np.linspace(0.0, 0.8, 20001)[:, None] * [1.0, 0.0, 0.0] + [0.0, 0.0, -0.75]
    half = 1e3 * way[np.argmin(np.abs(made.region.outside(way) - 0.5 * margin))]
    (cell / "half.csv").write_text(f"x_mm,y_mm,z_mm\n{half[0]},{half[1]},{half[2]}\n")
    order = [str(cell / "half.csv") if "targets" in a else a for a in arguments(cell, "plain")]
    assert run([*order, "--outside", "nominal"]) == 1
    (row,) = rows_of(cell / "plain.csv")
    assert row["status"] == "outside_region"
    assert row["joint_1"] == row["nominal_joint_1"]
    (cell / "plain.csv").unlink()
    assert run([*order, "--outside", "refuse"]) == 1
    assert not (cell / "plain.csv").exists()


def test_joints_are_written_in_the_unit_asked_for(cell, capsys):
    rad = commands(cell, "plain")
    assert run(arguments(cell, "plain", "--unit", "deg")) == 0
    rows = rows_of(cell / "plain.csv")
    deg = np.array([[float(row[f"{name}_deg"]) for name in ROBOT.joints.names] for row in rows])
    np.testing.assert_allclose(np.radians(deg), rad, atol=1e-8)
    assert run(arguments(cell, "plain", "--unit", "mm")) == 2
    assert "--unit mm: the robot's joints turn; allowed: rad or deg" in capsys.readouterr().err


def test_the_swarms_answer_is_never_worse_than_newtons(cell):
    """Earlier, it stopped within 0.1 um of the target, and was the default method."""
    assert run(arguments(cell, "plain")) == 0
    newton = [float(row["error_mm"]) for row in rows_of(cell / "plain.csv")]
    assert run([a if a != "newton" else "apso" for a in arguments(cell, "plain")]) == 0
    swarm = [float(row["error_mm"]) for row in rows_of(cell / "plain.csv")]
    assert max(swarm) <= max(max(newton), 1e-8)


def test_u95_of_a_scara_holds_what_its_joints_cannot_correct(tmp_path: Path) -> None:
    """Its axes are not parallel: the tool rises and falls by hundredths of a millimetre.

    The true tool is compared with its targets in the frame that suits both best.
    """
    robot = load_robot("scara")
    machine = draw_machine(robot, 31)
    poses = collect(
        simulate_session(machine, make_plan("identify", robot, count=40), 31), robot.joints.names
    )
    found = identify(poses, robot)
    save_calibration(tmp_path / "scara.yaml", found, robot, poses)
    model = robot.commanded
    meant = model.points(model.forward(poses.command, model.parameters.nominal), robot.tool_offset)
    lines = "".join(f"{x},{y},{z}\n" for x, y, z in (1e3 * meant).tolist())
    (tmp_path / "targets.csv").write_text("x_mm,y_mm,z_mm\n" + lines)
    said = ["compensate", "--robot", "scara", "--calibration", str(tmp_path / "scara.yaml")]
    out = tmp_path / "commands.csv"
    assert run([*said, str(tmp_path / "targets.csv"), "--out", str(out)]) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    joint = np.array([[float(row[name]) for name in robot.joints.names] for row in rows])
    u95 = 1e-3 * np.array([float(row["u95_mm"]) for row in rows])
    own = machine.chain.mechanism
    true = own.points(machine.chain.pose(at_rest(joint), machine.theta), robot.tool_offset)
    turned, _ = Rotation.align_vectors(meant - meant.mean(0), true - true.mean(0))
    missed = turned.apply(true - true.mean(0)) - (meant - meant.mean(0))
    distance = np.linalg.norm(missed, axis=1)
    assert np.sqrt((missed[:, 2] ** 2).mean()) > 15e-6
    assert np.mean(distance < u95) > 0.9
    assert np.median(u95) < 3 * np.sqrt((distance**2).mean())


def test_u95_of_a_five_axis_machine_has_no_error_that_its_joints_cannot_correct() -> None:
    """Of its tool all three coordinates are commanded, x by its turn."""
    robot = load_robot("five_axis")
    poses = collect(
        simulate_session(draw_machine(robot, 31), make_plan("identify", robot, count=30), 31),
        robot.joints.names,
        robot.commanded.joint_size,
    )
    made = from_identification(identify(poses, robot), robot, poses)
    assert made.identified is not None
    compensator, at = JointCompensator(made, "newton"), at_rest(poses.command)
    found = compensator.compensate(poses.command, at)
    left = _uncommanded(compensator, made.identified.machine, found, at, print)
    np.testing.assert_allclose(left, 0.0, atol=1e-9)
