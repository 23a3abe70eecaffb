"""A UR10 measured by a laser tracker: geometry and its residuals, with blocks of time held out.

Extensions are columns beside those of the geometry, linearised about the fit. Each block of
consecutive poses is predicted by a fit without it, because poses that are close in time are alike.
"""

from __future__ import annotations

import csv
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from delta_calibration.estimation.measurements import PoseMeasured
from delta_calibration.estimation.mixed_measurements import MixedFit, fit_observations
from delta_calibration.geometry import Frame, align
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmTolerances
from delta_calibration.robot import load_robot

UR10 = load_robot("ur10").dimensions

Array = NDArray[np.float64]

SERIES = {"A": "series_a_grid.csv", "C": "series_c_random_poses.csv"}
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
TOLERANCES = ArmTolerances(length=1e-3, twist=1e-3, zero=1e-3, tool=np.inf, mount=np.inf)
NOISE, TURN_NOISE = 0.2e-3, 1e-3  # [m], [rad]: probe noise and what the model leaves out
BLOCKS = 10
PACE = 3.74  # [s] per pose, from series A; the stamps of C have lost their digits
WARMING = (600.0, 1200.0, 2400.0, 4800.0)  # [s] time constants of thermal growth of the links
GROWTH = 150e-6  # [1] expected size
KNOT = np.radians(4.0)  # of the error curve of a joint; chosen in advance, not tuned
CURVE, HARMONIC, DRIFT = 0.15e-3, 0.15e-3, 0.1e-3  # expected sizes [rad, m]
BENDING = (0, 1, 2, 3, 4)  # joints that move the probe far; the last rotates it in place
_GENEROUS = 10.0  # factor on the expected sizes of the geometry in a linearised fit


