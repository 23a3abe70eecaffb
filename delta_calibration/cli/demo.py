"""`delta-cal demo`: a live simulated cell measures itself, fits, compensates and gets better."""

from __future__ import annotations

import importlib.util
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.children import Children
from delta_calibration.cli.fit import describe
from delta_calibration.cli.options import table, write_json
from delta_calibration.errors import DataError, InputError
from delta_calibration.identification import Identification, identify
from delta_calibration.plans import Plan, make_plan
from delta_calibration.processes import remove_dead_shared_memory
from delta_calibration.recording import read_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.samples import Poses, collect
from delta_calibration.simulation import draw_machine
from delta_calibration.trial import Errors, measured_errors, paper_simulation, true_errors

_RATE = 50.0  # [1/s] of commands, states and tracker
_RAMP = 0.2  # [s] over which corrections come in: before the first stop is reached
_DWELL = 0.25  # [s]
_RADIUS = 0.45  # [m] of the disc
_STOPS = {"identify": 48, "line": 37, "disc": 36}
_PAPER = ("3.3050", "0.8030", "2.0860")  # [mm] table 3: a real machine, without compensation
_PAPER_NAMES = ("max_mm", "mean_mm", "three_std_mm")
_TIMEOUT = 200.0  # [s] of one plan


@click.command("demo", short_help="a live simulated cell, from measurement to compensation")
@click.option("--robot", "robot_file", default="srbd", show_default=True, metavar="FILE|NAME")
@click.option(
    "--out", type=click.Path(path_type=Path), default=Path("out/demo"), show_default=True
)
@click.option(
    "--seed", type=click.IntRange(min=0), default=7, show_default=True, help="Of the machine."
)
@click.option(
    "--method", type=click.Choice(["newton", "apso"]), default="newton", show_default=True
)
def command(robot_file: str, out: Path, seed: int, method: str) -> None:
    """Start the nodes of a cell as processes on this machine and take them through a calibration.

    The workspace is measured and recorded, the machine identified, compensation switched on, and
    the Delta paper's line and a disc are measured before and after. Then the paper's own
    simulation. Needs ROS 2.
    """
    if importlib.util.find_spec("rclpy") is None:
        raise InputError(
            "the demo needs ROS 2 (rclpy), which this Python does not have; see the README"
        )
    robot = load_robot(robot_file)
    logs = _clean(out)
    remove_dead_shared_memory()
    say = _clock()
    begun = _run_cell(robot_file, robot, out, logs, seed, method, say)
    say("reading the recorded session")
    summary = _evaluate(robot, out, seed, method, begun)
    write_json(out / "summary.json", summary)
    click.echo(f"written: {out}/session, {out}/calibration.yaml, {out}/summary.json")


def _run_cell(
    robot_file: str,
    robot: Robot,
    out: Path,
    logs: Path,
    seed: int,
    method: str,
    say: Callable[[str], None],
) -> dict[str, int]:
    """Drive the live cell; when each part began [ns]."""
    begun: dict[str, int] = {}
    domain = 1 + os.getpid() % 100
    common = {"robot": robot_file}
    with Children(domain, logs) as cell:
        say(f"starting the nodes on ROS domain {domain}")
        provenance = f"[robot={robot.name}, robot_sha256={robot.hash}, seed={seed}, made_by=demo]"
        cell.start("session_recorder", {"output": out / "session", "provenance": provenance})
        cell.start("simulated_tracker", {**common, "seed": seed, "rate": _RATE})
        calibration = {
            **common,
            "autostart": True,
            "method": method,
            "ramp_s": _RAMP,
            "output": out / "calibration.yaml",
        }
        cell.start("calibration_node", calibration)

        def measure(part: str, plan: str, both_sides: bool) -> None:
            begun[part] = time.time_ns()
            cell.plan(
                {
                    **common, "plan": plan, "count": _STOPS[plan], "dwell": _DWELL, "rate": _RATE,
                    "both_sides": both_sides, "radius": _RADIUS, "seed": seed,
                    "subscribers": 2,  # the calibration node and the recorder
                },
                _TIMEOUT,
            )  # fmt: skip

        cell.call("/calibration_node/start_capture")
        say(f"measuring the workspace: {_STOPS['identify']} places from both sides")
        measure("identify", "identify", True)
        cell.call("/calibration_node/stop_capture")
        for plan in ("line", "disc"):
            say(f"measuring the {plan} without compensation: {_STOPS[plan]} points")
            measure(f"{plan}_before", plan, False)
        say("fitting")
        say(cell.call("/calibration_node/fit"))
        cell.call("/calibration_node/save")
        say(cell.call("/calibration_node/enable", True))
        time.sleep(1.5)  # the correction is ramped in
        for plan in ("line", "disc"):
            say(f"measuring the {plan} with compensation")
            measure(f"{plan}_after", plan, False)
        say("stopping the nodes")
    return begun


