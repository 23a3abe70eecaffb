"""Searches for the box in which a machine can be measured, from its dimensions and limits."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.plans.points import tool_points, usable
from delta_calibration.robot import Robot, Workspace

Array = NDArray[np.float64]

_DRAWS = 11  # joint vectors drawn, as a power of two
_FLAT = 1e-6  # [m] a smaller extent of the tool points along an axis counts as none
_WIDE = 0.7  # central share of the tool points; its extents give the proportions of the boxes
_SHAPES = (0.5, 1.0, 2.0)  # factors on those extents, for each axis separately
_CENTRES = 12
_HALVINGS = 6  # bisections of the size of a box: to 2 % of the largest
_LATTICE = 4  # points of a box along each edge that have to be usable
_MOST = 10.0  # [m] largest side, and distance of a centre from the base, in a robot file
_STEP = 0.01  # [m] that sides and centres are rounded to
_BETTER = 1.05  # gain in volume for a new box: points are random, and the middle is preferred
_EDGES = tuple(_MOST / 2**k for k in range(6))  # [m] of cubes about a point
_FEWEST = 20  # usable points needed of those drawn


def largest_box(robot: Robot) -> Workspace:
    """Find about the largest box in which the tool can be measured without rotation.

    Centres are tried among tool points from all over the joint ranges; a box is usable if a
    lattice of its points is within reach and limits and away from singularities.

    Args:
        robot: its dimensions, limits and tool.

    Raises:
        InputError: hardly any tool point is usable.
    """
    places = _places(robot)
    deep = np.ptp(places, axis=0) >= _FLAT
    low, high = np.quantile(places, [0.5 - _WIDE / 2, 0.5 + _WIDE / 2], axis=0)
    tried = np.minimum((high - low) * deep * list(product(_SHAPES, repeat=3)), _MOST)
    shapes = {tuple(shape) for shape in tried}
    best, volume = None, 0.0
    for centre in _centres(places):
        for shape in map(np.array, sorted(shapes)):
            whole = float(np.prod(shape[deep]))
            least = (_BETTER * volume / whole) ** (1 / deep.sum())
            size = np.floor(shape * _share(robot, centre, shape, least) / _STEP) * _STEP
            held = float(np.prod(size[deep]))
            if held > _BETTER * volume:
                best, volume = Workspace(centre, size), held
    if best is None:
        raise InputError(f"{robot.source}: no box of {1e3 * _STEP:.0f} mm or more is within reach")
    return best


def written(box: Workspace) -> dict[str, list[float]]:
    """The entries of a robot file for a box, rounded to the millimetre."""
    of = {"centre_mm": box.centre, "size_mm": box.size}
    return {key: (np.round(1e3 * value) + 0.0).tolist() for key, value in of.items()}  # no -0.0


def _places(robot: Robot) -> Array:
    """Usable tool points (n, 3) [m] of joint vectors spread evenly over the joint ranges.

    Cable lengths drawn independently do not meet in one point, so for cables the points are drawn
    about one point where they do.
    """
    from scipy.stats import qmc  # slow to load, and `robot check` needs no box

    joints = robot.joints
    share = qmc.Sobol(len(joints.names), scramble=False).random_base2(_DRAWS)
    point = tool_points(robot, joints.lower + share * (joints.upper - joints.lower))
    point = point[np.isfinite(point).all(axis=1)]
    if 0 < len(point) < _FEWEST:
        cube = qmc.Sobol(3, scramble=False).random_base2(_DRAWS - 2) - 0.5
        point = np.concatenate([point[0] + edge * cube for edge in _EDGES])
    point = point[usable(robot, point)]
    if len(point) < _FEWEST:
        raise InputError(
            f"{robot.source}: hardly a place is within reach, limits and limits.condition"
        )
    return point


def _centres(places: Array) -> Array:
    """Candidate centres of boxes, (k, 3) [m]: along the vertical middle line, and off it."""
    middle = np.median(places, axis=0)
    height = np.quantile(places[:, 2], (np.arange(_CENTRES) + 0.5) / _CENTRES)
    upright = np.column_stack([np.tile(middle[:2], (_CENTRES, 1)), height])
    aside = places[:: len(places) // _CENTRES]  # the middle of an arm's range is inside the arm
    centres = np.round(np.concatenate([upright, aside]) / _STEP) * _STEP
    centres = np.where(np.ptp(places, axis=0) < _FLAT, middle, centres)
    return np.asarray(centres[np.abs(centres).max(axis=1) <= _MOST])


def _share(robot: Robot, centre: Array, size: Array, least: float) -> float:
    """Largest scale, 0 to 1, at which the box about a centre is usable; 0 if under `least`."""
    edge = np.linspace(-0.5, 0.5, _LATTICE)
    lattice = np.unique(np.array(list(product(edge, repeat=3))) * size, axis=0)
    corner = (np.abs(lattice) == np.abs(lattice).max(axis=0)).all(axis=1)

    def good(share: float) -> bool:
        """Whether all points are usable; corners first, as they are the first out of reach."""
        parts = (share * each for each in (lattice[corner], lattice[~corner], 0 * size[None]))
        return all(usable(robot, centre + part).all() for part in parts)

    low, high = least, 1.0
    if low >= high or not good(low):
        return 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if good(middle) else (low, middle)
    return low
