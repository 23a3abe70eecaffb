"""Five-axis machine of paper 004: its swarms against least squares, on its 18 measurement arcs.

    python benchmarks/five_axis.py                 the table: 20 machines, without and with noise
    python benchmarks/five_axis.py --settling      the paper's stepwise by the rule it leaves open
    python benchmarks/five_axis.py --conditions    by the condition of the error model

The joint centres of random machines are off by up to 0.03 mm. The measured poses are those that
the machine reaches with the nominal joint values of the arcs. The identified parameters are
evaluated on arcs 7 and 8.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the imports after them.
# ruff: noqa: E402
import numpy as np
from numpy.typing import NDArray

from delta_calibration.papers import (
    Apso,
    Box,
    LinearResidual,
    PoseResidual,
    Pso,
    Settled,
    SwarmResult,
    SwarmSettings,
    all_singular,
    in_rounds,
    least_squares,
    minimise,
    stepwise,
    stepwise_singular,
)
from delta_calibration.robot import load_robot

Array = NDArray[np.float64]

MACHINE = load_robot("five_axis").model()
NOMINAL = MACHINE.parameters.nominal
PAPERS = 24  # parameters of the paper: it measures the struts' lengths before assembly
# Identifiable of these: all but the x errors at struts 3, 4.
FREE = np.array(
    [
        row
        for row, name in enumerate(MACHINE.parameters.names[:PAPERS])
        if name[-4:] not in ("_x_3", "_x_4")
    ]
)
ERROR, BOX = 0.03e-3, 0.05e-3  # [m] half widths: errors of the machines; search box
SWARM = SwarmSettings()  # N = 80, t_max = 300, a from 1 to 0.5
ROUNDS = 2
# One direction at a time needs fewer moves: two rounds of all twenty stay within the paper's
# budget.
ONE_DIRECTION = replace(SWARM, iterations=120)
BUDGET = SWARM.particles * SWARM.iterations * (len(FREE) + 1)  # of the paper's stepwise method
LEVER = 0.2  # [m] factor for angles in the residual
PRINTED_ERROR, PRINTED_DEVIATION = 10.0, 3.4369e-4  # [%], [mm] of the paper's stepwise method
ON_ARC, ON_EVALUATION = 11, 16  # poses

Method = Callable[[PoseResidual, np.random.Generator], SwarmResult]


@dataclass(frozen=True)
class Arc:
    """Arc on which the platform's centre stands still and the tool turns about one axis."""

    y: float  # [mm]
    z: float
    axis: str  # X or Y
    low: float  # [deg]
    high: float

    def poses(self, count: int) -> Array:
        """(count, 4): y, z [m], A, B [rad]."""
        turn = np.radians(np.linspace(self.low, self.high, count))
        still = np.full(count, 1e-3)
        angles = (turn, 0 * turn) if self.axis == "X" else (0 * turn, turn)
        return np.column_stack([self.y * still, self.z * still, *angles])


def _paper_arcs() -> Iterator[Arc]:
    for z, most in ((1050, 20), (1150, 15), (950, 15)):  # arcs 1 to 6
        for axis in "XY":
            yield Arc(0, z, axis, -most, most)
    for y, low, high in ((-100, -10, 0), (100, 0, 10)):  # arcs 7 to 18
        for z in (1150, 1050, 950):
            yield Arc(y, z, "X", low, high)
            yield Arc(-y, z, "Y", -15, 15)


ARCS = tuple(_paper_arcs())
MEASURED = np.concatenate([arc.poses(ON_ARC) for arc in ARCS])  # (198, 4)
EVALUATED = np.concatenate([arc.poses(ON_EVALUATION) for arc in ARCS[6:8]])


@dataclass(frozen=True)
class Noise:
    """Noise of a measured pose, after averaging."""

    tip: float  # [m] of each coordinate of the tool tip
    turn: float  # [rad] of each angle


@dataclass(frozen=True)
class Outcome:
    """Errors and cost of an identification."""

    percent: float  # largest error of a parameter relative to its true value
    error: float  # [m] largest error of a parameter
    deviation: float  # [m] largest error of the tool tip on arcs 7, 8
    evaluations: int
    seconds: float


def tip(x: Array) -> Array:
    """Position of the tool tip, (n, 3) [m]."""
    return MACHINE.position(x) + MACHINE.rotation(x) @ MACHINE.tool


