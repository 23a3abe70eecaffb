"""Finds clock offset and drift between streams by the times at which they move.

No model of the machine is needed: a machine that moves, moves in all of its streams at the same
time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft

from delta_calibration.data import JointStream, Session, TrackerStream
from delta_calibration.doctor.change import (
    COMMAND,
    STATES,
    TRACKER,
    Change,
    Mistake,
    as_it_is,
    joint_streams,
    joints_of,
    of_joints,
    of_tracker,
)
from delta_calibration.doctor.stops import SPARSE

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]
Line = tuple[float, float, float]  # offset [s], rate, spread [s]

_BIN = 0.05  # [s]
_LATEST = 60.0  # [s] largest searched offset of clocks that overlap
_WINDOW = 25.0  # [s] usual length of a window; the drift of a clock within it is negligible
_WINDOWS = 16, 4  # largest and smallest number of windows
_RATES = tuple(k * 4e-3 for n in range(1, 9) for k in (n, -n))
_FASTEST = 0.05  # [s/s] of any clock
_SHORTEST = 4.0  # [s] of a window
_AGREE = 0.12  # [s] largest distance of a window's lag from the fitted line
_MOST = 0.6  # share of the windows that must agree with the line
_SURE = 0.6  # least correlation of the motions after correction of the clock
_CLEAR = 0.35  # least correlation at a window's best lag
# [s] a smaller offset is latency, which a machine may have and `diagnose` names
_LATENCY = {TRACKER: 0.06, STATES: 0.06, COMMAND: 0.25}
_DRIFTED = 0.12  # [s] over the session
_GAP = 1.0  # [s] between messages; when a stream moved within a longer gap is not known
_UNSEEN = 0.5  # share of its way within such gaps, above which its motion is not known
_LEAST_STEPS = 30


@dataclass(frozen=True)
class Motion:
    """Speed of a stream over bins of time, relative to its fast moves."""

    start: float  # [s] beginning of the first bin
    speed: Array  # (bins,)


@dataclass(frozen=True)
class Clock:
    """Clock of a stream relative to a reference: its time is late by offset + rate (t - begin)."""

    offset: float  # [s]
    rate: float  # [s/s]
    begin: float  # [s]
    duration: float  # [s]
    likeness: float  # correlation of the motions after correction of the clock
    before: float  # correlation of the motions as recorded
    spread: float  # [s] standard error of the line through the windows' lags

    @property
    def drifted(self) -> float:
        """Drift over the session [s]."""
        return self.rate * self.duration

    def late(self, time: Array) -> Array:
        """Lateness of stamps (n,) [s] of the stream's own clock, (n,) [s]."""
        true = (time - self.offset + self.rate * self.begin) / (1 + self.rate)
        return np.asarray(time - true)


def clocks(session: Session) -> tuple[Session, tuple[Mistake, ...]]:
    """Find clock errors between the streams and correct them.

    The tracker's clock is compared with that of the joints that a fit uses; of two joint streams
    that differ, the one that agrees with the tracker is right.
    """
    tracker, names = session.tracker, joint_streams(session)
    if tracker is None or not names:
        return session, ()
    motions = {name: _motion(joints_of(session, name)) for name in names}
    motions[TRACKER] = _motion(tracker)
    if any(m is None for m in motions.values()):
        return session, ()
    late = {name: _late(motions[TRACKER], motions[name]) for name in names}
    wrong = _wrong(late)
    found: list[Mistake] = []
    for name, clock in wrong.items():
        session = _shifted(name, clock)(session)
        found += _told(name, clock)
    if wrong and COMMAND not in wrong and len(names) == 2:
        again, more = clocks(session)
        return again, (*found, *(m for m in more if m.stream == COMMAND))
    return session, tuple(found)


def _wrong(late: dict[str, Clock | None]) -> dict[str, Clock]:
    """Streams with wrong clocks, from the lateness of each joint stream against the tracker.

    It is the tracker's clock if the joint streams agree with each other; `clocks` then compares
    the corrected streams again.
    """
    main = STATES if STATES in late else COMMAND
    own, command = late[main], late.get(COMMAND)
    if own is not None and _is_off(own, TRACKER):
        alone = main == COMMAND or command is None
        if alone or (command is not None and _agree(own, command)):
            return {TRACKER: _reversed(own)}
        return {main: own}
    if main == STATES and command is not None and _is_off(command, COMMAND):
        return {COMMAND: command}
    return {}


