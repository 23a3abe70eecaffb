"""`delta-cal plan`: where to measure, from which side, with what load and in what motion."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import load_calibration
from delta_calibration.chain import Chain
from delta_calibration.cli.options import (
    calibration_option,
    progress,
    require_folder,
    robot_option,
    seed_option,
    table,
    topics_option,
)
from delta_calibration.cli.quantity import Quantity
from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.contrast import ALIKE
from delta_calibration.diagnosis.experiments import NOTHING
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.errors import InputError
from delta_calibration.plans import PLACES, Plan, make_plan, write_plan
from delta_calibration.plans.bench import SLOTS, StopConditions
from delta_calibration.plans.optimal import OptimalPlan, optimal_plan
from delta_calibration.plans.parting import Parting, part
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import Robot, load_robot

_STOPS = 20  # of --separate, where --count is not given


@click.command("plan", short_help="where to measure, from which side, with what load")
@robot_option
@click.option(
    "--name",
    default=None,
    metavar="NAME",
    help="A plan by name: line, disc, iso9283, identify, circles, rich; the nodes and `simulate` "
    "have the same. `identify` spreads its places over the workspace, --identify chooses them.",
)
@click.option(
    "--identify", is_flag=True, help="The D-optimal poses to fit the geometry, from both sides."
)
@click.option(
    "--separate",
    nargs=2,
    default=None,
    metavar="CAUSE CAUSE",
    help="What parts the first cause from the second; `geometry` for all dimensions.",
)
@click.option(
    "--from",
    "session",
    type=click.Path(path_type=Path),
    default=None,
    metavar="SESSION",
    help="What was measured before, to which --separate adds.",
)
@calibration_option("The machine that --separate goes by, in place of the drawing.")
@click.option(
    "--count",
    type=click.IntRange(min=1),
    default=None,
    help=f"Of different places ({PLACES} to identify; cycles for iso9283), or of stops for "
    "--separate (20).",
)
@click.option(
    "--payload-kg",
    type=Quantity(0, 100_000, above=True),
    default=2.0,
    show_default=True,
    help="That can be put on the platform, for rich and --separate.",
)
@click.option(
    "--radius-mm",
    type=Quantity(0, 1_000_000, above=True),
    default=None,
    help="Keep the tool within this distance of the axis.",
)
@seed_option
@topics_option
@click.option("--out", type=click.Path(path_type=Path), required=True, help="CSV file to write.")
def command(
    robot_file: str,
    name: str | None,
    identify: bool,
    separate: tuple[str, str] | None,
    session: Path | None,
    calibration_file: Path | None,
    count: int | None,
    payload_kg: float,
    radius_mm: float | None,
    seed: int,
    topics: tuple[str, ...],
    out: Path,
) -> None:
    """Write a measurement plan that `simulate` and the node `measurement_plan` take by its file.

    The CSV has a line a stop: the tool point (x_mm, y_mm, z_mm), the side that the joints come
    from (direction: 1 or -1) and the load (payload_kg); lines with a path and its duration_s are
    driven through without a stop, with the load of the last stop. A column `note` is for people;
    others are refused.

    --identify and --separate choose among poses in the robot file's `workspace`, turned by no more
    than it allows; where the file states none, among all that the joints can take, the machine put
    together as at home. Cables stay taut with the loads of the plan.
    """
    if [name is not None, identify, separate is not None].count(True) != 1:
        raise InputError("give one of --name, --identify and --separate")
    if separate is None and (session or calibration_file):
        raise InputError("--from and --calibration are for --separate")
    if session and calibration_file:
        raise InputError("--from and --calibration exclude each other; give one")
    if name is not None and radius_mm is not None:
        raise InputError("--radius-mm is for --identify and --separate")
    require_folder(out)
    robot = load_robot(robot_file)
    radius = None if radius_mm is None else 1e-3 * radius_mm
    if separate is not None:
        parting = part(
            robot,
            separate,
            count or _STOPS,
            session=None if session is None else _measured(session, robot, topics),
            known=None if calibration_file is None else _known(calibration_file, robot),
            payload=payload_kg,
            radius=radius,
            seed=seed,
            follow=_bar,
        )
        plan, said = parting.plan, describe_parting(parting, separate, session)
    elif identify:
        best = optimal_plan(robot, count or PLACES, radius=radius, seed=seed, follow=_bar)
        plan, said = best.plan, describe_optimal(best, robot)
    else:
        load = payload_kg if name == "rich" else 0.0
        plan, said = make_plan(name or "", robot, count=count, payload=load, seed=seed), ""
    if said:
        click.echo(said)
    write_plan(out, plan, robot)
    click.echo(f"written: {out} ({len(plan)} stops and {len(plan.paths)} paths)")


def describe_optimal(best: OptimalPlan, robot: Robot) -> str:
    """How good the stops are, for people."""
    seen = best.observability
    return "\n".join(
        [
            f"{len(best.plan) // 2} poses of {best.candidates}, each from both sides: log det of "
            f"the information {best.log_det:.1f}, of as many random ones "
            f"{best.random_log_det:.1f}; those would have to be {best.worth:.1f} times as many",
            f"rank {seen.rank} of {seen.columns} parameters, O1 {seen.indices['O1']:.4g}",
            f"{_kept_to(robot)} and a condition of {robot.limits.condition / 2:g}, half of the "
            "file's limits.condition, as it states none of the ball joints",
        ]
    )


def _kept_to(robot: Robot) -> str:
    """Where the poses were chosen from."""
    if robot.workspace is None:
        return "poses keep to the joints' limits, the assembly mode of home"
    return "poses keep to the file's workspace and the turns allowed there, the joints' limits"


def describe_parting(parting: Parting, causes: tuple[str, str], session: Path | None) -> str:
    """What the plan achieves and what it varies, for people."""
    plan = parting.plan
    before = f"{len(plan)} plain stops" if session is None else session.name
    after = "this plan" if session is None else "with this plan"
    rows = [
        (label, f"{contrast.cosine:.3f}", f"{contrast.signal:.1f}")
        for label, contrast in ((before, parting.before), (after, parting.after))
    ]
    lines = [
        f"{causes[0]} beside {causes[1]}, at a typical size:",
        table(("", "cosine", "lambda"), rows),
        f"{len(plan)} stops at {len(np.unique(plan.target, axis=0))} poses",
        *_varied(plan),
        *_timed(parting.levels),
    ]
    if not parting.after.parted:
        lacking = "more stops" if parting.after.cosine < ALIKE else parting.outside or NOTHING
        lines.append(f"not enough to tell them apart: {lacking}")
    return "\n".join(lines)


def _varied(plan: Plan) -> Iterator[str]:
    """Sides, loads and paths, where there is a choice."""
    sides, stops = np.unique(plan.direction, return_counts=True)
    if len(sides) > 1:
        yield f"approached from both sides: {stops[1]} stops forward, {stops[0]} backward"
    loads, stops = np.unique(plan.payload, return_counts=True)
    if len(loads) > 1:
        each = (f"{load:g} kg at {n} stops" for load, n in zip(loads, stops, strict=True))
        yield f"payloads: {', '.join(each)}"
    if plan.paths:
        yield f"paths: {', '.join(path.name for path in plan.paths)}"


def _timed(levels: tuple[StopConditions, ...]) -> Iterator[str]:
    """When to take which stops, where warmth or the clock matter."""
    if len({level.slot for level in levels}) < 2:
        return
    yield "in this order, over an hour of warming up by 10 K and an hour of cooling:"
    first = 1
    for slot, group in groupby(levels, key=lambda level: level.slot):
        last = first + len(list(group)) - 1
        time, warmer = SLOTS[slot]
        yield f"  stops {first} to {last} after {time / 60:.0f} min, {warmer:g} K warmer"
        first = last + 1


def _measured(session: Path, robot: Robot, topics: tuple[str, ...]) -> LinearizedModel:
    recorded = read_session(session, Topics.from_options(topics))
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    return calibrated(seen, robot).evidence


def _known(path: Path, robot: Robot) -> tuple[Chain, NDArray[np.float64]]:
    calibration = load_calibration(path, robot)
    return calibration.chain, calibration.theta


def _bar(steps: range) -> Iterable[int]:
    return progress(steps, len(steps), "step")
