"""How often a circle test alone names a hidden cause, and whether its predictions are right.

    python benchmarks/circles.py [--machines 200] [--seed 1] [--robots srbd,...] [--json FILE]
    python benchmarks/circles.py --clean --machines 100 --seed 3

Machines are drawn from the robots in turn, each with its own dimensions. Three of four have one
cause hidden at one place, of 0.1 to 3 times its typical size. Each is measured by the plan
`circles` alone and diagnosed. The table counts:

    right       machines with lambda >= 80 beside the geometry in which the cause is named or is
                among those listed as indistinguishable; separately, those where it is named itself
    alarms      machines without a cause in which a cause beyond the geometry is named;
                separately, those in which unknown structure is reported
    shares      largest difference between the sum of the shares and the whole deviation
    foretold    predicted mean circular deviation after a repair, compared with that of the same
                simulated machine without the cause (only causes that are named correctly); and
                after compensating all dimensions, compared with that of the same machine
                with nominal parts

With --clean no machine has a hidden cause and nothing is repaired; only alarms are counted.

Seeds are --seed * 10^5 and the following ones; they are used only here.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections import defaultdict
from dataclasses import asdict
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import beta

from delta_calibration.circle_test import DIMENSIONS, CircleTest, circle_test, measured_circles
from delta_calibration.data import Session, Survey, survey
from delta_calibration.diagnosis import calibrated, diagnose
from delta_calibration.diagnosis.candidates import Candidate, columns_of
from delta_calibration.diagnosis.model import Model
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.errors import CalibrationError, InputError
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session

SURE = 80.0  # lambda
_GEOMETRY = "geometry"
_SIZES = 0.1, 3.0
_ANEW = 50_000  # offset between the seeds of a session and of the one after the repair
_MATTERS = 0.1  # smallest change by a repair that is counted, as a fraction of the deviation


def drive(machine: TrueMachine, seed: int) -> tuple[Session, Survey]:
    """Run the circle test of a machine."""
    robot = machine.robot
    session = simulate_session(machine, make_plan("circles", robot), seed)
    return session, survey(session, robot.joints.names, robot.commanded.joint_size)


def hidden_in(robot: Robot, rng: np.random.Generator) -> dict[str, dict[str, str]]:
    """Draw a cause with its options; one of four machines gets none."""
    effects = catalogue(robot, robot.detailed)
    effect = effects[rng.integers(len(effects))]
    places = sorted({p.location for p in effect.parameters if p.location})
    size = float(np.exp(rng.uniform(*np.log(_SIZES))))
    options = {"strength": f"{size:.4f}"}
    if places:
        options["location"] = str(rng.choice(places))
    return {effect.cause: options} if rng.random() > 0.25 else {}


def possible(
    robot: Robot, seed: int, hidden: dict[str, dict[str, str]]
) -> dict[str, dict[str, str]]:
    """Halve the strength of the hidden cause until such a machine can be drawn."""
    while True:
        try:
            draw_machine(robot, seed, hidden=hidden)
        except InputError:
            for options in hidden.values():
                options["strength"] = f"{float(options['strength']) / 2:.4f}"
        else:
            return hidden


def signal(start: Model, machine: TrueMachine, options: dict[str, str]) -> float:
    """Lambda of the hidden cause beside the geometry."""
    (hidden,) = machine.chain.effects
    effect = effect_named(hidden.cause, machine.robot, start.bare.mechanism, hidden.settings)
    place = options.get("location")
    rows = tuple(i for i, p in enumerate(effect.parameters) if place in (None, p.location))
    true = machine.theta[machine.chain.layout.effects] / effect.parameters.prior
    column = columns_of(Candidate(effect.cause, "", place, effect, rows), start.evidence)
    return float(true[list(rows)] @ start.evidence.information(column) @ true[list(rows)])


def mean_deviation(machine: TrueMachine, seed: int) -> float:
    """Mean circular deviation of a machine in a new measurement with other noise [m]."""
    session, seen = drive(machine, seed + _ANEW)
    circles = measured_circles(session, machine.robot, calibrated(seen, machine.robot))
    return float(np.mean([m.deviation for m in circles]))


def one(name: str, seed: int, clean: bool) -> dict[str, Any]:
    """Test one machine; return what was hidden and what was found."""
    rng = np.random.default_rng(seed)
    robot = load_robot(name)
    hidden = {} if clean else possible(robot, seed, hidden_in(robot, rng))
    machine = draw_machine(robot, seed, hidden=hidden)
    session, seen = drive(machine, seed)
    begin = time.perf_counter()
    test = circle_test(session, robot, diagnose(seen, robot))
    told: dict[str, Any] = {
        "robot": name,
        "seed": seed,
        "hidden": hidden,
        "findings": [[f.cause, f.location, list(f.equivalents)] for f in test.verdict.findings],
        "unknown": test.verdict.unknown_structure.found,
        "structure": asdict(test.verdict.unknown_structure),
        "deviation_um": 1e6 * test.deviation,
        "off": max(_off(test)),
        "seconds": time.perf_counter() - begin,
    }
    for cause, options in hidden.items():
        told["lambda"] = signal(calibrated(seen, robot), machine, options)
        for finding in test.verdict.findings:
            key = finding.cause, finding.location
            if finding.cause == cause and key in test.circles[0].without:
                repaired = draw_machine(robot, seed)
                told["repair"] = [test.without(*key), mean_deviation(repaired, seed)]
    if (DIMENSIONS, None) in test.circles[0].without and not clean:
        as_drawn = draw_machine(robot, seed, scatter=0.0, hidden=hidden)
        told["drawn"] = [test.without(DIMENSIONS, None), mean_deviation(as_drawn, seed)]
    return told


def _changed(e: dict[str, Any]) -> float:
    return abs(1e-6 * e["deviation_um"] / e["repair"][1] - 1)


def _off(test: CircleTest) -> list[float]:
    """Distance of each circle's sum of shares from 1, relative to the deviation."""
    return [abs(sum(s.size for s in m.shares) / m.deviation - 1) for m in test.circles]


