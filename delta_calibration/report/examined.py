"""Comparison of a session's poses with the identified machine, as the basis of a certificate."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from delta_calibration.calibration import Calibration
from delta_calibration.data import Conditions, Poses, at_rest
from delta_calibration.errors import DataError
from delta_calibration.estimation import (
    Identification,
    chain_of,
    doubts,
    prepare,
    registered,
)
from delta_calibration.estimation.noise import Noise
from delta_calibration.geometry import Frame
from delta_calibration.lazy import cached_property
from delta_calibration.plans import joints_toward, tool_frames
from delta_calibration.region import Region
from delta_calibration.report.confirmed import Confirmed, confirmed
from delta_calibration.robot import Robot
from delta_calibration.uncertainty import Identified
from delta_calibration.wording import figures

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_BESIDE = 1e-2  # margin over the range of each joint, for the errors of the machine
_ON_FACE = 1e-6  # [m] tolerance for a place on a face of the region


@dataclass(frozen=True)
class Examined:
    """Measured poses with their errors by the nominal and by the identified machine."""

    robot: Robot
    poses: Poses
    identified: Identified
    noise: Noise
    region: Region
    joint_range: tuple[Array, Array]  # lowest and highest measured, (m,) [rad or m]
    target: Array  # (n, 3) [m] tool points that were commanded, by the drawing, in the base
    before: Array  # (n, 3) [m] measured less commanded, in the base; drawing in its best place
    after: Array  # (n, 3) [m] error that would remain with corrected commands
    believed: Mask  # (n,) whether the fit counts a pose
    seen: bool  # whether the identified machine was fitted to these very poses
    doubts: tuple[str, ...] = ()
    fit: Identification | None = None  # None: the machine was identified elsewhere
    # whether model error, play and repeatability are as the earlier calibration states them; else
    # they were estimated from the residuals of these poses
    stated: bool = False

    @property
    def place(self) -> Array:
        """Middle of the poses, (3,) [m] in the base."""
        return np.asarray(self.target.mean(axis=0))

    def tools(self, platform: Array) -> Array:
        """Tool points of platforms at places (k, 3) [m], oriented as at the nearest pose."""
        near = np.argmin(cdist(platform, self._platform), axis=1)
        return np.asarray(platform + (self.target - self._platform)[near])

    @cached_property
    def _platform(self) -> Array:
        """Nominal platform positions of the poses, (n, 3) [m]; they define the region."""
        model = self.robot.commanded
        x = model.forward(self.poses.command, model.parameters.nominal)
        return np.asarray(model.position(x))

    def conditions(self, joint: Array) -> Conditions:
        """Conditions of joints (n, m) at rest, with the session's median load and temperatures."""
        n, poses = len(joint), self.poses
        payload = float(np.median(np.nan_to_num(poses.payload)))
        warm = np.nanmedian(poses.temperature, axis=0) if poses.temperature_parts else np.zeros(0)
        return replace(
            at_rest(joint),
            payload=np.full(n, payload),
            payload_centre=np.zeros((n, 3)),
            temperature_parts=poses.temperature_parts,
            temperature=np.tile(warm, (n, 1)),
        )

    @property
    def measured(self) -> Array:
        """Measured positions, (n, 3) [m] in the base."""
        return np.asarray(self._frame.inverse().apply(self.poses.point))

    @property
    def _frame(self) -> Frame:
        return self.identified.chain.split(self.identified.theta)[2]

    def beam(self, places: Array) -> Array:
        """Unit vectors from the tracker to places (n, 3) in the base, (n, 3)."""
        way = places - self._frame.inverse().translation
        return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))

    def joints_at(self, places: Array) -> Array:
        """Nominal joints for tool points (k, 3) [m] of the region, (k, m).

        The platform is oriented as at the nearest measured pose. NaN out of reach, outside the
        region, and beyond the measured joint range.
        """
        turns = tool_frames(self.robot, self.poses.command)[1]
        near = np.argmin(cdist(places, self.target), axis=1)
        joint = joints_toward(self.robot, places, turns[near])
        joint[~self._inside(joint)] = np.nan
        return joint

    def radius_at(self, places: Array, stated: Array | None = None) -> Array:
        """95 % radius of corrected positions about tool points (k, 3) of the region, (k,) [m].

        Args:
            places: tool points in the base, (k, 3) [m].
            stated: additional covariance by stated uncertainties, (k, 3, 3) [m^2].

        Returns:
            Radius, (k,) [m]; NaN where `joints_at` is.
        """
        joint, radius = self.joints_at(places), np.full(len(places), np.nan)
        rows = np.flatnonzero(np.isfinite(joint).all(axis=1))
        if rows.size:
            more = 0.0 if stated is None else stated[rows]
            radius[rows] = self.identified.radius(self.conditions(joint[rows]), more)
        return radius

    def _inside(self, joint: Array) -> Mask:
        """Whether joints (k, m) and their platform positions lie in the measured range."""
        low, high = self.joint_range
        margin = _BESIDE * (high - low)
        model = self.robot.commanded
        with np.errstate(invalid="ignore"):
            within = np.asarray(((joint >= low - margin) & (joint <= high + margin)).all(axis=1))
            rows = np.flatnonzero(within)
            x = model.forward(joint[rows], model.parameters.nominal)
            within[rows] = self.region.outside(model.position(x)) <= _ON_FACE
        return within