@dataclass(frozen=True)
class Series:
    """Poses in the order in which they were measured."""

    joint: Array  # (n, 6) [rad] commanded
    point: Array  # (n, 3) [m] of the probe in the tracker's frame
    rotation: Array  # (n, 3, 3)
    time: Array  # (n,) [s] since the first; by order at the usual pace where stamps are missing
    temperature: Array  # (n,) [deg C] of the room

    @property
    def clock(self) -> Array:
        """Time scaled to -1 ... 1 over the series, (n,)."""
        return 2 * (self.time - self.time[0]) / (self.time[-1] - self.time[0]) - 1

    def take(self, rows: NDArray[np.intp]) -> Series:
        """A subset of the poses."""
        return Series(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


@dataclass(frozen=True)
class Left:
    """Residuals of the geometry in a series, and their derivatives."""

    series: Series
    missed: Array  # (n, 3) [m]
    geometry: Array  # (n, 3, P) per expected size
    by_joint: Array  # (n, 3, 6) [m/rad]
    growth: Array  # (n, 3) [m] when all links grow in proportion to their length


@dataclass(frozen=True)
class Gained:
    """Gain of an extension on held-out blocks."""

    name: str
    gain: float  # [m] decrease of the RMS, mean over blocks
    half: float  # [m] half width of its 95 % interval


def read(path: Path) -> Series:
    """Read a series as published."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))

    def columns(*names: str) -> Array:
        return np.array([[float(row[name]) for name in names] for row in rows])

    angles = columns(*(f"measurement_r{axis}" for axis in "xyz"))
    return Series(
        joint=columns(*(f"{name}_joint" for name in JOINTS)),
        point=1e-3 * columns(*(f"measurement_{axis}" for axis in "xyz")),
        rotation=Rotation.from_euler("XYZ", angles, degrees=True).as_matrix(),
        time=_time([row["timestamp"] for row in rows]),
        temperature=columns("measurement_temperature")[:, 0],
    )


def mounted(series: Series) -> tuple[SerialArm, Frame]:
    """The nominal arm with the probe's mounting found from the poses, and the tracker frame.

    Alternates between the frame that fits the positions best and the mounting that fits in that
    frame.
    """
    bare = SerialArm(UR10, TOLERANCES)
    x = bare.forward(series.joint, bare.parameters.nominal)
    flange, tool = bare.rotation(x), np.zeros(3)
    for _ in range(200):
        frame = align(x[:, :3] + flange @ tool, series.point)
        seen = frame.inverse().apply(series.point) - x[:, :3]
        tool = np.mean(np.swapaxes(flange, 1, 2) @ seen[..., None], axis=0)[:, 0]
    turn = np.swapaxes(frame.rotation @ flange, 1, 2) @ series.rotation
    mount = Rotation.from_matrix(turn).mean().as_euler("ZYX")
    return SerialArm(replace(UR10, tool=tool, mount=mount), TOLERANCES), frame


def fits(series: Series) -> tuple[MixedFit, MixedFit]:
    """Fit base and tool alone, then the whole geometry, by plain least squares of whole poses."""
    arm, frame = mounted(series)
    seen = PoseMeasured(
        series.joint, series.point, np.zeros(3), NOISE, series.rotation, TURN_NOISE
    )
    tool = np.array([name.startswith("tool") for name in arm.parameters.names])
    return (
        fit_observations(arm, [seen], frame, tool, priors=False),
        fit_observations(arm, [seen], frame, priors=False),
    )


def position_rms(fit: MixedFit) -> float:
    """RMS of the 3-D position residuals [m]."""
    return fit.rms(0, slice(0, 3))


def left_by(fit: MixedFit, series: Series) -> Left:
    """Position residuals of the fitted geometry."""
    seen = PoseMeasured(
        series.joint, series.point, np.zeros(3), NOISE, series.rotation, TURN_NOISE
    )
    chain = fit.machine.chain
    own = ~chain.layout.mask(chain.layout.offset)
    slopes = seen.slopes(fit.machine)[:, :3, own]
    parameters = chain.mechanism.parameters
    prior = np.append(parameters.prior, np.full(6, np.inf))
    scale = np.where(np.isfinite(prior), prior, 1e-3)
    zeros = [parameters.row(f"zero_{joint}") for joint in range(1, 7)]
    lengths = [p.nominal * (p.cause in ("link_length", "link_offset")) for p in parameters]
    growth = slopes[..., : len(parameters)] @ np.array(lengths)
    missed = seen.missed(fit.machine)[:, :3]
    return Left(series, missed, slopes * scale, slopes[..., zeros], growth)


def extensions(left: Left) -> Iterator[tuple[str, Array]]:
    """Yield names and columns (n, 3, k), each at its expected size."""
    series, q = left.series, left.series.joint
    course = np.stack([series.clock, series.clock**2, series.clock**3], axis=1)
    warm = (series.temperature - series.temperature.mean())[:, None]
    frame = left.geometry[..., -6:] * 0.1  # tenths of a millimetre and of a milliradian
    zeros = left.by_joint * DRIFT
    yield "tracker or base drifts, cubic in time", _times(frame, course)
    yield "tracker or base by room temperature", _times(frame, warm)
    yield "joint zeros drift, cubic in time", _times(zeros, course)
    yield "joint zeros by room temperature", _times(zeros, warm)
    yield "joints give way to gravity", gravity(left)
    over = [1 - np.exp(-series.time / constant) for constant in WARMING]
    links = left.growth[..., None] * GROWTH
    yield "links grow as the arm warms up", _times(links, np.stack(over, axis=1))
    yield (
        "one and two cycles a turn of each joint",
        np.concatenate(
            [left.by_joint * wave(n * q)[:, None] for n in (1, 2) for wave in (np.sin, np.cos)], -1
        )
        * HARMONIC,
    )


def gravity(left: Left) -> Array:
    """Sag of joints 2, 3, 4 by the lever of each link, (n, 3, k)."""
    each = levers(left.series.joint).items()
    parts = [left.by_joint[..., j] * v[:, None] for j, some in each for v in some]
    return np.stack(parts, axis=-1) * 0.3e-3


def levers(q: Array) -> dict[int, list[Array]]:
    """Terms of gravity's torque about joints 2, 3, 4: cosines of absolute angles, (n,)."""
    upper = q[:, 1]
    fore, wrist = upper + q[:, 2], upper + q[:, 2] + q[:, 3]
    hand = [np.sin(wrist), np.cos(wrist), np.cos(wrist) * np.sin(q[:, 4])]
    return {1: [np.cos(upper), np.cos(fore), *hand], 2: [np.cos(fore), *hand], 3: hand}


def curves(left: Left, joints: tuple[int, ...]) -> Array:
    """Error of each joint as a free function of its own angle, cubic splines, (n, 3, k)."""
    q = left.series.joint
    return np.concatenate(
        [left.by_joint[..., j, None] * _splines(q[:, j])[1][:, None] * CURVE for j in joints],
        axis=-1,
    )


def curve_of(left: Left, joint: int, at: Array, joints: tuple[int, ...] = BENDING) -> Array:
    """Estimated error of a joint at given angles, (k,) [rad], beside the curves of the others."""
    columns = np.concatenate([left.geometry, curves(left, joints)], axis=-1)
    values = _solve(*_normal(columns, left.missed), _generous(left))
    first = left.geometry.shape[-1]
    for j in joints:
        knots, design = _splines(left.series.joint[:, j])
        size = design.shape[1]
        if j == joint:
            return np.asarray(BSpline(knots, values[first : first + size] * CURVE, 3)(at))
        first += size
    raise ValueError(f"joint {joint} is none of {joints}")


def curve_size(left: Left, joint: int) -> float:
    """RMS of a joint's error curve about its mean, over the middle 80 % of the poses [rad]."""
    low, high = np.quantile(left.series.joint[:, joint], [0.1, 0.9])
    return float(np.std(curve_of(left, joint, np.linspace(low, high, 500))))


def agreement(one: Left, other: Left, joint: int) -> tuple[float, Array]:
    """Correlation of a joint's error curves in two series, and the range that they share [rad].

    The outer tenths of the range are left out because splines have few poses there. A fourth-order
    polynomial is subtracted from both because other parameters may have absorbed it in either
    series.
    """
    ranges = [np.quantile(x.series.joint[:, joint], [0.0, 1.0]) for x in (one, other)]
    low, high = max(r[0] for r in ranges), min(r[1] for r in ranges)
    at = np.linspace(low + 0.1 * (high - low), high - 0.1 * (high - low), 500)
    left = [without_course(curve_of(each, joint, at)) for each in (one, other)]
    return float(np.corrcoef(*left)[0, 1]), at[[0, -1]]


def without_course(curve: Array) -> Array:
    """A curve at even steps, (k,), minus its fourth-order polynomial."""
    course = np.vander(np.linspace(-1, 1, len(curve)), 5)
    return np.asarray(curve - course @ np.linalg.lstsq(course, curve, rcond=None)[0])


def held_out(left: Left, *columns: Array) -> Array:
    """Residuals of each block by a fit without that block, (n, 3) [m]."""
    every = np.concatenate([left.geometry, *columns], axis=-1)
    n = len(left.missed)
    block = np.arange(n) * BLOCKS // n
    parts = [_normal(every[block == b], left.missed[block == b]) for b in range(BLOCKS)]
    matrix, right = (sum(part[i] for part in parts) for i in (0, 1))
    missed = np.zeros_like(left.missed)
    for b, (own, own_right) in enumerate(parts):
        values = _solve(matrix - own, right - own_right, _generous(left))
        missed[block == b] = left.missed[block == b] - every[block == b] @ values
    return missed


def margin(before: Array, after: Array) -> tuple[float, float]:
    """Mean over blocks of the decrease of the RMS, and half its 95 % interval [m]."""
    n = len(before)
    block = np.arange(n) * BLOCKS // n

    def each(missed: Array) -> Array:
        return np.array([rms(missed[block == b]) for b in range(BLOCKS)])

    gain = each(before) - each(after)
    half = student.ppf(0.975, BLOCKS - 1) * gain.std(ddof=1) / np.sqrt(BLOCKS)
    return float(gain.mean()), float(half)


def rms(missed: Array) -> float:
    """Root mean square of the 3-D distance."""
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=-1))))


