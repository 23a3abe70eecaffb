"""`delta-cal import` makes sessions that the other commands read like recorded ones."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest
from ruamel.yaml import YAML
from scipy.spatial.transform import Rotation

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import collect, survey
from delta_calibration.estimation import identify
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot
from import_bench import JOINTS, SRBD, imported, mapping_of, measured, refused, stops
from real_machines import DATA

UR10 = load_robot("ur10")
MODEL = "rotary_delta"  # the fastest model
ARM = DATA / "ur10_lasertracker"


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder, a session and its poses at rest."""
    return tmp_path_factory.mktemp("cell"), *measured()


def test_a_stream_comes_back_as_it_was(cell):
    """From session to CSV and back: the streams are the same, and therefore the calibration."""
    folder, session, _ = cell
    write_session(folder / "session", session)
    time = (session.tracker.stamp_ns - session.tracker.stamp_ns[0]) / 1e9
    motors = [f"e_{name}" for name in JOINTS]
    rows = np.column_stack(
        [time, session.command.position, session.states.position, session.tracker.position]
    )
    mapping = mapping_of(
        rows="stream",
        time={"column": "t", "unit": "s"},
        commands=[
            {"joint": j, "column": c, "unit": "rad"}
            for j, c in zip(SRBD.joints.names, JOINTS, strict=True)
        ],
        encoders=[
            {"joint": j, "column": c, "unit": "rad"}
            for j, c in zip(SRBD.joints.names, motors, strict=True)
        ],
        position={"columns": ["x", "y", "z"], "unit": "m"},
    )
    text = [[repr(v) for v in row] for row in rows.tolist()]
    out = imported(folder, ["t", *JOINTS, *motors, "x", "y", "z"], text, mapping)
    back = read_session(out)
    for name in ("command", "states"):
        one, other = getattr(session, name), getattr(back, name)
        np.testing.assert_array_equal(other.position, one.position)
    np.testing.assert_array_equal(back.tracker.position, session.tracker.position)
    gone = np.diff(session.tracker.stamp_ns) - np.diff(back.tracker.stamp_ns)
    assert np.abs(gone).max() <= 1
    both = read_session(folder / "session"), back
    fits = [identify(collect(s, SRBD.joints.names), SRBD, MODEL) for s in both]
    assert np.abs((fits[0].theta - fits[1].theta) / fits[0].std).max() < 1e-4


def test_stops_give_the_same_calibration_by_the_verbs(cell):
    """One averaged row per pose, in other units; `info`, `fit` and `diagnose` run on it."""
    folder, _, poses = cell
    head, rows = stops(poses)
    out = imported(folder, head, rows, mapping_of())
    assert run(["info", str(out)]) == 0
    made = folder / "stops.yaml"
    chosen = [str(out), "--robot", "srbd", "--model", MODEL]
    assert run(["fit", *chosen, "--out", str(made)]) == 0
    assert run(["diagnose", *chosen, "--json", str(folder / "v.json")]) == 0
    whole = identify(poses, SRBD, MODEL)
    found = load_calibration(made, SRBD)
    at = collect(read_session(out), SRBD.joints.names).conditions
    predicted = [whole.chain.predict(at, theta) for theta in (whole.theta, found.theta)]
    apart = np.linalg.norm(predicted[0] - predicted[1], axis=1)
    assert apart.max() < 2 * whole.noise.floor  # averaged readings have other weights


def test_every_column_a_table_may_have(cell, capsys):
    folder, _, poses = cell
    poses = poses.take(np.arange(12))
    joint = np.degrees(poses.joint)
    step = 0.0125  # [deg]
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3])
    spun = turn.as_euler("XYZ", degrees=True)
    head = [
        "when",
        "q3",
        "q1",
        "q2",
        "x",
        "y",
        "z",
        "rx",
        "ry",
        "rz",
        "load",
        "hot",
        "side",
        "state",
        "pose",
    ]
    rows = []
    for k in range(12):
        steps = [-(joint[k, 0] - 3.0) / step, *joint[k, 1:]]
        place = 1e3 * poses.point[k]
        rows.append(
            [
                f"2024-05-0{1 + k // 6} 10:{k:02d}:30",
                steps[2],
                steps[0],
                steps[1],
                *place,
                *spun,
                500 if k < 6 else 750,
                68 + k,
                1 if k % 2 else -1,
                "stop" if k != 4 else "go",
                k,
            ]
        )
    rows[4][4:10] = ["", "", "", "", "", ""]
    names = SRBD.joints.names
    mapping = mapping_of(
        delimiter=";",
        time={"column": "when", "unit": "format", "format": "%Y-%m-%d %H:%M:%S"},
        commands=[
            {"joint": names[1], "column": "q2", "unit": "deg"},
            {"joint": names[2], "column": "q3", "unit": "deg"},
            {
                "joint": names[0],
                "column": "q1",
                "unit": "microsteps",
                "step_deg": step,
                "scale": -1.0,
                "offset": 3.0 / step,
            },
        ],
        rotation={"columns": ["rx", "ry", "rz"], "form": "rpy", "unit": "deg", "axes": "XYZ"},
        payload={"column": "load", "unit": "g"},
        temperature=[{"part": "arm", "column": "hot", "unit": "degF"}],
        direction=["side"],
        moving={"column": "state", "at_rest": ["stop"]},
        same_command="pose",
    )
    out = imported(folder, head, rows, mapping)
    assert "1 rows in motion" in capsys.readouterr().out
    back = read_session(out)
    found = survey(back, names).poses
    rest = np.delete(np.arange(12), 4)
    np.testing.assert_allclose(found.joint, poses.joint[rest], atol=1e-12)
    np.testing.assert_allclose(found.point, poses.point[rest], atol=1e-12)
    same = Rotation.from_quat(found.quaternion) * turn.inv()
    assert same.magnitude().max() < 1e-12
    np.testing.assert_allclose(found.payload, np.where(rest < 6, 0.5, 0.75))
    np.testing.assert_allclose(found.temperature[:, 0], 20 + 5 / 9 * rest, atol=1e-6)
    np.testing.assert_array_equal(
        found.direction, np.where(rest % 2, 1.0, -1.0)[:, None] * np.ones(3)
    )
    assert found.time[6] - found.time[0] > 86400


