"""`delta-cal demo`: a live simulated cell measures itself, fits, compensates and gets better."""

from __future__ import annotations

import importlib.util
import shutil
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import click

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli import second_cell
from delta_calibration.cli.diagnose import diagnosed
from delta_calibration.cli.fit import describe
from delta_calibration.cli.live_cell import (
    RADIUS,
    STOPS,
    LiveCell,
    Say,
    at_targets,
    clock,
    part_of,
)
from delta_calibration.cli.machine_demo import machine_demo
from delta_calibration.cli.making import report_on
from delta_calibration.cli.options import table, write_json
from delta_calibration.cli.report import write
from delta_calibration.cli.second_cell import Hidden
from delta_calibration.compensation import require_method
from delta_calibration.data import collect, survey
from delta_calibration.errors import InputError
from delta_calibration.estimation import Identification, identify
from delta_calibration.plans import make_plan
from delta_calibration.processes import remove_dead_shared_memory
from delta_calibration.recording import read_session
from delta_calibration.report import require_libraries
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine
from delta_calibration.trial import Errors, measured_errors, paper_simulation, true_errors

_PAPER = ("3.3050", "0.8030", "2.0860")  # [mm] table 3: the real machine, not compensated
_FILES = ("calibration.yaml", "extended.yaml", "verdict.json", "summary.json", "report.html")
_PAPER_NAMES = ("max_mm", "mean_mm", "three_std_mm")


@click.command("demo")
@click.option("--robot", "robot_file", default="srbd", show_default=True, metavar="FILE|NAME")
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=None,
    help="Folder for the results.  [default: out/demo; out/demo_ROBOT for other robots]",
)
@click.option(
    "--seed",
    type=click.IntRange(min=0),
    default=7,
    show_default=True,
    help="Seed of the simulated machine.",
)
@click.option(
    "--method", type=click.Choice(["newton", "apso"]), default="newton", show_default=True
)
@click.option(
    "--draw",
    type=click.IntRange(min=0),
    default=None,
    help="Seed of the cause that is hidden in the second live cell.  [default: from the clock]",
)
def command(robot_file: str, out: Path | None, seed: int, method: str, draw: int | None) -> None:
    """Show a complete calibration of a simulated cell.

    With srbd, the Delta paper's kind of robot, the nodes of two cells are started as processes on
    this machine (needs ROS 2). In the first, the workspace is measured and recorded, the machine
    is identified, compensation is switched on, and the Delta paper's line and a disc are measured
    before and after. The paper's own simulation follows. In the second, which is measured at the
    same time, an error that no geometry explains is hidden in the machine; the cell finds it,
    names it and measures the line again.

    With any other robot (cdpr8, five_axis, linear_delta, scara, ur10) everything runs in this
    process, without ROS 2: the workspace is measured and recorded, the machine is identified and
    compensated, and test positions are measured before and after; then again with a hidden cause.
    The points of the SCARA are also corrected without a model, using a simulated camera.
    """
    robot = load_robot(robot_file)
    if robot.workspace is not None:
        if draw is not None:
            raise InputError(
                f"--draw is for a live cell; the demo of {robot.name} always hides the same cause"
            )
        _without_nodes(robot, robot_file, out or Path(f"out/demo_{robot.name}"), seed, method)
    else:
        _with_nodes(robot_file, out or Path("out/demo"), seed, method, draw)


def _without_nodes(robot: Robot, called: str, out: Path, seed: int, method: str) -> None:
    """Run the demonstration in this process, without ROS nodes."""
    require_method(robot.commanded, method, robot.name)
    _clean(out)
    say = clock()
    write_json(out / "summary.json", machine_demo(robot, called, out, seed, method, say))
    files = ("session", "calibration.yaml", "session_2", "extended.yaml", "verdict.json")
    click.echo(f"written: {', '.join(f'{out}/{name}' for name in (*files, 'summary.json'))}")
    say("writing the report of the second act")
    _report(out, robot)


def _with_nodes(robot_file: str, out: Path, seed: int, method: str, draw: int | None) -> None:
    """Run the demonstration of a live cell with ROS nodes."""
    if importlib.util.find_spec("rclpy") is None:
        raise InputError(
            "the demo needs ROS 2 (rclpy), which this Python does not have; see the README"
        )
    robot = load_robot(robot_file)
    _clean(out)
    remove_dead_shared_memory()
    say = clock()
    hidden = Hidden.of(robot, draw)
    files = out / "session", out / "calibration.yaml"
    others = out / "session_2", out / "extended.yaml"
    one = LiveCell(robot_file, robot, *files, seed, method)
    other = LiveCell(robot_file, robot, *others, seed, method, (hidden.effect,), 1)
    # the cells end before the thread that drives the second is waited for
    with ThreadPoolExecutor(1) as aside, one, other:
        say(
            f"started two cells, on ROS domains {one.domain} and {other.domain}; an error that no "
            "geometry explains is hidden in the second"
        )
        second = aside.submit(second_cell.measured, other, _told_of("second", say))
        begun, captured = _measured(one, _told_of("first", say))
        begun_2, captured_2 = second.result()
        say("stopping the nodes")
    say("reading the session of the first cell")
    summary = _evaluate(robot, out, seed, method, begun, captured)
    say("reading the session of the second cell")
    repeat = f"delta-cal demo --robot {robot_file} --seed {seed} --method {method}"
    told = second_cell.evaluated(robot, out, seed, hidden, begun_2, repeat)
    write_json(out / "summary.json", {**summary, "second_act": told})
    click.echo(
        f"written: {out}/session, {out}/calibration.yaml, {out}/session_2, {out}/extended.yaml, "
        f"{out}/summary.json"
    )
    say("writing the report of the second cell")
    _report(out, robot, captured_2)


