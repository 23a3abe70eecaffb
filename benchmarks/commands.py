"""Time of one corrected command, with and without effects, and of the forward kinematics.

    python benchmarks/commands.py                 both tables, some minutes
    python benchmarks/commands.py --calls 100     fewer calls for each row

First table: `JointCompensator.compensate(q[:1], at)` by Newton's method, called from Python for
one command after the other, with all conditions known. Only commands that are returned corrected
count. Dimensions and effects have values within their tolerances. Second table: forward kinematics
and identification Jacobian for many poses at once, the shortest of a few repeats.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
import timeit
from collections.abc import Callable, Iterator
from dataclasses import replace

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import Effect, catalogue
from delta_calibration.estimation import chain_of
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import Robot, known_robots, load_robot

Array = NDArray[np.float64]

DELTA, MODELS = "srbd", ("rotary_delta", "six_rod_delta")  # effects are timed with these as well
COMMANDS, SEED = 40, 4
POSES, REPEATS = 2000, 5
PART, WARMTH = "arm", 20e-6  # part with a known temperature; [1/K] its expansion
PAYLOAD = 1.0  # [kg]
AT_ONCE = ("joint_compliance", "thermal_growth_arm", "backlash")  # the row of three
EVERYWHERE = Region(10.0 * (2.0 * np.array(list(np.ndindex(2, 2, 2))) - 1.0))  # [m]


def within(mechanism: Mechanism, rng: np.random.Generator) -> Array:
    """Dimensions (p,) of a machine, drawn with half the tolerances as standard deviation."""
    parameters = mechanism.parameters
    spread = np.where(np.isfinite(parameters.prior), parameters.prior, 0.0)
    return np.asarray(parameters.nominal + 0.5 * spread * rng.standard_normal(len(parameters)))


def known(robot: Robot, model: str | None, effects: tuple[Effect, ...]) -> Calibration:
    """Calibration of such a machine that is valid everywhere."""
    rng = np.random.default_rng(SEED)
    chain = chain_of(robot, model)
    base = chain.join(within(chain.mechanism, rng), np.zeros(3), Frame.identity())
    values = [e.parameters.prior * rng.uniform(0.3, 0.9, len(e.parameters)) for e in effects]
    shaped = tuple(e.refined(v) for e, v in zip(effects, values, strict=True))
    for i, effect in enumerate(shaped):
        if hasattr(effect, "sensor"):
            shaped = (*shaped[:i], replace(effect, sensor=PART), *shaped[i + 1 :])
            values[i] = np.full(len(effect.parameters), WARMTH)
    theta = np.concatenate([base, *values])
    ends = robot.joints.lower, robot.joints.upper
    return Calibration(
        robot, chain.with_effects(shaped), theta, EVERYWHERE, *ends, 1e-5, "drawn", "seal"
    )


def conditions(q: Array) -> Conditions:
    """Conditions for commands (n, m) in motion, with a payload and a warm arm."""
    rng, n = np.random.default_rng(SEED), len(q)
    return replace(
        at_rest(q),
        velocity=0.1 * rng.standard_normal(q.shape),
        acceleration=rng.standard_normal(q.shape),
        direction=rng.choice([-1.0, 1.0], q.shape),
        payload=np.full(n, PAYLOAD),
        payload_centre=np.zeros((n, 3)),
        temperature_parts=(PART,),
        temperature=np.full((n, 1), 25.0),
    )


def live(robot: Robot, model: str) -> list[Effect]:
    """Effects of this robot's catalogue for which commands can be corrected."""
    mechanism = chain_of(robot, model).mechanism
    every = catalogue(robot, mechanism)
    return [effect for effect in every if known(robot, model, (effect,)).live]


def cases() -> Iterator[tuple[str, str | None, tuple[Effect, ...]]]:
    """Yield the robots, models and effects that are timed."""
    robot = load_robot(DELTA)
    for model in MODELS:
        yield DELTA, model, ()
        effects = live(robot, model)
        for effect in effects:
            yield DELTA, model, (effect,)
        yield DELTA, model, tuple(e for e in effects if e.cause in AT_ONCE)
    for name in known_robots():
        if name != DELTA:
            yield name, None, ()


def times(calibration: Calibration, calls: int) -> tuple[Array, int]:
    """Times of single commands [us], and the number of the plan's commands that are corrected."""
    robot = calibration.robot
    q = make_plan("identify", robot, count=COMMANDS, both_sides=False).joint
    at, compensator = conditions(q), JointCompensator(calibration)
    singles = [(q[i : i + 1], at.take(slice(i, i + 1))) for i in range(len(q))]
    good = [
        single
        for single in singles
        if compensator.compensate(*single).verdicts[0] is CommandStatus.CORRECTED
    ]
    seconds = np.full(calls if good else 0, np.nan)
    for i in range(len(seconds)):
        command, under = good[i % len(good)]
        begin = time.perf_counter()
        compensator.compensate(command, under)
        seconds[i] = time.perf_counter() - begin
    return 1e6 * seconds, len(good)


def commands(calls: int) -> None:
    """Print the table of single commands."""
    print("| robot | model | effects | p50 [us] | p99 [us] | corrected |")
    print("|---|---|---|---|---|---|")
    for name, model, effects in cases():
        calibration = known(load_robot(name), model, effects)
        found, good = times(calibration, calls)
        p50, p99 = np.percentile(found, [50, 99]) if len(found) else (np.nan, np.nan)
        causes = ", ".join(effect.cause for effect in effects) or "none"
        head = f"| {name} | {calibration.chain.mechanism.name} | {causes} "
        print(f"{head}| {p50:.1f} | {p99:.1f} | {good} of {COMMANDS} |", flush=True)


def direct() -> None:
    """Print the table of forward kinematics and Jacobian."""
    print("\n| model | forward [us a pose] | identification Jacobian [us a pose] |")
    print("|---|---|---|")
    pairs = [(DELTA, model) for model in MODELS]
    pairs += [(name, None) for name in known_robots() if name != DELTA]
    for name, model in pairs:
        robot = load_robot(name)
        mechanism = chain_of(robot, model).mechanism
        plan = make_plan("identify", robot, count=COMMANDS, both_sides=False).joint
        q = np.resize(plan, (POSES, plan.shape[1]))
        g = within(mechanism, np.random.default_rng(SEED))
        x = mechanism.forward(q, g)
        forward = least(lambda m=mechanism, q=q, g=g: m.forward(q, g))
        slope = least(lambda m=mechanism, q=q, x=x, g=g: m.identification_jacobian(q, x, g))
        print(f"| {mechanism.name} | {forward:.2f} | {slope:.2f} |", flush=True)


def least(call: Callable[[], object]) -> float:
    """Time per pose, the shortest of a few repeats [us]."""
    return 1e6 * min(timeit.repeat(call, number=1, repeat=REPEATS)) / POSES


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=5000, help="calls timed for each row")
    commands(parser.parse_args().calls)
    direct()
    return 0


if __name__ == "__main__":
    sys.exit(main())
