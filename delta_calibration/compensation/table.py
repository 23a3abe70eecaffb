"""Table of corrections: values at the nodes of a grid, tricubic splines between them.

The grid lies in *nominal joint space*, dq(q) with point(q + dq) = p*(q), and not in the space of
the targets. Near the edge of the reach an arm and its rods become collinear; there the joints vary
as the square root of the remaining distance, but in the joints themselves the correction is
smooth. A grid over the targets of the paper's disc is far less exact with as many nodes: some are
out of reach, and cells at the rim have no value. The robot reaches every command in the disc's box
of joints. The command is in joints already, so that the lookup is all that is needed.

The correction varies most at the ends of the joints' ranges. The nodes are therefore denser
towards the ends, evenly spaced in x (1 + b x^2) with x from -1 to 1 along an axis: an order of
magnitude less error than with nodes evenly spaced in x. Splines through the nodes (with a
continuous third derivative next to the ends, so that cubics in x (1 + b x^2) are met exactly) have
about half the error of Lagrange's or Catmull-Rom's cubics, and continuous velocity and
acceleration, at the cost of the same 64 terms.
`benchmarks/table_choices.py` measures all of this, docs/performance.md has its figures.

The region is a volume in space, and its box of joints also holds commands outside of it: nodes
there support the spline, but the bound only holds for commands that pass the guards. It is checked
between the nodes, in the middle of every cell, where such a spline errs most, and at points of
the region and its boundary that are independent of the grid; the grid is refined until it holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.base import (
    Array,
    Correction,
    Flags,
    PointFunction,
    checked_commands,
    distance,
)
from delta_calibration.errors import InputError
from delta_calibration.lazy import cached_property

BEND = 0.4  # b
FEWEST_NODES = 5  # per axis: as many as the end condition takes
AXES = 3


@dataclass(frozen=True)
class Stamp:
    """Identity of the calibration, robot and tool that a table was made for."""

    calibration: str  # its seal
    robot: str  # hash of its file
    model: str  # name of the mechanism
    tool: tuple[float, ...]  # (3,) [m] tool centre point in the platform's frame

    @classmethod
    def of(cls, calibration: Calibration) -> Stamp:
        """Return the stamp of a table for this calibration."""
        robot = calibration.robot
        name = calibration.chain.mechanism.name
        return cls(calibration.seal, robot.hash, name, tuple(map(float, robot.tool_offset)))

    def require(self, calibration: Calibration) -> None:
        """Refuse any other calibration than the one that the table was made for.

        Raises:
            InputError: names what the table was made for, and the current one.
        """
        now = Stamp.of(calibration)
        for what, own, other in (
            ("robot", self.robot[:12], now.robot[:12]),
            ("tool [m]", self.tool, now.tool),
            ("model", self.model, now.model),
            ("calibration", self.calibration[:12], now.calibration[:12]),
        ):
            if own != other:
                raise InputError(
                    f"the table is outdated: it was made for {what} {own}, but the current one "
                    f"is {other}; compute it again"
                )


@dataclass(frozen=True)
class Table:
    """Corrections at the nodes of a grid over nominal joint angles.

    Raises:
        InputError: values that do not form a table.
    """

    lower: Array  # (3,) [rad] ends of the axes
    upper: Array  # (3,) [rad]
    corrections: Array  # (k, k, k, 3) [rad] at the nodes
    stamp: Stamp
    solver: str  # that found the corrections
    bound: float  # [m] largest error allowed between the nodes
    worst: float  # [m] largest error found there
    checked: int  # number of commands at which it was checked
    bend: float = BEND  # b, see above

    def __post_init__(self) -> None:
        """Refuse invalid values, and compute the splines now: no command is to wait for them."""
        shape, k = self.corrections.shape, len(self.corrections)
        if shape != (k, k, k, AXES) or k < FEWEST_NODES:
            raise InputError(
                f"corrections have shape {shape}; it has to be (k, k, k, 3), k at least "
                f"{FEWEST_NODES}"
            )
        if not np.isfinite(self.corrections).all():
            raise InputError("corrections hold values that are not finite")
        if self.lower.shape != (AXES,) or not (self.lower < self.upper).all():
            raise InputError(f"axes from {self.lower} to {self.upper}: no grid of three joints")
        _ = self._axes, self._coefficients

    @cached_property
    def _axes(self) -> Array:
        """Axes in the form of `table_kernel.look_up`, (3, 6)."""
        half = (self.upper - self.lower) / 2
        steps = np.full(AXES, (self.nodes - 1) / 2 / (1 + self.bend))
        columns = self.lower, self.upper, self.lower + half, 1 / half, 0 * half + self.bend, steps
        return np.stack(columns, axis=1)

    @cached_property
    def _coefficients(self) -> Array:
        """Coefficients of the splines through the nodes."""
        return _splined(self.corrections)

    @property
    def nodes(self) -> int:
        """Number of nodes per axis."""
        return len(self.corrections)

    def covers(self, q: Array) -> Flags:
        """Whether commands (n, 3) [rad] lie within the grid, (n,)."""
        return np.asarray(((q >= self.lower) & (q <= self.upper)).all(axis=1))

    def at(self, q: Array) -> Array:
        """Corrections (n, 3) [rad] of commands (n, 3) [rad]; NaN outside the grid."""
        rows = np.array(q, dtype=np.float64, order="C")  # a contiguous copy
        return np.asarray(_kernel().look_up(self._axes, self._coefficients, rows))

    def told(self) -> str:
        """Size, solver and error of the table, for display."""
        return (
            f"{self.nodes} nodes an axis by {self.solver}, at most {self.worst * 1e6:.2g} um off "
            f"at {self.checked} places between them, bound {self.bound * 1e6:g} um"
        )


@dataclass(frozen=True)
class Tabulated:
    """A table as a `Compensator`; each correction is judged by one evaluation of the model."""

    table: Table
    point: PointFunction

    def correct(self, q: Array, target: Array) -> Correction:
        """Look up the correction of every command; none outside of the grid.

        Args:
            q: Nominal commands (n, 3) [rad].
            target: Their target points (n, 3) [m], by the nominal model that the table is for.
        """
        q, target, usable = checked_commands(q, target, AXES)
        usable &= self.table.covers(q)
        dq = self.table.at(q[usable])
        error = distance(self.point(q[usable] + dq) - target[usable])
        ones = np.ones(len(dq), dtype=np.int64)
        return Correction(dq, error, ones, converged=error <= self.table.bound).spread(usable)


def nodes_between(lower: Array, upper: Array, steps: Array, bend: float) -> Array:
    """Joint angles of each axis (k, 3) [rad] at steps x (1 + b x^2) / (1 + b), in -1 .. 1 (k,)."""
    root = np.sqrt(3 * bend)
    x = 2 / root * np.sinh(np.arcsinh(1.5 * root * (1 + bend) * steps) / 3)  # Cardano's formula
    return np.asarray((lower + upper) / 2 + np.outer(x, (upper - lower) / 2))


def _splined(values: Array) -> Array:
    """Coefficients (k + 2, k + 2, k + 2, 3) of the splines through the nodes' values."""
    k = len(values)
    rows = np.zeros((k + 2, k + 2))
    for node in range(k):
        rows[node, node : node + 3] = 1 / 6, 4 / 6, 1 / 6
    rows[k, :5] = rows[k + 1, -5:] = 1, -4, 6, -4, 1  # not-a-knot: one cubic about the second node
    solve = np.linalg.inv(rows)[:, :k]
    for axis in range(AXES):
        values = np.moveaxis(np.tensordot(solve, values, (1, axis)), 0, axis)
    return np.ascontiguousarray(values)


def _kernel() -> Any:
    """The compiled lookup; numba is loaded with the first lookup."""
    from delta_calibration.compensation import table_kernel

    return table_kernel
