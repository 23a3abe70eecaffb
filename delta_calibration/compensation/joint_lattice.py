"""A lattice of joint commands about a nominal one, and what was measured on it.

A node is a command a whole number of command units away,

    q(n) = q_0 + n u,    n in Z^m,    measured there: p(n), of d coordinates,

so that the drives can go to every node. Near the command p changes by the edges,
S_j = dp / dn_j, which are the paper's S_1, S_2 for one command unit (7), (8).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.base import require_positive, require_whole
from delta_calibration.errors import DataError, InputError

Array = NDArray[np.float64]
Node = tuple[int, ...]  # (m,) command units from the start

_ROUNDING = 1e-9  # share of the bound that may be rounding


@dataclass(frozen=True)
class GridSettings:
    """Spacing and limits of a lattice, and the noise of the measurements on it.

    Lengths are in the measured quantity's unit; joint units are rad, or m for sliders.
    """

    unit: Array  # (m,) one command unit of each joint
    lower: Array  # (m,) joint limits
    upper: Array  # (m,)
    bound: float  # largest correction of a joint
    noise: float = 0.0  # standard uncertainty of each coordinate at one stop, incl. the rest error
    spacing: int = 16  # command units between nodes at first
    visits: int = 2  # largest number of visits of a node, if nodes are equal
    every_node: bool = False  # measure all neighbours, not only promising ones
    most_moves: int = 300

    def __post_init__(self) -> None:
        """Refuse settings that do not give a lattice."""
        if not (self.unit.ndim == 1 and self.unit.size and np.all(self.unit > 0.0)):
            raise InputError(f"unit is {self.unit}; it has to be above 0 for each joint")
        if not self.lower.shape == self.upper.shape == self.unit.shape:
            raise InputError(
                f"limits of shapes {self.lower.shape} and {self.upper.shape} for "
                f"{self.unit.size} command units"
            )
        if not (np.isfinite(self.noise) and self.noise >= 0.0):
            raise InputError(f"noise is {self.noise}; it has to be finite and not negative")
        require_whole("spacing", self.spacing, 1)
        require_whole("visits", self.visits, 1)
        require_whole("most_moves", self.most_moves, 1)
        require_positive("bound", self.bound)
        first = self.spacing * float(self.unit.max())
        if self.bound < first:
            raise InputError(
                f"bound is {self.bound:g}; the first lattice alone needs "
                f"{self.spacing} command units, {first:g}"
            )


class JointLattice:
    """Nodes about a command, with the points measured at them.

    Args:
        command: (m,) nominal joint command, node zero.
        target: (d,) point to reach; coordinates of one unit, as distances are Euclidean.
        settings: units, limits, bound.
        edges: (d, m) change of the point by one command unit where it is known beforehand.

    Raises:
        InputError: shapes that do not match, values that are not finite, a command
            beyond the joint limits or without room for the first lattice.
    """

    def __init__(
        self, command: Array, target: Array, settings: GridSettings, edges: Array | None = None
    ) -> None:
        _require_finite("command", command, settings.unit.shape)
        _require_finite("target", target, (len(target),))
        if edges is not None:
            _require_finite("edges", edges, (len(target), len(command)))
        self._command, self._target, self._settings = command, target, settings
        self._given = edges
        self._offsets = np.array(list(product((0, 1, -1), repeat=len(command)))[1:])
        self._points: dict[Node, list[Array]] = {}
        self.zero: Node = (0,) * len(command)
        self._require_room()

    def joint(self, node: Node) -> Array:
        """Joint command of a node, (m,)."""
        return np.asarray(self._command + self.shift(node))

    def shift(self, node: Node) -> Array:
        """Correction that a node adds to the nominal command, (m,)."""
        return np.asarray(np.array(node) * self._settings.unit)

    def allowed(self, node: Node) -> bool:
        """Whether a node lies within the joint limits and the largest correction."""
        s, joint = self._settings, self.joint(node)
        inside = bool(np.all((joint >= s.lower) & (joint <= s.upper)))
        return inside and bool(np.abs(self.shift(node)).max() <= s.bound * (1.0 + _ROUNDING))

    def around(self, node: Node, k: int) -> list[Node]:
        """The 3^m - 1 neighbours at a spacing of k, whether allowed or not."""
        return [tuple(row) for row in (np.array(node) + k * self._offsets).tolist()]

    def probe(self, joint: int, k: int) -> Node:
        """A node k command units along one joint: ahead if that is allowed, else back."""
        ahead = tuple(k if j == joint else 0 for j in range(len(self.zero)))
        return ahead if self.allowed(ahead) else tuple(-v for v in ahead)

    def measured(self, node: Node, point: Array) -> None:
        """Take one measurement of a node, (d,).

        Raises:
            InputError: a point of another size.
            DataError: not finite.
        """
        point = np.array(point, dtype=np.float64)
        if point.shape != self._target.shape:
            raise InputError(
                f"point has shape {point.shape}; the target's is {self._target.shape}"
            )
        if not np.isfinite(point).all():
            where = ", ".join(f"{v:.6g}" for v in self.joint(node))
            raise DataError(f"measured at joints ({where}): {point}; finite values are needed")
        self._points.setdefault(node, []).append(point)

    def visits(self, node: Node) -> int:
        """How often a node was measured."""
        return len(self._points.get(node, ()))

    def known(self) -> list[Node]:
        """All nodes measured, in the order of their first visit."""
        return list(self._points)

    def mean(self, node: Node) -> Array:
        """Mean of a node's measurements, (d,)."""
        return np.asarray(np.mean(self._points[node], axis=0))

    def distance(self, node: Node) -> float:
        """Distance of a measured node from the target (10)."""
        return float(np.linalg.norm(self.mean(node) - self._target))

    def gaps(self, points: Array) -> Array:
        """Distances of points (n, d) from the target, (n,)."""
        return np.asarray(np.linalg.norm(points - self._target, axis=1))

    def edges(self) -> Array:
        """Change of the point by one command unit of each joint, (d, m).

        Least squares over all nodes measured. Given edges count as one measurement a single
        command unit away along each joint, so that the first nodes measured outweigh wrong edges.
        """
        nodes = np.array(self.known(), dtype=float)
        points = np.array([self.mean(node) for node in self._points])
        n, p = nodes - nodes.mean(axis=0), points - points.mean(axis=0)
        if self._given is not None:
            n = np.concatenate([n, np.eye(n.shape[1])])
            p = np.concatenate([p, self._given.T])
        return np.asarray(np.linalg.lstsq(n, p, rcond=None)[0].T)

    def predicted(self, nodes: Sequence[Node], here: Node) -> Array:
        """Predict the points of nodes by the edges, from a measured node `here`, (n, d)."""
        away = np.array(nodes, dtype=float) - here
        return np.asarray(self.mean(here) + away @ self.edges().T)

    def toward(self, here: Node, k: int) -> Node:
        """The node, whole steps of k from a measured one, where the edges put the target."""
        steps = np.linalg.lstsq(self.edges(), self._target - self.mean(here), rcond=None)[0]
        whole = np.rint(steps / k).astype(int).tolist()
        return tuple(n + k * w for n, w in zip(here, whole, strict=True))

    def points(self, nodes: Sequence[Node], here: Node) -> Array:
        """Points of nodes, (n, d): measured where there are measurements, else predicted."""
        points = self.predicted(nodes, here)
        for row, node in enumerate(nodes):
            if node in self._points:
                points[row] = self.mean(node)
        return points

    def _require_room(self) -> None:
        s = self._settings
        for joint, angle in enumerate(self._command.tolist()):
            low, high = float(s.lower[joint]), float(s.upper[joint])
            room = s.spacing * float(s.unit[joint])
            if not low <= angle <= high or (angle + room > high and angle - room < low):
                raise InputError(
                    f"command of joint {joint + 1} is {angle:.6g}; allowed are {low:.6g} to "
                    f"{high:.6g}, with {room:.6g} of room on one side"
                )


def _require_finite(name: str, value: Array, shape: tuple[int, ...]) -> None:
    if value.shape != shape or not np.isfinite(value).all():
        raise InputError(f"{name} is {value}; it has to be finite and of shape {shape}")
