"""Benefit of the priors of a fleet for its next machines.

A hidden population (the mean of a dimension half a tolerance off the drawing, scatter a fraction
of the tolerance) is learnt from fits of its machines. New machines are fitted from few places,
with the drawing's tolerances and with what was learnt as priors. The error is that of the fitted
model at places of the workspace that were not measured, compared with the simulated machine.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import from_identification
from delta_calibration.data import Poses, Survey, survey
from delta_calibration.estimation import Identification, Population, identify
from delta_calibration.fleet.evidence import Fitted, together
from delta_calibration.fleet.population import estimate, expected, kinds_of
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.simulation.machine import TrueMachine, standing

Array = NDArray[np.float64]

PLACES = (6, 8, 10, 12, 16, 20, 24)
FEWEST = 12  # places for a fit with tolerances
MOST = 48  # places of a full measurement
OFF = 0.5  # [tolerances] standard deviation of the population's mean
ODD = 6.0  # [tolerances] deviation of the odd dimension of an odd machine
TESTED = 300  # joint positions at which errors are evaluated


def drawn(robot: Robot, seed: int, deviation: Array) -> TrueMachine:
    """A machine with these dimensions, in tolerances off the drawing, in front of a tracker."""
    machine = draw_machine(robot, seed, 1.0)
    parameters, theta = machine.chain.mechanism.parameters, machine.theta.copy()
    theta[machine.chain.layout.geometry] = parameters.nominal + parameters.prior * deviation
    return replace(machine, theta=theta)


def poses_of(machine: TrueMachine, places: int, seed: int) -> Poses:
    """Poses at rest at this many places, drawn from those of a full measurement."""
    return seen_at(machine, places, seed).poses


def seen_at(machine: TrueMachine, places: int, seed: int) -> Survey:
    """The same, with the motion between the places."""
    robot = machine.robot
    plan = make_plan("identify", robot, count=MOST, seed=seed)
    chosen = np.random.default_rng(seed).permutation(MOST)[:places]
    rows = np.sort(np.concatenate([2 * chosen, 2 * chosen + 1]))  # each from both sides
    plan = replace(
        plan,
        target=plan.target[rows],
        joint=plan.joint[rows],
        direction=plan.direction[rows],
        payload=plan.payload[rows],
    )
    session = simulate_session(machine, plan, seed)
    return survey(session, robot.joints.names, robot.commanded.joint_size)


def error_of(found: Identification, machine: TrueMachine, at: Array) -> float:
    """RMS error of the fitted model at joint positions that were not measured [m]."""
    conditions = standing(at)
    off = found.chain.predict(conditions, found.theta) - machine.reflector_points(conditions)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def priors(
    robot: Robot, spread: float, machines: int, measured: int, trials: int, seed: int
) -> None:
    """Learn a population; print its benefit for new machines and its effect on an odd one."""
    rng = np.random.default_rng([seed, 18])
    size = len(robot.detailed.parameters)
    mean = OFF * rng.standard_normal(size)
    own = spread * rng.uniform(0.5, 1.5, size)

    def like_them() -> Array:
        return np.asarray(mean + own * rng.standard_normal(size))

    fits = []
    for number in range(machines):
        poses = poses_of(drawn(robot, 10_000 * seed + number, like_them()), measured, number)
        found = identify(poses, robot)
        fits.append(Fitted(str(number), (from_identification(found, robot, poses),)))
    learnt = estimate(together(fits), kinds_of(robot.detailed.parameters.names))
    population = expected(learnt.population, learnt.told)
    well = learnt.told > machines / 4
    print(f"{machines} machines of {measured} places, spread {spread:g} tolerances")
    print(
        f"dimensions told: {well.sum()} of {size}; their spread over the true one: median "
        f"{np.median((learnt.population.spread / own)[well]):.2f}; mean off by "
        f"{np.sqrt(np.mean((learnt.population.mean - mean)[well] ** 2)):.3f} tolerances RMS"
    )
    at = make_plan("identify", robot, count=TESTED, both_sides=False, seed=99).joint
    new = [drawn(robot, 10_000 * seed + 5000 + n, like_them()) for n in range(trials)]
    print("places  by tolerances [um]  by the fleet [um]   (median of machines, and largest)")
    for places in PLACES:
        row = []
        for prior in (None, population):
            if prior is None and places < FEWEST:
                row.append("-")
                continue
            errors = [
                error_of(identify(poses_of(m, places, 700 + n), robot, population=prior), m, at)
                for n, m in enumerate(new)
            ]
            row.append(f"{1e6 * np.median(errors):6.1f} {1e6 * max(errors):8.1f}")
        print(f"{places:6d}  {row[0]:>18}  {row[1]:>17}", flush=True)
    _odd(robot, population, like_them, trials, seed, at)


def _odd(
    robot: Robot,
    population: Population,
    like_them: Callable[[], Array],
    trials: int,
    seed: int,
    at: Array,
) -> None:
    """Print errors of machines with one arm ODD tolerances off, by either prior."""
    row = robot.detailed.parameters.row("arm_2")
    tolerance = float(robot.detailed.parameters.prior[row])
    nominal = float(robot.detailed.parameters.nominal[row])
    narrow = replace(
        population, odd=0.0 * population.odd
    )  # pulls every deviation towards the population
    told: dict[str, list[tuple[float, float]]] = {}
    for number in range(trials):
        deviation = like_them()
        deviation[row] = ODD * (1.0 if number % 2 else -1.0)
        machine = drawn(robot, 10_000 * seed + 8000 + number, deviation)
        poses = poses_of(machine, FEWEST, 900 + number)
        for name, prior in (
            ("tolerances", None),
            ("fleet", population),
            ("fleet, none odd", narrow),
        ):
            found = identify(poses, robot, population=prior)
            arm = (found.theta[row] - nominal) / tolerance - deviation[row]
            told.setdefault(name, []).append((error_of(found, machine, at), arm))
    print(f"machines with one arm {ODD:g} tolerances off, {FEWEST} places:")
    for name, values in told.items():
        error, arm = np.array(values).T
        print(
            f"  by {name}: error {1e6 * np.median(error):.1f} um (largest "
            f"{1e6 * error.max():.1f}); arm off by {np.sqrt(np.mean(arm**2)):.2f} tolerances RMS"
        )
