"""Continual calibration: an update with three tenths of the poses against a full calibration.

Each history is a simulated machine whose dimensions drift from day to day (a random walk). It is
measured on several days, with tracker and reflector set up again each time. On the next day it is
measured with the few poses of an update, chosen from the history, and with a full plan; both are
compared at poses that neither has used. In every second history a parameter steps before that day.

    python benchmarks/continual.py [--histories 10] [--seed 0] [--count 18] [--whole 60]
        [--sessions 12] [--speed 0.01]
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses, survey
from delta_calibration.estimation import Carried, Identification, identify
from delta_calibration.history import Dated, prospect
from delta_calibration.plans import Plan, make_plan
from delta_calibration.plans.renewal import renewal_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, visited
from history import KINDS, SESSIONS, Hidden, drifted

Array = NDArray[np.float64]

BEGAN = datetime(2026, 1, 1, tzinfo=timezone.utc)
HELD = 100  # poses that no fit uses


@dataclass(frozen=True)
class Drifting:
    """A machine whose dimensions follow a random walk of `speed` tolerances per session."""

    robot: Robot
    seed: int
    speed: float
    change: Hidden | None

    def on(self, day: int) -> TrueMachine:
        """The machine on a given day, with the tracker set up for that day."""
        causes = []
        if self.change is not None and day > self.change.gap:
            size = str(self.change.size)
            causes = [(self.change.what, {"location": self.change.location, "value": size})]
        machine = draw_machine(self.robot, self.seed, 1.0, causes)
        machine = drifted(machine, self.seed, day, self.speed)
        return visited(machine, self.robot, self.seed, day + 1)

    def dated(self, day: int, plan: Plan) -> Dated:
        """Session of a given day."""
        recorded = simulate_session(self.on(day), plan, self.seed + 1_000_003 * (day + 1))
        joints = self.robot.joints.names
        seen = survey(recorded, joints, self.robot.commanded.joint_size)
        return Dated(f"day_{day}", BEGAN + timedelta(days=day), seen)


def held_out(found: Identification, poses: Poses) -> float:
    """RMS distance between measured poses and the predictions of a fit of the same set-up [m]."""
    missed = poses.point - found.chain.predict(poses.conditions, found.theta)
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def drawn(rng: np.random.Generator, sessions: int) -> Hidden:
    """Draw a step before the last session."""
    what = str(rng.choice(list(KINDS)))
    size = float(KINDS[what] * rng.uniform(0.5, 2.0))
    return Hidden(what, f"joint_{rng.integers(1, 4)}", sessions - 1, size)


def main() -> None:
    """Draw histories, update them and print the errors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=10)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=18)
    parser.add_argument("--whole", type=int, default=60)
    parser.add_argument("--sessions", type=int, default=SESSIONS)
    parser.add_argument("--speed", type=float, default=0.01)
    parser.add_argument("--robot", default="srbd")
    given = parser.parse_args()
    robot = load_robot(given.robot)
    ratios: dict[bool, list[float]] = {False: [], True: []}
    told = {False: 0, True: 0}
    for number in range(given.histories):
        seed = 1000 * given.seed + number
        rng = np.random.default_rng([seed, 20])
        change = drawn(rng, given.sessions) if number % 2 else None
        machine = Drifting(robot, seed, given.speed, change)
        whole = make_plan("identify", robot, count=given.whole, seed=seed)
        old = [machine.dated(day, whole) for day in range(given.sessions)]
        known = prospect(old, robot).carried
        update = renewal_plan(robot, known, given.count, seed=seed).plan
        new = machine.dated(given.sessions, update)
        again = machine.dated(given.sessions, whole)
        held = machine.dated(
            given.sessions, make_plan("identify", robot, count=HELD, seed=seed + 7)
        ).survey.poses
        now = prospect(old, robot, new)
        poses = new.survey.poses
        error = {
            "update": held_out(identify(poses, robot, carried=now.carried), held),
            "whole": held_out(identify(again.survey.poses, robot), held),
            "whole with history": held_out(
                identify(again.survey.poses, robot, carried=prospect(old, robot, again).carried),
                held,
            ),
            "few alone": held_out(identify(poses, robot), held),
            "old": held_out(_placed(poses, robot, known), held),
        }
        seen = now.changed_now(new.name)
        best = min(error["whole"], error["whole with history"])
        ratios[change is not None].append(error["update"] / best)
        told[change is not None] += bool(seen)
        print(
            f"{seed}: "
            + ", ".join(f"{name} {1e6 * value:.1f} um" for name, value in error.items())
            + f"; hidden {change.what + ' ' + change.location if change else '-'}"
            + f" | told {', '.join(f'{c.what} {c.location}' for c in seen) or '-'}"
            + (f" | believed {now.odd:.1f} times less" if now.odd > 1 else ""),
            flush=True,
        )
    share = given.count / given.whole
    print(f"{given.count} places of {given.whole} ({100 * share:.0f} % of the poses)")
    for stepped, values in ratios.items():
        if values:
            print(
                f"{'something stepped' if stepped else 'nothing stepped'}: held-out error of the "
                f"update over that of the better whole fit: median {np.median(values):.3f}, worst "
                f"{max(values):.3f}; {np.sum(np.array(values) < 1.1)} of {len(values)} within "
                f"10 %; change told in {told[stepped]}"
            )


def _placed(poses: Poses, robot: Robot, known: Carried) -> Identification:
    """The machine as known from the history; the new poses determine only the set-up."""
    return identify(poses, robot, carried=replace(known, covariance=1e-12 * known.covariance))


if __name__ == "__main__":
    main()
