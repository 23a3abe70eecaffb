"""Compensation without a model: a lattice about the command, driven and measured node by node.

Shen, Bai and Li 2017 (plane positioning of a SCARA by camera), for any number of joints and any
measured quantity. The machine goes to that neighbour of the present node, k command units away in
each joint or none, whose *measured* point is nearest the target (9), (10); once the present node
is the nearest of its neighbours, k is halved: 16, 8, 4, 2, 1. Which nodes are worth driving to is
predicted from the points measured so far, as the paper does by its edges (7), (8); no node
is chosen before it was measured.

Two nodes are *equal* if their distances differ by less than the repeatability can resolve. They
are measured again, up to a number of visits; among nodes that are still equal the shortest move
decides, and no move at all is the shortest. The two special cases of the paper:

- target at the circumcentre of three nodes (11): they are equal, and the shortest move decides;
- target at the centre of a cell, where the diagonals meet: opposite nodes are equal and there is
  no direction to go; the machine stays, and the next lattice has 3/4 of the spacing (in whole
  command units) where else it would have half.

The paper does not define how near "at" is: here, within what the repeatability can resolve. Where
cells are narrow (the edges of a stretched SCARA include 15 degrees and less) a far node may be
nearer to the target than all neighbours, and the paper's search stops short of it. So one more
node of the same lattice is considered: the one that the edges point at. Only with `every_node` the
search is exactly the paper's. Neither is certain to find the nearest node of all.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from delta_calibration.compensation.joint_lattice import GridSettings, JointLattice, Node
from delta_calibration.errors import InputError

Array = NDArray[np.float64]

COVERAGE = 1.0  # distances are equal within so many standard uncertainties of their difference
_EXACT = 1e-9  # share of a distance that may be rounding


class Stop(Enum):
    """Why a search ended."""

    FINEST = "one command unit reached"
    BOUND = "a nearer node lies beyond the joint limits or the largest correction"
    MOVES = "the allowed number of moves is reached"


@dataclass(frozen=True)
class LatticeLevel:
    """State of the search at the end of one spacing."""

    spacing: int  # command units
    dq: Array  # (m,) from the start
    point: Array  # (d,) measured there
    error: float  # distance of that from the target


@dataclass(frozen=True)
class GridResult:
    """Outcome of one search.

    `error` is from the readings by which the node was chosen, and so is slightly too small:
    measure the node again for an error to quote.
    """

    dq: Array  # (m,) the correction: node less start
    before: float  # distance from the target at the start
    error: float  # the same at the node
    moves: int  # stops driven to, including the start and repeated visits
    stop: Stop
    levels: tuple[LatticeLevel, ...]
    edges: Array  # (d, m) change of the measured point by one command unit


@dataclass(frozen=True)
class GridCorrection:
    """Mean of repeated searches for one target."""

    dq: Array  # (m,)
    std: Array  # (m,) standard uncertainty


class GridSearch:
    """A search for one target: drive to `step`, `tell` the point measured there, until `done`.

    Args:
        command: (m,) nominal joint command, the middle of the first lattice.
        target: (d,) point to reach; coordinates of one unit, as distances are Euclidean.
        settings: the lattice.
        edges: (d, m) change of the point by one command unit, nominal or of an earlier search; if
            not given, a neighbour along each joint is measured to find them.

    Raises:
        InputError: shapes that do not match, values that are not finite, a command
            beyond the joint limits or without room for the first lattice.
    """

    def __init__(
        self, command: Array, target: Array, settings: GridSettings, edges: Array | None = None
    ) -> None:
        self._settings = settings
        self._lattice = JointLattice(command, target, settings, edges)
        self._blind = edges is None and not settings.every_node
        self._present = self._lattice.zero
        self._levels: list[LatticeLevel] = []
        self._stop: Stop | None = None
        self.moves = 0
        self._way = self._search()
        self._next: Node | None = next(self._way)

    @property
    def step(self) -> Array:
        """Joint command to drive to next, (m,).

        Raises:
            InputError: the search is done.
        """
        return self._lattice.joint(self._wanted)

    @property
    def done(self) -> bool:
        """Whether the search has ended and has a result."""
        return self._next is None

    def tell(self, point: Array) -> None:
        """Record the point measured at `step`, (d,), and choose the next step.

        Raises:
            DataError: it is not finite; the step still waits for one that is.
            InputError: the search is done, or a point of another size.
        """
        self._lattice.measured(self._wanted, point)
        self.moves += 1
        self._next = next(self._way, None)
        if self._next is not None and self.moves >= self._settings.most_moves:
            self._break_off()

    @property
    def result(self) -> GridResult:
        """The node that was found.

        Raises:
            InputError: the search is not done.
        """
        if self._stop is None or not self.done:
            raise InputError(f"the search is not done after {self.moves} moves")
        lattice = self._lattice
        return GridResult(
            dq=lattice.shift(self._present),
            before=lattice.distance(lattice.zero),
            error=lattice.distance(self._present),
            moves=self.moves,
            stop=self._stop,
            levels=tuple(self._levels),
            edges=lattice.edges(),
        )

    @property
    def _wanted(self) -> Node:
        if self._next is None:
            raise InputError("the search is done; there is nothing left to measure")
        return self._next

    def _search(self) -> Generator[Node, None, None]:
        """Yields the nodes to be measured, one by one."""
        yield self._present
        k = self._settings.spacing
        if self._blind:
            yield from (self._lattice.probe(j, k) for j in range(len(self._present)))
        while True:
            centred = yield from self._settle(k)
            self._levels.append(self._level(k))
            if k == 1:
                break
            k = 3 * k // 4 if centred else k // 2
        self._stop = Stop.BOUND if self._held_back() else Stop.FINEST
        if self._next != self._present:
            yield self._present  # the machine ends at the best node

    def _settle(self, k: int) -> Generator[Node, None, bool]:
        """Move until no node is nearer; returns whether the target is at a cell's centre."""
        lattice = self._lattice
        while True:
            around = [n for n in lattice.around(self._present, k) if lattice.allowed(n)]
            if self._settings.every_node:
                yield from (node for node in around if not lattice.visits(node))
            if k > 2 and self._at_cell_centre(around):  # 3/4 and 1/2 of 2 both round to 1
                return True
            if not self._settings.every_node:
                around += [node for node in self._pointed_at(k) if node not in around]
            yield from self._promising(around)
            nearest = yield from self._nearest(around)
            if nearest == self._present:
                return False
            self._present = nearest

    def _pointed_at(self, k: int) -> list[Node]:
        """The node at a spacing of k that the edges point at from the present one, if allowed."""
        node = self._lattice.toward(self._present, k)
        return [node] if node != self._present and self._lattice.allowed(node) else []

    def _promising(self, around: list[Node]) -> Iterator[Node]:
        """Yield nodes predicted to be nearer than any measured; each one improves the edges.

        Nearer by more than could be resolved after the largest number of visits of a node.
        """
        visits = self._settings.visits
        while True:
            unknown = [node for node in around if not self._lattice.visits(node)]
            if not unknown:
                return
            gaps = self._lattice.gaps(self._lattice.predicted(unknown, self._present))
            best = int(np.argmin(gaps))
            nearest = min(map(self._lattice.distance, self._known(around)))
            if gaps[best] >= nearest - self._tolerance(nearest, visits, visits):
                return
            yield unknown[best]

    def _nearest(self, around: list[Node]) -> Generator[Node, None, Node]:
        """Choose the node to go to, after measuring equal ones again."""
        lattice = self._lattice
        while True:
            equal = self._equal(self._known(around))
            again = min(equal, key=lattice.visits)
            if len(equal) == 1 or lattice.visits(again) >= self._settings.visits:
                break
            yield again
        if self._present in equal:
            return self._present
        here = lattice.distance(self._present)
        return min((n for n in equal if lattice.distance(n) < here), key=self._travel)

    def _known(self, around: list[Node]) -> list[Node]:
        """The present node and those neighbours that were measured."""
        return [self._present, *(node for node in around if self._lattice.visits(node))]

    def _equal(self, nodes: list[Node]) -> list[Node]:
        """The nearest node, and all that are equal to it."""
        lattice = self._lattice
        best = min(nodes, key=lattice.distance)
        least, visits = lattice.distance(best), lattice.visits(best)
        return [
            node
            for node in nodes
            if lattice.distance(node) - least
            <= self._tolerance(least, visits, lattice.visits(node))
        ]

    def _tolerance(self, distance: float, visits_a: int = 1, visits_b: int = 1) -> float:
        """Difference below which two nodes' distances, of about this size, are equal."""
        noise = self._settings.noise * np.sqrt(1.0 / visits_a + 1.0 / visits_b)
        return float(COVERAGE * noise + _EXACT * distance)

    def _travel(self, node: Node) -> float:
        """Length of the move there from the present node."""
        return float(np.linalg.norm(self._lattice.mean(node) - self._lattice.mean(self._present)))

    def _at_cell_centre(self, around: list[Node]) -> bool:
        """Whether the target is at the centre of a cell that has the present node as a corner.

        The centre is where the diagonals meet: half the way to the opposite node.
        """
        here, lattice = self._present, self._lattice
        opposite = [n for n in around if all(a != b for a, b in zip(n, here, strict=True))]
        if not opposite:
            return False
        centre = (lattice.mean(here) + lattice.points(opposite, here)) / 2
        return bool(lattice.gaps(centre).min() <= self._tolerance(lattice.distance(here)))

    def _held_back(self) -> bool:
        """Whether a neighbour outside the limits is predicted to be nearer."""
        lattice, here = self._lattice, self._present
        barred = [node for node in lattice.around(here, 1) if not lattice.allowed(node)]
        if not barred:
            return False
        nearest, distance = lattice.gaps(lattice.predicted(barred, here)), lattice.distance(here)
        return bool(nearest.min() < distance - self._tolerance(distance))

    def _level(self, k: int) -> LatticeLevel:
        here, lattice = self._present, self._lattice
        return LatticeLevel(k, lattice.shift(here), lattice.mean(here), lattice.distance(here))

    def _break_off(self) -> None:
        """End at the node that was chosen already, or else at the nearest node measured."""
        self._way.close()
        self._next = None
        if self._stop is None:
            self._present = min(self._lattice.known(), key=self._lattice.distance)
            self._stop = Stop.MOVES


def averaged(results: Sequence[GridResult], unit: Array) -> GridCorrection:
    """Mean correction of repeated searches (step 5 of the paper), with its standard uncertainty.

    The spread of the repeats shows the random errors of machine and measurement. All repeats are
    rounded to the same nodes: that error is taken as uniform over one command unit.

    Args:
        results: of two searches or more for one target from one command.
        unit: (m,) one command unit of each joint.

    Raises:
        InputError: fewer than two.
    """
    if len(results) < 2:
        raise InputError(f"{len(results)} searches; 2 or more are needed for an uncertainty")
    dq = np.array([result.dq for result in results])
    random = dq.var(axis=0, ddof=1) / len(dq)
    return GridCorrection(dq.mean(axis=0), np.sqrt(random + unit**2 / 12.0))
