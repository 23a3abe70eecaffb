"""Hidden histories: how often a change and its time are reported correctly, and how often falsely.

Each history is a simulated machine, measured on twelve days with tracker and reflector set up
again each time. None, one or two of its parameters step in randomly drawn gaps, by sizes drawn
evenly in their logarithm. With --speed all dimensions also drift from day to day. With --few only
every fourth session is a full one; the others have this number of places, chosen after the first
session by `plan --update`. The search knows nothing of what was hidden. A change counts if its
signal is strong enough: lambda is the decrease of chi square that the true step would bring,
computed from the information of these sessions.

    python benchmarks/history.py [--histories 20] [--seed 0] [--plan identify] [--count 30]
        [--smallest 0.3] [--speed 0] [--few 0]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone

import numpy as np

from delta_calibration.data import survey
from delta_calibration.history import Dated, Step, Steps, find_changes, prospect
from delta_calibration.history.few import pool
from delta_calibration.plans import make_plan
from delta_calibration.plans.renewal import renewal_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, visited

STRONG = 80.0  # lambda
SESSIONS = 12
WHOLE = 4  # with --few, one session in this many is a full one
BEGAN = datetime(2026, 1, 1, tzinfo=timezone.utc)
# parameters that may step, and their typical sizes
KINDS = {
    "backlash": 1.5e-4,
    "joint_zero_offset": 2e-4,
    "arm_length": 5e-5,
    "forearm_length": 5e-5,
    "joint_compliance": 1.5e-5,
}


@dataclass(frozen=True)
class Hidden:
    """A change of the machine."""

    what: str
    location: str
    gap: int
    size: float


def drawn(rng: np.random.Generator, smallest: float) -> tuple[Hidden, ...]:
    """Draw none, one or two changes of different causes, of `smallest` to two typical sizes."""
    count = int(rng.integers(3))
    what = rng.choice(list(KINDS), count, replace=False)
    return tuple(
        Hidden(
            str(name),
            f"joint_{rng.integers(1, 4)}",
            int(rng.integers(SESSIONS - 1)),
            float(KINDS[str(name)] * np.exp(rng.uniform(np.log(smallest), np.log(2.0)))),
        )
        for name in what
    )


def drifted(machine: TrueMachine, seed: int, day: int, speed: float) -> TrueMachine:
    """The machine after some days; its dimensions walk randomly by `speed` tolerances a day."""
    theta, own = machine.theta.copy(), machine.chain.layout.geometry
    prior = machine.chain.parameters.prior[own]
    steps = np.random.default_rng([seed, 19]).standard_normal((SESSIONS + 1, len(prior)))
    theta[own] += speed * prior * steps[:day].sum(axis=0)
    return replace(machine, theta=theta)


def sessions_of(
    robot: Robot,
    seed: int,
    changes: Sequence[Hidden],
    plan: str,
    count: int | None,
    speed: float = 0.0,
    few: int = 0,
) -> list[Dated]:
    """Sessions of one machine, one per day."""
    whole = poses = make_plan(plan, robot, count=count, seed=seed)
    sessions: list[Dated] = []
    for day in range(SESSIONS):
        causes = [
            (c.what, {"location": c.location, "value": str(c.size)})
            for c in changes
            if day > c.gap
        ]
        machine = drifted(draw_machine(robot, seed, 1.0, causes), seed, day, speed)
        machine = visited(machine, robot, seed, day + 1)
        if few and day == 1:
            poses = renewal_plan(robot, prospect(sessions, robot).carried, few, seed=seed).plan
        now = poses if day % WHOLE else whole
        recorded = simulate_session(machine, now, seed + 1_000_003 * (day + 1))
        seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
        sessions.append(Dated(f"day_{day}", BEGAN + timedelta(days=day), seen))
    return sessions


def signals(steps: Steps, changes: Sequence[Hidden]) -> list[float]:
    """Lambda of each true change beside the others, from the information of the sessions."""
    own = [_step(steps, change) for change in changes]
    found = []
    for step, change in zip(own, changes, strict=True):
        _, information = steps.still.stepped(s for s in own if s is not step).shift(step)
        size = change.size / steps.kept[step.rows[0]].scale
        found.append(size**2 * float(information[0, 0]))
    return found


def _step(steps: Steps, change: Hidden) -> Step:
    return next(
        s for s in steps.candidates if steps.key(s) == (change.what, change.location, change.gap)
    )


def main() -> None:
    """Draw histories, search them, print the rates."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--histories", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--plan", default="identify")
    parser.add_argument("--count", type=int, default=None)
    parser.add_argument("--smallest", type=float, default=0.3)
    parser.add_argument("--speed", type=float, default=0.0)
    parser.add_argument("--few", type=int, default=0)
    parser.add_argument("--robot", default="srbd")
    given = parser.parse_args()
    robot = load_robot(given.robot)
    strong = named = false = beside = right_gap = sessions = inside = 0
    weak, seen = 0, 0
    for number in range(given.histories):
        seed = 1000 * given.seed + number
        changes = drawn(np.random.default_rng([seed, 18]), given.smallest)
        dated = sessions_of(robot, seed, changes, given.plan, given.count, given.speed, given.few)
        found = find_changes(dated, robot)
        told = {(c.what, c.location, int(c.after[4:])): c for c in found.changes}
        true = {(c.what, c.location, c.gap): c for c in changes}
        lambdas = []
        if changes:
            whole = pool(dated, robot)
            lambdas = signals(Steps(whole.kept, whole.parts), changes)
        for (key, change), value in zip(true.items(), lambdas, strict=True):
            if value < STRONG:
                weak += 1
                seen += key in told
                continue
            strong += 1
            named += key in told
            right_gap += key[2] in {gap for *_, gap in told}
            if key in told:
                off = abs(told[key].to - told[key].from_ - change.size)
                inside += off < 1.96 * told[key].std
        gaps = {c.gap for c in changes}
        false += sum(gap not in gaps for *_, gap in told)
        beside += sum(key not in true and key[2] in gaps for key in told)
        sessions += SESSIONS
        print(
            f"{seed}: hidden "
            + (", ".join(f"{k} lambda {v:.0f}" for k, v in zip(true, lambdas, strict=True)) or "-")
            + " | told "
            + (", ".join(f"{k} {c.confidence:.2f}" for k, c in told.items()) or "-"),
            flush=True,
        )
    print(f"{given.histories} histories, {sessions} sessions, plan {given.plan}")
    print(f"changes of lambda >= {STRONG:g}: {strong}; weaker ones: {weak}, of them named {seen}")
    if strong:
        print(f"cause, place and gap right: {named} of {strong} ({100 * named / strong:.0f} %)")
        print(f"gap right, whatever the name: {right_gap} of {strong}")
        print(f"true size inside the 95 % interval: {inside} of {named}")
    print(f"false changes (in a gap where nothing changed): {false} in {sessions} sessions")
    print(f"false names (in a gap where something else changed): {beside}")


if __name__ == "__main__":
    main()