@pytest.mark.parametrize("form", ["quaternion_xyzw", "quaternion_wxyz", "rotation_vector"])
def test_rotations_in_any_form(cell, form):
    folder, _, poses = cell
    poses = poses.take(np.arange(8))
    turn = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(8, 3)))
    x, y, z, w = turn.as_quat().T
    values = {
        "quaternion_xyzw": np.stack([x, y, z, w], axis=1),
        "quaternion_wxyz": -np.stack([w, x, y, z], axis=1),
        "rotation_vector": np.degrees(turn.as_rotvec()),
    }[form]
    head, rows = stops(poses)
    columns = [f"r{k}" for k in range(values.shape[1])]
    rotation = {"columns": columns, "form": form}
    if form == "rotation_vector":
        rotation["unit"] = "deg"
    rows = [row + list(map(repr, more)) for row, more in zip(rows, values.tolist(), strict=True)]
    out = imported(folder, [*head, *columns], rows, mapping_of(rotation=rotation))
    found = Rotation.from_quat(read_session(out).tracker.quaternion)
    assert (found * turn.inv()).magnitude().max() < 1e-12


def test_the_example_in_the_manual_works(tmp_path):
    text = (Path(__file__).parents[1] / "docs" / "import.md").read_text()
    table, mapping = re.findall(r"```(?:csv|yaml)\n(.*?)```", text, re.DOTALL)
    head, *rows = csv.reader(table.splitlines())
    out = imported(tmp_path, head, rows, YAML(typ="safe").load(mapping))
    poses = collect(read_session(out), SRBD.joints.names)
    assert len(poses) == len(rows)
    np.testing.assert_allclose(poses.payload, 0.5)


# --- a real table


@pytest.mark.real
@pytest.mark.skipif(
    not ARM.is_dir(), reason="the measurements of real machines are not beside the repository"
)
def test_a_published_table_of_a_real_arm(tmp_path, capsys):
    """133 of its poses. Frame and tool alone leave 0.84 mm, the geometry less than 0.6 mm."""
    with (ARM / "series_a_grid.csv").open() as file:
        head, *rows = list(csv.reader(file))
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    mapping = {
        "schema": 1,
        "rows": "stops",
        "time": {"column": "timestamp", "unit": "format", "format": "%Y%m%d%H%M%S"},
        "commands": [
            {"joint": joint, "column": f"{name}_joint", "unit": "rad"}
            for joint, name in zip(UR10.joints.names, names, strict=True)
        ],
        "position": {"columns": [f"measurement_{a}" for a in "xyz"], "unit": "mm"},
        "rotation": {
            "columns": [f"measurement_r{a}" for a in "xyz"],
            "form": "rpy",
            "unit": "deg",
            "axes": "XYZ",
        },
        "temperature": [{"part": "room", "column": "measurement_temperature", "unit": "degC"}],
    }
    some = rows[1::90]
    out = imported(tmp_path, head, some, mapping, "ur10")
    poses = collect(read_session(out), UR10.joints.names)
    assert len(poses) == len(some)
    assert poses.duration > 13 * 3600
    assert poses.temperature_parts == ("room",)
    found = identify(poses, UR10)
    assert 0.3e-3 < found.full.held_out < 0.6e-3 < found.frame_only.held_out
    wrong = {**mapping, "position": {**mapping["position"], "unit": "m"}}
    assert "likely mm, as in all rows" in refused(capsys, tmp_path, head, some, wrong, "ur10")
