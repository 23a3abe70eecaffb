"""Performance criteria of ISO 9283:1998 (GB/T 12642), for positions.

The formulas are from general knowledge of the standard, not from its text; check the text before a
figure goes into a contract. Left out: the criteria of orientation, of speed, of cornering and of
settling, and the drift of pose characteristics.

    AP = |mean x - x_c|                        pose accuracy: x attained, x_c commanded
    RP = mean l + 3 S_l, l_j = |x_j - mean x|  pose repeatability; S_l with n - 1
    vAP = max_hk |mean x_h - mean x_k|         between three perpendicular directions of approach
    AD = mean D_j - D_c, D_j = |x_1j - x_2j|   distance accuracy, signed
    RD = 3 S_D                                 distance repeatability, a +- figure
    AT = max_s |mean d_s|                      path accuracy, d_s normal to the command path
    RT = max_s (mean l + 3 S_l), likewise      path repeatability

RP is computed from the radii l, not from the coordinates: isotropic normal scatter of sigma in
each coordinate has RP = 3.62 sigma. AT and RT are maxima and so grow with the number of stations,
which is therefore a part of the conditions. AT does not show lag along a line. A frame fitted on
the same poses makes AP too small; AD, RD and RP do not depend on the frame.

The functions of positions take one pose or many: array axes before that of the cycles are poses
and stay in the result.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from delta_calibration.errors import InputError
from delta_calibration.iso9283.path import Path

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Conditions:
    """Test conditions: number of cycles, stations of a path, speed and load."""

    name: str
    position_cycles: int  # AP, RP; vAP: in each direction
    distance_cycles: int  # AD, RD
    path_cycles: int  # AT, RT
    stations: int = 101  # points along a path at which it is evaluated, ends included
    speed_fraction: float = 1.0  # of the rated speed
    load_fraction: float = 1.0  # of the rated load

    def __post_init__(self) -> None:
        """Refuse conditions under which the criteria have no meaning."""
        for name in ("position_cycles", "distance_cycles", "path_cycles", "stations"):
            value, least = getattr(self, name), 5 if name == "stations" else 2
            if not (np.isfinite(value) and value == int(value) and value >= least):
                raise InputError(
                    f"{name} is {value}; it has to be a whole number, at least {least}"
                )
        if not 0.0 < self.speed_fraction <= 1.0:
            raise InputError(f"speed_fraction is {self.speed_fraction}; allowed: above 0, up to 1")
        if not 0.0 <= self.load_fraction <= 1.0:
            raise InputError(f"load_fraction is {self.load_fraction}; allowed: 0 to 1")


STANDARD = Conditions("ISO 9283:1998", position_cycles=30, distance_cycles=30, path_cycles=10)
DELTA_PAPER = Conditions(
    "Delta paper", position_cycles=25, distance_cycles=30, path_cycles=3, speed_fraction=0.5
)
"""The cycles of table 2 in Pan, Qiu and Liu (2017), and the half speed of their table 3."""


@dataclass(frozen=True)
class Criterion:
    """Value of one criterion of the standard, for one pose () or many (...,)."""

    symbol: str
    value: Array  # (...,) [m]
    cycles: int
    conditions: Conditions


@dataclass(frozen=True)
class PositionAccuracy(Criterion):
    """AP: distance of the barycentre of the attained positions from the commanded one."""

    offset: Array  # (..., 3) [m] mean attained less commanded


@dataclass(frozen=True)
class PositionRepeatability(Criterion):
    """RP: radius of the sphere about the barycentre that holds nearly all attempts."""

    mean_radius: Array  # (...,) [m]
    radius_std: Array  # (...,) [m] S_l


@dataclass(frozen=True)
class DistanceAccuracy(Criterion):
    """AD: mean attained distance less the commanded one, signed."""

    commanded: Array  # (...,) [m] D_c


@dataclass(frozen=True)
class PathCriterion(Criterion):
    """AT or RT: a maximum over the stations of a path."""

    stations: Array  # (s, 3) [m] points of the command path at which it was evaluated
    profile: Array  # (s,) [m] value at each station; the criterion is its maximum


def position_accuracy(
    attained: ArrayLike, commanded: ArrayLike, conditions: Conditions = STANDARD
) -> PositionAccuracy:
    """Return AP of positions attained (..., n, 3) [m] for those commanded (..., 3) [m].

    Raises:
        InputError: if a shape is wrong, a value is not finite, or the cycles are too few.
    """
    x = _cycles("attained", attained, conditions.position_cycles, conditions)
    offset = np.mean(x, axis=-2) - _points("commanded", commanded, (*x.shape[:-2], 3))
    return PositionAccuracy("AP", _length(offset), x.shape[-2], conditions, offset)


def position_repeatability(
    attained: ArrayLike, conditions: Conditions = STANDARD
) -> PositionRepeatability:
    """Return RP of positions attained (..., n, 3) [m].

    Raises:
        InputError: as for `position_accuracy`.
    """
    x = _cycles("attained", attained, conditions.position_cycles, conditions)
    mean, std = _radii(x)
    return PositionRepeatability("RP", mean + 3.0 * std, x.shape[-2], conditions, mean, std)


def direction_variation(attained: ArrayLike, conditions: Conditions = STANDARD) -> Criterion:
    """Return vAP of positions attained from three perpendicular directions (..., 3, n, 3) [m].

    Raises:
        InputError: as for `position_accuracy`.
    """
    x = _cycles("attained", attained, conditions.position_cycles, conditions)
    if x.ndim < 3 or x.shape[-3] != 3:
        raise InputError(f"attained has shape {x.shape}; it has to be (..., 3 directions, n, 3)")
    middle = np.mean(x, axis=-2)
    apart = _length(middle - np.roll(middle, 1, axis=-2))  # of three, each pair once
    return Criterion("vAP", np.max(apart, axis=-1), x.shape[-2], conditions)


def distance_accuracy(
    first: ArrayLike, second: ArrayLike, commanded: ArrayLike, conditions: Conditions = STANDARD
) -> DistanceAccuracy:
    """Return AD of the two ends attained (..., n, 3) [m] for those commanded (..., 2, 3) [m].

    The standard's ends are P2 and P4; row j of both belongs to cycle j.

    Raises:
        InputError: as for `position_accuracy`.
    """
    d = _distances(first, second, conditions)
    ends = _points("commanded", commanded, (*d.shape[:-1], 2, 3))
    meant = _length(ends[..., 0, :] - ends[..., 1, :])
    return DistanceAccuracy("AD", np.mean(d, axis=-1) - meant, d.shape[-1], conditions, meant)


def distance_repeatability(
    first: ArrayLike, second: ArrayLike, conditions: Conditions = STANDARD
) -> Criterion:
    """Return RD, to be read as +-, of the two ends attained (..., n, 3) [m].

    Raises:
        InputError: as for `position_accuracy`.
    """
    d = _distances(first, second, conditions)
    return Criterion("RD", 3.0 * np.std(d, axis=-1, ddof=1), d.shape[-1], conditions)


def path_accuracy(
    command: ArrayLike, attempts: Sequence[ArrayLike], conditions: Conditions = STANDARD
) -> PathCriterion:
    """Return AT of attempts at a path; see `path_deviations`."""
    stations, d = path_deviations(command, attempts, conditions)
    profile = _length(np.mean(d, axis=0))
    return PathCriterion("AT", np.asarray(np.max(profile)), len(d), conditions, stations, profile)


def path_repeatability(
    command: ArrayLike, attempts: Sequence[ArrayLike], conditions: Conditions = STANDARD
) -> PathCriterion:
    """Return RT of attempts at a path; see `path_deviations`."""
    stations, d = path_deviations(command, attempts, conditions)
    mean, std = _radii(np.moveaxis(d, 0, -2))
    profile = mean + 3.0 * std
    return PathCriterion("RT", np.asarray(np.max(profile)), len(d), conditions, stations, profile)


def path_deviations(
    command: ArrayLike, attempts: Sequence[ArrayLike], conditions: Conditions = STANDARD
) -> tuple[Array, Array]:
    """Return the stations (s, 3) [m] and each attempt's deviation there (n, s, 3) [m].

    The stations lie at equal arc lengths along the command. Each sample of an attempt is projected
    on the path, which gives its arc length and its deviation; the deviation is interpolated to the
    stations by arc length, and its part in the plane normal to the command is returned. A command
    that ends where it began is a closed path. Run-in and run-out beyond the ends do not count. A
    path that crosses or retraces itself has to be evaluated in parts.

    Args:
        command: The commanded path (k, 3) [m], in order, with closely spaced points on curves.
        attempts: The attained paths, (k_j, 3) [m] each; any number of samples, any timing.
        conditions: Give the least number of attempts and the number of stations.

    Raises:
        InputError: if a shape is wrong, a value is not finite, the attempts are too few, the
            command stands still or turns back on itself.
        DataError: if an attempt leaves out a part of the path.
    """
    if len(attempts) < conditions.path_cycles:
        raise InputError(
            f"attempts are {len(attempts)}; {conditions.name} has {conditions.path_cycles} or more"
        )
    path = Path.through(_one_path("command", command), conditions.stations)
    named = [(f"attempts[{j}]", attempt) for j, attempt in enumerate(attempts)]
    deviations = [path.deviation(_one_path(name, attempt), name) for name, attempt in named]
    return path.stations, np.stack(deviations)


def _length(v: Array) -> Array:
    """Return |v| (...,) of v (..., 3)."""
    return np.asarray(np.linalg.norm(v, axis=-1))


def _radii(x: Array) -> tuple[Array, Array]:
    """Return mean and S of the distances (..., n) of x (..., n, 3) from their barycentre."""
    radius = _length(x - np.mean(x, axis=-2, keepdims=True))
    return np.mean(radius, axis=-1), np.std(radius, axis=-1, ddof=1)


def _distances(first: ArrayLike, second: ArrayLike, conditions: Conditions) -> Array:
    """Return D_j (..., n) [m]."""
    a = _cycles("first", first, conditions.distance_cycles, conditions)
    return _length(a - _points("second", second, a.shape))


def _cycles(name: str, value: ArrayLike, fewest: int, conditions: Conditions) -> Array:
    """Return positions (..., n, 3) [m] with enough cycles n."""
    x = _points(name, value)
    if x.shape[-2] < fewest:
        raise InputError(
            f"{name} has {x.shape[-2]} cycles; {conditions.name} has {fewest} or more"
        )
    return x


def _one_path(name: str, value: ArrayLike) -> Array:
    """Return the finite points of one path (n, 3) [m]."""
    x = _points(name, value)
    if x.ndim != 2:
        raise InputError(f"{name} has shape {x.shape}; it has to be (n, 3)")
    return x


def _points(name: str, value: ArrayLike, shape: tuple[int, ...] | None = None) -> Array:
    """Return finite points, of the shape given or (..., n, 3) [m]."""
    x = np.asarray(value, dtype=np.float64)
    if shape is None and (x.ndim < 2 or x.shape[-1] != 3):
        raise InputError(f"{name} has shape {x.shape}; it has to be (..., n, 3)")
    if shape is not None and x.shape != shape:
        raise InputError(f"{name} has shape {x.shape}; it has to be {shape}")
    if not np.all(np.isfinite(x)):
        raise InputError(f"{name} holds a value that is not finite; allowed: lengths in m")
    return x
