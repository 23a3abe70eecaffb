"""Detects steps during a session and constant joint offsets by a fit of the whole machine.

The model is fitted to the poses with everything free, then linearised. A step of the tracker's
frame or of the reflector's offset at every time between two poses, and an offset of every joint,
are fitted to the residuals. Gross errors are left out. What machine and frame can imitate is
projected out:

    min |b - A dz - C v|^2,   gain of v = h' G^-1 h,   h = C' b_r,   G = C' C - (Q' C)' (Q' C)

with b the whitened residuals, A the whitened Jacobian of the fit with the rows of the priors
below, C the columns of the step, Q an orthonormal basis of the columns of A, and b_r = b - Q Q' b.
Sums over the poses after each time are cumulative: all times cost one pass.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Poses
from delta_calibration.errors import CalibrationError
from delta_calibration.estimation import (
    Problem,
    Solution,
    chain_of,
    prepare,
    solve,
    spread_of,
)
from delta_calibration.geometry import Frame, rotations
from delta_calibration.lazy import cached_property
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

FEWEST = 20  # poses of a fit
_EDGE = 4  # poses on either side of a step
_SETTLING, _SETTLED = 6, 3e-6  # most iterations; [m] a smaller change ends them
_BULK = 4.0  # standard deviations up to which a pose tells whether a correction holds
_GROSS = 12.0  # standard deviations from which a pose is a gross error
_SEEN = 1e-10  # relative eigenvalue below which a direction is taken as not identifiable


@dataclass(frozen=True)
class Step:
    """A step of the tracker's frame between two poses."""

    first: int  # first pose after it
    moved: Frame  # motion of the points: measured = moved(point in the first frame)
    size: float  # [m] RMS displacement of the points after it
    left: float  # share of chi square that remains
    turn_std: float  # [rad] standard error of its rotation


@dataclass(frozen=True)
class Offset:
    """An offset of a joint's zero."""

    joint: int
    value: float  # [rad or m] reading less true value
    gain: float  # decrease of chi square
    second: float  # gain of the next best joint


@dataclass(frozen=True)
class _Rows:
    """Whitened residuals of n poses without what machine and frame can imitate."""

    basis: Array  # (n, 3, r) orthonormal, of what they can imitate
    left: Array  # (n, 3)
    whiten: Array  # (n, 3, 3) [1/m]
    total: float  # chi square

    def gains(self, columns: Array, steps: bool) -> tuple[Array, Array, Array]:
        """Gain (k,), values (k, v) and their information (k, v, v) for columns (n, 3, v).

        With `steps`, for a step at each pose: the columns act from that pose on (k = n); otherwise
        the columns act at all poses (k = 1).
        """
        c = self.whiten @ columns
        across = np.einsum("nif,niv->nfv", self.basis, c)
        own = np.einsum("niv,niw->nvw", c, c)
        right = np.einsum("niv,ni->nv", c, self.left)
        if steps:
            across, own, right = (_behind(a) for a in (across, own, right))
        else:
            across, own, right = (a.sum(axis=0, keepdims=True) for a in (across, own, right))
        info = own - np.swapaxes(across, 1, 2) @ across
        scale = np.sqrt(np.maximum(np.einsum("kvv->kv", own), 1e-300))
        info = info / (scale[:, :, None] * scale[:, None, :])
        values, vectors = np.linalg.eigh(info)
        h = np.einsum("kvw,kv->kw", vectors, right / scale)
        good = values > _SEEN
        solved = np.where(good, h / np.where(good, values, 1.0), 0.0)
        gain = np.sum(np.where(good, h * solved, 0.0), axis=1)
        estimate = np.einsum("kvw,kw->kv", vectors, solved) / scale
        return gain, estimate, info * (scale[:, :, None] * scale[:, None, :])


