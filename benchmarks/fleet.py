"""What a fleet brings and what it costs: priors, throughput, the page.

    python benchmarks/fleet.py --priors [--spread 0.2] [--machines 40] [--trials 20] [--seed 0]
    python benchmarks/fleet.py --throughput [--most 2]
    python benchmarks/fleet.py --scale
    python benchmarks/fleet.py --page fleet.html

--priors: a hidden population (mean of a dimension half a tolerance off the drawing, spread a share
of the tolerance) is learnt from fits of its machines; new machines are fitted from few places with
the drawing's tolerances and with what was learnt. The error is that of the fitted model at places
of the workspace that were not measured, against the simulated machine itself.
"""

from __future__ import annotations

import argparse
import hashlib
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration_file import from_identification
from delta_calibration.cli.main import run as run_verb
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue
from delta_calibration.fleet.evidence import Fitted, together
from delta_calibration.fleet.population import estimate, kinds_of
from delta_calibration.history.entries import Origin, entry_of
from delta_calibration.history.ledger import Compared, Failure, Ledger
from delta_calibration.history.store import Entry, open_store
from delta_calibration.identification import Identification, Population, identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.samples import Poses, collect, survey
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.simulation.machine import Machine, standing

Array = NDArray[np.float64]

PLACES = (6, 8, 10, 12, 16, 20, 24, 32, 48)
FEWEST = 12  # places of a fit by tolerances
MOST = 48  # places of a full measurement
OFF = 0.5  # [tolerances] of the population's mean, standard deviation
ODD = 6.0  # [tolerances] of the odd dimension of an odd machine
TESTED = 300  # joints at which errors are told


def drawn(robot: Robot, seed: int, deviation: Array) -> Machine:
    """A machine of these dimensions, in tolerances off the drawing, before a tracker."""
    machine = draw_machine(robot, seed, 1.0)
    parameters, theta = machine.chain.mechanism.parameters, machine.theta.copy()
    theta[machine.chain.layout.geometry] = parameters.nominal + parameters.prior * deviation
    return replace(machine, theta=theta)


def poses_of(machine: Machine, places: int, seed: int) -> Poses:
    """Its still moments at so many places, drawn from those of a full measurement."""
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
    return collect(session, robot.joints.names, robot.commanded.joint_size)


def error_of(found: Identification, machine: Machine, at: Array) -> float:
    """Of the fitted model at joints that were not measured [m RMS], against the machine."""
    conditions = standing(at)
    off = found.chain.predict(conditions, found.theta) - machine.reflector_points(conditions)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def priors(
    robot: Robot, spread: float, machines: int, measured: int, trials: int, seed: int
) -> None:
    """Learn a population, and say what it brings to new machines and does to an odd one."""
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
    population = replace(
        learnt.population, spread=np.hypot(learnt.population.spread, learnt.mean_std)
    )
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
    """Machines of which one arm is ODD tolerances off: errors and the arm, by either prior."""
    row = robot.detailed.parameters.row("arm_2")
    tolerance = float(robot.detailed.parameters.prior[row])
    nominal = float(robot.detailed.parameters.nominal[row])
    plain = Population.as_drawn(len(population.mean))
    narrow = replace(population, odd=1e-12)  # all that is not of the crowd is pulled to it
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
            ("tolerances, odd ones", plain),
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


def page(robot: Robot, out: Path, seed: int) -> None:
    """The page of 200 machines, their results made of one real fit and drawn verdicts."""
    rng = np.random.default_rng([seed, 200])
    machine = draw_machine(robot, seed)
    plan = make_plan("identify", robot, count=24, seed=seed)
    seen = survey(
        simulate_session(machine, plan, seed), robot.joints.names, robot.commanded.joint_size
    )
    origin = Origin("m", "s", Path("/sessions/m/s"), "0" * 64)
    fit = entry_of(origin, seen, robot, seed, diagnose)
    day = datetime(2026, 6, 1, tzinfo=timezone.utc)
    with TemporaryDirectory() as folder:
        url = str(Path(folder) / "fleet.sqlite")
        with open_store(url, make=True) as store:
            ledger = Ledger(store)
            for number in range(200):
                _add_machine(ledger, robot, fit, number, day, rng)
        run_verb(["fleet", "report", "--store", url, "--on", f"{day:%Y-%m-%d}", "--out", str(out)])


