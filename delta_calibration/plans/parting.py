"""Plans that separate two causes: D_s-optimal for one cause in the presence of the other."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.contrast import Contrast, Pair
from delta_calibration.diagnosis.experiments import prepared
from delta_calibration.diagnosis.linear_model import LinearizedModel
from delta_calibration.diagnosis.predicted_information import Foresight, Products, Samples
from delta_calibration.diagnosis.scores import PRECISION
from delta_calibration.effects import Effect, catalogue
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans.bench import Bench, StopConditions
from delta_calibration.plans.motion import MotionPath, Plan
from delta_calibration.plans.named import make_plan, motion_paths
from delta_calibration.plans.optimal import candidates, choose, foresight_of
from delta_calibration.plans.points import tool_points
from delta_calibration.robot import Robot

Array = NDArray[np.float64]
Index = NDArray[np.int64]

GEOMETRY = "geometry"  # as a cause: all dimensions together
_CANDIDATES = 2000  # poses times conditions
_FEWEST = 100  # poses
_PROBES = 12  # poses used to find the conditions on which a cause depends
_WEAK = 1e-6  # precision of unknowns without prior
_WORTH_A_PATH = 0.5  # least gain in log det for which a path is added


@dataclass(frozen=True)
class Parting:
    """A plan, and how well two causes are separated without it and with it."""

    plan: Plan
    levels: tuple[StopConditions, ...]  # (n,) of the stops
    before: Contrast  # from the session, or from as many stops under default conditions
    after: Contrast
    outside: str  # measurement outside the cell that would separate them; empty: none known


def part(
    robot: Robot,
    causes: tuple[str, str],
    count: int = 20,
    *,
    session: LinearizedModel | None = None,
    known: tuple[Chain, Array] | None = None,
    payload: float = 2.0,
    dwell: float = 1.0,
    radius: float | None = None,
    seed: int = 0,
    follow: Callable[[range], Iterable[int]] = iter,
) -> Parting:
    """Make the plan that best separates the first cause from the second.

    Args:
        robot: nominal dimensions, tolerances, limits, noise.
        causes: two names; `geometry` stands for all dimensions.
        count: number of stops.
        session: earlier measurement that the plan extends.
        known: chain and theta of a calibration, used if there is no earlier measurement.
        payload: mass that can be put on the platform [kg].
        dwell: at each stop [s].
        radius: largest distance of the tool from the axis [m]; None for no limit.
        seed: seed of the candidates and of the order.
        follow: iterates over the steps; for a progress bar.

    Raises:
        InputError: no such cause, the same twice, or too small a radius.
    """
    rng = np.random.default_rng(seed)
    measured = None if session is None else prepared(session)
    foresight = foresight_of(robot, known) if measured is None else Foresight.about(measured)
    bench = Bench.after(measured, foresight.chain.mechanism.joint_size)
    pair = _pair(robot, causes, foresight.chain.mechanism, bench)
    question = _Question(foresight, pair)
    if measured is None:
        plain = make_plan("identify", robot, count=count, both_sides=False, seed=seed).joint
        stands_in = question.products(bench.plain(plain))
        start = stands_in.times(0.0)
    else:
        start = stands_in = pair.products(measured)
    joint = candidates(robot, max(_CANDIDATES, count), radius, rng, (0.0, payload), follow)
    joint = joint[np.isfinite(foresight.pose(bench.plain(joint))).all(axis=1)]
    levels = bench.levels(question.columns, joint[:_PROBES], payload)
    joint = joint[: max(_CANDIDATES // len(levels), _FEWEST, count)]
    paths, added = _paths_worth(robot, question, bench, joint[:_PROBES], stands_in, payload)
    start = start + added
    joint, levels = np.repeat(joint, len(levels), axis=0), levels * len(joint)
    samples = bench.stops(joint, levels)
    chosen = choose(question.rows(samples), question.matrix(start), count, question.asked, follow)
    chosen = _ordered(chosen, levels, rng)
    return Parting(
        plan=Plan(
            name="separate",
            target=tool_points(robot, joint[chosen]),
            joint=joint[chosen],
            direction=np.array([levels[row].side for row in chosen]),
            payload=np.array([levels[row].payload for row in chosen]),
            dwell=dwell,
            paths=paths,
        ),
        levels=tuple(levels[row] for row in chosen),
        before=question.contrast(stands_in),
        after=question.contrast(start + question.products(samples.take(chosen))),
        outside=pair.outside,
    )


def _pair(robot: Robot, causes: tuple[str, str], mechanism: Mechanism, bench: Bench) -> Pair:
    """The two explanations; the geometry as a whole can only be the second.

    Raises:
        InputError: no such cause, one that needs what the robot file lacks, or the same twice.
    """
    effects = {effect.cause: effect for effect in catalogue(robot, mechanism)}
    dimensions = dict.fromkeys(p.cause for p in mechanism.parameters)
    for cause in causes:
        if cause not in (known := (*effects, *dimensions, GEOMETRY)):
            raise InputError(f"no cause {cause!r}; there are: {', '.join(known)}")
        if cause in effects and (lacking := effects[cause].lacking):
            raise InputError(f"cause {cause!r}: {lacking}")
    if causes[0] == causes[1]:
        raise InputError(f"{causes[0]!r} cannot be distinguished from itself; name two causes")
    at = bench.course(mechanism.home)
    each = [_explanation(c, effects.get(c), mechanism, at) for c in causes if c != GEOMETRY]
    return Pair(each[0], each[1] if len(each) > 1 else None)


def _explanation(
    cause: str, effect: Effect | None, mechanism: Mechanism, at: Conditions
) -> Candidate:
    """A cause, an effect or a kind of dimension, as a candidate explanation of such samples."""
    if effect is not None:
        shape = next(iter(effect.shapes(at)), None)
        if shape is None:
            raise InputError(f"{cause!r} has no shape before a session is measured: name another")
        return Candidate(cause, effect.kind, None, shape, tuple(range(len(shape.parameters))))
    rows = tuple(row for row, p in enumerate(mechanism.parameters) if p.cause == cause)
    return Candidate(cause, GEOMETRY, None, None, rows)


@dataclass(frozen=True)
class _Question:
    """The contrast to optimise: first explanation beside second explanation and nuisance."""

    foresight: Foresight
    pair: Pair

    @property
    def asked(self) -> int:
        """Number of columns of the first explanation."""
        return len(self.pair.first.rows)

    def evidence(self, samples: Samples) -> LinearizedModel:
        """Linearised model of samples that are all within reach."""
        return self.foresight.evidence(samples, self.foresight.pose(samples))

    def columns(self, samples: Samples) -> Array:
        """Columns of both explanations in the Jacobian, (3 n, k)."""
        return self.pair.columns(self.evidence(samples))

    def products(self, samples: Samples) -> Products:
        """Inner products of the columns of both explanations and the nuisance."""
        return self.pair.products(self.evidence(samples))

    def rows(self, samples: Samples) -> Array:
        """Rows of stops with the columns nuisance, second, first explanation, (n, 3, P)."""
        evidence = self.evidence(samples)
        columns = self.pair.columns(evidence).reshape(len(samples), 3, -1)
        nuisance = evidence.nuisance[..., self.pair.nuisance(len(self.foresight.precision))]
        return np.concatenate([nuisance, np.roll(columns, -self.asked, axis=-1)], axis=-1)

    def matrix(self, products: Products) -> Array:
        """Information matrix in the column order of `rows`, priors included, (P, P)."""
        kept = self.pair.nuisance(len(self.foresight.precision))
        across = np.roll(products.across[kept], -self.asked, axis=1)
        own = np.roll(products.own, (-self.asked, -self.asked), axis=(0, 1))
        prior = np.concatenate([self.foresight.precision[kept], np.full(len(own), PRECISION)])
        both = np.block([[products.shared[np.ix_(kept, kept)], across], [across.T, own]])
        return np.asarray(both + np.diag(np.maximum(prior, _WEAK)))

    def worth(self, products: Products) -> float:
        """log det of the first explanation's information."""
        whole = self.matrix(products)
        rest = whole[: -self.asked, : -self.asked]
        return float(np.linalg.slogdet(whole)[1] - np.linalg.slogdet(rest)[1])

    def contrast(self, products: Products) -> Contrast:
        """How well data with these products separate the pair."""
        geometry = self.foresight.chain.layout.geometry
        return self.pair.contrast(products, self.foresight.precision, geometry)


