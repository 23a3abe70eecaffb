"""`delta-cal simulate`: a session of a machine that is not built as drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from delta_calibration import __version__
from delta_calibration.cli.options import duration, progress, robot_option, seed_option
from delta_calibration.errors import InputError
from delta_calibration.plans import Leg, make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

_RICH_PERIOD = 38.0  # [s] from stop to stop: two hours for the usual number of stops


@click.command("simulate", short_help="make a session of a machine that is not built as drawn")
@robot_option
@click.option(
    "--effect", "effects", multiple=True, metavar="NAME[:k=v,...]",
    help="Cause to hide, e.g. arm_length:location=joint_3,value=0.0002 (SI); may be repeated.",
)  # fmt: skip
@click.option(
    "--plan", default="rich", show_default=True, metavar="NAME|CSV",
    help="line, disc, iso9283, identify, rich, or a CSV of tool points (x_mm, y_mm, z_mm).",
)  # fmt: skip
@click.option(
    "--count", type=click.IntRange(min=1), default=None, help="Of points; cycles for iso9283."
)
@click.option(
    "--scatter", type=click.FloatRange(min=0), default=1.0, show_default=True,
    help="Size of the manufacturing errors; 1 is a real machine's.",
)  # fmt: skip
@click.option(
    "--rate", type=click.FloatRange(min=1, max=1000), default=20.0, show_default=True, help="[1/s]"
)
@seed_option
@click.option(
    "--out", type=click.Path(path_type=Path), required=True, help="Folder of the session to write."
)
def command(
    robot_file: str,
    effects: tuple[str, ...],
    plan: str,
    count: int | None,
    scatter: float,
    rate: float,
    seed: int,
    out: Path,
) -> None:
    """Drive a simulated machine through a plan and record the session.

    The machine has six rods and parts that deviate by their tolerances, its own tracker frame,
    tracker noise and joint repeatability. The seed decides all of it.
    """
    robot = load_robot(robot_file)
    hidden = dict(_effect(text) for text in effects if text != "none")
    machine = draw_machine(robot, seed, scatter, hidden)
    measured = make_plan(plan, robot, count=count, seed=seed)
    period = _RICH_PERIOD if plan == "rich" else 0.0
    total = len(measured) + 2 * len(measured.paths)

    def follow(legs: Iterator[Leg]) -> Iterable[Leg]:
        return progress(legs, total, "stop")

    session = simulate_session(machine, measured, seed, rate, period, str(out), follow)
    provenance = {
        "made_by": f"delta-cal simulate {__version__}",
        "robot": robot.name,
        "robot_sha256": robot.hash,
        "plan": measured.name,
        "seed": str(seed),
        "scatter": str(scatter),
        "effects": " ".join(effects) or "none",
    }
    write_session(out, session, provenance)
    tracker = session.tracker
    if tracker is not None:
        seconds = float(tracker.stamp_ns[-1] - tracker.stamp_ns[0]) * 1e-9
        stops = f"{len(measured)} stops and {len(measured.paths)} paths"
        click.echo(
            f"written: {out} ({stops}, {len(tracker.stamp_ns)} readings, {duration(seconds)})"
        )


def _effect(text: str) -> tuple[str, dict[str, str]]:
    """`NAME:k=v,k=v` as a name and its options."""
    name, _, rest = text.partition(":")
    options = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise InputError(f"--effect {text}: {part!r} is not of the form key=value")
        options[key] = value
    return name, options
