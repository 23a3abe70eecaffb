"""Review of a robot file: key numbers of its machine, and values that seem to be in a wrong unit.

A file can satisfy its schema and still be wrong: `arm_mm: 0.235` is a valid length,
`lower_deg: [-0.6, ...]` are valid angles. The review uses no measurements; it reports values that
no machine would have if all were in the stated unit.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.documents import Document
from delta_calibration.errors import CalibrationError
from delta_calibration.plans import make_plan
from delta_calibration.plans.box import largest_box, written
from delta_calibration.plans.points import tool_points
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_PLACES = 60  # number of places in the workspace at which the numbers are computed
# Limits of plausible values. A desk machine is some decimetres wide, no part of it is shorter than
# a five-hundredth of its longest, and an arm that turns by less than 7 degrees moves nothing.
_SMALL_MM = 20.0
_TINY_PART = 1 / 500
_FEW_DEG, _FEW_MM = 7.0, 5.0
_ROUND_DEG, _ROUNDLY = 15.0, 0.05  # grid of usual drawing angles, and tolerance to it
_FULL_TURN = 2 * np.pi
_LARGE_TOLERANCE, _TINY_TOLERANCE_MM = 1 / 20, 0.0005
_LEAST_NOISE_UM, _MOST_NOISE_UM = 0.05, 1000.0
_SIGMAS = 2.0


@dataclass(frozen=True)
class Review:
    """Result of a review.

    Attributes:
        figures: key numbers of the machine, each a name and a value in words, in reading order.
        doubts: implausible values, a sentence each, with the entry, its value and a likely cause.
    """

    figures: tuple[tuple[str, str], ...]
    doubts: tuple[str, ...]


def review(robot: Robot, data: Document) -> Review:
    """Review a robot file.

    Args:
        robot: robot that the file describes.
        data: content of the file.
    """
    doubts = [*_lengths(data), *_angles(data), *_ranges(robot), *_tolerances(data)]
    doubts += [*_noise(data), *_room(robot, data)]
    try:
        figures, more = _figures(robot)
    except CalibrationError as error:
        said = f"its workspace cannot be used for measuring: {error}{_proposed(robot)}"
        return Review((), (*doubts, said))
    return Review(figures, (*doubts, *more))


def _proposed(robot: Robot) -> str:
    """Proposal of a workspace that can be used, in words; empty if there is none."""
    try:
        return f"; `workspace: {written(largest_box(robot))}` can be"
    except CalibrationError:
        return ""


# --- checks of the entries


def entries(value: Any, path: str) -> Iterator[tuple[str, str, float]]:
    """Yield each number of a section, also within lists: path, unit suffix of its key, value."""
    if isinstance(value, Mapping):
        for key, item in value.items():
            yield from entries(item, f"{path}.{key}")
    elif isinstance(value, list):
        for row, item in enumerate(value):
            yield from entries(item, f"{path}[{row}]")
    elif isinstance(value, int | float) and not isinstance(value, bool):
        key = path.rsplit(".", 1)[-1].split("[", 1)[0]
        yield path, key.rsplit("_", 1)[-1], float(value)


def _lengths(data: Document) -> Iterator[str]:
    """Doubts about lengths that seem not to be in mm."""
    sizes = [
        (path, abs(v)) for path, unit, v in entries(data["geometry"], "geometry") if unit == "mm"
    ]
    longest = max((size for _, size in sizes), default=0.0)
    if 0.0 < longest < _SMALL_MM:
        yield (
            f"geometry: the longest of its lengths is {longest:.6g} mm; were they written in "
            "metres or inches?"
        )
        return
    for path, size in sizes:
        if 0.0 < size < _TINY_PART * longest:
            yield (
                f"{path}: {size:.6g} mm is a {longest / size:.0f}th of the longest length; was it "
                f"written in metres ({1e3 * size:.6g} mm)?"
            )


def _angles(data: Document) -> Iterator[str]:
    """Doubts about angles and drive zeros that would be round numbers if they were in radians."""
    zeros = entries(data["joints"].get("zero_deg", []), "joints.zero_deg")
    drawn = entries(data["geometry"], "geometry")
    for path, unit, value in (*drawn, *((path, "deg", value) for path, _, value in zeros)):
        if unit != "deg" or not 0.0 < abs(value) <= _FULL_TURN:
            continue
        turned = np.degrees(value)
        nearest = _ROUND_DEG * round(turned / _ROUND_DEG)
        if abs(turned - nearest) < _ROUNDLY and value != round(value):
            meant = f"{nearest:.0f} degrees"
            yield f"{path}: {value:.6g} degrees; was it written in radians ({meant})?"


def _ranges(robot: Robot) -> Iterator[str]:
    """Doubts about joint limits that leave almost no range."""
    unit, factor = robot.joints.shown
    widest = float(factor * (robot.joints.upper - robot.joints.lower).max())
    few, meant = (_FEW_DEG, "radians") if robot.joints.unit == "rad" else (_FEW_MM, "metres")
    if widest < few:
        yield (
            f"joints: the widest range between its limits is {widest:.6g} {unit}; were they "
            f"written in {meant}?"
        )


def _tolerances(data: Document) -> Iterator[str]:
    """Doubts about tolerances that are implausible for a machine part."""
    sizes = [abs(v) for _, unit, v in entries(data["geometry"], "geometry") if unit == "mm"]
    longest = max(sizes, default=np.inf)
    for path, unit, value in entries(data["tolerances"], "tolerances"):
        if unit != "mm" or not np.isfinite(value):
            continue
        if value > _LARGE_TOLERANCE * longest:
            yield f"{path}: {value:.6g} mm on a machine of {longest:.6g} mm; is it in micrometres?"
        elif value < _TINY_TOLERANCE_MM:
            yield f"{path}: {value:.6g} mm; was it written in metres ({1e3 * value:.6g} mm)?"


def _noise(data: Document) -> Iterator[str]:
    """Doubts about tracker noise that is implausible."""
    for key in ("radial_um", "transverse_um"):
        value = float(data["tracker"][key])
        if not _LEAST_NOISE_UM <= value <= _MOST_NOISE_UM:
            yield f"tracker.{key}: {value:.6g} um; trackers have some 1 to 100 um"


def _room(robot: Robot, data: Document) -> Iterator[str]:
    """Doubts about a workspace that is hardly more than a point; a planar robot's may be flat."""
    if robot.workspace is None:
        return
    sizes = [abs(v) for _, unit, v in entries(data["geometry"], "geometry") if unit == "mm"]
    widest = 1e3 * float(robot.workspace.size.max())
    if widest < _TINY_PART * max(sizes, default=0.0):
        yield (
            f"workspace.size_mm: {widest:.6g} mm at its widest, hardly larger than a point; was "
            "it "
            f"written in metres?{_proposed(robot)}"
        )


