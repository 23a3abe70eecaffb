"""`delta-cal simulate`: record a session of a simulated machine with errors."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from textwrap import wrap

import click

from delta_calibration import __version__
from delta_calibration.cli.options import duration, progress, robot_option, seed_option
from delta_calibration.cli.quantity import Quantity
from delta_calibration.cli.verb import NEW_FOLDER, Verb
from delta_calibration.data import collect
from delta_calibration.plans import Leg, make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import (
    RICH_PERIOD,
    days_later,
    draw_machine,
    effect_options,
    hideable_causes,
    simulate_session,
    visited,
)

_CAUSES = """\b
Dimensions (default strength 3; geometry, all of them at random: 1):
  joint_zero_offset arm_length forearm_length base_joint_position
  base_joint_tilt parallelogram_mismatch geometry
Measurement (default strength 1, as for all below):
  smr_offset            reflector offset in a random direction
  tracker_scale
  tracker_drift         value: total shift. time_constant=S: settles (2400 s
                        by default); 0: linear over an hour; step_at=S: a step;
                        period=S: a cycle, phase=0 to 1 of it at the start
  timestamp_latency
Drive:
  encoder_eccentricity  value: amplitude
  transmission_error    value: amplitude; cycles=N per turn, or per 2 pi m of
                        a sliding joint (default: gear ratio); second=2: also
                        a wave of twice the order
  joint_scale joint_compliance joint_lag
  backlash              with masses in the robot file, held_by=N m (N if the
                        joint slides): loads above it hold the gear on one
                        flank (0: none does)
  joint_zero_drift      linear over an hour; or time_constant=S, step_at=S,
                        period=S [s]
  stick_slip            falls to level= (0 by default) of its value above
                        speed= [rad/s; m/s for sliding joints]; by default
                        0.1 rad/s on a Delta, a similar speed on others
  encoder_interpolation
                        only if the robot file has joints.encoder_lines
Structure:
  thermal_growth_arm thermal_growth_base
                        follows the sensor of its own part; sensor=arm or
                        sensor=base selects another, time_constant=S a growth
                        with time, period=S a cycle. The cell warms up
  thermal_growth_forearm
                        has no sensor: grows with time, time_constant=2400
  forearm_compliance dynamic_deflection base_compliance
  flange_compliance     behind=M: from the tool centre point to the flange
  pulley_radius         upper=-1: the cables come from above to the pulleys
                        above the platform, lower=-1: to those below it;
                        1: from below
  pretension_loss       settles with time_constant=S; 0: linear over an hour
  ball_joint_clearance  force=N: load that takes it from end to end (0: any);
                        end=1: at the elbow, -1: at the platform, 0: at both
By robot:
"""
_REFUSED = "An unknown cause or location is refused with a list of those the robot has."
_LEFT, _WIDE = 24, 54  # width of the robots' names and of their causes [characters]


def _causes(context: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """Shell completion of `--effect`: causes of the robot that is named before it."""
    robot = load_robot(context.params.get("robot_file") or "srbd")
    chain = draw_machine(robot, seed=0).chain
    return [name for name in hideable_causes(robot, chain) if name.startswith(begun)]


def _by_robot() -> str:
    """List the causes that each robot of the package can have, those of all robots first."""
    have = {}
    for name in known_robots():
        robot = load_robot(name)
        have[name] = hideable_causes(robot, draw_machine(robot, seed=0).chain)
    common = set.intersection(*(set(causes) for causes in have.values()))
    rows = [("every robot", [cause for cause in next(iter(have.values())) if cause in common])]
    rows += [(name, [c for c in causes if c not in common]) for name, causes in have.items()]
    lines = []
    for name, causes in rows:
        for number, text in enumerate(wrap(" ".join(causes), _WIDE)):
            lines.append(f"  {name if number == 0 else '':{_LEFT - 2}}{text}")
    return "\n".join(lines)


class Simulate(Verb):
    """The verb, with the list of causes at the end of its help, made when it is shown."""

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the causes, and which robot can have which."""
        self.epilog = f"{_CAUSES}{_by_robot()}\n{_REFUSED}\n"
        super().format_epilog(ctx, formatter)