def measure(deviation: Array, noise: Noise | None, rng: np.random.Generator) -> PoseResidual:
    """Tracker measurement of a machine on the 18 arcs: y, z of the tip and both angles."""
    joint = MACHINE.inverse(MEASURED, NOMINAL)
    pose = MACHINE.forward(joint, geometry(deviation))
    if noise is not None:
        seen = tip(pose)[:, 1:] + noise.tip * rng.standard_normal((len(pose), 2))
        pose[:, 2:] += noise.turn * rng.standard_normal((len(pose), 2))
        pose[:, :2] = seen - (tip(pose) - MACHINE.position(pose))[:, 1:]
    weight = np.zeros((len(pose), 4, 4))
    weight[:, :2] = MACHINE.point_by_pose(pose, MACHINE.tool)[:, 1:]
    weight[:, 2, 2] = weight[:, 3, 3] = LEVER
    return PoseResidual(MACHINE, joint, pose, weight, FREE)


def geometry(deviation: Array) -> Array:
    """Parameters of the machine, (28,)."""
    values = NOMINAL.copy()
    values[FREE] += deviation
    return values


def judge(found: SwarmResult, truth: Array, seconds: float) -> Outcome:
    """Compare an identification with the true deviations, (20,)."""
    joint = MACHINE.inverse(EVALUATED, NOMINAL)
    reached, meant = (tip(MACHINE.forward(joint, geometry(d))) for d in (found.best, truth))
    error = np.abs(found.best - truth)
    return Outcome(
        100 * float((error / np.abs(truth)).max()),
        float(error.max()),
        float(np.linalg.norm(reached - meant, axis=1).max()),
        found.evaluations,
        seconds,
    )


def condition() -> float:
    """Condition number of the error model about the drawing."""
    nothing = np.zeros(len(FREE))
    slope = measure(nothing, None, np.random.default_rng(0)).jacobian(nothing)
    return float(np.linalg.cond(slope))


def gain() -> float:
    """Error of the tip divided by the error of each joint's coordinates, RMS over the arcs."""
    joint = MACHINE.inverse(MEASURED, NOMINAL)
    by_pose = MACHINE.point_by_pose(MEASURED, MACHINE.tool)
    slope = by_pose @ MACHINE.identification_jacobian(joint, MEASURED, NOMINAL)
    return float(np.sqrt(np.sum(slope[..., :PAPERS] ** 2, axis=(1, 2)).mean()))


def methods() -> dict[str, Method]:
    """Methods, by the name of their row in the table."""

    def plain(settings: SwarmSettings) -> Method:
        return once(lambda r, box, rng: minimise(r, box, settings, rng))

    return {
        "nominal parameters, not identified": lambda r, _: SwarmResult(
            np.zeros(len(FREE)), float(r(np.zeros((1, len(FREE))))[0]), 0, np.empty(0)
        ),
        "least squares (Gauss-Newton)": lambda r, _: in_rounds(r, search_box(), least_squares, 3),
        "PSO": plain(replace(SWARM, law=Pso())),
        "APSO": plain(replace(SWARM, law=Apso())),
        "QPSO, plain": plain(SWARM),
        "QPSO, stepwise by settled parameters": once(
            lambda r, box, rng: stepwise(r, box, SWARM, rng)
        ),
        "QPSO, singular coordinates, all at once": once(
            lambda r, box, rng: all_singular(r, r.factor, box, SWARM, rng)
        ),
        "QPSO, stepwise by singular direction": lambda r, rng: in_rounds(
            r,
            search_box(),
            lambda line, box: stepwise_singular(line, line.factor, box, ONE_DIRECTION, rng),
            ROUNDS,
        ),
    }


def once(search: Callable[[LinearResidual, Box, np.random.Generator], SwarmResult]) -> Method:
    """One round about the drawing, with the paper's error model."""
    return lambda r, rng: in_rounds(r, search_box(), lambda line, box: search(line, box, rng), 1)


def search_box() -> Box:
    """The paper's search box, about the drawing."""
    return Box.about_zero(np.full(len(FREE), BOX))


def trial(method: Method, seed: int, noise: Noise | None) -> Outcome:
    """Identify one machine, which is the same for every method with this seed."""
    truth = np.random.default_rng(seed).uniform(-ERROR, ERROR, len(FREE))
    measured = measure(truth, noise, np.random.default_rng([seed, 1]))
    begin = time.perf_counter()
    found = method(measured, np.random.default_rng([seed, 2]))
    return judge(found, truth, time.perf_counter() - begin)


