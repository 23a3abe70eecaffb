"""Second act of the demonstration: a cause of error is hidden in the machine, found and named."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path

import click
import numpy as np

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cli.hidden import hidden_and_found
from delta_calibration.cli.live_cell import RADIUS, STOPS, LiveCell, Say, at_targets, part_of
from delta_calibration.cli.options import table
from delta_calibration.data import collect
from delta_calibration.effects import catalogue
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session
from delta_calibration.robot import Robot
from delta_calibration.simulation import TrueMachine, draw_machine, effect_options
from delta_calibration.trial import Errors, true_errors


def second_act(
    robot_file: str,
    robot: Robot,
    out: Path,
    seed: int,
    method: str,
    say: Say,
    draw: int | None = None,
) -> tuple[dict[str, object], tuple[int, int]]:
    """Hide, measure, diagnose, extend, measure again.

    Args:
        robot_file: file or name, for the nodes.
        robot: loaded from that file.
        out: folder of the session and the calibration.
        seed: of the machine.
        method: of compensation.
        say: tells the step.
        draw: seed that selects the hidden cause; from the clock if not given, so that the cause is
            unknown until it is printed at the end.

    Returns:
        Result as data; begin and end of the diagnosed readings [ns].
    """
    draw = time.time_ns() % 2**31 if draw is None else draw
    shown = _shown(robot)
    effect = shown[int(np.random.default_rng(draw).integers(len(shown)))]
    files = out / "session_2", out / "extended.yaml"
    with LiveCell(robot_file, robot, *files, seed, method, (effect,)) as cell:
        say("second act: an error that no geometry explains is hidden in the machine")
        cell.order("start_capture")
        begun = time.time_ns()
        say(f"measuring the workspace: {STOPS['identify']} places from both sides")
        cell.measure("identify", "identify", True)
        captured = begun, time.time_ns()
        cell.order("stop_capture")
        say(cell.order("fit"))
        say(cell.order("enable", True))
        time.sleep(1.5)  # the correction is ramped in
        say("measuring the line with geometry compensated, from both sides")
        cell.measure("calibrated", "line", True)
        say("diagnosing")
        told = cell.order("diagnose")
        say(told)
        cell.order("save")
        time.sleep(1.5)
        say("measuring the line with the extended model")
        cell.measure("extended", "line", True)
    machine = draw_machine(robot, seed, 1.0, [effect_options(effect)])
    rows, figures = _compared(robot, out, machine, cell.begun)
    click.echo("\n" + table(("error [mm], line from both sides", "max", "mean", "3 std"), rows))
    found = [e.cause for e in load_calibration(files[1], robot).chain.effects]
    hidden = effect.partition(":")[0]
    before, after = (figures[name]["mean_mm"] for name in ("calibrated", "extended"))
    click.echo(
        f"\nhidden: {effect}; found: {', '.join(found) or 'nothing'}; mean error of the line "
        f"{before:.4f} -> {after:.4f} mm\n\n{hidden_and_found(machine, files[1])}\n\nto repeat "
        f"this run: delta-cal demo --robot {robot_file} --seed {seed} --method {method} --draw "
        f"{draw}\n"
    )
    right = found == [hidden]
    return {"draw": draw, "hidden": effect, "found": found, "right": right, **figures}, captured


def _shown(robot: Robot) -> tuple[str, ...]:
    """Effects, as the simulator's options, that this demonstration may hide."""
    effects = [effect for effect in catalogue(robot, robot.detailed) if effect.live_strength]
    return tuple(f"{effect.cause}:strength={effect.live_strength}" for effect in effects[::-1])


def _compared(
    robot: Robot, out: Path, machine: TrueMachine, begun: dict[str, int]
) -> tuple[list[tuple[str, str, str, str]], dict[str, dict[str, float | int]]]:
    """Errors against the truth with geometry and with the extended model."""
    recorded = read_session(out / "session_2")
    poses = collect(recorded, robot.joints.names, robot.commanded.joint_size)
    extended = load_calibration(out / "extended.yaml", robot)
    plain = replace(extended, chain=extended.chain.with_effects(()))
    plain = replace(plain, theta=extended.theta[plain.chain.layout.base])
    plan = make_plan("line", robot, count=STOPS["line"], both_sides=False, radius=RADIUS)
    rows, figures = [], {}
    names = {"calibrated": "geometry compensated", "extended": "extended model"}
    for part, name in names.items():
        stops = at_targets(part_of(poses, begun, part), plan, sides=2)
        errors = true_errors(plain, machine, stops, plan.target)
        figures[part] = errors.in_mm()
        rows.append(_row(f"{name}, simulated truth", errors))
    return rows, figures


def _row(name: str, errors: Errors) -> tuple[str, str, str, str]:
    values = (errors.maximum, errors.mean, errors.three_std)
    first, second, third = (f"{v * 1e3:.4f}" for v in values)
    return name, first, second, third
