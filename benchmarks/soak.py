"""The calibration node under faults at 1 kHz, 10 minutes: `make soak`; `--seconds 60` for less.

The test cell applies its faults to the node again and again: missing tracker, bursts of NaN, clock
stepping back and forth, late messages, marked and unmarked echoes, commands beyond the region and
the joint limits, exchanged calibrations, one of them useless, a silent sensor, a storm of
parameters, compensation and lifecycle switched in motion. In the first half the node is also
stopped, and killed. At all times, whatever the load of the machine:

- every output is finite, has the stamp of a command, and moves no faster than the commands plus
what corrections and returns from a hold may add; - outside holds and returns from them or from a
stop of the stream, output and command differ by the largest correction at most; - each guard's
counter has risen; the node's log has no traceback; its memory does not grow.

On a machine that is too busy for 1 kHz commands are left out while the node is behind; their
number is printed and is no failure. The exit code is 1 if one of the conditions fails.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections import Counter
from dataclasses import replace
from pathlib import Path

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cell import command_path as path
from delta_calibration.compensation import CommandStatus
from delta_calibration.robot import load_robot
from node_processes import Processes, identified, processes, with_effects
from soak_cell import Cell
from soak_faults import Faults
from soak_outputs import Outputs

RATE = 0.05  # [rad/s] fastest change of a correction
SLOPE = 1.0  # [MB/min] largest permitted growth of memory
# Backlash and an arm that grows: a correction with steps, and one that needs a sensor.
EFFECTS = {"backlash": ({}, 4e-4), "thermal_growth_arm": ({"sensor": "arm"}, 23e-6)}
FIRST = 10.0  # [MB] permitted in the first round, for what is used for the first time
BROKEN = "broken.yaml"
GUARDS = (
    CommandStatus.CORRECTED.value,
    path.BEYOND,
    CommandStatus.OUTSIDE_REGION.value,
    CommandStatus.SINGULAR.value,
    CommandStatus.NOT_REACHED.value,
    CommandStatus.MISSING_CONDITION.value,
    path.PASSED,
    path.ALREADY,
    path.ECHO,
    path.BLENDED,
    path.LIMITED,
    path.STALE,
    path.REFUSED,
    path.HELD,
    path.DROPPED,
    path.BACKWARD,
)


def files(folder: Path) -> tuple[Path, dict[str, Path]]:
    """A robot file that counts the far end of the region as singular, and its calibrations."""
    robot = load_robot("srbd")
    found, poses = identified(robot)
    model = robot.commanded
    x = model.forward(poses.joint, model.parameters.nominal)
    condition = model.condition(poses.joint, x, model.parameters.nominal)
    text = Path(robot.source).read_text(encoding="utf-8")
    file = folder / "robot.yaml"
    file.write_text(text.replace("condition: 20.0", f"condition: {0.9 * condition.max():.4f}"))
    robot = load_robot(file)
    calibrations = {name: folder / f"{name}.yaml" for name in ("plain", "extended", "useless")}
    save_calibration(calibrations["plain"], found, robot, poses)
    save_calibration(calibrations["extended"], with_effects(found, robot, EFFECTS), robot, poses)
    wrong = found.theta.copy()
    wrong[found.parameters.row("joint_zero_1")] += 0.03  # more than may be corrected
    save_calibration(calibrations["useless"], replace(found, theta=wrong), robot, poses)
    calibrations["broken"] = folder / BROKEN
    calibrations["broken"].write_bytes(calibrations["plain"].read_bytes()[:2000])
    np.save(folder / "singular.npy", poses.joint[int(np.argmax(condition))])
    return file, calibrations


def growth(memory: list[tuple[float, float]]) -> tuple[float, float]:
    """Slope [MB/min] by least squares over (time [s], size [MB]) of the second half; minutes."""
    time, size = np.array(memory).T
    late = time >= (time[0] + time[-1]) / 2
    minutes = (time[late] - time[late][0]) / 60
    return float(np.polyfit(minutes, size[late], 1)[0]), float(minutes[-1])


def verdict(cell: Cell, outputs: Outputs, log: str) -> list[str]:
    """Failures in words; the statistics are printed."""
    failed = list(outputs.broken)
    counts: Counter[str] = cell.counts
    print(
        f"commands {cell.commanded} (left out, as the node was behind: {cell.left_out}), "
        f"outputs {outputs.count}, rounds of faults {cell.rounds}"
    )
    if outputs.count < cell.commanded / 5:
        failed.append("hardly any outputs")
    for name in GUARDS:
        print(f"  {counts[name]:8d}  {name}")
        if not counts[name]:
            failed.append(f"never counted: {name}")
    for said, seen in cell.told.items():
        print(f"  {'told' if seen else 'not told':>8}  {said}")
        if not seen:
            failed.append(f"never told: {said}")
    print(
        f"fastest output {outputs.fastest:.3f} of what is allowed, largest correction "
        f"{outputs.largest * 1e3:.3f} of {outputs.bound * 1e3:.3f} mrad"
    )
    for word in ("Traceback", "[ERROR]", "[FATAL]", "Exception"):
        # A broken calibration has to be reported as an error.
        lines = [line for line in log.splitlines() if word in line and BROKEN not in line]
        failed += [f"in the log: {line}" for line in lines[:1]]
    if len(cell.memory) < 10:
        return [*failed, "memory was not measured"]
    slope, minutes = growth(cell.memory)
    limit = SLOPE if cell.rounds > 2 else max(SLOPE, FIRST / minutes)
    print(f"memory {slope:+.3f} MB/min over the last {minutes:.1f} min, {limit:.2f} allowed")
    if slope > limit:
        failed.append(f"memory grows by {slope:.2f} MB/min")
    return failed


def soak(seconds: float, hz: float, running: Processes, folder: Path) -> list[str]:
    """Run the cell; return the failures."""
    robot_file, calibrations = files(folder)
    robot = load_robot(robot_file)
    outputs = Outputs(robot.limits.correction, RATE, robot.joints.speed)
    faults = Faults(calibrations, np.load(folder / "singular.npy"), seed=1)
    os.environ.update(running.environment)
    cell = Cell(running, robot, robot_file, calibrations, outputs, faults, seconds, RATE, hz)
    cell.run()
    log = (running.logs / "calibration_node.log").read_text("utf-8", "replace")
    return verdict(cell, outputs, log)


def main() -> int:
    """Run and judge."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--hz", type=float, default=1000.0, help="rate of the commands")
    parser.add_argument("--logs", type=Path, default=None, help="folder for the logs")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        logs = arguments.logs or Path(folder) / "logs"
        with processes(logs) as running:
            failed = soak(arguments.seconds, arguments.hz, running, Path(folder))
    for text in failed:
        print(f"FAILED: {text}")
    print("passed" if not failed else "failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
