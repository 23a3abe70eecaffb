"""Whether a machine is still what was calibrated, by whatever is read of it at rest.

About the calibration all is linear. Stop i, at place p of set-up k of the tracker, misses by

    r = J_x x + J_o z_k + R u_p + noise

with x how far the machine is from its calibration in typical sizes, known to C_0; z_k the frame
and the reflector of the set-up, of which no more is known than of any new one; u_p what the model
leaves out at that place, where the joints come to rest there and play included: one draw a place,
so that a program which comes back a thousand times proves nothing by that. With z and u integrated
out there is information H and a vector b on x. That something stepped has the Bayes factor B of
`history/steps.py`, averaged over all dimensions and effects and over sizes.

Under a machine that did not change B is a martingale: it ever reaches 1/a with probability a at
most (Ville 1939; Shafer and others 2011, Statistical Science 26, 84-101), however often it is
looked at. It begins anew with every window; of windows of w days there are 30.4/w a month, and
a = rate w / 30.4, shared among the lengths.

An alarm is told if it stays one with any place left out, and if the tracker was moved once in the
last set-up, whenever that was. Of a set-up the first readings, at three or four places, tell where
the tracker is and nothing of the machine.
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
_PLACES = 60  # that a window keeps apart; stops at others are not looked at
_BOUNDARIES = 16  # at which it is tried whether the tracker was moved
_LIKELY = 0.3  # probability from which on a cause is named


@dataclass(frozen=True)
class Suspicion:
    """What the readings say of the machine."""

    odds: float  # ln B
    limit: float  # from which on an alarm is told
    cause: str | None  # likeliest, by its fixed name, where one is likelier than all others
    location: str | None

    @property
    def changed(self) -> bool:
        """Whether the machine is no longer what was calibrated."""
        return self.odds >= self.limit


class Vigil:
    """Keeps what was read of a machine, and tells when it is no longer what was calibrated.

    Args:
        calibration: with its uncertainty.
        rate: false alarms a month at most.

    Raises:
        InputError: a calibration file that does not say how uncertain it is, or no rate.
    """

    def __init__(self, calibration: Calibration, rate: float) -> None:
        if calibration.uncertainty is None:
            raise InputError(
                f"{calibration.source}: its file does not say how uncertain it is; fit again"
            )
        if not 0.0 < rate <= 10.0:
            raise InputError(f"false alarms: {rate:g} a month is not allowed; 0 to 10")
        self._about = _About.of(calibration)
        self._windows = [_Window(self._about, days, rate / len(WINDOWS)) for days in WINDOWS]
        self._last: Stop | None = None
        self.stops = 0  # that were looked at
        self.held = 0  # at which the tracker told what it had told elsewhere
        self.unknown = 0  # of which the calibration cannot say where the machine stands
        self._sensors: tuple[str, ...] = ()
        self.suspicion = Suspicion(0.0, min(w.limit for w in self._windows), None, None)

    def set_up(self) -> None:
        """The tracker was set up anew, or may have been moved."""
        for window in self._windows:
            window.close()

    def take(self, poses: Poses) -> Suspicion:
        """Look at what was read at rest; an alarm stays until a calibration is watched anew."""
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
        """lambda of a dimension that is off by so much [m or rad], by all that is kept.

        Args:
            name: of the dimension, as in the calibration file.
            size: by which it is off.
        """
        about = self._about
        names = about.calibration.chain.parameters.names
        row = int(np.flatnonzero(about.own == names.index(name))[0])
        _, information = self._windows[-1].shift()
        return float((size / about.scale[row]) ** 2 * information[row, row])

    def _is_held(self, stop: Stop) -> bool:
        """Whether the reading is that of the stop before, though the joints moved."""
        last, self._last = self._last, stop
        if last is None or not np.array_equal(last.point, stop.point):
            return False
        moved = np.abs(last.joint - stop.joint).max() > 1e-4 * self._about.joint_size
        self.held += int(moved)
        return bool(moved)


@dataclass(frozen=True)
class _About:
    """The calibration as a point about which all is linear."""

    calibration: Calibration
    own: Index  # entries of theta that are the machine's own
    scale: Array  # (q,) typical sizes of these
    known: Array  # (q, q) C_0 in typical sizes
    groups: tuple[tuple[str, str | None], ...]  # cause and place of what steps together
    sizes: tuple[tuple[Index, Index], ...]  # groups of as many numbers, and which these are
    joint_size: float

    @classmethod
    def of(cls, calibration: Calibration) -> _About:
        """Of a calibration that says how uncertain it is."""
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
        """Which poses the calibration can foretell, (n,): not without a load that it asks for."""
        seen = self.calibration.chain.see(poses.conditions, self.calibration.theta)
        return np.asarray(
            np.isfinite(seen.reading).all(axis=1) & np.isfinite(seen.jacobian).all(axis=(1, 2))
        )


class _Window:
    """Readings of so many days, with the set-ups of the tracker in them."""

    def __init__(self, about: _About, days: float, rate: float) -> None:
        self._about, self._length = about, days * _DAY
        self.limit = float(np.log(MONTH / (rate * days)))
        self._begin()

    def _begin(self) -> None:
        self._until: float | None = None
        self._numbers: dict[tuple[int, ...], int] = {}
        self._loose: set[int] = set()  # places that are not believed
        self._sum: Told | None = None
        self._stops: list[Stop] = []

    def close(self) -> None:
        """Begin another set-up."""
        if self._stops:
            told = self._told(self._stops)
            if told is not None:
                self._sum = told if self._sum is None else self._sum + told
        self._stops = []

    def take(self, stops: Sequence[Stop]) -> Suspicion:
        """Look at more stops."""
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
        """ln B by the likeliest excuse, and what makes the excuse true from now on."""
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
        """What the stops of a set-up say of machine and places."""
        about = self._about
        return SetUp(about.calibration, about.own, about.scale).told(stops, self._numbers)

    def shift(self) -> tuple[Array, Array]:
        """Vector (q,) and information (q, q) on what stepped, by all that the window holds."""
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