def judged(told: list[dict[str, Any]]) -> None:
    """Print the table."""
    head = ("robot", "machines", "lambda >= 80", "right", "first", "clean", "alarms", "unknown")
    print("".join(f"{h:>13}" for h in head))
    rows = defaultdict(list)
    for each in told:
        rows[each["robot"]].append(each)
        rows["all"].append(each)
    for name in [*sorted(set(rows) - {"all"}), "all"]:
        every = rows[name]
        sure = [e for e in every if e.get("lambda", 0.0) >= SURE]
        clean = [e for e in every if not e["hidden"]]
        alarms = [e for e in clean if any(f[0] not in _OF_PARTS for f in e["findings"])]
        counts = len(every), len(sure), sum(map(right, sure)), sum(map(first, sure))
        unknown = sum(e["unknown"] for e in clean)
        numbers = *counts, len(clean), len(alarms), unknown
        print(f"{name:>13}" + "".join(f"{n:>13}" for n in numbers))
    clean = [e for e in told if not e["hidden"]]
    named = sum(any(f[0] not in _OF_PARTS for f in e["findings"]) for e in clean)
    either = sum(_alarm(e) for e in clean)
    for what, count in (("a cause named", named), ("any alarm", either)):
        low, high = between(count, len(clean))
        print(
            f"{what} without a cause: {count} of {len(clean)}, "
            f"95 % between {100 * low:.1f} and {100 * high:.1f} %"
        )
    print(f"shares deviate from the whole by at most {max(e['off'] for e in told):.1e}")
    matter = [e for e in told if "repair" in e and _changed(e) >= _MATTERS]
    for key, of, what in (
        ("repair", told, "the named cause repaired"),
        ("repair", matter, "the same where that changes the deviation by 10 % or more"),
        ("drawn", told, "all dimensions right"),
    ):
        off = np.array([e[key][0] / e[key][1] - 1 for e in of if key in e])
        if off.size:
            within = int((np.abs(off) <= 0.1).sum())
            median = 100 * np.median(np.abs(off))
            print(
                f"{what}: {within} of {off.size} predicted within 10 %, median {median:.1f} % off"
            )
    print(f"{np.median([e['seconds'] for e in told]):.1f} s a session (median)")
    for e in told:
        if e.get("lambda", 0.0) >= SURE and not right(e):
            print(
                f"  {e['robot']} seed {e['seed']} {e['hidden']} lambda {e['lambda']:.0f}: ", end=""
            )
            print(e["findings"], "unknown" if e["unknown"] else "")
        if not e["hidden"] and _alarm(e):
            print(f"  alarm: {e['robot']} seed {e['seed']}: {e['findings']} {e.get('structure')}")


# Every drawn machine has its own dimensions and its own reflector offset.
_OF_PARTS = {
    _GEOMETRY,
    "smr_offset",
    *(
        p.cause
        for name in ("srbd", "linear_delta", "scara")
        for p in load_robot(name).detailed.parameters
    ),
}


def _alarm(e: dict[str, Any]) -> bool:
    """Whether anything beyond dimensions and reflector offset is reported."""
    return e["unknown"] or any(f[0] not in _OF_PARTS for f in e["findings"])


def between(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a rate (Clopper and Pearson 1934, Biometrika 26, 404-413)."""
    low = beta.ppf(0.025, count, of - count + 1) if count else 0.0
    high = beta.ppf(0.975, count + 1, of - count) if count < of else 1.0
    return float(low), float(high)


def right(e: dict[str, Any]) -> bool:
    """Whether the hidden cause is named, or listed as indistinguishable from a finding."""
    (cause,) = e["hidden"]
    return any(cause in (f[0], *f[2]) for f in e["findings"])


def first(e: dict[str, Any]) -> bool:
    """Whether the hidden cause itself is a finding."""
    (cause,) = e["hidden"]
    return any(cause == f[0] for f in e["findings"])


def main() -> None:
    """Run the study; machines whose results are already in the file are not repeated."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robots", default="srbd,linear_delta,scara")
    parser.add_argument("--clean", action="store_true", help="hide nothing in any machine")
    parser.add_argument(
        "--json", type=Path, default=None, help="file for the results, one JSON line per machine"
    )
    options = parser.parse_args()
    robots, told = options.robots.split(","), []
    if options.json is not None and options.json.exists():
        told = [json.loads(line) for line in options.json.read_text().splitlines()]
    for number in range(len(told), options.machines):
        name, seed = robots[number % len(robots)], options.seed * 10**5 + number
        try:
            each = one(name, seed, options.clean)
        except CalibrationError as error:
            print(f"{name} seed {seed}: {error}", flush=True)
            raise
        told.append(each)
        if options.json is not None:
            with options.json.open("a") as file:
                file.write(json.dumps(each) + "\n")
    judged(told)


if __name__ == "__main__":
    main()
