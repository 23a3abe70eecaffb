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
from delta_calibration.cli.kept import (
    known_machine_option,
    robot_given,
    sessions_of,
    store_option,
)
from delta_calibration.cli.options import (
    calibration_option,
    progress,
    require_folder,
    robot_or_machine_option,
    seed_option,
    table,
    topics_option,
)
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import OUTPUT, verb
from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.constants import SAME
from delta_calibration.diagnosis.experiments import NOTHING
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.errors import InputError
from delta_calibration.history import Prospect, prospect
from delta_calibration.plans import PLACES, Plan, make_plan, write_plan
from delta_calibration.plans.bench import SLOTS, StopConditions
from delta_calibration.plans.named import SEPARATE, causes_in
from delta_calibration.plans.optimal import OptimalPlan, optimal_plan
from delta_calibration.plans.parting import Parting, part
from delta_calibration.plans.points import RADIUS
from delta_calibration.plans.renewal import UPDATE_PLACES, Renewal, renewal_plan
from delta_calibration.recording import Topics, read_session
from delta_calibration.robot import Robot

_STOPS = 20  # of --separate, if --count is not given
_PAYLOAD = 2.0  # [kg]


@verb("plan")
@robot_or_machine_option
@click.option(
    "--name",
    default=None,
    metavar="NAME",
    help="Name of a plan: line, disc, iso9283, identify, separate, circles, rich (the same names "
    "as in `simulate` and the nodes). `separate:CAUSE,CAUSE` is --separate CAUSE CAUSE; "
    "`separate` distinguishes play of the joints from geometry. `identify` spreads its poses "
    "over the workspace; the option --identify selects optimal ones.",
)
@click.option(
    "--identify",
    is_flag=True,
    help="Select D-optimal poses for fitting the geometry, each approached from both sides.",
)
@click.option(
    "--update",
    is_flag=True,
    help="Select the few D-optimal poses that a new calibration of a machine needs, given the "
    "sessions in its history (--machine, --store).",
)
@known_machine_option("--update builds on its sessions.")
@store_option
@click.option(
    "--separate",
    nargs=2,
    default=None,
    metavar="CAUSE CAUSE",
    help="Select stops that distinguish the first cause from the second; `geometry` stands for "
    "all dimensions.",
)
@click.option(
    "--from",
    "session",
    type=click.Path(path_type=Path),
    default=None,
    metavar="SESSION",
    help="Session already measured, which --separate extends.",
)
@calibration_option("Calibration that --separate uses instead of the nominal geometry.")
@click.option(
    "--count",
    type=click.IntRange(min=1),
    default=None,
    help=f"Number of different places ({PLACES} to identify and {UPDATE_PLACES} to update by "
    "default), of cycles for iso9283, or of stops for --separate (20 by default).",
)
@click.option(
    "--payload-kg",
    type=Quantity(0, 100_000, above=True),
    default=None,
    help=f"Largest load that can be put on the platform, for rich and --separate "
    f"({_PAYLOAD:g} by default).",
)
@click.option(
    "--radius-mm",
    type=Quantity(0, 1_000_000, above=True),
    default=None,
    help="Largest distance of the tool from the z axis.",
)
@seed_option
@topics_option
@click.option("--out", type=OUTPUT, required=True, help="CSV file to write.")
def command(
    robot_file: str | None,
    name: str | None,
    identify: bool,
    update: bool,
    machine: str | None,
    url: str,
    separate: tuple[str, str] | None,
    session: Path | None,
    calibration_file: Path | None,
    count: int | None,
    payload_kg: float | None,
    radius_mm: float | None,
    seed: int,
    topics: tuple[str, ...],
    out: Path,
) -> None:
    """Write a measurement plan for `simulate` and for the node `measurement_plan`.

    The CSV file has one line per stop: the tool point (x_mm, y_mm, z_mm), the side from which the
    joints approach (direction: 1 or -1) and the load (payload_kg). Lines with a path and a
    duration_s are driven through without a stop, with the load of the last stop. A column `note`
    is for people; other columns are refused.

    --identify, --update and --separate select poses inside the robot file's `workspace` and turn
    the platform no further than it allows. If the file has no workspace, all poses within the
    joint limits are candidates, in the assembly mode of the home pose. Cables stay taut under the
    loads of the plan.
    """
    if [name is not None, identify, update, separate is not None].count(True) != 1:
        raise InputError("give one of --name, --identify, --update and --separate")
    by_name = False
    if name is not None and name.partition(":")[0] == SEPARATE:
        separate, name, by_name = causes_in(name), None, True
    if update != (machine is not None):
        raise InputError(
            "--update and --machine must be given together: --machine names the history to extend"
        )
    if separate is None and (session or calibration_file):
        raise InputError("--from and --calibration are for --separate")
    if session and calibration_file:
        raise InputError("--from and --calibration exclude each other; give one")
    if name is not None and radius_mm is not None:
        raise InputError("--radius-mm is for --identify, --update and --separate")
    if payload_kg is not None and name != "rich" and separate is None:
        raise InputError("--payload-kg is for --name rich and --separate")
    payload = _PAYLOAD if payload_kg is None else payload_kg
    require_folder(out)
    robot = robot_given(robot_file, machine, url)
    radius = None if radius_mm is None else 1e-3 * radius_mm
    if by_name and radius is None and robot.workspace is None:
        radius = RADIUS  # as in `simulate` and the nodes
    if separate is not None:
        parting = part(
            robot,
            separate,
            count or _STOPS,
            session=None if session is None else _measured(session, robot, topics),
            known=None if calibration_file is None else _known(calibration_file, robot),
            payload=payload,
            radius=radius,
            seed=seed,
            follow=_bar,
        )
        plan, said = parting.plan, describe_parting(parting, separate, session)
    elif update and machine is not None:
        known = prospect(sessions_of(machine, robot, url), robot)
        few = count or UPDATE_PLACES
        renewal = renewal_plan(robot, known.carried, few, radius=radius, seed=seed, follow=_bar)
        plan, said = renewal.plan, describe_renewal(renewal, known, robot)
    elif identify:
        best = optimal_plan(robot, count or PLACES, radius=radius, seed=seed, follow=_bar)
        plan, said = best.plan, describe_optimal(best, robot)
    else:
        load = payload if name == "rich" else 0.0
        plan, said = make_plan(name or "", robot, count=count, payload=load, seed=seed), ""
    if said:
        click.echo(said)
    write_plan(out, plan, robot)
    click.echo(f"written: {out} ({len(plan)} stops and {len(plan.paths)} paths)")


