"""Share of each cause in the circular deviation, and the deviation that remains without it.

The actual path of a reflector, less the nominal path at the commanded joints, is a sum,

    off = following error + [model(all causes) - nominal model] + residual

with the model of the diagnosis. A cause is removed from that model, and the circles are predicted
again. As the largest and the smallest radius then lie elsewhere, the change depends on the causes
removed before: a share is the mean over all orders (the Shapley value of the range), so that all
shares add up to the whole deviation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import comb

import numpy as np
from numpy.typing import NDArray

from delta_calibration.circle_test.ballbar import Ballbar
from delta_calibration.circle_test.circles import (
    Circle,
    circular_deviation,
    circular_hysteresis,
    find_circles,
    pairs,
)
from delta_calibration.circle_test.dimensions import clear_dimensions
from delta_calibration.data import Conditions, Session
from delta_calibration.diagnosis import Diagnosis, Finding, Judgement, Model, Verdict
from delta_calibration.diagnosis.fitted import Fitted
from delta_calibration.diagnosis.verdict import Estimate
from delta_calibration.errors import DataError
from delta_calibration.geometry import Frame
from delta_calibration.lazy import cached_property
from delta_calibration.plans import tool_points
from delta_calibration.robot import Robot
from delta_calibration.theta import entries

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Key = tuple[str, str | None]  # a cause and where it sits

FOLLOWING = "following_error"
DIMENSIONS = "dimensions"  # all that are not findings
NOT_EXPLAINED = "not_explained"
NOISE = "measurement_noise"
_FOLLOW: Key = (FOLLOWING, None)
_LEFT: Key = ("left", None)  # residual: unexplained errors, and noise
_LOBES = 12  # largest number of undulations a turn that is searched
_SPIKE = 6.0  # a reading with a residual of so many times the median is an outlier
_SEEN = 2.0  # following errors are detected from so many times the encoders' variance


@dataclass(frozen=True)
class Share:
    """Share of a cause in a circular deviation."""

    cause: str
    location: str | None
    size: float  # [m]


@dataclass(frozen=True)
class Measured:
    """Evaluation of one measured circle."""

    circle: Circle  # with the readings that are no outliers
    off: Array  # (n, 3) [m] actual less commanded point, in the base
    radial: Array  # (n,) [m] actual less nominal radius about the least squares centre
    deviation: float  # [m] G
    hysteresis: float | None  # [m] H, if the circle was measured in both senses
    shares: tuple[Share, ...]  # they add up to G
    without: Mapping[Key, float]  # [m] G without a cause
    predicted: Array  # (n,) [m] radius by the extended model, less the nominal radius
    moved: Mapping[Key, Array]  # (n,) [m] contribution of a cause to the radius


@dataclass(frozen=True)
class PartError:
    """Form error of a round part due to one cause."""

    radius: float  # [m] mean error of the radius, positive if too large
    lobes: int  # number of waves a turn of the strongest undulation
    height: float  # [m] its amplitude
    senses: float  # [m] largest radial difference between the two senses


@dataclass(frozen=True)
class CircleTest:
    """Result of a circle test: verdict, circles, and deviating dimensions."""

    verdict: Verdict
    circles: tuple[Measured, ...]
    dimensions: Mapping[str, Estimate]  # significant deviations that are no findings, in order

    @property
    def deviation(self) -> float:
        """Mean circular deviation of all circles [m]."""
        return float(np.mean([m.deviation for m in self.circles]))

    @property
    def shares(self) -> tuple[Share, ...]:
        """Mean share of each cause, the largest first; they add up to the mean deviation."""
        first = self.circles[0].shares
        sizes = np.mean([[s.size for s in m.shares] for m in self.circles], axis=0)
        means = [replace(s, size=float(v)) for s, v in zip(first, sizes, strict=True)]
        return tuple(sorted(means, key=lambda share: -share.size))

    def without(self, cause: str, location: str | None) -> float:
        """Mean circular deviation if only this cause is repaired [m]."""
        return float(np.mean([m.without[cause, location] for m in self.circles]))

    @cached_property
    def first(self) -> Key | None:
        """The cause whose repair reduces the deviation most; None if no repair reduces it."""
        known = self.circles[0].without
        best = min(known, key=lambda key: self.without(*key), default=None)
        return best if best is not None and self.without(*best) < self.deviation else None

    def part_error(self, cause: str, location: str | None) -> PartError:
        """Form error by a cause of a round part that is machined on these circles."""
        key = (cause, location)
        waves = np.array([_waves(m.circle.angle, m.moved[key]) for m in self.circles])
        mean = np.sqrt(np.mean(waves[:, 1:] ** 2, axis=0))
        k = int(np.argmax(mean))
        apart = [
            _apart(self.circles[i], self.circles[j], key)
            for i, j in pairs([m.circle for m in self.circles])
        ]
        return PartError(
            float(np.mean(waves[:, 0])), k + 2, float(mean[k]), max(apart, default=0.0)
        )

    def finding(self, cause: str, location: str | None) -> Finding | None:
        """The finding of the verdict for a cause; None if the cause is no finding."""
        every = self.verdict.findings
        return next((f for f in every if (f.cause, f.location) == (cause, location)), None)


def circle_test(session: Session, robot: Robot, diagnosis: Diagnosis) -> CircleTest:
    """Evaluate the circles of a session that was diagnosed.

    Raises:
        DataError: no circle among the paths of the session.
    """
    verdict = diagnosis.verdict
    found = measured_circles(session, robot, diagnosis.model, verdict.findings)
    return CircleTest(verdict, found, _dimensions(diagnosis.model, verdict.findings))


def ballbar_test(ballbar: Ballbar, robot: Robot, judgement: Judgement) -> CircleTest:
    """Evaluate the circles of a ballbar that was diagnosed by `diagnose_ballbar`."""
    model, findings = judgement.model, judgement.verdict.findings
    parts = _Lengths(model, robot, findings, ballbar)
    measured = _all_measured(ballbar.circles, parts)
    return CircleTest(judgement.verdict, measured, _dimensions(model, findings))


def measured_circles(
    session: Session, robot: Robot, model: Model, findings: Sequence[Finding] = ()
) -> tuple[Measured, ...]:
    """Evaluate the circles of a session, in order of time.

    Args:
        session: the recorded session.
        robot: nominal dimensions and noise.
        model: the model fitted to the session.
        findings: causes in the model that get shares of their own.

    Raises:
        DataError: no circle among the paths of the session.
    """
    survey = model.survey
    at, paths = survey.paths.conditions, survey.paths
    command = _commanded(session, robot, survey.poses.start_ns, at)
    circles = find_circles(at.time, tool_points(robot, command), paths.path)
    if not circles:
        raise DataError(
            f"{session.source}: no circle among {len(np.unique(paths.path))} paths in motion: "
            "one turn of 340 degrees or more at a constant feed is needed, as the plan circles has"
        )
    return _all_measured(circles, _Readings(model, robot, findings, command))


def _all_measured(circles: tuple[Circle, ...], parts: _Parts) -> tuple[Measured, ...]:
    kept = parts.kept
    circles = tuple(circle.take(kept[circle.rows]) for circle in circles)
    measured = [_measured(circle, parts) for circle in circles]
    for i, k in pairs(circles):
        height = circular_hysteresis(circles[i], measured[i].off, circles[k], measured[k].off)
        measured[i] = replace(measured[i], hysteresis=height)
        measured[k] = replace(measured[k], hysteresis=height)
    return tuple(measured)


class _Parts(ABC):
    """Contributions to the reflector's deviation from its nominal path, predicted by cause."""

    following: bool  # whether following errors of the drives are one contribution
    begin: int  # first row of these readings in the evidence
    repeatability: float  # [rad or m] of the joints

    def __init__(
        self,
        model: Fitted,
        findings: Sequence[Finding],
        at: Conditions,
        command: Array,
        offset: Array | None = None,
    ) -> None:
        """Predict for joints as read (`at`) and as commanded; `offset` (3,) if theta has none."""
        self.model, self.at = model, at
        self.chain, self.layout, self.theta = (
            model.extended.chain,
            model.layout,
            model.theta.copy(),
        )
        if offset is not None:
            self.theta[self.layout.offset] = offset
        self.frame = Frame.from_vector(self.theta[self.layout.frame])
        self.rows = _rows_of(model, findings)
        self.drawn = self._seen(frozenset())
        commanded = self._seen(frozenset(), replace(at, joint=command))
        self.follow = self._in_base(self.drawn - commanded)
        self.full = self._seen(frozenset(self.rows))
        self.left = self._in_base(self.unseen())
        self._kept: dict[frozenset[Key], Array] = {}

    @abstractmethod
    def unseen(self) -> Array:
        """Residual: measured less predicted by the extended model, (n, 3) [m]."""

    @abstractmethod
    def root(self, rows: Index) -> Array:
        """Square root of the covariance of some readings, (k, 3, d) [m]."""

    @property
    def _believed(self) -> NDArray[np.bool_]:
        """Mask of the readings that the fit did not set aside, (n,)."""
        return self.model.evidence.believed[self.begin :]

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Mask of the readings that are no outliers, (n,).

        Readings just after a joint reverses are left out of a fit, but kept in the circle.
        """
        off = np.linalg.norm(self.left, axis=1)
        usual = float(np.median(off[self._believed]))
        return np.asarray(self._believed | (off <= _SPIKE * usual))

    def causes(self, keys: frozenset[Key]) -> Array:
        """Displacement of the reflector by these causes, (n, 3) [m] in the base frame."""
        if keys not in self._kept:
            self._kept[keys] = self._in_base(self._seen(keys) - self.drawn)
        return self._kept[keys]

    def noise(self, circle: Circle) -> float:
        """Variance of the radii due to noise and rest errors of the joints [m^2]."""
        circle = circle.take(self._believed[circle.rows])
        root = self.frame.rotation.T @ self.root(circle.rows)
        reading = np.sum(_outward(circle, root) ** 2, axis=1)
        by_joints = self.model.evidence.by_joints[circle.rows + self.begin, :3]
        slope = root @ by_joints * self.repeatability
        resting = _outward(circle, slope)
        turn = circle.angle
        shift = np.column_stack([np.cos(turn), np.sin(turn), np.ones(len(turn))])
        resting = resting - shift @ np.linalg.lstsq(shift, resting, rcond=None)[0]
        return float(reading.mean() + np.sum(resting**2, axis=1).mean())

    def _seen(self, keys: frozenset[Key], at: Conditions | None = None) -> Array:
        """Predicted readings of a machine with these causes only, (n, 3) [m]."""
        theta, layout = self.theta.copy(), self.layout
        nominal = np.zeros(len(theta))
        nominal[layout.chain] = self.chain.parameters.nominal
        gone = ~layout.mask(layout.offset, layout.frame)
        for key, rows in self.rows.items():
            gone[rows] = key not in keys
        theta[gone] = nominal[gone]
        return self.chain.predict(self.at if at is None else at, theta[layout.chain])

    def _in_base(self, way: Array) -> Array:
        return np.asarray(way @ self.frame.rotation)


class _Readings(_Parts):
    """Contributions for a tracker's readings in motion."""

    def __init__(
        self, model: Model, robot: Robot, findings: Sequence[Finding], command: Array
    ) -> None:
        paths = model.survey.paths
        at = paths.conditions
        self.following = _follows(command, at.joint, paths.count, robot)
        self.begin = len(model.survey.poses)
        self.repeatability = model.cell.noise.repeatability
        joint = at.joint if self.following else command
        super().__init__(model, findings, replace(at, joint=joint), command)

    def unseen(self) -> Array:
        """Residual of each point, (n, 3) [m]."""
        return np.asarray(self.at.reading - self.full)

    def root(self, rows: Index) -> Array:
        """Square root of the covariance of points, (k, 3, 3) [m]."""
        return np.asarray(np.linalg.inv(self.model.evidence.whiten[rows + self.begin, :3, :3]))