# --- key numbers of the machine


def _figures(robot: Robot) -> tuple[tuple[tuple[str, str], ...], tuple[str, ...]]:
    model = robot.commanded
    g = model.parameters.nominal
    joint = make_plan("identify", robot, count=_PLACES, both_sides=False).joint
    x = model.forward(joint, g)
    point = tool_points(robot, joint)
    size = 1e3 * np.ptp(point, axis=0)
    condition = model.condition(joint, x, g)
    miss, corrections = _by_tolerances(robot, joint, x)
    unit, factor = robot.joints.shown
    figures = (
        ("measured in", " x ".join(f"{edge:.0f}" for edge in size) + " mm (plan `identify`)"),
        (
            "joints there",
            ", ".join(
                f"{name} {factor * low:.1f} to {factor * high:.1f}"
                for name, low, high in zip(
                    robot.joints.names, joint.min(axis=0), joint.max(axis=0), strict=True
                )
            )
            + f" {unit}",
        ),
        (
            "condition",
            (
                f"{condition.min():.1f} to {condition.max():.1f}; limits.condition is "
                f"{robot.limits.condition:.1f}"
            ),
        ),
        ("error within tolerances", f"{1e3 * miss:.2g} mm RMS before calibration"),
        (
            "corrections",
            (
                f"{_SIGMAS:.0f} sigma: {factor * _SIGMAS * corrections:.2g} {unit}; "
                f"limits.correction allows {factor * robot.limits.correction:.2g}"
            ),
        ),
    )
    doubts = []
    if _SIGMAS * corrections > robot.limits.correction:
        doubts.append(
            f"limits: corrections up to {factor * robot.limits.correction:.2g} {unit} are "
            "allowed, but machines within the tolerances need "
            f"{factor * _SIGMAS * corrections:.2g}"
        )
    return figures, tuple(doubts)


def _by_tolerances(robot: Robot, joint: Array, x: Array) -> tuple[float, float]:
    """Expected error of machines within the tolerances, and the joint correction it needs.

    The error is a root mean square [m] in the best-fit frame; the correction is the standard
    deviation [rad or m] at the joint and place with the largest one.
    """
    model = robot.commanded
    g = model.parameters.nominal
    spread = model.parameters.prior.copy()
    spread[~np.isfinite(spread)] = 0.0
    slope = model.identification_jacobian(joint, x, g) * spread  # (n, k, p)
    moved = model.point_by_pose(x, robot.tool_offset) @ slope
    left = _beyond_rigid(moved, tool_points(robot, joint))
    asked = np.linalg.pinv(model.velocity_jacobian(joint, x, g)) @ slope
    return float(np.sqrt((left**2).sum() / len(x))), float(np.sqrt((asked**2).sum(axis=2)).max())


def _beyond_rigid(moved: Array, place: Array) -> Array:
    """Part of the motions (n, 3, p) of points (n, 3) beyond a best-fit rigid motion, (3 n, p)."""
    turned = -np.cross(place[:, None], np.eye(3)).transpose(0, 2, 1)
    shifted = np.tile(np.eye(3), (len(place), 1, 1))
    rigid = np.concatenate([shifted, turned], axis=2).reshape(-1, 6)
    rows = moved.reshape(len(rigid), -1)
    return np.asarray(rows - rigid @ np.linalg.lstsq(rigid, rows, rcond=None)[0])
