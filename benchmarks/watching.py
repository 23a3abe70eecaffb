"""Monitoring of a calibrated machine: false alarms in simulated years, and delay of detection.

A machine visits the same places every day, with tracker and reflector set up again each time. The
rest errors of a place are correlated from visit to visit and from day to day (correlation 0.9). In
the second part an arm is longer from the first day on; lambda is the decrease of chi square that
this causes in the first day's readings.

    python benchmarks/watching.py [--years 4] [--rate 0.1] [--places 12] [--visits 2] [--seed 0]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import from_identification
from delta_calibration.cell.vigil import Vigil
from delta_calibration.data import Poses, collect
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, visited

DAY_NS = 86_400_000_000_000
ALIKE = 0.9
COUNT = 20  # readings averaged at a stop
SIZES = (2e-5, 3e-5, 4e-5, 6e-5, 8e-5, 1.2e-4)  # [m]


def days(
    machine: TrueMachine, robot: Robot, program: Poses, seed: int, visits: int
) -> Iterator[Poses]:
    """Yield the readings of one day after the other."""
    rng, n = np.random.default_rng([seed, 21]), len(program)
    index, spread = np.tile(np.arange(n), visits), robot.joints.repeatability
    rows = ("joint", "command", "point", "scatter", "direction", "travel", "place", "repeat")
    more = ("payload", "payload_centre", "temperature")
    whole = replace(
        program,
        time=10.0 * np.arange(len(index)),
        count=np.full(len(index), COUNT),
        **{name: getattr(program, name)[index] for name in rows + more},
    )
    rest = spread * rng.standard_normal(program.joint.shape)
    day = 0
    while True:
        here, errors = visited(machine, robot, seed, 1 + day), []
        for _ in range(visits):
            rest = ALIKE * rest
            rest += np.sqrt(1 - ALIKE**2) * spread * rng.standard_normal(rest.shape)
            errors.append(rest)
        at = replace(whole.conditions, joint=whole.joint + np.concatenate(errors))
        ideal = here.chain.predict(at, here.theta)
        _, across = robot.tracker.sigmas(np.linalg.norm(ideal, axis=1))
        noise = across[:, None] / np.sqrt(COUNT) * rng.standard_normal(ideal.shape)
        yield replace(whole, start_ns=program.start_ns + day * DAY_NS, point=ideal + noise)
        day += 1


def main() -> None:
    """Simulate years, then changes; print the alarms."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--years", type=int, default=4)
    parser.add_argument("--rate", type=float, default=0.1)
    parser.add_argument("--places", type=int, default=12)
    parser.add_argument("--visits", type=int, default=2)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    robot = load_robot("srbd")
    alarms = looked = 0
    for year in range(given.years):
        seed = 1000 * given.seed + year
        machine, calibration, program = calibrated(robot, seed, given.places)
        vigil = Vigil(calibration, given.rate)
        for _, poses in zip(
            range(365), days(machine, robot, program, seed, given.visits), strict=False
        ):
            vigil.set_up()
            if vigil.take(poses).changed:
                alarms, looked = alarms + 1, looked + vigil.stops
                vigil = Vigil(calibration, given.rate)
        looked += vigil.stops
    allowed = 12 * given.rate * given.years
    print(f"{given.years} years, {looked} stops: {alarms} false alarms, {allowed:g} are allowed")
    machine, calibration, program = calibrated(robot, 1000 * given.seed, given.places)
    for size in SIZES:
        theta = machine.theta.copy()
        theta[machine.chain.parameters.names.index("arm_2")] += size
        vigil, seen, signal = Vigil(calibration, given.rate), None, 0.0
        longer = days(replace(machine, theta=theta), robot, program, given.seed, given.visits)
        for day, poses in zip(range(1, 31), longer, strict=False):
            vigil.set_up()
            told = vigil.take(poses)
            signal = signal or vigil.signal("arm_2", size)
            if told.changed:
                seen = day
                break
        when = f"after {vigil.stops} stops, day {seen}" if seen else "never"
        cause = f"{told.cause} {told.location}"
        print(f"arm 2 longer by {1e6 * size:.0f} um, lambda {signal:.0f}: {when}; {cause}")


def calibrated(robot: Robot, seed: int, places: int) -> tuple[TrueMachine, Calibration, Poses]:
    """A machine, its calibration and the places that it visits daily."""
    machine = draw_machine(robot, seed)
    plan = make_plan("identify", robot, count=40, seed=seed)
    poses = collect(simulate_session(machine, plan, seed), robot.joints.names)
    daily = make_plan("identify", robot, count=places, both_sides=False, seed=seed + 1)
    program = collect(simulate_session(machine, daily, seed + 1), robot.joints.names)
    return machine, from_identification(identify(poses, robot), robot, poses), program


if __name__ == "__main__":
    main()
