"""Sessions, fits and verdicts in notebooks, and the notebooks of the documentation."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.errors import InputError, MistakeError
from delta_calibration.estimation import identify
from delta_calibration.notebook import Identified, Session, open_session

pytest.importorskip("pandas")
ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.py"))


@pytest.fixture(scope="module")
def session() -> Session:
    return open_session(ROOT / "bags" / "srbd_plain", robot="srbd")


@pytest.fixture(scope="module")
def found(session: Session) -> Identified:
    return session.fit()


def test_poses_are_rows(session: Session) -> None:
    poses = collect(session.recorded, session.robot.joints.names)
    table = session.to_frame()
    assert len(table) == len(poses)
    np.testing.assert_array_equal(table["joint_2_rad"], poses.joint[:, 1])
    np.testing.assert_allclose(table[["x_mm", "y_mm", "z_mm"]], 1e3 * poses.point, rtol=1e-15)


def test_a_fit_is_that_of_the_library(session: Session, found: Identified) -> None:
    poses = collect(session.recorded, session.robot.joints.names)
    same = identify(poses, session.robot)
    table = found.to_frame()
    item = same.parameters.items[0]
    assert table.index[0] == item.name
    assert table["identified"].iloc[0] == pytest.approx(1e3 * same.theta[0], rel=1e-12)
    off = table["identified"] - table["drawn"] - table["deviation"]
    assert np.abs(off).max() < 1e-9
    left = found.residuals()
    assert (left["calibrated_mm"] < left["before_mm"]).mean() > 0.95
    gap = left[[f"calibrated_d{axis}_mm" for axis in "xyz"]].to_numpy()
    np.testing.assert_allclose(np.linalg.norm(gap, axis=1), left["calibrated_mm"])


def test_commands_put_the_identified_machine_on_the_targets(found: Identified) -> None:
    targets = np.array([[0.0, 0.0, -750.0], [150.0, -50.0, -700.0], [3000.0, 0.0, 0.0]])
    table = found.compensate(targets)
    assert list(table["status"]) == ["corrected", "corrected", "out_of_reach"]
    names = found.session.robot.joints.names
    q = table[[f"{name}_rad" for name in names]].to_numpy()[:2]
    chain = found.found.chain
    x = chain.mechanism.forward(q, found.found.theta[chain.layout.geometry])
    np.testing.assert_allclose(1e3 * chain.mechanism.position(x), targets[:2], atol=1e-6)
    assert np.isnan(table[f"{names[0]}_rad"].iloc[2])
    again = found.compensate(table)
    assert list(again["status"]) == list(table["status"])


@pytest.mark.parametrize(
    ("targets", "more", "message"),
    [
        ([[1.0, 2.0]], {}, "2 numbers a target; expected: x_mm, y_mm, z_mm"),
        ([[0.0, 0.0, -700.0, 1.0]], {}, "4 numbers a target"),
        ([], {}, "n at least 1"),
        ("abc", {}, "not a table of numbers"),
        ([[0.0, 0.0, -700.0]], {"payload": -5.0}, "payload: -5 kg is not allowed"),
        ([[0.0, 0.0, -700.0]], {"payload": np.nan}, "payload: nan kg is not allowed"),
        (
            [[0.0, 0.0, -700.0]],
            {"temperature": {"arm": np.nan}},
            "temperature of arm: nan deg C is not",
        ),
    ],
)
def test_what_no_command_can_be_made_of_is_refused(
    found: Identified, targets: object, more: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        found.compensate(targets, **more)


def test_a_session_with_a_mistake_is_warned_of_and_not_saved(
    session: Session, tmp_path: Path
) -> None:
    """Commands are in degrees. The fit uses the encoders, but the calibration is not written."""
    command = session.recorded.command
    degrees = replace(command, position=np.degrees(command.position))
    wrong = Session(session.robot, replace(session.recorded, command=degrees))
    with pytest.warns(UserWarning, match="unit degrees in joint command"):
        found = wrong.fit()
    out = tmp_path / "c.yaml"
    with pytest.raises(MistakeError, match=r"no calibration .* with a mistake \(unit degrees\)"):
        found.save(out)
    assert not out.exists()
    found.save(out, force=True)
    load_calibration(out, session.robot)


def test_commands_are_those_of_the_verb(tmp_path: Path) -> None:
    """With backlash in the model, a command depends on the side from which the joints come."""
    pandas = pytest.importorskip("pandas")
    verdict = open_session(ROOT / "bags" / "srbd_backlash", robot="srbd").diagnose()
    verdict.save(tmp_path / "c.yaml")
    targets = pandas.DataFrame({"name": list("abc"), "x_mm": [0, 200, 0], "y_mm": [0, 0, 150]})
    _require_the_verbs(verdict, targets.assign(z_mm=-750.0), "srbd", tmp_path)


def test_turns_of_a_platform_count(tmp_path: Path) -> None:
    """Targets of robots that tilt their platform include turns.

    A plain array of positions has the columns that the robot commands.
    """
    pandas = pytest.importorskip("pandas")
    made = ["simulate", "--robot", "five_axis", "--plan", "identify", "--count", "14"]
    assert run([*made, "--seed", "2", "--out", str(tmp_path / "session")]) == 0
    found = open_session(tmp_path / "session", robot="five_axis").fit()
    found.save(tmp_path / "c.yaml")
    targets = pandas.DataFrame({"y_mm": [0.0, 5.0], "z_mm": [1200.0, 1190.0]})
    plain = found.compensate(targets)
    np.testing.assert_array_equal(plain, found.compensate(targets.to_numpy())[plain.columns])
    turned = targets.assign(turn_x_deg=[0.0, 3.0], turn_y_deg=[2.0, 0.0])
    _require_the_verbs(found, turned, "five_axis", tmp_path)
    with pytest.raises(InputError, match="column y_mm, z_mm missing"):
        found.compensate(pandas.DataFrame({"x": [1.0]}))
    with pytest.raises(InputError, match="line 1: y_mm: 'nan' is not a finite number"):
        found.compensate([[np.nan, 1200.0]])


def _require_the_verbs(found, targets, robot: str, folder: Path) -> None:
    """Require the commands, status and radius that `delta-cal compensate` writes."""
    pandas = pytest.importorskip("pandas")
    targets.to_csv(folder / "targets.csv", index=False)
    verb = ["compensate", str(folder / "targets.csv"), "--robot", robot]
    files = ["--calibration", str(folder / "c.yaml"), "--out", str(folder / "out.csv")]
    assert run([*verb, *files]) == 0
    said, table = pandas.read_csv(folder / "out.csv"), found.compensate(targets)
    joints, (unit, factor) = (
        found.session.robot.joints,
        {"rad": ("", 1), "m": ("_mm", 1e3)}[found.session.robot.joints.unit],
    )
    for name in joints.names:
        np.testing.assert_allclose(
            factor * table[f"{name}_{joints.unit}"], said[f"{name}{unit}"], atol=1e-8
        )
    np.testing.assert_allclose(table["u95_mm"], said["u95_mm"], atol=6e-5)
    assert list(table["status"]) == list(said["status"])
    assert set(targets.columns) <= set(table.columns)


def test_they_show_themselves_and_escape_what_files_say(found: Identified) -> None:
    shown = found._repr_html_()
    left = f"{1e3 * found.found.full.held_out:.4f} mm"
    assert f">error left, calibrated</th><td style='text-align:left'>{left}<" in shown
    assert "held-out" not in shown  # a term of the diagnosis
    notes = found.session.recorded.notes
    page = Session(found.session.robot, found.session.recorded)._repr_html_()
    assert "srbd (six_rod_delta)" in page
    assert notes == ()


def test_what_is_saved_is_a_calibration(found: Identified, tmp_path: Path) -> None:
    found.save(tmp_path / "c.yaml")
    read = load_calibration(tmp_path / "c.yaml", found.session.robot)
    np.testing.assert_array_equal(read.theta, found.calibration.theta)


def test_a_plot_has_every_pose(found: Identified) -> None:
    import matplotlib

    matplotlib.use("agg")
    axes = found.plot_residuals()
    points = [line for line in axes.get_lines() if len(line.get_xdata()) > 2]
    assert [len(line.get_xdata()) for line in points] == [len(found.residuals())] * 2
    assert axes.get_ylabel() == "3-D error of a pose [mm]"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It runs in its own kernel; its assertions hold, and it shows tables and plots."""
    jupytext = pytest.importorskip("jupytext")
    client = pytest.importorskip("nbclient")
    pytest.importorskip("ipykernel")
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    monkeypatch.setenv(
        "PYTHONPATH", os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    )
    monkeypatch.setenv("MPLBACKEND", "module://matplotlib_inline.backend_inline")
    book = jupytext.read(path)
    client.NotebookClient(
        book, timeout=120, kernel_name="python3", resources={"metadata": {"path": str(tmp_path)}}
    ).execute()
    shown = {
        kind
        for cell in book.cells
        for out in cell.get("outputs", ())
        for kind in out.get("data", ())
    }
    assert {"text/html", "image/png"} <= shown
    assert list(tmp_path.glob("*.yaml"))