def row(name: str, outcomes: list[Outcome]) -> str:
    """A line of the table: medians, with the largest values in brackets."""
    figures = {key: np.array([getattr(o, key) for o in outcomes]) for key in vars(outcomes[0])}
    good = (figures["percent"] <= PRINTED_ERROR) & (1e3 * figures["deviation"] < PRINTED_DEVIATION)

    def spread(values: Array) -> str:
        return f"{np.median(values):.2g} ({values.max():.2g})"

    return (
        f"| {name} | {spread(figures['percent'])} | {spread(1e6 * figures['error'])} "
        f"| {spread(1e3 * figures['deviation'])} | {good.sum()} of {len(good)} "
        f"| {figures['evaluations'].max()} | {np.median(figures['seconds']):.2g} |"
    )


HEAD = (
    "| method | worst parameter [%] | worst parameter [um] | deviation [mm] | as printed "
    "| evaluations, most | time [s] |\n|---|---|---|---|---|---|---|"
)


def table(machines: int, noise: Noise | None) -> None:
    """Print the table of all methods on the same machines."""
    print(HEAD)
    for name, method in methods().items():
        print(row(name, [trial(method, seed, noise) for seed in range(machines)]), flush=True)


def settling(machines: int) -> None:
    """Print the paper's stepwise method with several settling rules, and with longer searches."""
    print(HEAD)
    rules = [
        (Settled(window, tolerance), SWARM)
        for window in (5, 20, 50, 100)
        for tolerance in (1e-1, 1e-2, 1e-3)
    ]
    rules += [(Settled(SWARM.iterations, 0.0), SWARM)]  # complete searches
    rules += [(Settled(), replace(SWARM, iterations=300 * times)) for times in (3, 10)]
    for rule, swarm in rules:
        method = once(lambda r, box, rng, s=swarm, k=rule: stepwise(r, box, s, rng, k))
        name = f"{rule.window} iterations, {rule.tolerance:g} of the box, t_max {swarm.iterations}"
        print(row(name, [trial(method, seed, None) for seed in range(machines)]), flush=True)


def conditions(machines: int) -> None:
    """Print the paper's two methods on error models of other condition, singular vectors kept."""
    each = "worst parameter [%] | parameters within 10 % | machines with all within 10 %"
    print(f"| condition | plain: {each} | stepwise: {each} |\n|---|---|---|---|---|---|---|")
    nothing = np.zeros(len(FREE))
    model = measure(nothing, None, np.random.default_rng(0)).linear(nothing)
    u, values, vt = np.linalg.svd(model.factor)
    whole = np.log(values[0] / values[-1])
    for wanted in (1.0, 3.0, 6.0, 10.0, 20.0, 50.0, 100.0, float(np.exp(whole))):
        flat = (u * values ** (np.log(wanted) / whole)) @ vt
        cells = [f"{wanted:.0f}"]
        for search in (minimise, stepwise):
            percent = np.array([_on_model(search, flat, seed) for seed in range(machines)])
            worst, good = percent.max(axis=1), percent <= PRINTED_ERROR
            cells += [
                f"{np.median(worst):.2g} ({worst.max():.2g})",
                f"{np.median(good.sum(axis=1)):.0f} of {len(FREE)}",
                f"{good.all(axis=1).sum()} of {machines}",
            ]
        print(f"| {' | '.join(cells)} |", flush=True)


def _on_model(search: Callable[..., SwarmResult], factor: Array, seed: int) -> Array:
    """Errors of the parameters relative to their true values, (20,) [%], on a linear machine."""
    truth = np.random.default_rng(seed).uniform(-ERROR, ERROR, len(FREE))
    model = LinearResidual(factor, factor @ truth, 0.0)
    found = search(model, search_box(), SWARM, np.random.default_rng([seed, 2]))
    return 100 * np.abs(found.best - truth) / np.abs(truth)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--machines", type=int, default=20)
    parser.add_argument("--noise-um", type=float, default=1.0, help="noise of each tip coordinate")
    parser.add_argument("--noise-urad", type=float, default=5.0, help="noise of each angle")
    parser.add_argument(
        "--settling",
        action="store_true",
        help="study the settling rule of the paper's stepwise search",
    )
    parser.add_argument(
        "--conditions", action="store_true", help="study the condition number of the error model"
    )
    asked = parser.parse_args()
    if asked.settling or asked.conditions:
        (settling if asked.settling else conditions)(asked.machines)
        return
    print(f"condition {condition():.0f}, gain from joints to tip {gain():.2f}")
    noise = Noise(asked.noise_um * 1e-6, asked.noise_urad * 1e-6)
    for title, each in (("without noise", None), (f"with noise: {noise}", noise)):
        print(f"\n{asked.machines} machines, {title}; budget of the paper's stepwise: {BUDGET}\n")
        table(asked.machines, each)


if __name__ == "__main__":
    main()