def _told_of(cell: str, say: Say) -> Say:
    """Print lines that begin with the name of the cell."""
    return lambda text: say(f"{cell} cell: {text}")


def _report(out: Path, robot: Robot, captured: tuple[int, int] | None = None) -> None:
    """Write the report of the second act's diagnosis; if a library is missing, print which one.

    Args:
        out: folder of the demonstration.
        robot: its robot.
        captured: begin and end of the readings that the node captured [ns]; later ones were
            measured with compensation and are no part of the diagnosis.
    """
    try:
        require_libraries()
    except InputError as error:
        click.echo(f"no report: {error}")
        return
    path = out / "session_2"
    recorded = read_session(path)
    if captured is not None:
        recorded = recorded.between(*captured)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    found = diagnosed(seen, robot, None, 0, None)
    made = report_on(path, recorded, found, robot, 0)
    click.echo(f"{len(seen.poses)} poses; verdict: {made.sentence}")
    write(made, out / "report.html", None, None)
    click.echo(f"open {out / 'report.html'} in a browser: the findings and their evidence")


def _measured(cell: LiveCell, say: Say) -> tuple[dict[str, int], tuple[int, int]]:
    """Measure, fit, compensate, measure again.

    Returns:
        Start of each part, and begin and end of the readings that the node captured, all in ns.
    """
    captured = cell.captured(say)
    for plan in ("line", "disc"):
        say(f"measuring the {plan} without compensation: {STOPS[plan]} points")
        cell.measure(f"{plan}_before", plan, False)
    say("fitting")
    say(cell.order("fit"))
    cell.order("save")
    say(cell.order("enable", True))
    time.sleep(1.5)  # the correction is ramped in
    for plan in ("line", "disc"):
        say(f"measuring the {plan} with compensation")
        cell.measure(f"{plan}_after", plan, False)
    return cell.begun, captured


def _evaluate(
    robot: Robot,
    out: Path,
    seed: int,
    method: str,
    begun: dict[str, int],
    captured: tuple[int, int],
) -> dict[str, object]:
    """Print and return the errors before and after compensation, from the recorded session."""
    recorded = read_session(out / "session")
    names, size = robot.joints.names, robot.commanded.joint_size
    poses = collect(recorded, names, size)
    calibration = load_calibration(out / "calibration.yaml", robot)
    # the same poses as the node fitted, and so the same figures
    found = identify(collect(recorded.between(*captured), names, size), robot)
    click.echo("\n" + describe(found, verbose=False) + "\n")
    registered = replace(calibration, chain=found.chain, theta=found.frame_only_theta)
    machine = draw_machine(robot, seed)
    rows = [("the paper's machine, line, measured", *_PAPER)]
    summary: dict[str, object] = {}
    for name in ("line", "disc"):
        plan = make_plan(name, robot, count=STOPS[name], both_sides=False, radius=RADIUS)
        parts: dict[str, object] = {}
        for when, seen_by in (("before", registered), ("after", calibration)):
            stops = at_targets(part_of(poses, begun, f"{name}_{when}"), plan, joint_size=size)
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
        'contained in "measured", removed from "simulated truth"'
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
        "noise_of_a_pose_mm": found.noise.floor * 1e3,
        "error_left_before_mm": found.frame_only.held_out * 1e3,
        "error_left_calibrated_mm": found.full.held_out * 1e3,
    }


def _row(name: str, errors: Errors) -> tuple[str, str, str, str]:
    values = (errors.maximum, errors.mean, errors.three_std)
    first, second, third = (f"{v * 1e3:.4f}" if v > 1e-6 else f"{v * 1e3:.1e}" for v in values)
    return name, first, second, third


def _clean(out: Path) -> None:
    """Remove the files of an earlier run from the output folder, and make a folder for logs."""
    for name in ("session", "session_2", "logs"):
        shutil.rmtree(out / name, ignore_errors=True)
    for name in _FILES:
        (out / name).unlink(missing_ok=True)
    try:
        (out / "logs").mkdir(parents=True)
    except OSError as error:
        raise InputError(f"{out}: cannot be written: {error.strerror or error}") from error
