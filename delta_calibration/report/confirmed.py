"""Uncertainty of an earlier calibration, held against the residuals of a later session.

Only the tracker's frame is fitted to the later session, by least squares. With G the derivatives
of its readings by the frame, A those by all other parameters (covariance C of the calibration) and
N the noise of its readings, the frame follows the other parameters by -H and has a covariance F of
its own:

    H = (G^T G)^-1 G^T A        residuals: covariance N + (A - G H) C (A - G H)^T + model error

The calibration states its model error, the backlash that it does not model and the repeatability
of the joints. The residuals exceed this statement if

- their squares exceed what follows from it by more than the standard error of their mean;
- their squares exceed it at all, and a joint has backlash where none was stated; or
- more of them than by chance exceed their 95 % radius.

Then these contributions are estimated anew: from the residuals of the later session, in the same
way as those of a fit (`estimation/positions.py`). From three standard errors on, the statement is
refuted.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, Poses
from delta_calibration.errors import DataError
from delta_calibration.estimation import (
    Known,
    Missed,
    Rest,
    studentized,
    uncertainty_of,
    whitening,
)
from delta_calibration.estimation.noise import Noise
from delta_calibration.estimation.positions import reached
from delta_calibration.geometry import align
from delta_calibration.robot import Robot
from delta_calibration.uncertainty import Identified, Parts, radius95, turned_round

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_STEPS = 3  # of Gauss and Newton for the frame, from one that is correct to 1e-4
_EXCEEDS = 1.0  # standard errors of an excess, from which it counts in the uncertainty
_REFUTES = 3.0  # the same, from which the calibration's own uncertainty is refuted


@dataclass(frozen=True)
class Confirmed:
    """An earlier calibration in the tracker's frame of a session."""

    identified: Identified  # with the uncertainty that holds for this session
    after: Array  # (n, 3) [m] measured less predicted, in the base
    expected: float  # [m] RMS of `after` by the calibration's own uncertainty
    stated: bool  # whether model error, play and repeatability are as the calibration states them
    refuted: bool  # whether the residuals are far larger than it states


def confirmed(earlier: Identified, poses: Poses, noise: Noise, robot: Robot) -> Confirmed:
    """Hold an earlier calibration against the poses of a session.

    Args:
        earlier: the calibration.
        poses: measured poses of a session.
        noise: of these poses.
        robot: its tracker.

    Raises:
        DataError: poses out of reach of the calibrated machine.
    """
    chain = earlier.chain
    held = _Held.of(chain, _placed(chain, poses, earlier.theta), earlier, poses, noise, robot)
    stated = replace(earlier.uncertainty, covariance=held.covariance())
    parts = Identified(chain, held.theta, stated).parts(held.at)
    told = replace(parts, frame=np.zeros_like(parts.frame))  # residuals are without the frame's
    own = uncertainty_of(
        chain,
        held.theta,
        stated.covariance,
        Rest(noise.repeatability, noise.freedom),
        Missed(held.at, held.free, held.whiten, held.place),
    )
    error, readings = held.free @ held.turned, held.readings
    excess = _excess(error, readings, told, held.place)
    played = bool(((own.model.play > 0.0) & (stated.model.play == 0.0)).any())
    as_stated = excess <= (0.0 if played else _EXCEEDS) and not _beyond(
        error, readings, told, stated.model.widen
    )
    if not as_stated:
        stated = replace(own, covariance=held.covariance(own.model.at(held.position)))
    return Confirmed(
        Identified(chain, held.theta, stated, earlier.ended),
        held.missed @ held.turned,
        float(np.sqrt(np.trace(readings + told.whole, axis1=1, axis2=2).mean())),
        as_stated,
        excess > _REFUTES,
    )


@dataclass(frozen=True)
class _Held:
    """Residuals of a session by an earlier calibration, with their covariances; n poses."""

    chain: Chain
    theta: Array  # (P,) in the tracker's frame of the session
    at: Conditions
    place: Index  # (n,) of each pose
    position: Array  # (n, 3) [m] of the platform, in the base
    turned: Array  # (3, 3) from the base to the tracker
    missed: Array  # (n, 3) [m] measured less predicted, in the tracker's frame
    free: Array  # (n, 3) [m] the same, as large as if the frame had absorbed none of it
    slope: Array  # (n, 3, 6) d(reading)/d(frame)
    scatter: Array  # (n, 3, 3) [m^2] covariance of the noise of the poses
    moving: Array  # (n, 3, 3) [m^2] its part by the repeatability of the joints
    whiten: Array  # (n, 3, 3) [1/m] of noise and dimensions together
    following: Array  # (P, P) covariance of theta, without that of the frame itself

    @classmethod
    def of(
        cls,
        chain: Chain,
        theta: Array,
        earlier: Identified,
        poses: Poses,
        noise: Noise,
        robot: Robot,
    ) -> _Held:
        """Compute the residuals of poses by theta, with the covariance of an earlier fit."""
        at = poses.conditions
        seen = chain.see(at, theta)
        following, slope = _followed(seen.jacobian, chain, earlier.uncertainty.covariance)
        scatter = noise.covariance(poses, seen.by_joints, robot.tracker)
        dimensions = seen.jacobian @ following @ turned_round(seen.jacobian)
        whiten = whitening(scatter + dimensions)
        missed = poses.point - seen.reading
        return cls(
            chain,
            theta,
            at,
            poses.place,
            chain.mechanism.position(seen.x),
            chain.split(theta)[2].rotation,
            missed,
            _studentized(whiten, slope, missed, poses.place),
            slope,
            scatter,
            noise.repeatability**2 * seen.by_joints @ turned_round(seen.by_joints),
            whiten,
            following,
        )

    @property
    def readings(self) -> Array:
        """Covariance of the tracker's noise, in the base, (n, 3, 3) [m^2]."""
        return np.asarray(self.turned.T @ (self.scatter - self.moving) @ self.turned)

    def covariance(self, model: Array | None = None) -> Array:
        """Covariance of theta with that of the frame, (P, P).

        Args:
            model: covariance of errors that are common to all poses of a place, in the base,
                (n, 3, 3) [m^2].
        """
        inverse = np.linalg.pinv(_summed(self.slope, self.slope), hermitian=True)
        pull = _summed(self.slope, self.scatter @ self.slope)
        if model is not None:
            turned = self.turned @ model @ self.turned.T
            for number in np.unique(self.place):
                own = self.place == number
                whole = self.slope[own].sum(axis=0)
                pull += whole.T @ turned[own].mean(axis=0) @ whole
        found, frame = self.following.copy(), self.chain.layout.frame
        found[frame, frame] += inverse @ pull @ inverse
        return found