def _agree(one: Clock, other: Clock) -> bool:
    """Whether two clocks differ by no more than the usual lag of joints behind their command."""
    begin, end = one.offset - other.offset, one.drifted - other.drifted
    return max(abs(begin), abs(begin + end)) <= _LATENCY[COMMAND]


def _told(name: str, clock: Clock) -> Iterator[Mistake]:
    alike = (
        f"its motion matches that of the other streams (correlation {clock.likeness:.2f}, as "
        f"recorded {clock.before:.2f})"
    )
    if abs(clock.drifted) > _DRIFTED:
        yield from Change(
            "clock_drift",
            (name,),
            as_it_is,
            "synchronise both clocks (PTP, chrony), or stretch its stamps by "
            f"{-clock.rate / (1 + clock.rate):+.6f} (--fix does)",
            value=clock.rate,
            unit="1",
        ).found(
            f"its clock gains {clock.rate * 1e6:+.0f} ppm, {clock.drifted:+.2f} s over "
            f"{clock.duration:.0f} s; then {alike}"
        )
    if abs(clock.drifted) <= _DRIFTED or abs(clock.offset) > _LATENCY[name] + abs(clock.drifted):
        yield from Change(
            "clock_offset",
            (name,),
            as_it_is,
            f"subtract {clock.offset:.3f} s from its header stamps (--fix does this)",
            value=clock.offset,
            unit="s",
        ).found(f"shifted by {-clock.offset:+.3f} s {alike}")


def _shifted(name: str, clock: Clock) -> Callable[[Session], Session]:
    """Function that corrects the stamps of one stream."""

    def stamps(stamp_ns: Stamps) -> Stamps:
        late = clock.late(np.asarray(stamp_ns * 1e-9))
        return np.asarray(stamp_ns - np.round(late * 1e9).astype(np.int64))

    if name == TRACKER:
        return of_tracker(lambda s: replace(s, stamp_ns=stamps(s.stamp_ns)))
    return of_joints((name,), lambda s: replace(s, stamp_ns=stamps(s.stamp_ns)))


def _is_off(clock: Clock, name: str) -> bool:
    """Whether a clock has an offset larger than a latency, or drifts."""
    sure = 4 * clock.spread
    return (
        abs(clock.offset) > max(_LATENCY[name], sure) and abs(clock.drifted) <= _DRIFTED
    ) or abs(clock.drifted) > max(_DRIFTED, sure)


def _reversed(clock: Clock) -> Clock:
    """The inverse relation: the clock of the reference relative to this stream."""
    rate = -clock.rate / (1 + clock.rate)
    begin = clock.begin + clock.offset
    return replace(clock, offset=-clock.offset, rate=rate, begin=begin)


def _motion(stream: JointStream | TrackerStream | None) -> Motion | None:
    """Motion of a stream; None if it was recorded at stops only, or hardly moves."""
    if stream is None or len(stream.stamp_ns) < _LEAST_STEPS:
        return None
    first = int(stream.stamp_ns[0])
    time = (stream.stamp_ns - first) * 1e-9
    gaps = np.diff(time)
    if np.median(gaps) > SPARSE / 2:
        return None
    span = np.ptp(stream.position, axis=0)
    scale = span if isinstance(stream, JointStream) else np.full(3, span.max())
    steps = np.diff(stream.position, axis=0) / np.where(scale > 0, scale, 1.0)
    length, unseen = np.linalg.norm(steps, axis=1), gaps > _GAP
    if length[unseen].sum() > _UNSEEN * length.sum():
        return None
    speed = np.where(unseen, 0.0, length / np.maximum(gaps, 1e-3))
    fast = float(np.quantile(speed, 0.9))
    if fast <= 0:
        return None
    noise = float(np.quantile(speed, 0.1))
    speed = np.clip((speed - 2 * noise) / fast, 0.0, 1.5)
    edges = np.arange(0.0, time[-1] + _BIN, _BIN)
    gone = np.interp(edges, time, np.r_[0.0, np.cumsum(speed * gaps)])
    return Motion(first * 1e-9, np.diff(gone) / _BIN)