def describe_optimal(best: OptimalPlan, robot: Robot) -> str:
    """Text on the quality of the selected stops."""
    seen = best.observability
    return "\n".join(
        [
            f"{len(best.plan) // 2} poses of {best.candidates}, each approached from both sides: "
            f"log det of the information matrix {best.log_det:.1f}; "
            f"for the same number of random poses {best.random_log_det:.1f}; random poses would "
            f"have to be {best.worth:.1f} times as many for the same information",
            f"rank {seen.rank} of {seen.columns} parameters, O1 {seen.indices['O1']:.4g}",
            f"{_kept_to(robot)} and a condition number of {robot.limits.condition / 2:g}, half "
            "of limits.condition in the file, because the file has no limit for the ball joints",
        ]
    )


def describe_renewal(renewal: Renewal, known: Prospect, robot: Robot) -> str:
    """Text on the sessions that the stops extend, and how well the machine is then known."""
    names = known.carried.sessions
    return "\n".join(
        [
            f"{len(renewal.plan) // 2} poses of {renewal.candidates}, each from both sides, added "
            f"to {len(names)} session{'' if len(names) == 1 else 's'} ({names[0]} to {names[-1]})",
            f"the machine is then known to {renewal.after:.2f} times the noise of a stop; after "
            f"{PLACES} random poses and no history, to {renewal.whole:.2f} times",
            f"{_kept_to(robot)} and a condition number of {robot.limits.condition / 2:g}",
        ]
    )


def _kept_to(robot: Robot) -> str:
    """Limits within which the poses were selected, in words."""
    if robot.workspace is None:
        return "poses stay within the joint limits, in the assembly mode of the home pose"
    return "poses stay within the workspace and rotations of the robot file, the joint limits"


def describe_parting(parting: Parting, causes: tuple[str, str], session: Path | None) -> str:
    """Text on how well the plan separates the causes, and what it varies."""
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
        lacking = "more stops" if parting.after.cosine < SAME else parting.outside or NOTHING
        lines.append(f"not enough to distinguish them: {lacking}")
    return "\n".join(lines)


def _varied(plan: Plan) -> Iterator[str]:
    """Lines on sides, loads and paths, as far as the plan varies them."""
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
    """Lines on when to measure which stops, if temperature or time matter."""
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
