"""`delta-cal simulate`: a session of a machine that is not built as drawn."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import click

from delta_calibration import __version__
from delta_calibration.cli.options import duration, progress, robot_option, seed_option
from delta_calibration.cli.quantity import Quantity
from delta_calibration.data import collect
from delta_calibration.plans import Leg, make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import (
    days_later,
    draw_machine,
    effect_options,
    hideable_causes,
    simulate_session,
    visited,
)

_RICH_PERIOD = 38.0  # [s] from stop to stop: two hours for the usual number of stops
_CAUSES = """\b
Dimensions (strength 3 by default; geometry: all of them at random, 1):
  joint_zero_offset arm_length forearm_length base_joint_position
  base_joint_tilt parallelogram_mismatch geometry
Measurement (strength 1 by default, as all that follow):
  smr_offset            of the reflector, in a direction that is drawn
  tracker_scale
  tracker_drift         value is the shift; settles with time_constant=2400
                        [s]; 0: a ramp, of an hour; step_at=T [s]: a step
  timestamp_latency
Drive:
  encoder_eccentricity  value is the amplitude
  transmission_error    value is the amplitude; cycles= a turn, by default
                        the gear ratio
  joint_scale backlash joint_compliance joint_lag
  joint_zero_drift      a ramp, of an hour; or time_constant=, step_at= [s]
  stick_slip            beyond speed= [rad/s; m/s where joints slide] gone but
                        for level=0 of it; by default a Delta's 0.1 rad/s or
                        what moves as fast
Structure:
  thermal_growth_arm thermal_growth_base
                        by sensor=arm or base, their own by default; or by
                        the clock with time_constant= [s]. The cell warms up
  thermal_growth_forearm
                        no thermometer there: by the clock, time_constant=2400
  forearm_compliance dynamic_deflection
  ball_joint_clearance  from end to end over force=0 [N]
By robot:
  every one             geometry smr_offset tracker_scale tracker_drift
                        timestamp_latency backlash joint_lag
                        joint_zero_drift stick_slip
  srbd                  all of the above
  linear_delta          joint_zero_offset arm_length base_joint_position
                        transmission_error thermal_growth_arm slider_pitch
  five_axis             joint_zero_offset base_joint_position
                        platform_joint_position transmission_error slider_pitch
  cdpr8                 base_joint_position platform_joint_position drum_scale
                        encoder_eccentricity cable_elasticity cable_sag
                        pulley_radius drum_build_up
  scara, ur10           joint_zero_offset joint_axis_tilt link_length
                        link_offset tool_position tool_turn
                        encoder_eccentricity transmission_error joint_scale
                        thermal_growth_link joint_error_curve
  scara                 reducer_compliance as well
  ur10                  gravity_sag as well
An unknown cause or location is answered with those that the robot can have.
"""


def _causes(context: click.Context, _: click.Parameter, begun: str) -> list[str]:
    """What `--effect` may go on with, for the robot that is named before it."""
    robot = load_robot(context.params.get("robot_file") or "srbd")
    chain = draw_machine(robot, seed=0).chain
    return [name for name in hideable_causes(robot, chain) if name.startswith(begun)]


@click.command(
    "simulate",
    short_help="make a session of a machine that is not built as drawn",
    epilog=_CAUSES,
)
@robot_option
@click.option(
    "--effect",
    "effects",
    multiple=True,
    metavar="NAME[:k=v,...]",
    shell_complete=_causes,
    help="Cause to hide, e.g. backlash:location=joint_2,value=0.0003 (SI); may be repeated.",
)
@click.option(
    "--plan",
    default="rich",
    show_default=True,
    metavar="NAME|CSV",
    help="line, disc, iso9283, identify, circles, rich, or a CSV of x_mm, y_mm, z_mm.",
)
@click.option(
    "--count", type=click.IntRange(min=1), default=None, help="Of points; cycles for iso9283."
)
@click.option(
    "--scatter",
    type=Quantity(0, 1000),
    default=1.0,
    show_default=True,
    help="Size of the manufacturing errors; 1 is a real machine's.",
)
@click.option("--rate", type=Quantity(1, 1000), default=20.0, show_default=True, help="[1/s]")
@seed_option
@click.option(
    "--visit",
    type=click.IntRange(0, 100_000),
    default=0,
    show_default=True,
    help="Day on which the same machine is measured, with the tracker and the reflector set up "
    "anew and other noise.",
)
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
    visit: int,
    out: Path,
) -> None:
    """Drive a simulated machine through a plan and record the session.

    The machine has parts that deviate by their tolerances (a Delta six rods), its own tracker
    frame, tracker noise and joint repeatability. The seed decides all of it. The session of the
    plan "rich" lasts two hours, in which the cell warms up: the arms from 20 towards 33 deg C
    with a time constant of 40 minutes, the base plate slower and by a third of that.

    --effect hides a cause in the machine. All take strength=S, in typical sizes, and most
    value=V, in SI (rad, m, s, 1/K, rad/(N m), ...); those of single joints location=NAME, a
    joint's name in the robot file. What is not said is drawn: phases, ways of a drift and, with a
    strength, signs and shares. At the end: what each robot can have.
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

    period = _RICH_PERIOD if rich else 0.0
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
        # the ends of paths as well
        still = len(collect(session, robot.joints.names, robot.commanded.joint_size))
        click.echo(
            f"written: {out} ({stops}: {still} poses at rest, {len(tracker.stamp_ns)} readings, "
            f"{duration(seconds)})"
        )
