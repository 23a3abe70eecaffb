"""Second cell of the demonstration: a cause of error is hidden in it, found and named."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
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


@dataclass(frozen=True)
class Hidden:
    """The effect that is hidden in the second machine, and the seed that selected it."""

    effect: str  # option of the simulator
    draw: int

    @classmethod
    def of(cls, robot: Robot, draw: int | None) -> Hidden:
        """Select an effect by a seed, or by the clock if there is none."""
        draw = time.time_ns() % 2**31 if draw is None else draw
        shown = _shown(robot)
        return cls(shown[int(np.random.default_rng(draw).integers(len(shown)))], draw)


def measured(cell: LiveCell, say: Say) -> tuple[dict[str, int], tuple[int, int]]:
    """Measure, fit, diagnose, extend, measure again.

    Returns:
        Start of each part, and begin and end of the readings that are diagnosed, all in ns.
    """
    captured = cell.captured(say)
    say(cell.order("fit"))
    say(cell.order("enable", True))
    time.sleep(1.5)  # the correction is ramped in
    say("measuring the line with geometry compensated, from both sides")
    cell.measure("calibrated", "line", True)
    say("diagnosing")
    say(cell.order("diagnose"))
    cell.order("save")
    time.sleep(1.5)
    say("measuring the line with the extended model")
    cell.measure("extended", "line", True)
    return cell.begun, captured


def evaluated(
    robot: Robot, out: Path, seed: int, hidden: Hidden, begun: dict[str, int], repeat: str
) -> dict[str, object]:
    """Print and return what was found beside what was hidden, and the errors of the line.

    Args:
        robot: of the cell.
        out: folder of its session and calibration.
        seed: of the machine.
        hidden: the effect hidden in it.
        begun: start of each part [ns].
        repeat: command that repeats this run, apart from `--draw`.
    """
    machine = draw_machine(robot, seed, 1.0, [effect_options(hidden.effect)])
    rows, figures = _compared(robot, out, machine, begun)
    click.echo("\n" + table(("error [mm], line from both sides", "max", "mean", "3 std"), rows))
    file = out / "extended.yaml"
    found = [e.cause for e in load_calibration(file, robot).chain.effects]
    before, after = (figures[name]["mean_mm"] for name in ("calibrated", "extended"))
    click.echo(
        f"\nhidden: {hidden.effect}; found: {', '.join(found) or 'nothing'}; mean error of the "
        f"line {before:.4f} -> {after:.4f} mm\n\n{hidden_and_found(machine, file)}\n\nto repeat "
        f"this run: {repeat} --draw {hidden.draw}\n"
    )
    right = found == [hidden.effect.partition(":")[0]]
    told = {"draw": hidden.draw, "hidden": hidden.effect, "found": found, "right": right}
    return {**told, **figures}


def _shown(robot: Robot) -> tuple[str, ...]:
    """Effects, as the simulator's options, that this demonstration may hide."""
    every = catalogue(robot, robot.detailed)
    effects = [effect for effect in every if effect.live_strength and not effect.lacking]
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
