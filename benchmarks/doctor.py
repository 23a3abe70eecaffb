"""How many mistakes `delta-cal check` names, and how often it names one where there is none.

    python benchmarks/doctor.py [--robots srbd,...] [--kinds mirrored,...] [--seeds 1]
    python benchmarks/doctor.py --clean 100      sessions without a mistake, with and without a
                                                 hidden effect

Mistakes are made by test/mistakes.py, each kind at two sizes on six robots. A result is right if
it names the mistake, the stream and, where the mistake has them, part and size, and beyond that
only mistakes that the session cannot distinguish from it. `first` counts the cases in which it is
named first. `mended` counts those in which a fit of the repaired session leaves at most 1.5 times
what a fit of the clean session leaves.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1] / "test"))

from delta_calibration.chain import Chain
from delta_calibration.data import collect
from delta_calibration.doctor import check
from delta_calibration.doctor.steps import Fitted
from delta_calibration.errors import CalibrationError
from delta_calibration.robot import load_robot
from delta_calibration.simulation import hideable_causes
from mistakes import KINDS, ROBOTS, clean_case, examined, has_turns, judged

_MENDED = 1.5
_SLOW = 5.0  # [s]


def left_by_a_fit(session, robot) -> float:
    """Median residual distance of a fit of the whole machine [m]."""
    try:
        poses = collect(session, robot.joints.names, robot.commanded.joint_size)
        return Fitted(poses, robot).typical
    except CalibrationError:
        return np.inf


def mistakes(robots, kinds, seeds) -> None:
    """Print the table of mistakes by kind, and what went wrong."""
    count: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0, 0])
    wrong, begun = [], time.time()
    seconds = []
    for name in robots:
        for seed in seeds:
            cases = {turns: clean_case(name, seed, turns) for turns in (False, True)}
            usual = left_by_a_fit(cases[False].session, cases[False].robot)
            for kind in kinds:
                case = cases[has_turns(kind)]
                for size in (0, 1):
                    made = KINDS[kind](case, size)
                    if made is None:
                        continue
                    at = time.time()
                    try:
                        checked = examined(case, made)
                        found = checked.found
                    except CalibrationError as error:
                        checked, found = None, ()
                        wrong.append(f"{name} {kind} {size} seed {seed}: {error}")
                    seconds.append(time.time() - at)
                    if seconds[-1] > _SLOW:
                        print(f"{name} {kind} {size}: {seconds[-1]:.1f} s", flush=True)
                    named, first = judged(found, made)
                    least = usual
                    if made.clean is not None:
                        least = left_by_a_fit(made.clean, case.robot)
                    mended = (
                        checked is not None
                        and left_by_a_fit(checked.session, checked.robot) < _MENDED * least
                    )
                    for k, good in enumerate((True, named, first, mended)):
                        count[kind][k] += good
                    if not named or not mended:
                        said = "; ".join(
                            f"{m.mistake} {m.stream} {m.part} {m.value}" for m in found
                        )
                        what = "named" if named else "NOT NAMED"
                        wrong.append(
                            f"{name} {kind} {size} seed {seed}: {what}, "
                            f"{'mended' if mended else 'not mended'}: {said or 'nothing'}"
                        )
    print(f"{'mistake':<20}{'made':>6}{'right':>7}{'first':>7}{'mended':>8}")
    for kind, row in count.items():
        print(f"{kind:<20}{row[0]:>6}{row[1]:>7}{row[2]:>7}{row[3]:>8}")
    total = np.sum(list(count.values()), axis=0)
    print(f"{'all':<20}{total[0]:>6}{total[1]:>7}{total[2]:>7}{total[3]:>8}")
    named, mended = 100 * total[1] / total[0], 100 * total[3] / total[0]
    print(f"{len(count)} kinds: named right {named:.1f} %, mended {mended:.1f} %")
    usual, most = np.median(seconds), max(seconds)
    print(f"{usual:.2f} s a session (most {most:.1f} s), {time.time() - begun:.0f} s in all")
    print("\n".join(wrong))


def clean(robots, number: int, strength: float) -> None:
    """Check sessions without a mistake, with no effect and with each that can be hidden."""
    cases = (
        (f"{robots[k % len(robots)]} seed {1000 + k}", robots[k % len(robots)], 1000 + k, None)
        for k in range(number)
    )
    claimed = claims(cases, strength)
    print(f"{number} clean sessions: a mistake is claimed in {claimed}", flush=True)
    hidden = [
        (f"{name} {cause}", name, 2000 + k, cause)
        for name in robots
        for k, cause in enumerate(causes_of(name))
    ]
    claimed = claims(hidden, strength)
    print(f"{len(hidden)} with an effect of {strength:g} x its usual size: claimed in {claimed}")


def claims(cases, strength: float) -> int:
    """Number of sessions in which a mistake is reported that was never made."""
    count = 0
    for said, name, seed, cause in cases:
        effects = () if cause is None else {cause: {"strength": str(strength)}}
        case = clean_case(name, seed, turns=seed % 2 == 1, effects=effects)
        found = check(case.session, case.robot).found
        count += bool(found)
        for mistake in found:
            print(f"{said}: {mistake.sentence()}", flush=True)
    return count


def causes_of(name: str) -> list[str]:
    """Effects that can be hidden in a robot."""
    robot = load_robot(name)
    tracker = robot.tracker
    chain = Chain(robot.detailed, tracker.reflector_offset, tracker.reflector_offset_prior)
    every = hideable_causes(robot, chain)
    return [c for c in every if name == "srbd" or c != "base_joint_position"]


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", default=",".join(ROBOTS))
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--clean", type=int, default=0)
    parser.add_argument("--strength", type=float, default=1.0)
    given = parser.parse_args()
    robots = given.robots.split(",")
    if given.clean:
        clean(robots, given.clean, given.strength)
    else:
        mistakes(robots, given.kinds.split(","), [int(s) for s in given.seeds.split(",")])


if __name__ == "__main__":
    main()
