"""Tests of `delta-cal export`: files of every format, and refusals."""

from __future__ import annotations

import csv
import subprocess
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from ruamel.yaml import YAML

from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.compensation import JointCompensator
from delta_calibration.data import collect
from delta_calibration.estimation import identify
from delta_calibration.geometry import rotations
from delta_calibration.plans import joints_toward, make_plan, tool_frames
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from export_bench import COMPILER, STRICT, needs_compiler
from extended_bench import with_effects

EFFECTS = {"backlash": ({}, 4e-4), "joint_compliance": ({}, 4e-5)}
X, Y, Z = np.eye(3)
UR10 = (
    "x_mm,y_mm,z_mm,turn_x_deg,turn_y_deg,turn_z_deg,note\n-600,-250,500,0,0,0,first\n"
    "-550,-200,450,5,-3,2,\n"
)


def calibrated(name: str, folder: Path, effects=None) -> Path:
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=25, dwell=0.4, both_sides=False)
    poses = collect(simulate_session(draw_machine(robot, 5), plan, 5), robot.joints.names)
    found = identify(poses, robot, "rotary_delta" if name == "srbd" else None)
    path = folder / f"{name}.yaml"
    save_calibration(path, with_effects(found, robot, effects or {}), robot, poses)
    return path


@pytest.fixture(scope="module", name="files")
def files_fixture(tmp_path_factory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("calibrations")
    found = {name: calibrated(name, folder) for name in ("ur10", "scara", "cdpr8")}
    return {**found, "srbd": calibrated("srbd", folder, EFFECTS)}


def arguments(files, name: str, form: str, out: Path, *more: str) -> list[str]:
    return [
        "export",
        "--robot",
        name,
        "--calibration",
        str(files[name]),
        "--format",
        form,
        "--out",
        str(out),
        *more,
    ]


def error_of(capsys, arguments: list[str], code: int = 2) -> str:
    capsys.readouterr()
    assert run(arguments) == code
    return capsys.readouterr().err


@needs_compiler
def test_c_compiles_and_names_what_it_is(files, tmp_path, capsys):
    out = tmp_path / "machine.c"
    assert run(arguments(files, "srbd", "c", out)) == 0
    assert f"written: {out} and {tmp_path / 'machine.h'}" in capsys.readouterr().out
    calibration = load_calibration(files["srbd"], load_robot("srbd"))
    header = (tmp_path / "machine.h").read_text()
    assert calibration.seal in header
    assert "effects       backlash, joint_compliance" in header
    command = [COMPILER, *STRICT, "-c", "machine.c"]
    subprocess.run(command, cwd=tmp_path, check=True)
    assert {path.name for path in tmp_path.iterdir()} == {"machine.c", "machine.h", "machine.o"}


def test_urdf_is_of_the_identified_machine(files, tmp_path, capsys):
    assert run(arguments(files, "srbd", "urdf", tmp_path / "a.urdf")) == 0
    assert "not included: backlash, joint_compliance" in capsys.readouterr().err
    assert (
        run(
            [
                "urdf",
                "--robot",
                "srbd",
                "--calibration",
                str(files["srbd"]),
                "--out",
                str(tmp_path / "b.urdf"),
            ]
        )
        == 0
    )
    assert (tmp_path / "a.urdf").read_text() == (tmp_path / "b.urdf").read_text()
    assert ElementTree.parse(tmp_path / "a.urdf").getroot().tag == "robot"


def turned(axis: np.ndarray, angle: float) -> np.ndarray:
    made = np.eye(4)
    made[:3, :3] = rotations.exp(axis * angle)
    return made


def shifted(*place: float) -> np.ndarray:
    made = np.eye(4)
    made[:3, 3] = place
    return made


def to_axis(row) -> np.ndarray:
    return turned(X, row["alpha_rad"]) @ turned(Y, row["beta_rad"]) @ shifted(row["a_m"], 0, 0)


def about_axis(row, q: float) -> np.ndarray:
    return turned(Z, q + row["theta_rad"]) @ shifted(0, 0, row["d_m"])


@pytest.mark.parametrize("name", ["ur10", "scara"])
def test_both_tables_are_the_identified_arm(name, files, tmp_path):
    out = tmp_path / "arm.yaml"
    assert run(arguments(files, name, "dh", out)) == 0
    tables = YAML(typ="safe").load(out.read_text())
    calibration = load_calibration(files[name], load_robot(name))
    arm, q = calibration.chain.mechanism, calibration.chain.mechanism.home + 0.1
    tool = shifted(*tables["tool"]["place_m"])
    for axis, angle in zip((Z, Y, X), tables["tool"]["mount_zyx_rad"], strict=True):
        tool = tool @ turned(axis, angle)
    for axis, angle in zip((X, Y, Z), tables["tool"]["turn_xyz_rad"], strict=True):
        tool = tool @ turned(axis, angle)
    modified, standard = np.eye(4), to_axis(tables["standard"]["first"])
    for row, angle in zip(tables["modified"], q, strict=True):
        modified = modified @ to_axis(row) @ about_axis(row, angle)
    for row, angle in zip(tables["standard"]["links"], q, strict=True):
        standard = standard @ about_axis(row, angle) @ to_axis(row)
    x = arm.forward(q[None], calibration.geometry)
    for product in (modified @ tool, standard @ tool):
        np.testing.assert_allclose(product[:3, 3], x[0, :3], atol=1e-12)
        np.testing.assert_allclose(product[:3, :3], rotations.exp(x[0, 3:]), atol=1e-12)
    assert tables["drawing"]["modified"] != tables["modified"]
    assert tables["calibration"]["sha256"] == calibration.seal


def test_points_keep_their_form_and_lead_to_the_corrected_commands(files, tmp_path):
    robot, targets, out = load_robot("ur10"), tmp_path / "targets.csv", tmp_path / "out.csv"
    targets.write_text(UR10)
    assert run(arguments(files, "ur10", "csv", out, "--points", str(targets))) == 0
    with out.open() as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == UR10.splitlines()[0].split(",")
    assert [row["note"] for row in rows] == ["first", ""]
    numbers = np.array([[float(value) for value in list(row.values())[:6]] for row in rows])
    joint = joints_toward(robot, 1e-3 * numbers[:, :3], np.radians(numbers[:, 3:]))
    meant = np.array([[-600, -250, 500, 0, 0, 0], [-550, -200, 450, 5, -3, 2]], dtype=float)
    nominal = joints_toward(robot, 1e-3 * meant[:, :3], np.radians(meant[:, 3:]))
    calibration = load_calibration(files["ur10"], robot)
    expected = JointCompensator(calibration).compensate(nominal).joint
    np.testing.assert_allclose(joint, expected, atol=1e-8)
    assert np.abs(numbers - meant).max() > 0.1


def test_turns_that_were_not_given_come_with_the_correction(files, tmp_path):
    targets, out = tmp_path / "targets.csv", tmp_path / "out.csv"
    targets.write_text("x_mm,y_mm,z_mm\n-600,-250,500\n")
    assert run(arguments(files, "ur10", "csv", out, "--points", str(targets))) == 0
    head = "x_mm,y_mm,z_mm,turn_x_deg,turn_y_deg,turn_z_deg"
    assert out.read_text().splitlines()[0] == head


def test_effects_take_part_in_points(files, tmp_path, capsys):
    robot, targets, out = load_robot("srbd"), tmp_path / "targets.csv", tmp_path / "out.csv"
    targets.write_text("x_mm,y_mm,z_mm\n0,0,-711\n50,0,-711\n0,0,-711\n")
    asked = arguments(files, "srbd", "csv", out, "--points", str(targets))
    assert "--payload KG" in error_of(capsys, asked)
    assert not out.exists()
    assert run([*asked, "--payload", "1"]) == 0
    with out.open() as file:
        points = np.array([[float(v) for v in row.values()] for row in csv.DictReader(file)])
    assert np.abs(points[0] - points[2]).max() > 0.01  # backlash: from another side
    np.testing.assert_allclose(
        tool_frames(robot, joints_toward(robot, 1e-3 * points))[0], 1e-3 * points, atol=1e-11
    )


@pytest.mark.parametrize(
    ("name", "form", "out", "more", "said"),
    [
        ("srbd", "c", "machine.cpp", [], "the name of a C source is expected"),
        ("srbd", "c", 'a"b.c', [], "the name of a C source is expected"),
        ("srbd", "c", "machine.c", ["--prefix", "2nd"], "--prefix '2nd' is not allowed"),
        ("srbd", "urdf", "a.urdf", ["--prefix", "a_"], "--prefix is for --format c, not urdf"),
        ("srbd", "c", "machine.c", ["--payload", "1"], "--payload is for --format csv, not c"),
        ("srbd", "csv", "a.csv", [], "--format csv needs --points"),
        ("srbd", "dh", "a.yaml", [], "is a rotary_delta; DH tables"),
        ("cdpr8", "csv", "a.csv", ["--points", "no.csv"], "8 joints command 6 coordinates"),
        ("srbd", "csv", "a.csv", ["--points", "no.csv"], "no.csv: cannot be read"),
    ],
)
def test_what_does_not_fit_is_refused(name, form, out, more, said, files, tmp_path, capsys):
    assert said in error_of(capsys, arguments(files, name, form, tmp_path / out, *more))
    assert list(tmp_path.iterdir()) == []
