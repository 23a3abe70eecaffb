"""Drift monitor: tests from readings at rest whether a machine still matches its calibration.

The model is linearised about the calibration. The residual of stop i, at place p in set-up k, is

    r = J_x x + J_o z_k + R u_p + noise

with x the deviation of the machine from its calibration in typical sizes, prior covariance C_0;
z_k the frame and reflector offset of the set-up, with the prior of any new set-up; u_p the model
discrepancy at that place, including the rest errors of the joints and backlash. u_p is drawn once
a place, so that a program which returns a thousand times gives no false evidence. Marginalising z
and u leaves an information matrix H and a vector b on x. The hypothesis of a step has the Bayes
factor B of `history/steps.py`, averaged over all dimensions and effects and over sizes.

If the machine did not change, B is a martingale: the probability that it ever reaches 1/a is at
most a (Ville 1939; Shafer and others 2011, Statistical Science 26, 84-101), however often it is
evaluated. It starts anew with every window; there are 30.4/w windows of w days a month, and
a = rate w / 30.4, with the rate shared among the window lengths.

An alarm is given only if it remains with any one place left out, and also under the assumption
that the tracker was moved once during the last set-up. The first readings of a set-up, at three or
four places, determine the tracker's frame and give no information on the machine.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.cell.vigil_setup import SetUp, Stop, Told, stops_of
from delta_calibration.data import Poses
from delta_calibration.errors import InputError
from delta_calibration.estimation import carried_rows
from delta_calibration.history.steps import by_size, log_bayes

Array = NDArray[np.float64]
Index = NDArray[np.int64]

MONTH = 30.4  # [days]
WINDOWS = (3.0, 30.4)  # [days]
_DAY = 86400.0  # [s]
_PLACES = 60  # largest number of places in a window; stops at further ones are ignored
_BOUNDARIES = 16  # instants at which a move of the tracker is tested
_LIKELY = 0.3  # probability above which a cause is named


@dataclass(frozen=True)
class Suspicion:
    """Result of the drift test, with the likeliest cause."""

    odds: float  # ln B
    limit: float  # ln B from which on an alarm is given
    cause: str | None  # likeliest cause, by its fixed name; None without alarm or a clear cause
    location: str | None

    @property
    def changed(self) -> bool:
        """Whether the machine has changed since its calibration."""
        return self.odds >= self.limit


class Vigil:
    """Collects readings of a machine, and detects when it no longer matches its calibration.

    Args:
        calibration: calibration with its uncertainty.
        rate: largest allowed rate of false alarms [1/month].

    Raises:
        InputError: a calibration file without uncertainty, or a rate outside 0 to 10.
    """

    def __init__(self, calibration: Calibration, rate: float) -> None:
        if calibration.uncertainty is None:
            raise InputError(
                f"{calibration.source}: the file does not contain its uncertainty; fit again"
            )
        if not 0.0 < rate <= 10.0:
            raise InputError(f"false alarms: {rate:g} per month is not allowed; 0 to 10")
        self._about = _About.of(calibration.later)
        self._windows = [_Window(self._about, days, rate / len(WINDOWS)) for days in WINDOWS]
        self._last: Stop | None = None
        self.stops = 0  # stops evaluated
        self.held = 0  # stops at which the tracker repeated the reading of another joint position
        self.unknown = 0  # poses that the calibration cannot predict
        self._sensors: tuple[str, ...] = ()
        self.suspicion = Suspicion(0.0, min(w.limit for w in self._windows), None, None)

    def set_up(self) -> None:
        """Begin a new set-up: the tracker was, or may have been, moved."""
        for window in self._windows:
            window.close()

    def take(self, poses: Poses) -> Suspicion:
        """Evaluate poses at rest; an alarm persists until another `Vigil` replaces this one."""
        if poses.temperature_parts != self._sensors:
            self._sensors = poses.temperature_parts
            self.set_up()
        every = stops_of(poses, self._about.joint_size)
        known = self._about.foreseen(poses)
        fresh = [stop for stop in every if not self._is_held(stop) and known[stop.row]]
        self.unknown += int(np.sum(~known))
        self.stops += len(fresh)
        found = [window.take(fresh) for window in self._windows]
        if not self.suspicion.changed:
            self.suspicion = max(found, key=lambda each: each.odds - each.limit)
        return self.suspicion

    def signal(self, name: str, size: float) -> float:
        """Signal lambda of a deviation of a dimension, from the data of the longest window.

        Args:
            name: name of the dimension, as in the calibration file.
            size: deviation [m or rad].
        """
        about = self._about
        names = about.calibration.chain.parameters.names
        row = int(np.flatnonzero(about.own == names.index(name))[0])
        _, information = self._windows[-1].shift()
        return float((size / about.scale[row]) ** 2 * information[row, row])

    def _is_held(self, stop: Stop) -> bool:
        """Whether the reading repeats that of the stop before although the joints have moved."""
        last, self._last = self._last, stop
        if last is None or not np.array_equal(last.point, stop.point):
            return False
        moved = np.abs(last.joint - stop.joint).max() > 1e-4 * self._about.joint_size
        self.held += int(moved)
        return bool(moved)


@dataclass(frozen=True)
class _About:
    """Calibration with the constants of the linearised model about it."""

    calibration: Calibration
    own: Index  # (q,) entries of theta that belong to the machine
    scale: Array  # (q,) their typical sizes
    known: Array  # (q, q) C_0 in typical sizes
    groups: tuple[tuple[str, str | None], ...]  # cause and place of each group
    sizes: tuple[tuple[Index, Index], ...]  # groups of equal length, and their parameters
    joint_size: float

    @classmethod
    def of(cls, calibration: Calibration) -> _About:
        """Prepare a calibration that contains its uncertainty."""
        assert calibration.uncertainty is not None
        chain = calibration.chain
        own = carried_rows(chain.layout)
        items = [chain.parameters.items[row] for row in own]
        scale = np.array([item.prior for item in items])
        able = np.flatnonzero(np.isfinite(scale) & (scale > 0))
        own, scale = own[able], scale[able]
        named: dict[tuple[str, str | None, str], list[int]] = {}
        for number, row in enumerate(able):
            item = items[int(row)]
            alone = item.name if int(own[number]) < chain.layout.geometry.stop else ""
            named.setdefault((item.cause, item.location, alone), []).append(number)
        covariance = calibration.uncertainty.covariance[np.ix_(own, own)]
        return cls(
            calibration,
            own,
            scale,
            covariance / scale[:, None] / scale,
            tuple((cause, location) for cause, location, _ in named),
            tuple(by_size(list(named.values()))),
            chain.mechanism.joint_size,
        )

    def foreseen(self, poses: Poses) -> NDArray[np.bool_]:
        """Whether the calibration can predict each pose, (n,); not if a needed load is unknown."""
        seen = self.calibration.chain.see(poses.conditions, self.calibration.theta)
        return np.asarray(
            np.isfinite(seen.reading).all(axis=1) & np.isfinite(seen.jacobian).all(axis=(1, 2))
        )


class _Window:
    """Readings of a fixed number of days, with the tracker's set-ups in them."""

    def __init__(self, about: _About, days: float, rate: float) -> None:
        self._about, self._length = about, days * _DAY
        self.limit = float(np.log(MONTH / (rate * days)))
        self._begin()

    def _begin(self) -> None:
        self._until: float | None = None
        self._numbers: dict[tuple[int, ...], int] = {}
        self._loose: set[int] = set()  # places excluded as doubtful
        self._sum: Told | None = None
        self._stops: list[Stop] = []

    def close(self) -> None:
        """End the present set-up and begin another one."""
        if self._stops:
            told = self._told(self._stops)
            if told is not None:
                self._sum = told if self._sum is None else self._sum + told
        self._stops = []

    def take(self, stops: Sequence[Stop]) -> Suspicion:
        """Add stops and evaluate the window."""
        for stop in stops:
            until = self._until
            if until is not None and not 0.0 <= until - stop.time <= self._length:
                self._begin()
            if self._until is None:
                self._until = stop.time + self._length
            if stop.place not in self._numbers and len(self._numbers) < _PLACES:
                self._numbers[stop.place] = len(self._numbers)
            if stop.place in self._numbers:
                self._stops.append(stop)
        return self._judged()

    def _judged(self) -> Suspicion:
        odds, posterior = self._odds([self._told(self._stops)])
        if odds < self.limit:
            return Suspicion(odds, self.limit, None, None)
        doubted, mend = self._doubted(odds)
        if doubted < self.limit:
            mend()
            return Suspicion(doubted, self.limit, None, None)
        best = int(np.argmax(posterior))
        named = posterior[best] > _LIKELY
        cause, location = self._about.groups[best] if named else (None, None)
        return Suspicion(doubted, self.limit, cause, location)

    def _doubted(self, odds: float) -> tuple[float, Callable[[], None]]:
        """Smallest ln B over alternative explanations, and a function that adopts that one."""
        excuses: list[tuple[float, Callable[[], None]]] = [(odds, lambda: None)]
        now = self._told(self._stops)
        for place in set(self._numbers.values()) - self._loose:
            without, _ = self._odds([now], {place})
            excuses.append((without, partial(self._loose.add, place)))
        count = len(self._stops)
        for cut in sorted({int(c) for c in np.linspace(1, count - 1, _BOUNDARIES)} - {0, count}):
            parts = [self._told(self._stops[:cut]), self._told(self._stops[cut:])]
            excuses.append((self._odds(parts)[0], partial(self._split, cut)))
        return min(excuses, key=lambda excuse: excuse[0])

    def _split(self, cut: int) -> None:
        rest, self._stops = self._stops[cut:], self._stops[:cut]
        self.close()
        self._stops = rest

    def _told(self, stops: Sequence[Stop]) -> Told | None:
        """Information of the stops of a set-up on machine and places."""
        about = self._about
        return SetUp(about.calibration, about.own, about.scale).told(stops, self._numbers)

    def shift(self) -> tuple[Array, Array]:
        """Vector (q,) and information (q, q) on a step, from all data of the window."""
        return self._shift([self._told(self._stops)], set())

    def _shift(self, parts: Iterable[Told | None], without: set[int]) -> tuple[Array, Array]:
        told = self._sum
        for part in parts:
            if part is not None:
                told = part if told is None else told + part
        known = self._about.known
        if told is None:
            return np.zeros(len(known)), np.zeros_like(known)
        information, right = told.machine(self._loose | without)
        inverse = np.linalg.inv(np.eye(len(right)) + information @ known)
        return inverse @ right, inverse @ information

    def _odds(
        self, parts: Iterable[Told | None], without: set[int] | None = None
    ) -> tuple[float, Array]:
        """ln B, and the probability of each group."""
        groups = self._about.groups
        g, n = self._shift(parts, without or set())
        each = np.empty(len(groups))
        for here, rows in self._about.sizes:
            each[here] = log_bayes(g[rows], n[rows[:, :, None], rows[:, None, :]])
        top = float(each.max())
        weight = np.exp(each - top)
        return top + float(np.log(weight.mean())), weight / weight.sum()