def examined_fit(found: Identification, poses: Poses, robot: Robot) -> Examined:
    """Examine poses by a fit to themselves; the errors are held-out errors."""
    at, counted = poses.conditions, found.weight > 0
    turned = found.frame.rotation
    whole = poses.point - found.chain.predict(at, found.theta)
    after = np.where(counted[:, None], found.missed, whole) @ turned
    drawn = found.chain.split(found.frame_only_theta)[2].rotation
    bare = chain_of(robot, found.chain.mechanism.name)
    loose = poses.point - bare.predict(at, found.frame_only_theta[bare.layout.base])
    before = np.where(counted[:, None], found.missed_before, loose) @ drawn
    return Examined(
        robot,
        poses,
        Identified(found.chain, found.theta, found.uncertainty, float(poses.time.max())),
        found.noise,
        found.region,
        found.region_joints,
        tool_frames(robot, poses.command)[0],
        before,
        after,
        counted,
        seen=False,
        doubts=doubts(found),
        fit=found,
    )


def examined_by(calibration: Calibration, poses: Poses, robot: Robot) -> Examined:
    """Examine poses by an earlier calibration; only the tracker's frame is fitted to them.

    The uncertainty is that of the calibration unless the poses refute it; then its model error,
    play and repeatability are estimated from the residuals of the poses.

    Args:
        calibration: calibration with the uncertainty of its positions.
        poses: measured poses.
        robot: drawing, tracker.

    Raises:
        DataError: a calibration without uncertainties, or poses out of its reach.
    """
    identified = calibration.identified
    if identified is None:
        raise DataError(
            f"the calibration of session {calibration.source!r} does not contain the uncertainty "
            "of its positions: it was written by an older version; fit again"
        )
    chain, at = calibration.chain, poses.conditions
    _, noise, problem = prepare(poses, robot, chain_of(robot, chain.mechanism.name))
    start = registered(problem)
    drawn = problem.chain.split(start.theta)[2].rotation
    before = (problem.y - problem.chain.predict(at, start.theta)) @ drawn
    seen = calibration.measured == poses.digest  # its uncertainty is by these very residuals
    held = confirmed(identified if seen else identified.later, poses, noise, robot)
    return Examined(
        robot,
        poses,
        identified if seen else held.identified,
        noise,
        calibration.region,
        (calibration.joints_lower, calibration.joints_upper),
        tool_frames(robot, poses.command)[0],
        before,
        held.after,
        np.ones(len(poses), dtype=bool),
        seen=seen,
        doubts=(_refuted(held),) if held.refuted and not seen else (),
        stated=held.stated and not seen,
    )


def _refuted(held: Confirmed) -> str:
    """Sentence on a calibration that the session refutes."""
    found, told = (
        figures(1e3 * value, 2)
        for value in (float(np.sqrt(np.mean(np.sum(held.after**2, axis=1)))), held.expected)
    )
    return (
        f"this session refutes the uncertainty of the calibration: its points miss by {found} mm "
        f"RMS, {told} mm follow from the calibration. The certified radius and the budget are "
        "therefore by the residuals of this session; the machine may have changed since, so "
        "calibrate it again"
    )