class Fitted:
    """Poses with the linearised fit of the whole machine."""

    def __init__(self, poses: Poses, robot: Robot) -> None:
        """Fit; raises what `prepare` and `solve` raise."""
        self.poses, self.robot = poses, robot
        chain = chain_of(robot)
        _, _, problem = prepare(poses, robot, chain)
        self.problem: Problem = problem
        self.solution: Solution = solve(problem)
        self.used = _without_few(self.solution.weight)
        self.spread = spread_of(self.solution.residual)
        self.rows = _rows(self.solution, self.spread, self.used.astype(float))

    @property
    def geometry(self) -> Array:
        """Fitted geometry of the mechanism, (p,)."""
        return self.problem.chain.split(self.solution.theta)[0]

    @property
    def typical(self) -> float:
        """Median residual distance [m]."""
        return float(np.median(np.linalg.norm(self._missed, axis=1)))

    @cached_property
    def _missed(self) -> Array:
        """Measured less predicted, (n, 3) [m]."""
        missed = np.linalg.solve(self.problem.whiten, self.solution.residual[..., None])
        return np.asarray(missed[..., 0])

    def step(self, first: int | None = None) -> Step:
        """Likeliest step of the tracker, or the step at pose `first` (of all poses), if given."""
        point = self.poses.point[self.used]
        n = len(point)
        centre = point.mean(axis=0)
        columns = np.concatenate(
            [-rotations.skew(point - centre), np.broadcast_to(np.eye(3), (n, 3, 3))], axis=2
        )
        gain, values, info = self.rows.gains(columns, True)
        rows = np.flatnonzero(self.used)
        if first is None:
            best = _EDGE + int(np.argmax(gain[_EDGE : n - _EDGE + 1]))
        else:
            best = int(np.searchsorted(rows, first))
        turn, shift = values[best][:3], values[best][3:]
        moved = columns[best:] @ values[best]
        covariance = np.linalg.pinv(info[best])[:3, :3]
        left = max(self.rows.total - float(gain[best]), 0.0) / max(self.rows.total, 1e-12)
        noise = max(left * self.rows.total / max(3 * n - self.rows.basis.shape[2], 1), 1e-12)
        turn_std = float(np.sqrt(noise * np.trace(covariance) / 3))
        rotation = rotations.exp(turn)
        return Step(
            int(rows[best]),
            Frame(rotation, centre + shift - rotation @ centre),
            float(np.sqrt(np.mean(np.sum(moved**2, axis=1)))),
            left,
            turn_std,
        )

    def reflector(self, first: int | None = None) -> tuple[int, float, Array]:
        """First pose with a changed reflector, share of chi square left, shift (3,) [m].

        The likeliest pose, or `first` (of all poses), if given.
        """
        turned = self.problem.chain.mechanism.rotation(self.solution.pose)[self.used]
        frame = self.problem.chain.split(self.solution.theta)[2]
        gain, values, _ = self.rows.gains(frame.rotation @ turned, True)
        rows, n = np.flatnonzero(self.used), int(self.used.sum())
        if first is None:
            best = _EDGE + int(np.argmax(gain[_EDGE : n - _EDGE + 1]))
        else:
            best = int(np.searchsorted(rows, first))
        left = max(self.rows.total - float(gain[best]), 0.0) / max(self.rows.total, 1e-12)
        return int(rows[best]), left, values[best]

    def offset(self) -> Offset:
        """The joint offset with the largest gain, by the weights of the robust loss."""
        weight = self.solution.weight
        rows = _rows(self.solution, self.spread, weight)
        seen = self.problem.chain.see(
            self.problem.at, self.solution.theta, self.solution.pose
        ).by_joints[weight > 0]
        found = [rows.gains(seen[:, :, [j]], False) for j in range(seen.shape[2])]
        gains = np.array([gain[0] for gain, _, _ in found])
        best = int(np.argmax(gains))
        second = float(np.sort(gains)[-2]) if len(gains) > 1 else 0.0
        return Offset(best, -float(found[best][1][0, 0]), float(gains[best]), second)

    def without(self, offset: Offset) -> Fitted:
        """Fit of the poses with a joint's offset undone; raises what `Fitted` raises."""
        joint = self.poses.joint.copy()
        joint[:, offset.joint] -= offset.value
        return Fitted(replace(self.poses, joint=joint), self.robot)

    def exchanged(self) -> tuple[int, ...]:
        """First of each two neighbouring poses that are gross errors unless they are exchanged."""
        out, found = self.solution.weight == 0, []
        predicted = self.poses.point - self._missed
        for k in np.flatnonzero(out[:-1] & out[1:]).tolist():
            pair = slice(k, k + 2)
            missed = self.poses.point[pair][::-1] - predicted[pair]
            away = np.linalg.norm((self.problem.whiten[pair] @ missed[..., None])[..., 0], axis=1)
            if away.max() < _GROSS * self.spread:
                found.append(k)
        return tuple(found)

    def lowered(self, other: Fitted) -> float:
        """Chi square of this fit less that of another of the same poses, priors included.

        A pose counts up to 4 standard deviations of this fit: a few gross errors decide nothing.
        """
        return self._chi_square(self) - self._chi_square(other)

    def _chi_square(self, fit: Fitted) -> float:
        missed = self.problem.whiten @ fit._missed[..., None]
        away = np.linalg.norm(missed[..., 0], axis=1) / self.spread
        told = fit.problem.expected @ fit.solution.z**2
        return float(np.sum(np.minimum(away, _BULK) ** 2) + told)


