"""Benefit and cost of a fleet: priors, throughput, the page.

python benchmarks/fleet.py --priors [--spread 0.1] [--noise 10] [--machines 30] [--trials 8] python
benchmarks/fleet.py --effects --noise 1 [--spread 0.1] [--machines 20] [--trials 6] python
benchmarks/fleet.py --throughput python benchmarks/fleet.py --scale python benchmarks/fleet.py
--page fleet.html
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from delta_calibration.robot import load_robot
from fleet_parts.effects import effects
from fleet_parts.page import page
from fleet_parts.priors import priors
from fleet_parts.scale import scale, throughput
from fleet_parts.shared import shared


def main() -> None:
    """Run the benchmarks that are selected by options."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--priors", action="store_true")
    parser.add_argument("--effects", action="store_true")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--shared", type=int, default=0, metavar="FLEETS")
    parser.add_argument("--throughput", action="store_true")
    parser.add_argument("--most", type=int, default=2, help="largest number of workers")
    parser.add_argument("--scale", action="store_true")
    parser.add_argument(
        "--sessions", type=int, default=100, help="sessions per machine, for --scale"
    )
    parser.add_argument("--robot", default="srbd")
    parser.add_argument("--spread", type=float, default=0.1)
    parser.add_argument("--machines", type=int, default=30)
    parser.add_argument("--places", type=int, default=48, help="places per machine of the fleet")
    parser.add_argument("--trials", type=int, default=8)
    parser.add_argument(
        "--noise", type=float, default=10.0, help="noise as a multiple of the tracker's"
    )
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    robot = load_robot(given.robot)
    tracker = robot.tracker
    robot = replace(
        robot,
        tracker=replace(
            tracker,
            radial=given.noise * tracker.radial,
            transverse=given.noise * tracker.transverse,
            transverse_per_metre=given.noise * tracker.transverse_per_metre,
        ),
    )
    if given.throughput:
        throughput(robot, given.most)
    if given.scale:
        scale(robot, given.machines if given.machines > 30 else 10_000, given.sessions)
    if given.shared:
        shared(given.shared, given.seed)
    if given.page is not None:
        page(robot, given.page, given.seed)
    if given.effects:
        print(f"{robot.name}, noise {given.noise:g} times the tracker's, seed {given.seed}")
        effects(robot, given.spread, given.machines, given.trials, given.seed)
    if given.priors:
        print(f"{robot.name}, noise {given.noise:g} times the tracker's, seed {given.seed}")
        priors(robot, given.spread, given.machines, given.places, given.trials, given.seed)


if __name__ == "__main__":
    main()
