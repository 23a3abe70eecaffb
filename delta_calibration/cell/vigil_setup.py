"""Information on the machine and on the places from the stops of one set-up of the tracker."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.data import Conditions, Poses, joined
from delta_calibration.errors import DataError
from delta_calibration.estimation import Noise, whitening
from delta_calibration.geometry import align

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_APART = 1e-3  # [rad of a Delta] grid of joint positions; stops in one cell are at one place
_FEWEST = 4  # smallest number of places for which a set-up is evaluated
_ROUNDS = 3  # iterations of the frame fit
_WEAK = 1e-6  # prior precision of an unknown quantity; of a frame in 1/mm^2 or 1/mrad^2
_FRAME = 1e-3  # [m, rad]


@dataclass(frozen=True)
class Stop:
    """Mean of the tracker readings at one stop."""

    time: float  # [s]
    place: tuple[int, ...]  # key of the place: rounded joints and their approach directions
    joint: Array  # (m,)
    point: Array  # (3,) [m] in the tracker's frame
    count: int  # readings
    at: Conditions  # one sample
    row: int = 0  # of the poses that it was taken from


def stops_of(poses: Poses, joint_size: float) -> list[Stop]:
    """Convert poses to a list of stops."""
    at, start = poses.conditions, 1e-9 * poses.start_ns
    return [
        Stop(
            start + float(poses.time[row]),
            (
                *np.round(poses.joint[row] / (_APART * joint_size)).astype(int).tolist(),
                *np.sign(poses.direction[row]).astype(int).tolist(),
            ),
            poses.joint[row],
            poses.point[row],
            int(poses.count[row]),
            at.take(np.array([row])),
            row,
        )
        for row in range(len(poses))
    ]


@dataclass(frozen=True)
class Told:
    """Information on the machine's parameters (q,) and the discrepancy at each place (3 P,)."""

    size: int  # q
    information: Array  # (q + 3 P, q + 3 P)
    right: Array  # (q + 3 P,)
    precision: Array  # (3 P, 3 P) prior precision of the discrepancy; 0 for unknown places

    def __add__(self, other: Told) -> Told:
        """Sum of both; a place gets the prior precision of the first operand that contains it."""
        more = len(other.right) - len(self.right)
        if more:
            return self._wider(max(more, 0)) + other._wider(max(-more, 0))
        unknown = np.diag(self.precision) == 0
        precision = self.precision + np.where(np.outer(unknown, unknown), other.precision, 0.0)
        return Told(
            self.size, self.information + other.information, self.right + other.right, precision
        )

    def _wider(self, more: int) -> Told:
        """Pad with zeros for `more` further entries of places."""
        return Told(
            self.size,
            np.pad(self.information, (0, more)),
            np.pad(self.right, (0, more)),
            np.pad(self.precision, (0, more)),
        )

    def machine(self, loose: set[int]) -> tuple[Array, Array]:
        """Information and vector of the machine with the places marginalised, (q, q) and (q,).

        Args:
            loose: places whose discrepancy may have any size.
        """
        q = self.size
        known = np.flatnonzero(np.diag(self.precision) > 0)
        prior = self.precision[np.ix_(known, known)].copy()
        free = np.isin(known // 3, list(loose))
        prior[free] = 0.0
        prior[:, free] = 0.0
        prior[free, free] = _WEAK
        across = self.information[:q, q + known]
        solved = np.linalg.solve(
            self.information[np.ix_(q + known, q + known)] + prior,
            np.column_stack([across.T, self.right[q + known]]),
        )
        information = self.information[:q, :q] - across @ solved[:, :q]
        return (information + information.T) / 2, self.right[:q] - across @ solved[:, q]


@dataclass(frozen=True)
class SetUp:
    """Evaluates the stops of a calibrated machine before a tracker at an unknown place."""

    calibration: Calibration
    own: Index  # (q,) entries of theta that belong to the machine
    scale: Array  # (q,) their typical sizes

    def told(self, stops: Sequence[Stop], numbers: Mapping[tuple[int, ...], int]) -> Told | None:
        """Information from the stops; None if they are too few to locate the tracker.

        Args:
            stops: stops of the set-up.
            numbers: number of each place, by its key.
        """
        seen = _places(stops)
        if len(seen) < _FEWEST:
            return None
        at = joined(*(group[0].at for group in seen))
        point = np.array([np.median([stop.point for stop in group], axis=0) for group in seen])
        try:
            theta = self._placed(at, point, seen)
        except DataError:  # on one line
            return None
        return self._information(at, point, theta, seen, numbers)

    def _placed(self, at: Conditions, point: Array, seen: Sequence[Sequence[Stop]]) -> Array:
        """Fit frame and reflector offset of this set-up; return the full theta, (P,)."""
        chain, theta = self.calibration.chain, self.calibration.theta.copy()
        layout = chain.layout
        theta[layout.offset] = chain.offset
        x = chain.pose(at, theta)
        frame = align(chain.point(x, chain.offset), point)
        theta[layout.frame] = frame.vector()
        for _ in range(_ROUNDS):
            r, rows, _, _ = self._rows(at, point, theta, seen)
            z = (theta[layout.offset] - chain.offset) / chain.offset_prior
            prior = self._visit_precision()
            normal = rows.T @ rows + np.diag(prior)
            pull = np.concatenate([prior[:3] * z, np.zeros(6)])
            step = np.linalg.solve(normal, rows.T @ r - pull)
            theta[self._visit] += self._visit_scale() * step
        return theta

    @property
    def _visit(self) -> slice:
        layout = self.calibration.chain.layout
        return slice(layout.offset.start, layout.place.stop)

    def _visit_scale(self) -> Array:
        return np.concatenate(
            [np.full(3, self.calibration.chain.offset_prior), np.full(6, _FRAME)]
        )

    def _visit_precision(self) -> Array:
        return np.concatenate([np.ones(3), np.full(6, _WEAK)])

    def _rows(
        self, at: Conditions, point: Array, theta: Array, seen: Sequence[Sequence[Stop]]
    ) -> tuple[Array, Array, Array, Array]:
        """Whitened residuals (3 n,), Jacobian of the set-up (3 n, 9), W (n, 3, 3) and J."""
        chain, known = self.calibration.chain, self.calibration.uncertainty
        assert known is not None
        reached = chain.see(at, theta)
        count = np.array([sum(stop.count for stop in group) for group in seen])
        visits = np.array([len(group) for group in seen])
        noise = Noise(1.0, 1.0, known.repeatability, 0.0, 0, False)
        readings = noise.reading(point, self.calibration.robot.tracker) / count[:, None, None]
        slope = reached.by_joints
        rest = known.repeatability**2 / visits[:, None, None] * slope @ np.swapaxes(slope, 1, 2)
        whiten = whitening(readings + rest)
        r = (whiten @ (point - reached.reading)[..., None])[..., 0].reshape(-1)
        visit = whiten @ reached.jacobian[..., self._visit] * self._visit_scale()
        return r, visit.reshape(len(r), -1), whiten, reached.jacobian

    def _information(
        self,
        at: Conditions,
        point: Array,
        theta: Array,
        seen: Sequence[Sequence[Stop]],
        numbers: Mapping[tuple[int, ...], int],
    ) -> Told:
        size = 3 * len(numbers)
        r, visit, whiten, jacobian = self._rows(at, point, theta, seen)
        chain, q = self.calibration.chain, len(self.own)
        turn = chain.split(theta)[2].rotation
        rows = np.zeros((len(seen), 3, q + size))
        rows[..., :q] = whiten @ jacobian[..., self.own] * self.scale
        for row, group in enumerate(seen):
            own = q + 3 * numbers[group[0].place]
            rows[row, :, own : own + 3] = whiten[row] @ turn
        flat = rows.reshape(len(r), -1)
        z = (theta[chain.layout.offset] - chain.offset) / chain.offset_prior
        prior = self._visit_precision()
        about = r + visit @ np.concatenate([z, np.zeros(6)])  # at the offset of the file
        normal = visit.T @ visit + np.diag(prior)
        across = visit.T @ flat
        solved = np.linalg.solve(normal, np.column_stack([across, visit.T @ about]))
        information = flat.T @ flat - across.T @ solved[:, :-1]
        right = flat.T @ about - across.T @ solved[:, -1]
        return Told(q, information, right, self._precision(at, seen, numbers, size))

    def _precision(
        self,
        at: Conditions,
        seen: Sequence[Sequence[Stop]],
        numbers: Mapping[tuple[int, ...], int],
        size: int,
    ) -> Array:
        """Prior precision of the discrepancy at each place, in the base: M, rest and backlash."""
        known, chain = self.calibration.uncertainty, self.calibration.chain
        assert known is not None
        there = chain.see(at, self.calibration.theta)
        turn = self.calibration.frame.rotation
        slope = np.swapaxes(turn, 0, 1) @ there.by_joints
        spread = known.repeatability**2 + known.model.play**2
        covariance = known.model.at(chain.mechanism.position(there.x))
        covariance = covariance + (slope * spread) @ np.swapaxes(slope, 1, 2)
        precision = np.zeros((size, size))
        for row, group in enumerate(seen):
            own = 3 * numbers[group[0].place]
            precision[own : own + 3, own : own + 3] = np.linalg.inv(covariance[row])
        return precision


def _places(stops: Sequence[Stop]) -> list[list[Stop]]:
    groups: dict[tuple[int, ...], list[Stop]] = {}
    for stop in stops:
        groups.setdefault(stop.place, []).append(stop)
    return list(groups.values())