class _Lengths(_Parts):
    """Contributions for a ballbar's lengths; across the bar the residual is taken as zero."""

    def __init__(
        self, model: Fitted, robot: Robot, findings: Sequence[Finding], ballbar: Ballbar
    ) -> None:
        self.following, self.begin = False, 0
        self.repeatability = robot.joints.repeatability
        self.radius = ballbar.radius
        super().__init__(model, findings, ballbar.at, ballbar.at.joint, robot.tool_offset)

    def unseen(self) -> Array:
        """Residual along the bar, (n, 3) [m]."""
        length = np.linalg.norm(self.full, axis=1, keepdims=True)
        return np.asarray((self.radius[:, None] - length) * self.full / length)

    def root(self, rows: Index) -> Array:
        """Square root of the covariance of lengths, along the bar, (k, 3, 1) [m]."""
        along = self.full[rows] / np.linalg.norm(self.full[rows], axis=1, keepdims=True)
        return np.asarray(along[:, :, None] / self.model.evidence.whiten[rows])


def _measured(circle: Circle, parts: _Parts) -> Measured:
    """Evaluate a circle: its deviation, and the share of each cause in it."""
    rows, causes = circle.rows, frozenset(parts.rows)
    follow = frozenset({_FOLLOW} if parts.following else ())

    def radial(keys: frozenset[Key]) -> Array:
        off = parts.causes(keys & causes)[rows]
        off = off + parts.follow[rows] * (_FOLLOW in keys) + parts.left[rows] * (_LEFT in keys)
        return circle.radial(off)

    known = {keys: circular_deviation(radial(keys)) for keys in _subsets(causes | follow)}
    every = known | {k | {_LEFT}: circular_deviation(radial(k | {_LEFT})) for k in known}
    whole = causes | follow | {_LEFT}
    left = circle.radial(parts.left[rows])
    noisy = min(1.0, parts.noise(circle) / max(float(left.var()), 1e-300))
    shares = [Share(*key, _share(key, whole, every)) for key in (*parts.rows, *sorted(follow))]
    rest = _share(_LEFT, whole, every)
    shares += [Share(NOT_EXPLAINED, None, (1 - noisy) * rest), Share(NOISE, None, noisy * rest)]
    off = (parts.causes(causes) + parts.follow * bool(follow) + parts.left)[rows]
    here = circle.radial(off)
    return Measured(
        circle=circle,
        off=off,
        radial=here,
        deviation=every[whole],
        hysteresis=None,
        shares=tuple(shares),
        without={key: every[whole - {key}] for key in (*parts.rows, *sorted(follow))},
        predicted=radial(causes | follow),
        moved={key: here - radial(whole - {key}) for key in (*parts.rows, *sorted(follow))},
    )