def _add_machine(
    ledger: Ledger,
    robot: Robot,
    fit: Entry,
    number: int,
    day: datetime,
    rng: np.random.Generator,
) -> None:
    """One machine with its sessions: most are fine, one in ten has a cause, a batch shares one."""
    name, sessions = f"press_{number:03d}", int(rng.integers(2, 6))
    last = day - timedelta(days=float(rng.exponential(30.0)))
    verdict = _verdict(fit, robot, number, rng)
    for k in range(sessions):
        began = last - timedelta(days=30.0 * (sessions - 1 - k))
        entry = replace(
            fit,
            machine=name,
            id=f"{began:%Y-%m-%d}",
            sha256=hashlib.sha256(f"{name} {k}".encode()).hexdigest(),
            began=began,
            verdict=verdict if k == sessions - 1 else fit.verdict,
        )
        ledger.keep(entry, "srbd", robot.machine_hash)
    changes: tuple[dict[str, Any], ...] = ()
    if rng.random() < 0.06:
        entries = ledger.store.sessions(name)
        what, where = str(rng.choice(["backlash", "arm_length"])), f"joint_{rng.integers(1, 4)}"
        change = {"after": entries[-2].id, "before": entries[-1].id, "what": what}
        signal = float(rng.exponential(3000.0))
        changes = ({**change, "location": where, "signal": signal},)
    ledger.keep_compared(Compared(name, "", changes))
    if rng.random() < 0.02:
        ledger.fail(Failure(name, "last_week", "", "last_week: holds no tracker readings"))


def _verdict(fit: Entry, robot: Robot, number: int, rng: np.random.Generator) -> dict[str, Any]:
    """The verdict of a fit with what is drawn for a machine; 60 to 73 are of the batch."""
    assert fit.verdict is not None
    verdict: dict[str, Any] = {**fit.verdict, "findings": []}
    left = float(rng.lognormal(np.log(0.015), 0.15))
    verdict["calibrated"] = verdict["extended"] = {"model": "m", "held_out_rms_mm": left}
    every = {effect.cause: effect for effect in catalogue(robot, robot.model())}
    batch = 60 <= number < 74
    if batch or rng.random() < 0.12:
        cause = "transmission_error" if batch else str(rng.choice(list(every)))
        effect, size = every[cause], float(rng.lognormal(np.log(0.06), 0.5))
        remedy = effect.remedy
        where = f"joint_{rng.integers(1, 4)}" if effect.parameters.items[0].location else None
        orders = {"order": float(rng.normal(33.0, 0.02))} if batch else {}
        finding = {
            "cause": cause,
            "location": where,
            "kind": effect.kind,
            "shape": orders,
            "action": {
                "do": remedy.do,
                "part": f"{remedy.part} of {where}" if where else remedy.part,
            },
        }
        verdict["findings"] = [finding]
        verdict["calibrated"] = {"model": "m", "held_out_rms_mm": float(np.hypot(left, size))}
    elif rng.random() < 0.03:
        unknown = {
            "found": True,
            "moves_with": "position",
            "rms_mm": float(rng.uniform(0.01, 0.05)),
        }
        verdict["unknown_structure"] = {**verdict["unknown_structure"], **unknown}
    return verdict


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--priors", action="store_true")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--robot", default="srbd")
    parser.add_argument("--spread", type=float, default=0.2)
    parser.add_argument("--machines", type=int, default=40)
    parser.add_argument("--places", type=int, default=48, help="of each machine of the fleet")
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--noise", type=float, default=1.0, help="times the tracker's")
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
    if given.page is not None:
        page(robot, given.page, given.seed)
    if given.priors:
        print(f"{robot.name}, noise {given.noise:g} times the tracker's, seed {given.seed}")
        priors(robot, given.spread, given.machines, given.places, given.trials, given.seed)


if __name__ == "__main__":
    main()