def _late(reference: Motion | None, other: Motion | None) -> Clock | None:
    """Clock of another stream relative to the reference; None if their motions do not match."""
    if reference is None or other is None:
        return None
    shift = other.start - reference.start
    size = len(reference.speed)
    count = int(np.clip(size * _BIN / _WINDOW, _WINDOWS[1], _WINDOWS[0]))
    width = size // count
    if width * _BIN < _SHORTEST:
        return None
    for line in _lines(reference, other, shift, width):
        clock = _clock(reference, other, width, line)
        if clock is not None and clock.likeness >= _SURE:
            return clock if _better(clock) else _as_recorded(clock)
    return None


def _better(clock: Clock) -> bool:
    """Whether its correction removes at least half of what does not match as recorded.

    Moves at equal intervals look alike when shifted by an interval; that removes next to nothing.
    """
    return 1 - clock.likeness < 0.5 * (1 - clock.before)


def _as_recorded(clock: Clock) -> Clock:
    """The clock if the stamps are right as they are."""
    return replace(clock, offset=0.0, rate=0.0, likeness=clock.before)


def _lines(reference: Motion, other: Motion, shift: float, width: int) -> Iterator[Line]:
    """Yield first guesses: clocks that nearly agree, that drift, that have another epoch."""
    line = _line(*_windows(reference, other, shift, width, (0.0, 0.0, 0.0), _LATEST))
    if line is not None:
        yield line
    line = _fast(reference, other, width)
    if line is not None:
        yield line
    whole, _ = _lag(reference.speed, other.speed, shift, None)
    line = _line(*_windows(reference, other, shift, width, (whole, 0.0, 0.0), _LATEST))
    if line is not None:
        yield line


def _clock(reference: Motion, other: Motion, width: int, guess: Line) -> Clock | None:
    """Refine a guess of the clock; None if the windows do not agree."""
    line = guess
    for _ in range(2):
        # corrected by the guess, so that the drift does not blur the correlation in a window
        put = _warped(other, line[0], line[1], reference.start)
        at, lag = _windows(reference, put, put.start - reference.start, width, (0.0,) * 3, 1.0)
        more = _line(at, lag)
        if more is None:
            return None
        line = _after(line, more)
    offset, rate, spread = line
    duration = len(reference.speed) * _BIN
    if abs(rate) * duration < _DRIFTED:
        offset, rate = offset + 0.5 * rate * duration, 0.0
    before = _likeness(reference, other)
    after = _likeness(reference, _warped(other, offset, rate, reference.start))
    return Clock(offset, rate, reference.start, duration, after, before, spread)


def _after(first: Line, second: Line) -> Line:
    """Combine a clock with the error that remains after its correction."""
    offset = first[0] + (1 + first[1]) * second[0]
    return offset, (1 + first[1]) * (1 + second[1]) - 1, second[2]


def _fast(reference: Motion, other: Motion, width: int) -> Line | None:
    """Offset and rate of a clock whose drift blurs a window; None if no rate fits."""
    best: tuple[int, Line] | None = None
    for rate in _RATES:
        put = _warped(other, 0.0, rate, reference.start)
        shift = put.start - reference.start
        at, lag = _windows(reference, put, shift, width, (0.0, 0.0, 0.0), _LATEST)
        line = _line(at, lag)
        if line is not None:
            agree = int((np.abs(lag - line[0] - line[1] * at) < _AGREE).sum())
            if best is None or agree > best[0]:
                best = agree, _after((0.0, rate, 0.0), line)
    return None if best is None else best[1]


def _windows(
    reference: Motion, other: Motion, shift: float, width: int, about: Line, reach: float
) -> tuple[Array, Array]:
    """Time of each window (k,) [s] since the reference's begin, and its best lag (k,) [s]."""
    at, lags = [], []
    for begin in range(0, len(reference.speed) - width + 1, width):
        middle = (begin + width / 2) * _BIN
        near = about[0] + about[1] * middle
        lag, likeness = _lag(
            reference.speed[begin : begin + width],
            other.speed,
            shift - begin * _BIN,
            (near, reach),
        )
        if likeness > _CLEAR:
            at.append(middle)
            lags.append(lag)
    return np.array(at), np.array(lags)


