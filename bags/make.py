"""Make the sessions of this folder again, and the table in README.md: `python bags/make.py`.

Each is a run of `delta-cal simulate`; the seed decides all of it. `python bags/make.py FOLDER`
makes them elsewhere.
"""

from __future__ import annotations

import csv
import hashlib
import shutil
import sys
from pathlib import Path

import numpy as np

from delta_calibration import __version__
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.recording import read_session
from delta_calibration.robot import load_robot

HERE = Path(__file__).parent
# name: arguments of `delta-cal simulate`, and what the session is for
BAGS = {
    "srbd_plain": (
        "--robot srbd --plan identify --count 24 --seed 1",
        "a machine with manufacturing errors and nothing else: for `fit`",
    ),
    "srbd_backlash": (
        "--robot srbd --plan rich --count 12 --seed 4"
        " --effect backlash:location=joint_2,value=0.0006",
        "play of 0.6 mrad hidden in joint 2: for `diagnose`",
    ),
    "srbd_warm": (
        "--robot srbd --plan rich --count 12 --seed 5"
        " --effect thermal_growth_arm:sensor=arm,value=0.000023",
        "arms of aluminium that grow while the cell warms up",
    ),
    "linear_delta_plain": (
        "--robot linear_delta --plan identify --count 20 --seed 7",
        "another mechanism, joints that slide",
    ),
}
SPREADSHEET = "srbd_plain.csv"  # the stops of srbd_plain as people keep them
TABLE = "<!-- table: bags/make.py -->"


def make(name: str, folder: Path) -> Path:
    """Simulate the session of that name into a folder; what was there of it goes."""
    path = folder / name
    shutil.rmtree(path, ignore_errors=True)
    if run(["simulate", *BAGS[name][0].split(), "--out", str(path)]) != 0:
        raise SystemExit(f"bags/make.py: {name} could not be made")
    return path


def spreadsheet(folder: Path) -> Path:
    """Write the stops of srbd_plain as a table: degrees, millimetres, minutes."""
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


def sha256(path: Path) -> str:
    """Of the recording itself, without its `metadata.yaml`."""
    return hashlib.sha256((path / f"{path.name}_0.mcap").read_bytes()).hexdigest()


def table(folder: Path) -> str:
    """What is in the folder, as rows of Markdown."""
    rows = ["| session | what it is | `delta-cal simulate ...` | kB | sha256 of the `.mcap` |"]
    rows.append("|---|---|---|---|---|")
    for name, (arguments, what) in BAGS.items():
        path = folder / name
        size = sum(file.stat().st_size for file in path.iterdir()) / 1000
        rows.append(f"| `{name}` | {what} | `{arguments}` | {size:.0f} | `{sha256(path)}` |")
    told = f"`{SPREADSHEET}`: the stops of `srbd_plain` as a spreadsheet has them, deg and mm."
    return "\n".join([*rows, "", told, "", f"Made by version {__version__}."])


def main(arguments: list[str]) -> None:
    """Make them all, here or in another folder."""
    folder = Path(arguments[0]) if arguments else HERE
    folder.mkdir(parents=True, exist_ok=True)
    for name in BAGS:
        make(name, folder)
    spreadsheet(folder)
    page = HERE / "README.md"
    head = page.read_text(encoding="utf-8").partition(TABLE)[0]
    if folder == HERE:
        page.write_text(f"{head}{TABLE}\n\n{table(folder)}\n", encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
