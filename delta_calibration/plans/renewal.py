"""Plan with few poses to update the calibration of a machine whose history is known.

The stops are D-optimal (`optimal.py`) given a prior of dimensions and effects from earlier
sessions (`Carried`); the tracker's frame and the reflector's position have only their usual
priors. Each stop is approached from both sides.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.errors import InputError
from delta_calibration.estimation import FEWEST_CARRIED, Carried, carried_rows, chain_of
from delta_calibration.plans.bench import Bench, StopConditions
from delta_calibration.plans.motion import Plan
from delta_calibration.plans.optimal import (
    SIDES,
    WEAK,
    FiledNoise,
    candidates,
    choose,
    drawn_theta,
    unmeasured,
)
from delta_calibration.plans.points import PLACES, tool_points
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

UPDATE_PLACES = 18  # three tenths of a complete plan
_CANDIDATES = 1000


@dataclass(frozen=True)
class Renewal:
    """Stops for an update, and the uncertainty of the tool position after them."""

    plan: Plan
    candidates: int  # number of poses that the stops were chosen from
    # RMS uncertainty of the predicted position over all candidates after the update, in standard
    # deviations of a measured stop
    after: float
    whole: float  # the same after random stops, as many as a complete plan has, without history


def renewal_plan(
    robot: Robot,
    carried: Carried,
    count: int = UPDATE_PLACES,
    *,
    dwell: float = 1.0,
    radius: float | None = None,
    seed: int = 0,
    follow: Callable[[range], Iterable[int]] = iter,
) -> Renewal:
    """Select the D-optimal stops for a machine with a prior from earlier sessions.

    Args:
        robot: nominal dimensions, tolerances, limits.
        carried: prior from earlier sessions.
        count: number of different stops.
        dwell: at each stop [s].
        radius: largest distance of the tool from the axis [m]; None for no limit.
        seed: seed of the candidates and of the order.
        follow: iterates over the steps; for a progress bar.

    Raises:
        InputError: too few stops, or too small a radius.
    """
    if count < FEWEST_CARRIED:
        raise InputError(f"--count {count}: an update needs {FEWEST_CARRIED} places or more")
    rng = np.random.default_rng(seed)
    joint = candidates(robot, max(_CANDIDATES, 2 * count), radius, rng, follow=follow)
    about = _About.of(robot, carried)
    rows = about.rows(robot, joint)
    chosen = rng.permutation(choose(rows, about.known, count, len(about.known), follow))
    spread = rng.permutation(len(rows))[:PLACES]
    stops = joint[chosen]
    return Renewal(
        Plan.around("update", tool_points(robot, stops), stops, SIDES, dwell),
        len(rows),
        about.uncertain(rows, about.known, chosen),
        about.uncertain(rows, about.drawn, spread),
    )


@dataclass(frozen=True)
class _About:
    """The prior of the machine, in scaled unknowns z: frame and reflector, then its own."""

    chain: Chain
    theta: Array  # (P,)
    scale: Array  # (P, P) d(theta)/dz
    known: Array  # (P, P) prior information on z from history, reflector by its tolerance
    drawn: Array  # (P, P) prior information on z from the tolerances alone

    @classmethod
    def of(cls, robot: Robot, carried: Carried) -> _About:
        """Linearise about the prior mean, with the tracker three metres away."""
        chain = chain_of(robot).with_effects(carried.effects)
        own = carried_rows(chain.layout)
        order = np.concatenate([np.setdiff1d(np.arange(chain.layout.size), own), own])
        theta = drawn_theta(chain)
        problem = carried.applied(unmeasured(chain, theta))
        precision = np.where(problem.has_prior, 1.0, WEAK)[order]
        scale = problem.basis[:, order]
        tolerance = scale[own] / chain.parameters.prior[own, None]
        before = np.diag(np.where(np.isin(order, own), 0.0, precision))
        return cls(
            chain,
            problem.theta0,
            scale,
            np.diag(precision),
            before + tolerance.T @ tolerance,
        )

    def rows(self, robot: Robot, joint: Array) -> Array:
        """Whitened rows of the Jacobian for stops approached from both sides, (N, 6, P)."""
        size = self.chain.mechanism.joint_size
        bench, noise = Bench.after(None, size), FiledNoise(robot, self.chain, self.theta)
        sides = []
        for side in SIDES:
            samples = bench.stops(joint, [StopConditions(side=side)] * len(joint))
            seen = self.chain.see(samples.at, self.theta)
            sides.append(noise(samples, seen.x) @ seen.jacobian @ self.scale)
        return np.concatenate(sides, axis=1)

    def uncertain(self, rows: Array, start: Array, chosen: NDArray[np.int64]) -> float:
        """RMS uncertainty of the position over all candidates, in sigmas of a stop's noise."""
        flat = rows[chosen].reshape(-1, rows.shape[-1])
        covariance = np.linalg.inv(start + flat.T @ flat)
        each = np.einsum("ndi,ij,ndj->n", rows[:, :3], covariance, rows[:, :3])
        return float(np.sqrt(each.mean() / 3))