def _evaluate(
    robot: Robot, out: Path, seed: int, method: str, begun: dict[str, int]
) -> dict[str, object]:
    """Before and after, from the recorded session; printed, and as data."""
    poses = collect(read_session(out / "session"), robot.joints.names)
    calibration = load_calibration(out / "calibration.yaml", robot)
    fitted = _part(poses, begun, "identify")
    found = identify(fitted, robot)
    click.echo("\n" + describe(found, verbose=False) + "\n")
    registered = replace(calibration, chain=found.chain, theta=found.frame_only_theta)
    machine = draw_machine(robot, seed)
    rows = [("the paper's machine, line, measured", *_PAPER)]
    summary: dict[str, object] = {}
    for name in ("line", "disc"):
        plan = make_plan(name, robot, count=_STOPS[name], both_sides=False, radius=_RADIUS)
        parts: dict[str, object] = {}
        for when, seen_by in (("before", registered), ("after", calibration)):
            stops = _at_targets(_part(poses, begun, f"{name}_{when}"), plan)
            true = true_errors(seen_by, machine, stops, plan.target)
            measured = measured_errors(seen_by, stops, plan.target)
            parts[when] = {**true.in_mm(), "measured": measured.in_mm()}
            rows.append(_row(f"{name} {when}, simulated truth", true))
            rows.append(_row(f"{name} {when}, measured by the tracker", measured))
        summary[name] = parts
    before, after = paper_simulation(machine, seed=seed)
    rows.append(_row("line before, errors known to the model", before))
    rows.append(_row("line after APSO, errors known to the model", after))
    click.echo(table(("error [mm]", "max", "mean", "3 std"), rows) + "\n")
    click.echo(
        f"joints come to rest within {robot.joints.repeatability * 1e6:.0f} urad of the command: "
        'in "measured", taken off in "simulated truth"'
    )
    return {
        **summary,
        "paper_simulation": {"before": before.in_mm(), "after": after.in_mm()},
        "paper_measured": dict(zip(_PAPER_NAMES, map(float, _PAPER), strict=True)),
        "fit": _fit_figures(found, calibration),
        "provenance": {
            "package_version": __version__,
            "robot": robot.name,
            "robot_sha256": robot.hash,
            "seed": seed,
            "method": method,
            "calibration_sha256": calibration.seal,
        },
    }


def _fit_figures(found: Identification, calibration: Calibration) -> dict[str, object]:
    return {
        "model": calibration.chain.mechanism.name,
        "rank": found.observability.rank,
        "noise_floor_mm": found.noise.floor * 1e3,
        "frame_only_held_out_mm": found.frame_only.held_out * 1e3,
        "held_out_mm": found.full.held_out * 1e3,
    }


def _part(poses: Poses, begun: dict[str, int], part: str) -> Poses:
    """The stops from the begin of one part to the begin of the next."""
    # By when a stop began: the last of a part lasts into the next, while its plan starts up.
    stamp = poses.start_ns + (poses.time - poses.count / (2 * _RATE)) * 1e9
    end = min((other for other in begun.values() if other > begun[part]), default=np.inf)
    keep = np.flatnonzero((stamp >= begun[part]) & (stamp < end))
    if keep.size == 0:
        raise DataError(f"{poses.source}: no stops were recorded in the part {part!r} of the demo")
    return poses.take(keep)


def _at_targets(poses: Poses, plan: Plan) -> Poses:
    """One stop for each target: what stands still elsewhere (the way in) is left out."""
    # Uncompensated or compensated, the joints are within a degree of the plan's.
    distance = np.abs(poses.joint[:, None] - plan.joint).max(axis=-1)
    nearest = np.argmin(distance, axis=0)
    return poses.take(np.unique(nearest))


def _row(name: str, errors: Errors) -> tuple[str, str, str, str]:
    values = (errors.maximum, errors.mean, errors.three_std)
    first, second, third = (f"{v * 1e3:.4f}" if v > 1e-6 else f"{v * 1e3:.1e}" for v in values)
    return name, first, second, third


def _clean(out: Path) -> Path:
    """The output folder without what an earlier run left; its folder of logs."""
    for name in ("session", "logs"):
        shutil.rmtree(out / name, ignore_errors=True)
    for name in ("calibration.yaml", "summary.json"):
        (out / name).unlink(missing_ok=True)
    try:
        (out / "logs").mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error
    return out / "logs"


def _clock() -> Callable[[str], None]:
    begin = time.monotonic()
    return lambda text: click.echo(f"[{time.monotonic() - begin:5.1f} s] {text}")
