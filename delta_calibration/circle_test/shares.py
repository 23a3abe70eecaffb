"""What each cause takes of the circular deviation, and how round the circles are without it.

The path of a reflector, less where the drawing has it at the commanded joints, is a sum,

    off = following error + [model(all causes) - drawing] + what is left

with the model of the diagnosis. A cause is taken out of that model, and the circles are predicted
again. As the largest and the smallest radius lie elsewhere then, what is taken away depends on
what was taken out before: a share is the mean over all orders (the Shapley value of the range), so
that all shares add up to the whole deviation.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
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
from delta_calibration.plans import tool_points
from delta_calibration.robot import Robot
from delta_calibration.theta import entries

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Key = tuple[str, str | None]  # a cause and where it sits

FOLLOWING = "following_error"
DIMENSIONS = "dimensions"  # beyond those that are findings
NOT_EXPLAINED = "not_explained"
NOISE = "measurement_noise"
_FOLLOW: Key = (FOLLOWING, None)
_LEFT: Key = ("left", None)  # what is not explained, and noise
_LOBES = 12  # a turn, at most, that an undulation is looked for with
_SPIKE = 6.0  # times what is usually left, from which a reading is an outlier
_SEEN = 2.0  # times the encoders' variance, from which following errors are told from noise


@dataclass(frozen=True)
class Share:
    """What a cause takes of a circular deviation."""

    cause: str
    location: str | None
    size: float  # [m]


@dataclass(frozen=True)
class Measured:
    """A circle as it was measured."""

    circle: Circle  # of the readings that count
    off: Array  # (n, 3) [m] actual less commanded point, in the base
    radial: Array  # (n,) [m] actual less nominal radius about the least squares centre
    deviation: float  # [m] G
    hysteresis: float | None  # [m] H, where the way back was measured too
    shares: tuple[Share, ...]  # they add up to G
    without: Mapping[Key, float]  # [m] G without a cause
    predicted: Array  # (n,) [m] radius less the nominal one, by the extended model
    moved: Mapping[Key, Array]  # (n,) [m] what the radius loses without a cause


@dataclass(frozen=True)
class PartError:
    """What a cause does to a round part."""

    radius: float  # [m] by which radii are too large, in the mean
    lobes: int  # a turn, of the strongest undulation
    height: float  # [m] its amplitude
    senses: float  # [m] by which the two senses are apart, at most


@dataclass(frozen=True)
class CircleTest:
    """The circles of a session with what is wrong by them."""

    verdict: Verdict
    circles: tuple[Measured, ...]
    dimensions: Mapping[str, Estimate]  # clearly off the drawing and no findings, clearest first

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
        """Mean circular deviation with a cause repaired and nothing else done [m]."""
        return float(np.mean([m.without[cause, location] for m in self.circles]))

    @cached_property
    def first(self) -> Key | None:
        """The cause after whose repair the circles are roundest; none where none helps."""
        known = self.circles[0].without
        best = min(known, key=lambda key: self.without(*key), default=None)
        return best if best is not None and self.without(*best) < self.deviation else None

    def part_error(self, cause: str, location: str | None) -> PartError:
        """What a cause does to a round part that is made on these circles."""
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
        """What the verdict says of a cause; none of dimensions within their tolerances."""
        every = self.verdict.findings
        return next((f for f in every if (f.cause, f.location) == (cause, location)), None)


def circle_test(session: Session, robot: Robot, diagnosis: Diagnosis) -> CircleTest:
    """The circles of a session that was diagnosed.

    Raises:
        DataError: no circle among the paths of the session.
    """
    verdict = diagnosis.verdict
    found = measured_circles(session, robot, diagnosis.model, verdict.findings)
    return CircleTest(verdict, found, _dimensions(diagnosis.model, verdict.findings))


def ballbar_test(ballbar: Ballbar, robot: Robot, judgement: Judgement) -> CircleTest:
    """The circles of a ballbar whose lengths were judged by `diagnose_ballbar`."""
    model, findings = judgement.model, judgement.verdict.findings
    parts = _Lengths(model, robot, findings, ballbar)
    measured = _all_measured(ballbar.circles, parts)
    return CircleTest(judgement.verdict, measured, _dimensions(model, findings))


def measured_circles(
    session: Session, robot: Robot, model: Model, findings: Sequence[Finding] = ()
) -> tuple[Measured, ...]:
    """The circles of a session, in the order of time.

    Args:
        session: what was recorded.
        robot: drawing and noise.
        model: fitted to the session.
        findings: causes in it that are to have shares of their own.

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
    """The parts that the way of the reflector is the sum of, predicted cause by cause."""

    following: bool  # whether the drives' following errors are a part
    begin: int  # of the readings' rows in the evidence
    repeatability: float  # [rad or m] of the joints

    def __init__(
        self,
        model: Fitted,
        findings: Sequence[Finding],
        at: Conditions,
        command: Array,
        offset: Array | None = None,
    ) -> None:
        """Of samples at joints as read, and as commanded; `offset` (3,) where theta has none."""
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
        """What was measured less what the extended model predicts, (n, 3) [m]."""

    @abstractmethod
    def root(self, rows: Index) -> Array:
        """Root of the covariance of some readings, (k, 3, d) [m]."""

    @property
    def _believed(self) -> NDArray[np.bool_]:
        """Readings whose noise the evidence knows, (n,)."""
        return self.model.evidence.believed[self.begin :]

    @property
    def kept(self) -> NDArray[np.bool_]:
        """Readings that are no outliers, (n,).

        Those just after a joint's turn are left out of a fit; the circle has them.
        """
        off = np.linalg.norm(self.left, axis=1)
        usual = float(np.median(off[self._believed]))
        return np.asarray(self._believed | (off <= _SPIKE * usual))

    def causes(self, keys: frozenset[Key]) -> Array:
        """What these causes move the reflector by, (n, 3) [m] in the base."""
        if keys not in self._kept:
            self._kept[keys] = self._in_base(self._seen(keys) - self.drawn)
        return self._kept[keys]

    def noise(self, circle: Circle) -> float:
        """Variance of the radii that noise and rest errors make [m^2]."""
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
        """What the tracker reads of a machine with these causes only, (n, 3) [m]."""
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
    """Those of a tracker's readings in motion."""

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
        """Point by point."""
        return np.asarray(self.at.reading - self.full)

    def root(self, rows: Index) -> Array:
        """Of points, (k, 3, 3)."""
        return np.asarray(np.linalg.inv(self.model.evidence.whiten[rows + self.begin, :3, :3]))