@dataclass(frozen=True)
class Moves:
    """The two explanations of a step, each fitted with the whole machine."""

    moved: Frame  # motion of the tracker's points
    turn_std: float  # [rad] standard error of its rotation
    tracker_left: float  # [m] median residual distance with it
    shift: Array  # (3,) [m] of the reflector
    reflector_left: float  # [m] median residual distance with it
    frame: Frame  # T_tracker_base
    geometry: Array  # (p,) of the machine, with the reflector changed


def fitted_moves(poses: Poses, robot: Robot, first: int, moved: Frame, shift: Array) -> Moves:
    """Fit both a move of the tracker and a change of reflector at a pose, by Gauss-Newton."""
    turn_std, now = 0.0, Fitted(moved_back(poses, first, moved), robot)
    for _ in range(_SETTLING):
        more = now.step(first)
        moved, turn_std = moved @ more.moved, more.turn_std
        now = Fitted(moved_back(poses, first, moved), robot)
        if more.size < _SETTLED:
            break
    frame = now.problem.chain.split(now.solution.theta)[2]
    tracker_left = now.typical
    geometry = now.geometry
    try:
        other = Fitted(shifted_back(poses, robot, first, shift, frame, geometry), robot)
        for _ in range(_SETTLING):
            change = other.reflector(first)[2]
            shift, geometry = shift + change, other.geometry
            frame = other.problem.chain.split(other.solution.theta)[2]
            other = Fitted(shifted_back(poses, robot, first, shift, frame, geometry), robot)
            if np.linalg.norm(change) < _SETTLED:
                break
        reflector_left = other.typical
    except CalibrationError:
        reflector_left = np.inf
    return Moves(moved, turn_std, tracker_left, shift, reflector_left, frame, geometry)


def moved_back(poses: Poses, first: int, moved: Frame) -> Poses:
    """Poses, from `first` on corrected to the readings without the move."""
    point = poses.point.copy()
    point[first:] = moved.inverse().apply(point[first:])
    return replace(poses, point=point)


def shifted_back(
    poses: Poses, robot: Robot, first: int, shift: Array, frame: Frame, geometry: Array
) -> Poses:
    """Poses, from `first` on corrected to the readings of the first reflector."""
    model, point = robot.model(), poses.point.copy()
    turned = model.rotation(model.forward(poses.joint[first:], geometry))
    point[first:] -= (frame.rotation @ turned) @ shift
    return replace(poses, point=point)


def _rows(solution: Solution, spread: float, weight: Array) -> _Rows:
    """Rows of the linearised fit of the poses whose weight (n,) is not 0."""
    used, problem = weight > 0, solution.problem
    root = np.sqrt(weight[used]) / spread
    residual = root[:, None] * solution.residual[used]
    slope = root[:, None, None] * solution.at.slope[used]
    known, n = problem.expected, len(residual)
    rows = np.concatenate([slope.reshape(3 * n, -1), np.diag(known)])
    right = np.concatenate([residual.reshape(-1), -known * solution.z])
    basis = np.linalg.qr(rows)[0]
    left = right - basis @ (basis.T @ right)
    return _Rows(
        basis[: 3 * n].reshape(n, 3, -1),
        left[: 3 * n].reshape(n, 3),
        root[:, None, None] * problem.whiten[used],
        float(left @ left),
    )


def _behind(values: Array) -> Array:
    """Cumulative sums from each row to the last."""
    return np.asarray(np.cumsum(values[::-1], axis=0)[::-1])


def _without_few(weight: Array) -> NDArray[np.bool_]:
    """Mask of poses: one with weight 0 stays in if 4 of the 7 around it have weight 0 too.

    Behind a step all poses may have weight 0; a few in a row are gross errors or exchanged rows.
    """
    out = (weight == 0).astype(int)
    near = np.convolve(out, np.ones(2 * _EDGE - 1, dtype=int))[_EDGE - 1 : 1 - _EDGE]
    return np.asarray((out == 0) | (near >= _EDGE))