def report(root: Path) -> tuple[dict[str, Left], dict[str, list[Gained]]]:
    """Print all results; return the residuals of each series and the gain of each extension."""
    lefts, gains = {}, {}
    for name, file in SERIES.items():
        series = read(root / file)
        nominal, full = fits(series)
        print(f"UR10, series {name}, {len(series.joint)} poses")
        print(f"  base and tool {position_rms(nominal) * 1e3:.3f} mm RMS, all geometry", end=" ")
        print(f"{position_rms(full) * 1e3:.3f} mm; rank {full.observability.rank} of", end=" ")
        print(full.observability.columns)
        left = lefts[name] = left_by(full, series)
        base = held_out(left)
        print(f"  {'geometry':48s} held out {rms(base) * 1e3:.3f} mm")
        gained = gains[name] = []
        for what, columns in extensions(left):
            gained.append(_tell(what, base, held_out(left, columns)))
        for joints in ((0,), (1,), (2,), (0, 1, 2), BENDING):
            named = ", ".join(str(joint + 1) for joint in joints)
            after = held_out(left, curves(left, joints))
            gained.append(_tell(f"own error curve of joint {named}", base, after))
        own = curves(left, BENDING)
        base = held_out(left, own)
        sizes = ", ".join(f"{curve_size(left, joint) * 1e3:.2f}" for joint in BENDING)
        print(f"  the five curves: {sizes} mrad RMS; beside them")
        for what, columns in extensions(left):
            _tell(what, base, held_out(left, own, columns))
    print("error curves of one joint, found in A and in C apart (joint 1 shares no range)")
    for joint in (1, 2, 3, 4):
        correlation, (low, high) = agreement(lefts["A"], lefts["C"], joint)
        shared = f"{np.degrees(low):.0f} to {np.degrees(high):.0f} deg"
        print(f"  joint {joint + 1}, {shared}: correlation {correlation:.3f}")
    return lefts, gains