class _Lengths(_Parts):
    """Those of a ballbar's lengths; across the bar nothing is known and nothing is missed."""

    def __init__(
        self, model: Fitted, robot: Robot, findings: Sequence[Finding], ballbar: Ballbar
    ) -> None:
        self.following, self.begin = False, 0
        self.repeatability = robot.joints.repeatability
        self.radius = ballbar.radius
        super().__init__(model, findings, ballbar.at, ballbar.at.joint, robot.tool_offset)

    def unseen(self) -> Array:
        """Along the bar."""
        length = np.linalg.norm(self.full, axis=1, keepdims=True)
        return np.asarray((self.radius[:, None] - length) * self.full / length)

    def root(self, rows: Index) -> Array:
        """Of lengths, (k, 3, 1)."""
        along = self.full[rows] / np.linalg.norm(self.full[rows], axis=1, keepdims=True)
        return np.asarray(along[:, :, None] / self.model.evidence.whiten[rows])


def _measured(circle: Circle, parts: _Parts) -> Measured:
    """A circle's deviation, and what of it is whose."""
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
    """Mean over all orders of what a key adds to those before it: its Shapley value."""
    rest, total = whole - {key}, 0.0
    for before in _subsets(rest):
        weight = 1 / (len(whole) * comb(len(rest), len(before)))
        total += weight * (value[before | {key}] - value[before])
    return total


def _waves(angle: Array, moved: Array) -> Array:
    """Mean of a radius, and amplitudes of 2, 3, ... waves a turn by least squares [m]."""
    turns = np.arange(1, _LOBES + 1) * angle[:, None]
    columns = np.column_stack([np.ones(len(angle)), np.cos(turns), np.sin(turns)])
    found = np.linalg.lstsq(columns, moved, rcond=None)[0]
    return np.append(found[:1], np.hypot(found[2 : _LOBES + 1], found[_LOBES + 2 :]))


def _apart(one: Measured, other: Measured, key: Key) -> float:
    """How far a cause draws the two senses apart, at most [m]."""
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
    """Entries of theta that each cause sets, and those of all other dimensions.

    A finding that the extended model was refused sets nothing: what it does is not explained.
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
    for term, own in zip(model.terms, model.layout.each, strict=True):
        if (term.cause, term.location) == (finding.cause, finding.location):
            rows = np.array(term.rows, dtype=np.int64)
            return rows if term.effect is None else entries(own)[rows]
    if finding.cause == "geometry":
        return entries(model.layout.geometry)
    known = [(p.cause, p.location) for p in model.bare.parameters]
    return np.flatnonzero([key == (finding.cause, finding.location) for key in known])


def _commanded(session: Session, robot: Robot, start_ns: int, at: Conditions) -> Array:
    """Joints that were commanded at the readings in motion, (n, m); the encoders' without."""
    stream = session.command
    if stream is None:
        return at.joint
    stamps, order = np.unique(stream.stamp_ns, return_index=True)
    columns = [stream.names.index(name) for name in robot.joints.names]
    joint = stream.position[order][:, columns]
    time = (stamps - start_ns) * 1e-9
    return np.stack([np.interp(at.time, time, column) for column in joint.T], axis=1)


def _follows(command: Array, joint: Array, count: Index, robot: Robot) -> bool:
    """Whether the encoders are farther off the command than their noise."""
    noise = robot.joints.encoder**2 / count[:, None]
    return bool(((joint - command) ** 2).mean() > _SEEN * noise.mean())


def _outward(circle: Circle, columns: Array) -> Array:
    """What columns (n, 3, k) in the base do to the radius, (n, k)."""
    way = np.cos(circle.angle)[:, None] * circle.axes[0]
    way = way + np.sin(circle.angle)[:, None] * circle.axes[1]
    return np.asarray(np.einsum("ni,nik->nk", way, columns))