def _share(key: Key, whole: frozenset[Key], value: Mapping[frozenset[Key], float]) -> float:
    """Shapley value of a key: the mean over all orders of its addition to those before it."""
    rest, total = whole - {key}, 0.0
    for before in _subsets(rest):
        weight = 1 / (len(whole) * comb(len(rest), len(before)))
        total += weight * (value[before | {key}] - value[before])
    return total


def _waves(angle: Array, moved: Array) -> Array:
    """Mean radial change, and amplitudes of 2, 3, ... waves a turn by least squares [m]."""
    turns = np.arange(1, _LOBES + 1) * angle[:, None]
    columns = np.column_stack([np.ones(len(angle)), np.cos(turns), np.sin(turns)])
    found = np.linalg.lstsq(columns, moved, rcond=None)[0]
    return np.append(found[:1], np.hypot(found[2 : _LOBES + 1], found[_LOBES + 2 :]))


def _apart(one: Measured, other: Measured, key: Key) -> float:
    """Largest difference of a cause's radial change between the two senses [m]."""
    there = np.argsort(np.mod(other.circle.angle, 2 * np.pi))
    angle, moved = np.mod(other.circle.angle, 2 * np.pi)[there], other.moved[key][there]
    back = np.interp(np.mod(one.circle.angle, 2 * np.pi), angle, moved, period=2 * np.pi)
    return float(np.abs(one.moved[key] - back).max())


