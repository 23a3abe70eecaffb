"""Building a table: the grid is refined until the error between its nodes is small enough.

Between nodes the error of the splines grows with the fourth power of the spacing; it is largest in
the middle of a cell. It is checked there, in every cell, and at points of the region and of its
boundary that are independent of the grid. The error is the distance of the identified model's tool
from the target, as for any other correction. Only commands that pass the guards count.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from delta_calibration.compensation.base import (
    REACHED,
    Array,
    Compensator,
    Flags,
    PointFunction,
    distance,
    require_positive,
    require_whole,
)
from delta_calibration.compensation.machine import SOLVERS
from delta_calibration.compensation.table import (
    BEND,
    FEWEST_NODES,
    Stamp,
    Table,
    nodes_between,
)
from delta_calibration.errors import DataError, InputError

_SHARE = 0.8  # of the bound, for the largest error found: points between are not checked
_ORDER, _GROWTH = 4, 2.0  # of the error in the spacing; largest growth of their number in one step
_PAD = 0.01  # of the box's width, added on either side of the commands
_BLOCK = 1024  # commands worked on at once

Follow = Callable[[range], Iterable[int]]


@dataclass(frozen=True)
class TableSettings:
    """Settings to build a table."""

    solver: str = "newton"  # what finds the corrections at the nodes: newton or apso
    bound: float = REACHED  # [m] largest error of a command between the nodes
    nodes: int = 15  # per axis, at first
    most: int = 80  # per axis; with more, no table is made

    def __post_init__(self) -> None:
        """Refuse settings with which no table can be made."""
        if self.solver not in SOLVERS:
            raise InputError(
                f"no solver {self.solver!r} for a table; choose from: {', '.join(SOLVERS)}"
            )
        require_positive("bound", self.bound, "m")
        require_whole("nodes", self.nodes, FEWEST_NODES)
        require_whole("most", self.most, self.nodes)
        if self.bound > REACHED:
            raise InputError(
                f"bound is {self.bound * 1e6:g} um; at most {REACHED * 1e6:g} allowed, because a "
                "correction with a larger remaining error counts as failed"
            )


@dataclass(frozen=True)
class Task:
    """Content of a table to build, as functions of nominal commands (n, 3) [rad]."""

    stamp: Stamp
    solver: Compensator  # exact
    meant: PointFunction  # tool points of the nominal robot
    point: PointFunction  # of the identified one
    admitted: Callable[[Array], Flags]  # whether commands pass all guards
    largest: float  # [rad] largest correction of a joint; a larger one is refused
    asked: Array  # (a, 3) [rad] commands all over the region that pass the guards


def build(task: Task, settings: TableSettings, follow: Follow = iter) -> Table:
    """Build a table whose error between the nodes is within the bound.

    Args:
        task: content of the table.
        settings: solver, bound and numbers of nodes.
        follow: wraps the iteration over the blocks of work; for a progress bar.

    Raises:
        DataError: the region holds no command, or the bound cannot be held.
    """
    if not len(task.asked):
        raise DataError("no table: the region has no command within reach and limits")
    nodes, goal = settings.nodes, _SHARE * settings.bound
    while True:
        table = _checked(task, _filled(task, settings, nodes, follow), follow)
        if table.worst <= goal:
            return table
        if nodes == settings.most:
            break
        growth = min((table.worst / goal) ** (1 / _ORDER), _GROWTH)
        nodes = min(int(np.ceil((nodes - 1) * growth)) + 1, settings.most)
    raise DataError(
        f"no table: with {table.nodes} nodes an axis it is {table.worst * 1e6:.2g} um off "
        f"between them, {goal * 1e6:.2g} um is the goal, and {settings.most} nodes are the limit; "
        "use another method, or a region farther from the limits of the reach"
    )


def _filled(task: Task, settings: TableSettings, k: int, follow: Follow) -> Table:
    """Build a table of k nodes per axis, not checked yet.

    A node without a solution, beyond the region, takes that of the nearest node that has one.
    """
    from scipy.ndimage import distance_transform_edt  # slow to load

    lowest, highest = task.asked.min(axis=0), task.asked.max(axis=0)
    pad = _PAD * (highest - lowest)
    lower, upper = lowest - pad, highest + pad
    q = _lattice(nodes_between(lower, upper, np.linspace(-1, 1, k), BEND))
    dq = np.full_like(q, np.nan)
    for rows in _blocks(len(q), follow):
        found = task.solver.correct(q[rows], task.meant(q[rows]))
        dq[rows] = np.where(found.converged[:, None], found.dq, np.nan)
    lacking = np.isnan(dq[:, 0]).reshape(k, k, k)
    if lacking.all():
        raise DataError(f"no table: {settings.solver} finds no correction at any of its nodes")
    nearest = distance_transform_edt(lacking, return_distances=False, return_indices=True)
    corrections = dq.reshape(k, k, k, -1)[tuple(nearest)]
    return Table(lower, upper, corrections, task.stamp, settings.solver, settings.bound, np.inf, 0)


def _checked(task: Task, table: Table, follow: Follow) -> Table:
    """Return the table with its largest error and the number of commands checked."""
    steps = np.linspace(-1, 1, 2 * table.nodes - 1)[1::2]
    middles = _lattice(nodes_between(table.lower, table.upper, steps, table.bend))
    q, worst, checked = np.concatenate([task.asked, middles]), 0.0, 0
    for rows in _blocks(len(q), follow):
        error = _errors(task, table, q[rows][task.admitted(q[rows])])
        worst, checked = max(worst, error.max(initial=0.0)), checked + len(error)
    return replace(table, worst=worst, checked=checked)


def _errors(task: Task, table: Table, q: Array) -> Array:
    """Distances from the targets (c,) [m]; corrections beyond the largest are left out."""
    dq = table.at(q)
    passed = ~(np.abs(dq) > task.largest).any(axis=1)
    return distance(task.point(q[passed] + dq[passed]) - task.meant(q[passed]))


def _lattice(axes: Array) -> Array:
    """All joints of a grid, (k, 3) -> (k^3, 3) [rad]; the last joint varies fastest."""
    grid = np.meshgrid(*axes.T, indexing="ij")
    return np.stack(grid, axis=-1).reshape(-1, axes.shape[1])


def _blocks(n: int, follow: Follow) -> Iterable[slice]:
    """Yield the slices of n rows, block by block."""
    for block in follow(range(-(-n // _BLOCK))):
        yield slice(block * _BLOCK, (block + 1) * _BLOCK)