@click.command("simulate", cls=Simulate)
@robot_option
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME[:k=v,...]",
    shell_complete=_causes,
    help="Cause of error to hide in the machine, such as backlash:location=joint_2,value=0.0003 "
    "(SI units); may be repeated.",
)
@click.option(
    "--plan",
    default="rich",
    show_default=True,
    metavar="NAME|CSV",
    help="Name of a plan (line, disc, iso9283, identify, separate, circles, rich) or a CSV file "
    "of x_mm, y_mm, z_mm. `separate:CAUSE,CAUSE` distinguishes these causes, as `plan` does.",
)
@click.option(
    "--count",
    type=click.IntRange(min=1),
    default=None,
    help="Number of points, or of cycles for iso9283.",
)
@click.option(
    "--scatter",
    type=Quantity(0, 1000),
    default=1.0,
    show_default=True,
    help="Size of the manufacturing errors; 1 draws them from the tolerances in the robot file.",
)
@click.option(
    "--rate",
    type=Quantity(1, 1000),
    default=20.0,
    show_default=True,
    help="Sampling rate of the recorded streams [1/s].",
)
@seed_option
@click.option(
    "--visit",
    type=click.IntRange(0, 100_000),
    default=0,
    show_default=True,
    help="Day on which the same machine is measured: tracker and reflector are set up again and "
    "the noise is new.",
)
@click.option("--out", type=NEW_FOLDER, required=True, help="Folder of the session to write.")
def command(
    robot_file: str,
    effects: tuple[str, ...],
    plan: str,
    count: int | None,
    scatter: float,
    rate: float,
    seed: int,
    visit: int,
    out: Path,
) -> None:
    """Drive a simulated machine through a plan and record the session.

    The parts of the machine deviate by their tolerances (a Delta has six separate rods). It has
    its own tracker frame, tracker noise and joint repeatability. All of this follows from the
    seed. A session of the plan "rich" lasts two hours, in which the cell warms up: the arms from
    20 towards 33 deg C with a time constant of 40 minutes, the base plate more slowly and by a
    third of that.

    --effect hides a cause of error in the machine. Every cause takes strength=S, in units of a
    typical size; most take value=V, in SI units (rad, m, 1/K, rad/(N m), m/N, ...); causes of a
    single joint take location=NAME, with the joint's name in the robot file. Anything not given is
    drawn at random: phases, the course of a drift and, with a strength, signs and shares. The list
    below shows which causes each robot can have.
    """
    robot = load_robot(robot_file)
    hidden = [effect_options(text) for text in effects if text != "none"]
    machine = draw_machine(robot, seed, scatter, hidden)
    machine = visited(machine, robot, seed, visit, scatter)
    measured = make_plan(plan, robot, count=count, seed=seed)
    rich = plan == "rich"
    total = len(measured) + 2 * len(measured.paths)

    def follow(legs: Iterator[Leg]) -> Iterable[Leg]:
        return progress(legs, total, "stop")

    period = RICH_PERIOD if rich else 0.0
    noise = seed + 1_000_003 * visit
    session = simulate_session(machine, measured, noise, rate, period, str(out), follow, rich)
    session = days_later(session, visit)
    provenance = {
        "made_by": f"delta-cal simulate {__version__}",
        "robot": robot.name,
        "robot_sha256": robot.hash,
        "plan": measured.name,
        "seed": str(seed),
        "visit": str(visit),
        "scatter": str(scatter),
        "effects": " ".join(effects) or "none",
    }
    write_session(out, session, provenance)
    tracker = session.tracker
    if tracker is not None:
        seconds = float(tracker.stamp_ns[-1] - tracker.stamp_ns[0]) * 1e-9
        stops = f"{len(measured)} stops and {len(measured.paths)} paths"
        # includes the rests at the ends of paths
        still = len(collect(session, robot.joints.names, robot.commanded.joint_size))
        click.echo(
            f"written: {out} ({stops}: {still} poses at rest, {len(tracker.stamp_ns)} readings, "
            f"{duration(seconds)})"
        )