def _lag(
    one: Array, other: Array, shift: float, near: tuple[float, float] | None
) -> tuple[float, float]:
    """Lag [s] of `other`, which begins `shift` [s] later, and the correlation at that lag.

    It is the lag of highest correlation, searched within `near` (centre, reach) [s] if given.
    """
    a, other = one - one.mean(), other - other.mean()
    if near is not None:
        reached = _reached(near, shift, len(a))
        other, shift = other[reached], shift + reached.start * _BIN
    if not len(other):
        return 0.0, 0.0
    full = _correlated(other, a)
    lag = (np.arange(len(full)) - (len(a) - 1)) * _BIN + shift
    size = np.linalg.norm(a)
    power = np.cumsum(np.r_[0.0, other**2])
    end = np.clip(np.arange(len(full)) + 1, None, len(other))
    begin = np.clip(np.arange(len(full)) + 1 - len(a), 0, None)
    own = np.sqrt(np.maximum(power[end] - power[begin], 0.05 * size**2 + 1e-12))
    full = full / (max(size, 1e-9) * own)
    allowed = np.ones(len(full), dtype=bool)
    if near is not None:
        allowed = np.abs(lag - near[0]) <= near[1]
    if not allowed.any():
        return 0.0, 0.0
    best = int(np.argmax(np.where(allowed, full, -np.inf)))
    fine = 0.0
    if 0 < best < len(full) - 1:
        left, top, right = full[best - 1 : best + 2]
        bend = left - 2 * top + right
        fine = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return float(lag[best] + fine * _BIN), float(full[best])


def _reached(near: tuple[float, float], shift: float, width: int) -> slice:
    """Bins of a stream, beginning `shift` [s] later, that overlap a window at lags `near`."""
    first = math.floor((near[0] - near[1] - shift) / _BIN) - 1
    last = math.ceil((near[0] + near[1] - shift) / _BIN) + 1 + width
    return slice(max(first, 0), max(last, 0))


def _correlated(long: Array, short: Array) -> Array:
    """Cross-correlation of both at every shift, from the first at which they overlap."""
    size = len(long) + len(short) - 1
    fast = next_fast_len(size, real=True)
    return np.asarray(irfft(rfft(long, fast) * rfft(short[::-1], fast), fast)[:size])


def _line(at: Array, lag: Array) -> Line | None:
    """Robust line through the windows' lags: offset [s], rate, standard error [s]; else None."""
    if len(at) < _WINDOWS[1] - 1:
        return None
    apart = at[:, None] - at
    rows = np.triu_indices(len(at), 1)
    slopes = (lag[:, None] - lag)[rows] / apart[rows]
    best = (-1, 0.0, 0.0)
    for rate in (0.0, float(np.median(slopes)), *slopes[np.abs(slopes) < _FASTEST]):
        offset = float(np.median(lag - rate * at))
        count = int((np.abs(lag - offset - rate * at) < _AGREE).sum())
        if count > best[0]:
            best = count, offset, rate
    if best[0] < max(_MOST * len(at), 3):
        return None
    good = np.abs(lag - best[1] - best[2] * at) < _AGREE
    rate, offset = np.polyfit(at[good], lag[good], 1)
    if abs(rate) >= _FASTEST:
        return None
    left = lag[good] - offset - rate * at[good]
    return float(offset), float(rate), float(np.std(left) / np.sqrt(good.sum()))


def _warped(other: Motion, offset: float, rate: float, begin: float) -> Motion:
    """The motion on the time axis of the reference's clock."""
    time = other.start + (np.arange(len(other.speed)) + 0.5) * _BIN
    true = begin + (time - begin - offset) / (1 + rate)
    grid = np.arange(true[0], true[-1], _BIN)
    return Motion(float(true[0]), np.interp(grid, true, other.speed))


def _likeness(one: Motion, other: Motion) -> float:
    """Correlation of two motions by their stamps; 0 if they do not overlap."""
    time, of = (m.start + (np.arange(len(m.speed)) + 0.5) * _BIN for m in (one, other))
    speed = np.interp(time, of, other.speed, left=0.0, right=0.0)
    spread = float(one.speed.std() * speed.std())
    if spread <= 0.0:
        return 0.0
    return float(np.mean((one.speed - one.speed.mean()) * (speed - speed.mean())) / spread)
