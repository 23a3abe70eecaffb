"""The box that a machine can be measured in, found from its dimensions and limits alone."""

from __future__ import annotations

from itertools import product

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.plans.points import tool_points, usable
from delta_calibration.robot import Robot, Workspace

Array = NDArray[np.float64]

_DRAWS = 11  # of the joints' ranges, as a power of two
_FLAT = 1e-6  # [m] extent of the tool's places along an axis, under which there is none
_WIDE = 0.7  # share of the places whose extents give the proportions of the boxes tried
_SHAPES = (0.5, 1.0, 2.0)  # times those, each axis by itself
_CENTRES = 12
_HALVINGS = 6  # of the size of a box: to 2 % of the largest
_LATTICE = 4  # points of a box along each edge that have to be usable
_MOST = 10.0  # [m] of a side, and of a centre from the base, that a robot file may have
_STEP = 0.01  # [m] that sides and centres are rounded to
_BETTER = 1.05  # times the box before: places are drawn by lot, and the middle comes first
_EDGES = tuple(_MOST / 2**k for k in range(6))  # [m] of cubes about a place
_FEWEST = 20  # usable places of those drawn


def largest_box(robot: Robot) -> Workspace:
    """About the largest box whose points the tool can be measured at without turning.

    Tool points of joints all over their ranges are the centres tried; a box counts if a lattice
    of its points is within reach and limits and away from singularities.

    Args:
        robot: its dimensions, limits and tool.

    Raises:
        InputError: there is hardly a place that it can be measured at.
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
    """As a robot file has it, to the millimetre."""
    of = {"centre_mm": box.centre, "size_mm": box.size}
    return {key: (np.round(1e3 * value) + 0.0).tolist() for key, value in of.items()}  # no -0.0


def _places(robot: Robot) -> Array:
    """Tool points (n, 3) [m] that are usable, of joints evenly over their ranges.

    Cables do not meet at lengths that are drawn each by itself: points about one where they do.
    """
    from scipy.stats import qmc  # takes long to load, and `robot check` draws no box

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
    """Centres of boxes that are tried, (k, 3) [m]: from low to high in the middle, and aside."""
    middle = np.median(places, axis=0)
    height = np.quantile(places[:, 2], (np.arange(_CENTRES) + 0.5) / _CENTRES)
    upright = np.column_stack([np.tile(middle[:2], (_CENTRES, 1)), height])
    aside = places[:: len(places) // _CENTRES]  # of an arm the middle is inside itself
    centres = np.round(np.concatenate([upright, aside]) / _STEP) * _STEP
    centres = np.where(np.ptp(places, axis=0) < _FLAT, middle, centres)
    return np.asarray(centres[np.abs(centres).max(axis=1) <= _MOST])


def _share(robot: Robot, centre: Array, size: Array, least: float) -> float:
    """The largest share of a box about a centre that is usable throughout; 0 under `least`."""
    edge = np.linspace(-0.5, 0.5, _LATTICE)
    lattice = np.unique(np.array(list(product(edge, repeat=3))) * size, axis=0)
    corner = (np.abs(lattice) == np.abs(lattice).max(axis=0)).all(axis=1)

    def good(share: float) -> bool:
        """Whether all of it is usable; its corners first, as what is out of reach is so there."""
        parts = (share * each for each in (lattice[corner], lattice[~corner], 0 * size[None]))
        return all(usable(robot, centre + part).all() for part in parts)

    low, high = least, 1.0
    if low >= high or not good(low):
        return 0.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if good(middle) else (low, middle)
    return low
