"""How often a hidden effect's values lie within their intervals, by effect and mechanism.

Each machine is drawn by the simulator with one effect, measured by a plan, and fitted with that
effect in the chain. The search for its shape starts at the true one and is otherwise as usual
(`make recovery`, or --robots, --causes, --seeds):

    inside      share of the values within 1.96 standard deviations as a verdict states them,
                including the uncertainty of the shape; 95 % where all is right
    spread      root mean square of (found - true) / standard deviation: 1 where all is right
    told        share of the values whose interval is narrower than half of the prior's

Values that the session hardly determines (their interval is the prior's) count like any other;
`told` shows where there are such values. The seeds are used only here.
"""

from __future__ import annotations

import argparse
import json
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import survey
from delta_calibration.diagnosis import calibrated
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.findings import spread_of
from delta_calibration.diagnosis.fitted import Fitted, gains_of
from delta_calibration.diagnosis.model import Model
from delta_calibration.diagnosis.shapes import Shapes
from delta_calibration.effects import Effect, catalogue, effect_named
from delta_calibration.errors import DataError, ReachError
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import RICH_PERIOD, draw_machine, simulate_session

Array = NDArray[np.float64]

FIRST_SEED = 90_000
STRENGTH = "1.0"  # in typical sizes
INSIDE = 1.96


def one(name: str, cause: str, seed: int) -> tuple[str, str, list[float], list[float]]:
    """Errors of one machine's values in standard deviations, and those in expected sizes."""
    robot = load_robot(name)
    machine = draw_machine(robot, seed, hidden={cause: {"strength": STRENGTH}})
    plan, period = ("rich", RICH_PERIOD) if name == "srbd" else ("identify", 0.0)
    session = simulate_session(machine, make_plan(plan, robot, seed=seed), seed, period=period)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    start = calibrated(seen, robot, machine.chain.mechanism.name)
    (hidden,) = machine.chain.effects
    effect = effect_named(cause, robot, start.bare.mechanism, hidden.settings)
    model = min((found(begin, effect) for begin in (start, *start.elsewhere())), key=misfit)
    assert isinstance(model, Model)
    own, (term,) = model.layout.effects, model.terms
    std = spread_of(model.evidence, model, term)[0] * effect.parameters.prior
    true = machine.theta[machine.chain.layout.effects]
    error = (model.theta[own] - true) / std
    return name, cause, error.tolist(), (std / effect.parameters.prior).tolist()


def found(start: Fitted, effect: Effect) -> Fitted:
    """Fit the machine with an effect, with the searched fields of its shape at their best."""
    at, rows = start.evidence.at, tuple(range(len(effect.parameters)))
    shapes = [
        Candidate(effect.cause, effect.kind, None, shape, rows)
        for shape in effect.shapes(at)
        if same_kind(shape, effect)
    ]
    shapes = shapes or [Candidate(effect.cause, effect.kind, None, effect, rows)]
    gains = gains_of(Shapes.of(start.evidence), shapes)
    model = start.fitted((shapes[int(np.argmax(gains))],))
    others = [terms for terms in model.in_other_shapes if same_kind(terms[0].effect, effect)]
    return min([model, *map(start.fitted, others)], key=misfit)


def same_kind(shape: Effect, effect: Effect) -> bool:
    """Whether two shapes of a cause differ only in searched fields."""
    searched = {name for name, _, _ in effect.intervals()}
    fixed = {name: value for name, value in effect.settings.items() if name not in searched}
    also = {name for name, _, _ in shape.intervals()}
    return also == searched and fixed.items() <= shape.settings.items()


def misfit(model: Fitted) -> float:
    """Chi square per degree of freedom."""
    return model.misfit


def attempt(task: tuple[str, str, int]) -> tuple[str, str, list[float], list[float]] | str:
    """The same, or the reason why there is no such machine or session."""
    try:
        return one(*task)
    except (DataError, ReachError) as error:
        return f"{task}: {error}"


def tasks(robots: list[str], causes: list[str], seeds: int) -> list[tuple[str, str, int]]:
    """Every effect of every robot's catalogue, `seeds` machines of each."""
    found = []
    for name in robots or known_robots():
        robot = load_robot(name)
        for effect in catalogue(robot, robot.detailed):
            if not effect.lacking and (not causes or effect.cause in causes):
                found += [(name, effect.cause, FIRST_SEED + i) for i in range(seeds)]
    return list(dict.fromkeys(found))


def row(name: str, cause: str, every: list[Any]) -> dict[str, Any]:
    """A row of the table."""
    error = np.concatenate([np.array(e) for _, _, e, _ in every])
    size = np.concatenate([np.array(s) for _, _, _, s in every])
    return {
        "robot": name,
        "cause": cause,
        "machines": len(every),
        "values": len(error),
        "inside": float(np.mean(np.abs(error) <= INSIDE)),
        "spread": float(np.sqrt(np.mean(error**2))),
        "told": float(np.mean(size < 0.5)),
    }


def main() -> int:
    """Print the table; write it to out/recovery.json."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--robots", nargs="*", default=[])
    parser.add_argument("--causes", nargs="*", default=[])
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args()
    every = tasks(chosen.robots, chosen.causes, chosen.seeds)
    rows: list[dict[str, Any]] = []
    print("| robot | effect | machines | values | inside | spread | determined |")
    print("|---|---|---|---|---|---|---|")
    pairs = list(dict.fromkeys((name, cause) for name, cause, _ in every))
    with ProcessPoolExecutor(chosen.workers) as pool:
        outcomes = pool.map(attempt, every)
        for name, cause in pairs:
            own = [next(outcomes) for task in every if task[:2] == (name, cause)]
            for said in (o for o in own if isinstance(o, str)):
                print(f"  {said}")
            good = [o for o in own if not isinstance(o, str)]
            if not good:
                continue
            rows.append(row(name, cause, good))
            r = rows[-1]
            print(
                f"| {name} | {cause} | {r['machines']} | {r['values']} | {r['inside']:.1%} "
                f"| {r['spread']:.2f} | {r['told']:.0%} |",
                flush=True,
            )
    out = Path("out")
    out.mkdir(exist_ok=True)
    (out / "recovery.json").write_text(json.dumps(rows, indent=1), encoding="utf-8")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
