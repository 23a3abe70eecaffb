"""Benefit of the priors of a fleet whose machines have the same causes.

Every machine has backlash and compliance in its joints, with sizes that scatter by a fraction of
their mean. The population of dimensions and effects is learnt from diagnoses. New machines are
fitted from few places with the tolerances as priors, with the fleet's priors of the dimensions
alone, and with all of its priors; and diagnosed. The error is that of the model at places that
were not measured, reached from both sides, compared with the simulated machine. Odd machines have
no backlash or three times as much.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import from_identification
from delta_calibration.data import Conditions, Survey, collect, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import SPREAD, catalogue
from delta_calibration.estimation import Identification, Population, identify
from delta_calibration.fleet.evidence import Fitted
from delta_calibration.fleet.population import expected
from delta_calibration.fleet.priors import population_of
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.simulation.machine import TrueMachine
from fleet_parts.priors import FEWEST, ODD, OFF, TESTED, poses_of, seen_at

Array = NDArray[np.float64]

CAUSES = ("backlash", "joint_compliance")  # of all machines, each of about its typical size
PLACES = (6, 8, 12, 16, 24)


@dataclass(frozen=True)
class Type:
    """Distribution from which the machines of a type are drawn."""

    robot: Robot
    mean: Array  # (p,) of the dimensions [tolerances]
    own: Array  # (p,) scatter of the dimensions [tolerances]
    spread: float  # relative scatter of the sizes of the causes

    def machine(self, seed: int, odd: float = 1.0) -> TrueMachine:
        """Draw one machine, with `odd` times the usual backlash."""
        rng = np.random.default_rng([seed, 19])
        sizes = 1.0 + self.spread * rng.standard_normal(len(CAUSES))
        sizes[0] *= odd
        hidden = {
            c: {"strength": f"{s}"} for c, s in zip(CAUSES, sizes.tolist(), strict=True) if s
        }
        drawn = draw_machine(self.robot, seed, 1.0, hidden)
        parameters, theta = drawn.chain.mechanism.parameters, drawn.theta.copy()
        off = self.mean + self.own * rng.standard_normal(len(self.mean))
        theta[drawn.chain.layout.geometry] = parameters.nominal + parameters.prior * off
        return replace(drawn, theta=theta)


def measured(machine: TrueMachine, seed: int) -> Survey:
    """Full session of a machine, with all data that a diagnosis needs."""
    robot = machine.robot
    session = simulate_session(machine, make_plan("rich", robot, count=30, seed=seed), seed)
    return survey(session, robot.joints.names, robot.commanded.joint_size)


def elsewhere(machine: TrueMachine) -> Conditions:
    """Places that were not measured, approached from both sides."""
    robot, plan = machine.robot, make_plan("identify", machine.robot, count=TESTED // 2, seed=99)
    session = simulate_session(machine, plan, 99)
    return collect(session, robot.joints.names, robot.commanded.joint_size).conditions


def error_of(found: Identification, machine: TrueMachine, at: Conditions) -> float:
    """RMS error of the fitted model compared with the machine [m]."""
    off = found.chain.predict(at, found.theta) - machine.reflector_points(at)
    return float(np.sqrt(np.nanmean(np.sum(off**2, axis=1))))


def effects(robot: Robot, spread: float, machines: int, trials: int, seed: int) -> None:
    """Learn a population of dimensions and effects, and print its benefit."""
    rng = np.random.default_rng([seed, 18])
    size = len(robot.detailed.parameters)
    kind = Type(
        robot, OFF * rng.standard_normal(size), spread * rng.uniform(0.5, 1.5, size), spread
    )
    fleet = [_diagnosed(kind.machine(10_000 * seed + n), n) for n in range(machines)]
    shown, learnt = population_of(fleet)
    asked = [{e.cause for e in each.all_found} for each in fleet]
    found = tuple(
        (c, (sum(c in each for each in asked) + 1) / (machines + 2)) for c in _every(robot)
    )
    crowd = replace(learnt.population, effects=shown, found=found)
    population = expected(crowd, learnt.told)
    print(f"{machines} machines diagnosed; causes found: {_counted(asked)}")
    for k, p in enumerate((p for e in shown for p in e.parameters), start=size):
        mean, spread = SPREAD * crowd.mean[k], SPREAD * crowd.spread[k]
        print(f"  {p.name}: {mean:.2f} +- {spread:.2f} typical sizes, odd {crowd.odd[k]:.2f}")
    new = [kind.machine(10_000 * seed + 5000 + n) for n in range(trials)]
    ways = _ways(robot, population, size)
    print(f"error [um], median of {trials} machines, and largest")
    print("places" + "".join(f"{name:>26}" for name in ways))
    for places in PLACES:
        row = "".join(f"{_told(way, new, places):>26}" for way in ways.values())
        print(f"{places:6d}{row}", flush=True)
    for odd in (0.0, ODD / 2):
        machines_odd = [kind.machine(10_000 * seed + 8000 + n, odd) for n in range(trials)]
        print(f"machines with {odd:g} times the play of the others, {FEWEST} places:")
        for name, way in ways.items():
            print(f"  {name}: {_told(way, machines_odd, FEWEST)}", flush=True)


def _diagnosed(machine: TrueMachine, seed: int) -> Fitted:
    seen = measured(machine, seed)
    calibration = from_identification(
        diagnose(seen, machine.robot).identification, machine.robot, seen.poses
    )
    return Fitted(str(seed), (calibration,), calibration)


def _every(robot: Robot) -> list[str]:
    return list(dict.fromkeys(e.cause for e in catalogue(robot, robot.model())))


def _counted(asked: list[set[str]]) -> str:
    causes = sorted({cause for each in asked for cause in each})
    return ", ".join(f"{c} {sum(c in each for each in asked)}" for c in causes) or "none"


Way = Callable[[TrueMachine, int, int], float]


def _ways(robot: Robot, population: Population, size: int) -> dict[str, Way]:
    """Fits with tolerances, with the fleet's dimensions, with all its priors; and diagnoses."""
    dimensions = replace(
        population,
        mean=population.mean[:size],
        spread=population.spread[:size],
        odd=population.odd[:size],
        effects=(),
    )
    narrow = replace(population, odd=0.0 * population.odd)

    def fit(prior: Population | None) -> Way:
        def way(machine: TrueMachine, places: int, seed: int) -> float:
            if prior is None and places < FEWEST:
                return np.nan
            found = identify(poses_of(machine, places, seed), robot, population=prior)
            return error_of(found, machine, elsewhere(machine))

        return way

    def diagnosis(prior: Population | None) -> Way:
        def way(machine: TrueMachine, places: int, seed: int) -> float:
            if places < FEWEST:
                return np.nan
            seen = seen_at(machine, places, seed)
            found = diagnose(seen, robot, population=prior)
            return error_of(found.identification, machine, elsewhere(machine))

        return way

    return {
        "tolerances": fit(None),
        "fleet, dimensions": fit(dimensions),
        "fleet, all": fit(population),
        "fleet, none odd": fit(narrow),
        "diagnosed": diagnosis(None),
        "diagnosed, fleet": diagnosis(population),
    }


def _told(way: Way, machines: list[TrueMachine], places: int) -> str:
    errors = [way(machine, places, 700 + n) for n, machine in enumerate(machines)]
    if np.isnan(errors).all():
        return "-"
    return f"{1e6 * np.median(errors):.1f} ({1e6 * max(errors):.0f})"