def _paths_worth(
    robot: Robot,
    question: _Question,
    bench: Bench,
    joint: Array,
    start: Products,
    payload: float,
) -> tuple[tuple[MotionPath, ...], Products]:
    """The paths that add enough information, best first, and their products."""
    added = start.times(0.0)
    if not bench.moves(question.columns, joint):
        return (), added
    paths = motion_paths(robot, payload)
    told = [question.products(bench.motion(path)) for path in paths]
    chosen: list[int] = []
    for _ in paths:
        now = question.worth(start + added)
        gains = [question.worth(start + added + more) - now for more in told]
        left = [i for i in range(len(paths)) if i not in chosen and gains[i] >= _WORTH_A_PATH]
        if not left:
            break
        chosen.append(max(left, key=lambda i: gains[i]))
        added = added + told[chosen[-1]]
    return tuple(paths[i] for i in chosen), added


def _ordered(chosen: Index, levels: Sequence[StopConditions], rng: np.random.Generator) -> Index:
    """Order the stops by time, then by payload, which is laborious to change, then at random."""
    order = sorted(rng.permutation(chosen).tolist(), key=lambda row: _laborious(levels[row]))
    return np.array(order, dtype=np.int64)


def _laborious(level: StopConditions) -> tuple[int, float]:
    return level.slot, level.payload
