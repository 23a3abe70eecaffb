"""Share of the true errors of corrected positions that lie within the certified radius.

    python benchmarks/certified_coverage.py [--robots srbd,scara] [--machines 10] [--seed 0]
                                            [--diagnosed | --later]

Each machine deviates from the drawing, with or without a hidden cause, and is measured once. At
places that were not measured, over the whole region and with each joint approached from either
side, the true error of the corrected command is compared with its certified radius. The radius
should cover 95 % of the errors.

By default the session follows the plan `identify` and is fitted by geometry alone; payload and
temperature are those of the session. With `--diagnosed` the session follows the plan `rich` and is
diagnosed. The extended calibration is then tested at other payloads and temperatures as well,
within the measured range. With `--later` the machine is calibrated without the cause; the radius
is that of the calibration held against a later session, with another tracker frame and the cause.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.data import Conditions, Poses, collect, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.errors import ReachError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.report import Examined, examined_by, examined_fit
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, effect_options, simulate_session
from delta_calibration.simulation.machine import TrueMachine
from delta_calibration.simulation.visit import visited

CAUSES = ("none", "backlash", "transmission_error", "encoder_eccentricity", "cable_sag")
HAVE = {  # causes that each robot can have
    "srbd": CAUSES[:4],
    "linear_delta": CAUSES[:3],
    "five_axis": CAUSES[:3],
    "scara": CAUSES[:4],
    "ur10": CAUSES[:4],
    "cdpr8": ("none", "encoder_eccentricity", "cable_sag"),
}
LOADED = {  # also causes that depend on payload and temperature
    "srbd": ("none", "backlash", "joint_compliance", "thermal_growth_arm"),
    "linear_delta": ("none", "backlash", "transmission_error"),
    "five_axis": ("none", "backlash", "transmission_error"),
    "scara": ("none", "backlash", "transmission_error"),
    "ur10": ("none", "backlash", "transmission_error"),
    "cdpr8": ("none", "cable_elasticity", "cable_sag"),
}
_PLACES = 300
_DAY = 60  # of the later session, which decides its tracker frame
_OTHER_NOISE = 77_777  # added to the seed for the noise of the later session

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Coverage:
    """Coverage of one machine."""

    covered: float  # share of true errors within the certified radius
    error: float  # [m] RMS of the true errors
    radius: float  # [m] median


def coverage(robot_name: str, cause: str, seed: int, count: int = 40) -> Coverage:
    """Measure one machine, fit it, and test it at other places."""
    robot = load_robot(robot_name)
    machine = _machine(robot_name, cause, seed)
    poses = _poses(machine, seed, count)
    examined = examined_fit(identify(poses, robot, seed=seed), poses, robot)
    rng = np.random.default_rng([seed, 7])
    return _held_against(machine, examined, examined.conditions(_joints(examined, rng)), rng)


def diagnosed(robot_name: str, cause: str, seed: int) -> Coverage:
    """Measure and diagnose one machine, and test it at other payloads and temperatures as well."""
    robot = load_robot(robot_name)
    machine = _machine(robot_name, cause, seed)
    session = simulate_session(machine, make_plan("rich", robot, seed=seed), seed, warming=True)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    found = diagnose(seen, robot, seed=seed)
    examined = examined_fit(found.identification, seen.poses, robot)
    rng = np.random.default_rng([seed, 7])
    at = _elsewhere(examined, examined.conditions(_joints(examined, rng)), rng)
    return _held_against(machine, examined, at, rng)


def later(robot_name: str, cause: str, seed: int, count: int = 40) -> Coverage:
    """Calibrate one machine without the cause, and certify it by a later session with it."""
    robot = load_robot(robot_name)
    fresh, machine = (_machine(robot_name, each, seed) for each in ("none", cause))
    theta, frame = machine.theta.copy(), machine.chain.layout.frame
    theta[frame] = visited(machine, robot, seed, _DAY).theta[frame]
    machine = replace(machine, theta=theta)
    seeds = (seed, seed + _OTHER_NOISE)
    poses = [_poses(each, s, count) for each, s in zip((fresh, machine), seeds, strict=True)]
    with TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.yaml"
        save_calibration(file, identify(poses[0], robot, seed=seed), robot, poses[0])
        examined = examined_by(load_calibration(file, robot), poses[1], robot)
    rng = np.random.default_rng([seed, 7])
    return _held_against(machine, examined, examined.conditions(_joints(examined, rng)), rng)


def _poses(machine: TrueMachine, seed: int, count: int) -> Poses:
    robot = machine.robot
    plan = make_plan("identify", robot, count=count, seed=seed)
    session = simulate_session(machine, plan, seed)
    return collect(session, robot.joints.names, robot.commanded.joint_size)


def _machine(robot_name: str, cause: str, seed: int) -> TrueMachine:
    hidden = [] if cause == "none" else [effect_options(cause)]
    return draw_machine(load_robot(robot_name), seed, hidden=hidden)


def _joints(examined: Examined, rng: np.random.Generator) -> Array:
    inside = examined.region.sample(_PLACES, 0.0, rng)[len(examined.region.vertices) :]
    joint = examined.joints_at(examined.tools(inside))
    return np.asarray(joint[np.isfinite(joint).all(axis=1)])


def _elsewhere(examined: Examined, at: Conditions, rng: np.random.Generator) -> Conditions:
    """Draw payloads and temperatures between the smallest and the largest that were measured."""
    poses, n = examined.poses, len(at)
    load = rng.uniform(poses.payload.min(), poses.payload.max(), n)
    warm = at.temperature
    if poses.temperature_parts:
        low, high = np.nanmin(poses.temperature, axis=0), np.nanmax(poses.temperature, axis=0)
        warm = low + (high - low) * rng.uniform(size=(n, 1))
    return replace(at, payload=load, temperature=warm)


def _held_against(
    machine: TrueMachine, examined: Examined, at: Conditions, rng: np.random.Generator
) -> Coverage:
    """Compare true errors with radii; the compensator knows the side of approach."""
    shape, own = at.joint.shape, examined.identified.machine
    known = replace(at, direction=rng.choice([-1.0, 1.0], shape), travel=np.full(shape, np.inf))
    rest = machine.robot.joints.repeatability * rng.standard_normal(shape)
    truly = machine.reflector_points(replace(known, joint=at.joint + rest))
    error = np.linalg.norm(truly - own.chain.predict(known, own.theta), axis=1)
    radius = examined.identified.radius(known)
    return Coverage(
        float(np.mean(error <= radius)),
        float(np.sqrt(np.mean(error**2))),
        float(np.median(radius)),
    )


def table(
    robots: Sequence[str],
    seed: int,
    machines: int,
    measured: Callable[[str, str, int], Coverage],
    causes: Mapping[str, Sequence[str]],
) -> Iterator[str]:
    """Yield a line per robot and cause; the standard error is from the scatter of machines."""
    yield f"{'robot':<14}{'hidden':<22}{'covered':>15}{'least':>8}{'error':>12}{'95 %':>11}"
    for name in robots:
        for cause in causes[name]:
            found = list(islice(_possible(measured, name, cause, seed), machines))
            share = 100 * np.array([each.covered for each in found])
            error, radius = (np.mean([getattr(f, k) for f in found]) for k in ("error", "radius"))
            spread = np.std(share, ddof=1) / np.sqrt(machines) if machines > 1 else np.nan
            yield (
                f"{name:<14}{cause:<22}{np.mean(share):>6.1f} +- {spread:.1f} %"
                f"{min(share):>6.0f} %"
                f"{1e3 * error:>9.4f} mm{1e3 * radius:>8.4f} mm"
            )


def _possible(
    measured: Callable[[str, str, int], Coverage], name: str, cause: str, seed: int
) -> Iterator[Coverage]:
    """Measure one machine after the other; skip those that cannot execute the plan."""
    for each in count(seed):
        try:
            yield measured(name, cause, each)
        except ReachError:  # cables that would become slack
            continue


@click.command()
@click.option("--robots", default=",".join(known_robots()), show_default=True)
@click.option("--machines", default=10, show_default=True, type=click.IntRange(min=1))
@click.option("--seed", default=0, show_default=True, help="Seed of the first machine.")
@click.option("--diagnosed", "extended", is_flag=True, help="Use rich sessions and diagnose them.")
@click.option("--later", "changed", is_flag=True, help="Certify by a session after a change.")
def main(robots: str, machines: int, seed: int, extended: bool, changed: bool) -> None:
    """Print the coverage of certified positions by robot and hidden cause."""
    measured, causes = (diagnosed, LOADED) if extended else (later if changed else coverage, HAVE)
    for line in table(robots.split(","), seed, machines, measured, causes):
        click.echo(line)


if __name__ == "__main__":
    main()