def _subsets(keys: frozenset[Key]) -> list[frozenset[Key]]:
    ordered = sorted(keys, key=str)
    return [
        frozenset(chosen)
        for size in range(len(ordered) + 1)
        for chosen in combinations(ordered, size)
    ]


def _rows_of(model: Fitted, findings: Sequence[Finding]) -> dict[Key, Index]:
    """Entries of theta that belong to each cause, and those of all other dimensions.

    A finding that was not accepted into the extended model has none: its part stays unexplained.
    """
    layout, taken = model.layout, np.zeros(len(model.theta), dtype=bool)
    found: dict[Key, Index] = {}
    for finding in findings:
        rows = _rows_of_one(model, finding)
        if rows.size:
            found[finding.cause, finding.location] = rows
            taken[rows] = True
    other = entries(layout.geometry)
    other = other[~taken[other]]
    return found | ({(DIMENSIONS, None): other} if other.size else {})


def _dimensions(model: Fitted, findings: Sequence[Finding]) -> Mapping[str, Estimate]:
    rows = _rows_of(model, findings).get((DIMENSIONS, None), np.zeros(0, dtype=np.int64))
    return clear_dimensions(model, rows)


def _rows_of_one(model: Fitted, finding: Finding) -> Index:
    """Entries of theta of all terms with the name and place of a finding."""
    found = [np.zeros(0, dtype=np.int64)]
    for term, own in zip(model.terms, model.layout.each, strict=True):
        if (term.cause, term.location) == (finding.cause, finding.location):
            rows = np.array(term.rows, dtype=np.int64)
            found.append(rows if term.effect is None else entries(own)[rows])
    if len(found) > 1:
        return np.concatenate(found)
    if finding.cause == "geometry":
        return entries(model.layout.geometry)
    known = [(p.cause, p.location) for p in model.bare.parameters]
    return np.flatnonzero([key == (finding.cause, finding.location) for key in known])


def _commanded(session: Session, robot: Robot, start_ns: int, at: Conditions) -> Array:
    """Commanded joints at the readings in motion, (n, m); encoder joints without a command."""
    stream = session.command
    if stream is None:
        return at.joint
    stamps, order = np.unique(stream.stamp_ns, return_index=True)
    columns = [stream.names.index(name) for name in robot.joints.names]
    joint = stream.position[order][:, columns]
    time = (stamps - start_ns) * 1e-9
    return np.stack([np.interp(at.time, time, column) for column in joint.T], axis=1)


def _follows(command: Array, joint: Array, count: Index, robot: Robot) -> bool:
    """Whether the encoders deviate from the command by more than their noise."""
    noise = robot.joints.encoder**2 / count[:, None]
    return bool(((joint - command) ** 2).mean() > _SEEN * noise.mean())


def _outward(circle: Circle, columns: Array) -> Array:
    """Radial component of columns (n, 3, k) in the base frame, (n, k)."""
    way = np.cos(circle.angle)[:, None] * circle.axes[0]
    way = way + np.sin(circle.angle)[:, None] * circle.axes[1]
    return np.asarray(np.einsum("ni,nik->nk", way, columns))
