"""How many true errors of corrected positions lie within what is certified of them.

    python benchmarks/certified_coverage.py [--robots srbd,scara] [--machines 10]

Machines that are not built as drawn, with a hidden cause and without, are measured once each (plan
`identify`) and fitted by geometry alone. At places that were not measured, all over the region,
each joint coming from either side, the true error of the corrected command is held against its
certified radius: 95 % should lie within it. Payload and temperature are those of the session.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import click
import numpy as np

from delta_calibration.identification import identify
from delta_calibration.plans import make_plan
from delta_calibration.report import Examined, examined_fit
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.samples import collect
from delta_calibration.simulation import draw_machine, effect_options, simulate_session
from delta_calibration.simulation.machine import Machine

CAUSES = ("none", "backlash", "transmission_error", "encoder_eccentricity", "cable_sag")
HAVE = {  # what each can have of these
    "srbd": CAUSES[:4],
    "linear_delta": CAUSES[:3],
    "five_axis": CAUSES[:3],
    "scara": CAUSES[:4],
    "ur10": CAUSES[:4],
    "cdpr8": ("none", "encoder_eccentricity", "cable_sag"),
}
_PLACES = 300


@dataclass(frozen=True)
class Coverage:
    """Of one machine."""

    covered: float  # share of true errors within the certified radius
    error: float  # [m] RMS of the true errors
    radius: float  # [m] median


def coverage(robot_name: str, cause: str, seed: int, count: int = 40) -> Coverage:
    """Measure one machine, fit it, and hold it against the truth elsewhere."""
    robot = load_robot(robot_name)
    hidden = [] if cause == "none" else [effect_options(cause)]
    machine = draw_machine(robot, seed, hidden=hidden)
    plan = make_plan("identify", robot, count=count, seed=seed)
    session = simulate_session(machine, plan, seed)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    examined = examined_fit(identify(poses, robot, seed=seed), poses, robot)
    return _held_against(machine, examined, np.random.default_rng([seed, 7]))


def _held_against(machine: Machine, examined: Examined, rng: np.random.Generator) -> Coverage:
    inside = examined.region.sample(_PLACES, 0.0, rng)[len(examined.region.vertices) :]
    joint = examined.joints_at(examined.tools(inside))
    joint = joint[np.isfinite(joint).all(axis=1)]
    at, own = examined.conditions(joint), examined.identified.machine
    rest = machine.robot.joints.repeatability * rng.standard_normal(joint.shape)
    sides = rng.choice([-1.0, 1.0], joint.shape)
    truly = replace(at, joint=joint + rest, direction=sides, travel=np.full(joint.shape, np.inf))
    missed = machine.reflector_points(truly) - own.chain.predict(at, own.theta)
    error, radius = np.linalg.norm(missed, axis=1), examined.identified.radius(at)
    return Coverage(
        float(np.mean(error <= radius)),
        float(np.sqrt(np.mean(error**2))),
        float(np.median(radius)),
    )


def table(robots: Sequence[str], machines: int) -> Iterator[str]:
    """A line a robot and cause."""
    yield f"{'robot':<14}{'hidden':<22}{'covered':>9}{'least':>8}{'error':>11}{'95 %':>11}"
    for name in robots:
        for cause in HAVE[name]:
            found = [coverage(name, cause, seed) for seed in range(machines)]
            share = [each.covered for each in found]
            error, radius = (np.mean([getattr(f, k) for f in found]) for k in ("error", "radius"))
            yield (
                f"{name:<14}{cause:<22}{100 * np.mean(share):>7.1f} %{100 * min(share):>6.0f} %"
                f"{1e3 * error:>8.4f} mm{1e3 * radius:>8.4f} mm"
            )


@click.command()
@click.option("--robots", default=",".join(known_robots()), show_default=True)
@click.option("--machines", default=10, show_default=True, type=click.IntRange(min=1))
def main(robots: str, machines: int) -> None:
    """Print the coverage of certified positions by robot and hidden cause."""
    for line in table(robots.split(","), machines):
        click.echo(line)


if __name__ == "__main__":
    main()