def _tell(what: str, before: Array, after: Array) -> Gained:
    gain, half = margin(before, after)
    print(f"  {what:48s} held out {rms(after) * 1e3:.3f} mm", end="  ")
    print(f"gain {gain * 1e3:+.3f} +- {half * 1e3:.3f}")
    return Gained(what, gain, half)


def _times(columns: Array, course: Array) -> Array:
    """Products of the columns (n, 3, k) with each of the courses (n, c): (n, 3, k c)."""
    return np.concatenate([columns * c[:, None, None] for c in course.T], axis=-1)


def _splines(angle: Array) -> tuple[Array, Array]:
    """Knots, and the cubic B-splines at each angle, (n, k)."""
    low, high = angle.min(), angle.max()
    inner = np.linspace(low, high, max(2, int(np.ceil((high - low) / KNOT)) + 1))
    step = inner[1] - inner[0]
    before, after = low - step * np.arange(3, 0, -1), high + step * np.arange(1, 4)
    knots = np.concatenate([before, inner, after])
    return knots, BSpline.design_matrix(angle, knots, 3).toarray()


def _normal(columns: Array, missed: Array) -> tuple[Array, Array]:
    flat = columns.reshape(-1, columns.shape[-1]) / NOISE
    return flat.T @ flat, flat.T @ missed.ravel() / NOISE


def _generous(left: Left) -> int:
    return left.geometry.shape[-1]


def _solve(matrix: Array, right: Array, geometry: int) -> Array:
    """Least squares with expected sizes as priors, wider ones for the geometry."""
    prior = np.ones(len(right))
    prior[:geometry] = _GENEROUS**-2
    return np.asarray(np.linalg.solve(matrix + np.diag(prior), right))


def _time(stamps: list[str]) -> Array:
    """Times from stamps YYYYmmddHHMMSS; from the order if the stamps have lost their digits."""
    if not all(len(stamp) == 14 and stamp.isdigit() for stamp in stamps):
        return PACE * np.arange(len(stamps), dtype=float)
    times = np.array([datetime.strptime(s, "%Y%m%d%H%M%S").timestamp() for s in stamps])
    return times - times[0]