def _summed(left: Array, right: Array) -> Array:
    """Sum of left^T right over the poses; (n, 3, j) and (n, 3, k) give (j, k)."""
    return np.asarray(np.einsum("nij,nik->jk", left, right))


def _placed(chain: Chain, poses: Poses, theta: Array) -> Array:
    """Theta of an earlier calibration with the frame that fits these poses best, (P,)."""
    at, layout = poses.conditions, chain.layout
    earlier = chain.split(theta)[2]
    inside = earlier.inverse().apply(chain.predict(at, theta))
    if not np.isfinite(inside).all():
        raise DataError(f"{poses.source}: poses out of reach of the calibrated machine")
    placed = theta.copy()
    placed[layout.frame] = align(inside, poses.point).vector()
    for _ in range(_STEPS):  # effects on the readings depend on the frame
        seen = chain.see(at, placed)
        slope = seen.jacobian[..., layout.frame].reshape(-1, 6)
        left = (poses.point - seen.reading).reshape(-1)
        placed[layout.frame] += np.linalg.lstsq(slope, left, rcond=None)[0]
    return placed


def _followed(jacobian: Array, chain: Chain, covariance: Array) -> tuple[Array, Array]:
    """Covariance of theta with the frame following all else, and slope by the frame.

    Args:
        jacobian: d(reading)/d(theta), (n, 3, P).
        chain: gives the layout of theta.
        covariance: of theta by the calibration, (P, P).

    Returns:
        (P, P) without the uncertainty of the frame itself, and (n, 3, 6).
    """
    slope, size = jacobian[..., chain.layout.frame], len(covariance)
    frame = np.arange(size)[chain.layout.frame]
    others = np.setdiff1d(np.arange(size), frame)
    flat = slope.reshape(-1, len(frame))
    along = np.linalg.lstsq(flat, jacobian[..., others].reshape(len(flat), -1), rcond=None)[0]
    moves = np.zeros((size, len(others)))
    moves[others, np.arange(len(others))] = 1.0
    moves[frame] = -along
    return np.asarray(moves @ covariance[np.ix_(others, others)] @ moves.T), slope


def _studentized(whiten: Array, slope: Array, missed: Array, place: Index) -> Array:
    """Residuals (n, 3) [m] as large as if the fit of the frame had absorbed none of them."""
    white = (whiten @ missed[..., None])[..., 0]
    own = whiten @ slope
    flat = own.reshape(-1, own.shape[-1])
    known = Known(flat.T @ flat, flat.T @ white.reshape(-1), np.zeros(own.shape[-1]))
    free = studentized(known, own, white, place)
    return np.asarray(np.linalg.solve(whiten, free[..., None])[..., 0])


def _excess(error: Array, readings: Array, parts: Parts, place: Index) -> float:
    """Mean excess of squared errors (n, 3) [m] over what is stated, in its standard errors.

    Args:
        error: measured less predicted, in the base.
        readings: covariance of the tracker's noise, (n, 3, 3) [m^2].
        parts: of the stated uncertainty at the poses.
        place: (n,) of each pose; the error of the model is the same at all visits.
    """
    beyond = np.sum(error**2, axis=1) - np.trace(readings + parts.whole, axis1=1, axis2=2)
    mean = float(beyond.mean())
    own = float(np.linalg.norm(np.bincount(place, beyond - mean)) / len(beyond))
    return mean / max(float(np.hypot(own, parts.doubt.mean())), np.finfo(float).tiny)


def _beyond(error: Array, readings: Array, parts: Parts, widen: float) -> bool:
    """Whether more errors (n, 3) [m] than by chance exceed their 95 % radius, times `widen`."""
    normal = readings + parts.whole - parts.play
    radius = widen * radius95(normal, parts.sided, parts.doubt, parts.fourth)
    return reached(np.linalg.norm(error, axis=1) / radius) > 1.0
