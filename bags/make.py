"""Make the sessions of this folder again, and the table in README.md: `python bags/make.py`.

Each is a run of `delta-cal simulate`, determined by its seed. `python bags/make.py FOLDER` makes
the sessions in another folder.
"""

from __future__ import annotations

import csv
import hashlib
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np

from delta_calibration import __version__
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.plans import make_plan, tool_points
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

HERE = Path(__file__).parent
# name: arguments of `delta-cal simulate`, and description
BAGS = {
    "srbd_plain": (
        "--robot srbd --plan identify --count 24 --seed 1",
        "manufacturing errors only; an example for `fit`",
    ),
    "srbd_backlash": (
        "--robot srbd --plan rich --count 12 --seed 4"
        " --effect backlash:location=joint_2,value=0.0006",
        "backlash of 0.6 mrad hidden in joint 2; an example for `diagnose`",
    ),
    "srbd_warm": (
        "--robot srbd --plan rich --count 12 --seed 5"
        " --effect thermal_growth_arm:sensor=arm,value=0.000023",
        "aluminium arms that expand while the cell warms up",
    ),
    "linear_delta_plain": (
        "--robot linear_delta --plan identify --count 20 --seed 7",
        "another mechanism, with sliding joints",
    ),
}
SPREADSHEET = "srbd_plain.csv"  # the stops of srbd_plain as a table
BALLBAR = "scara_ballbar.csv"  # circles of a SCARA with backlash, by a telescoping ballbar
PLAY = {"backlash": {"location": "joint_2", "value": "0.0006"}}
BALLBAR_NOISE = 1e-6  # [m] of a length, as `delta-cal circle` assumes
PIVOT_OFF = np.array([2e-4, -1e-4, 5e-5])  # [m] offset of the ball from its nominal place
TABLE = "<!-- table: bags/make.py -->"


def make(name: str, folder: Path) -> Path:
    """Simulate the session of that name into a folder; an earlier one there is deleted."""
    path = folder / name
    shutil.rmtree(path, ignore_errors=True)
    if run(["simulate", *BAGS[name][0].split(), "--out", str(path)]) != 0:
        raise SystemExit(f"bags/make.py: {name} could not be made")
    return path


def spreadsheet(folder: Path) -> Path:
    """Write the stops of srbd_plain as a table in degrees, millimetres and minutes."""
    robot = load_robot("srbd")
    poses = collect(read_session(folder / "srbd_plain"), robot.joints.names)
    path = folder / SPREADSHEET
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["minute", "A1", "A2", "A3", "X", "Y", "Z"])
        for time, command, point in zip(poses.time, poses.command, poses.point, strict=True):
            values = [f"{v:.6f}" for v in (time / 60, *np.degrees(command))]
            rows.writerow([*values, *(f"{v:.4f}" for v in 1e3 * point)])
    return path


def ballbar(folder: Path) -> Path:
    """Write the distances of a SCARA's tool from a ball on the table along circles."""
    robot, seed = load_robot("scara"), 5
    bar = replace(
        robot.tracker,
        radial=BALLBAR_NOISE,
        transverse=BALLBAR_NOISE,
        transverse_per_metre=0.0,
    )
    machine = draw_machine(replace(robot, tracker=bar), seed, 1.0, PLAY)
    plan = make_plan("circles", robot)
    session = simulate_session(machine, plan, seed)
    way = tool_points(robot, plan.paths[0].joint)
    pivot = (way.min(axis=0) + way.max(axis=0)) / 2 + PIVOT_OFF
    frame = machine.chain.split(machine.theta)[2]
    assert session.tracker is not None
    assert session.command is not None
    bar_length = np.linalg.norm(frame.inverse().apply(session.tracker.position) - pivot, axis=1)
    time = (session.command.stamp_ns - session.command.stamp_ns[0]) * 1e-9
    tool = 1e3 * tool_points(robot, session.command.position)
    path = folder / BALLBAR
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(["time_s", "radius_mm", "x_mm", "y_mm", "z_mm"])
        for row in list(zip(time, 1e3 * bar_length, tool, strict=True))[::2]:  # ten a second
            rows.writerow([f"{row[0]:.2f}", f"{row[1]:.4f}", *(f"{v:.4f}" for v in row[2])])
    return path


def sha256(path: Path) -> str:
    """Hash of the recording, without its `metadata.yaml`."""
    return hashlib.sha256((path / f"{path.name}_0.mcap").read_bytes()).hexdigest()


def table(folder: Path) -> str:
    """Table of the sessions in the folder, in Markdown."""
    rows = ["| session | what it is | `delta-cal simulate ...` | kB | sha256 of the `.mcap` |"]
    rows.append("|---|---|---|---|---|")
    for name, (arguments, what) in BAGS.items():
        path = folder / name
        size = sum(file.stat().st_size for file in path.iterdir()) / 1000
        rows.append(f"| `{name}` | {what} | `{arguments}` | {size:.0f} | `{sha256(path)}` |")
    told = (
        f"`{SPREADSHEET}`: the stops of `srbd_plain` as a table in deg and mm.\n"
        f"`{BALLBAR}`: circles of a SCARA with backlash of 0.6 mrad in joint 2, measured by a "
        "telescoping ballbar."
    )
    return "\n".join(
        [
            *rows,
            "",
            told,
            "",
            f"This table was made by version {__version__}; the `metadata.yaml` of a session "
            "states the version that made the session.",
        ]
    )


def main(arguments: list[str]) -> None:
    """Make all sessions, here or in another folder."""
    folder = Path(arguments[0]) if arguments else HERE
    folder.mkdir(parents=True, exist_ok=True)
    for name in BAGS:
        make(name, folder)
    spreadsheet(folder)
    ballbar(folder)
    page = HERE / "README.md"
    head = page.read_text(encoding="utf-8").partition(TABLE)[0]
    if folder == HERE:
        page.write_text(f"{head}{TABLE}\n\n{table(folder)}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
