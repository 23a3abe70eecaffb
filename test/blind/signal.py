"""Size of a cause's signal: raw, after fitting a frame, and after a calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lstsq

from blind.cell import Cell, Measured
from blind.world import World

Array = NDArray[np.float64]

_STEP = 1e-5  # [m], [rad] step of finite differences
_FREE = 1.0  # [m], [rad] prior of the frame: practically free
_THIN = 4  # every fourth reading in motion is used, and represents all four
_ALONG, _ACROSS, _PER_METRE = 3e-6, 2e-6, 2e-6  # [m], [m], [m/m] of a tracker's reading
_READ = 20  # readings of a stop
_RESTING = 0.02  # of the fastest speed in its motion: momentarily at rest


@dataclass(frozen=True)
class Signal:
    """RMS of the 3-D displacement of the measured points by the causes [um]."""

    still: float  # at stops
    moving: float  # in motion; 0 if nothing is measured in motion
    fitted: float  # at stops, after the best rigid frame


@dataclass(frozen=True)
class Left:
    """Signal of the causes that remains after a calibration.

    The prior of the geometry is the machine's own manufacturing scatter.
    """

    still: float  # [um] RMS at stops
    moving: float  # [um] RMS in measured motions
    strength: float  # lambda: squared, in standard deviations of the noise, summed


def signal(measured: Measured) -> Signal:
    """Signal before a calibration."""
    world, moved = measured.world, measured.reading - measured.plain
    still = world.still & world.seen
    after = after_frame(measured.reading[still], measured.plain[still])
    return Signal(_rms(moved[still]), _rms(moved[_in_motion(world)]), _rms(after))


def left(cell: Cell, measured: Measured) -> Left:
    """Signal after fitting frame, reflector offset and geometry by least squares with priors."""
    return lefts(cell, [measured])[0]


def lefts(cell: Cell, every: Sequence[Measured]) -> list[Left]:
    """The same for several causes of a machine, each measured alone by the same plan."""
    world = every[0].world
    rows, still = _looked_at(every[0])
    sigma = _sigmas(cell, every[0], rows, still)
    known = list(_columns(cell, world.command[rows]))
    known += _rest_errors(
        cell, world.command[rows], np.where(still, -1, _motions(cell, world)[rows])
    )
    columns = np.stack(known, axis=-1)
    slopes = _divided(columns, sigma).reshape(3 * len(rows), -1)
    moved = np.stack([(one.reading - one.plain)[rows] for one in every], axis=-1)
    effect = _divided(moved, sigma).reshape(3 * len(rows), -1)
    slopes = np.vstack([slopes, np.eye(slopes.shape[1])])
    effect = np.vstack([effect, np.zeros((slopes.shape[1], len(every)))])
    # QR: the priors leave no direction free, and it is ten times as fast as SVD.
    remains = effect - slopes @ lstsq(slopes, effect, lapack_driver="gelsy")[0]
    metres = _multiplied(remains[: 3 * len(rows)].reshape(len(rows), 3, -1), sigma)
    return [
        Left(_rms(metres[still, :, k]), _rms(metres[~still, :, k]), float(one @ one))
        for k, one in enumerate(remains.T)
    ]


def after_frame(reading: Array, plain: Array) -> Array:
    """Residuals of the difference after a rigid motion, (n, 3) [m]."""
    a, b = reading - reading.mean(axis=0), plain - plain.mean(axis=0)
    u, _, v = np.linalg.svd(b.T @ a)
    turn = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    return np.asarray(a - b @ turn)


def _rms(difference: Array) -> float:
    if len(difference) == 0:
        return 0.0
    return 1e6 * float(np.sqrt(np.mean(np.sum(difference**2, axis=1))))


def _in_motion(world: World) -> NDArray[np.bool_]:
    """Readings of the measured motions; moves between stops are too fast to be used."""
    return ~world.still & world.seen & (world.side == 0)


def _looked_at(measured: Measured) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The last row of each stop and every fourth in motion, and which of them are stops."""
    world = measured.world
    last = world.still & (np.diff(world.item, append=-1) != 0)
    motion = np.flatnonzero(_in_motion(world))[::_THIN]
    rows = np.sort(np.append(np.flatnonzero(last), motion))
    return rows, world.still[rows]


def _motions(cell: Cell, world: World) -> Array:
    """Number of the motion, (n,): between two moments of rest, each with its own rest error.

    For the Delta motions are counted by item, a sweep there and back as one, as its lambda values
    always were.
    """
    if cell.kind.noise is not None:
        return world.item
    speed = np.abs(world.velocity / cell.kind.size).max(axis=1)
    fastest = np.maximum.reduceat(speed, np.flatnonzero(np.diff(world.item, prepend=-1)))
    slow = speed < _RESTING * fastest[world.item]
    return np.asarray(np.cumsum(np.diff(slow.astype(int), prepend=0) > 0))


def _sigmas(cell: Cell, measured: Measured, rows: Array, still: Array) -> Array:
    """Standard deviation of each row per axis, (n,) [m]; or its Cholesky factor, (n, 3, 3) [m]."""
    if cell.kind.noise is not None:
        at_rest, in_motion = cell.kind.noise
        return np.where(still, at_rest, in_motion / np.sqrt(_THIN))
    reading = measured.plain[rows]
    distance = np.linalg.norm(reading, axis=1)[:, None, None]
    beam = (reading / distance[:, 0])[..., None]
    along = beam @ np.swapaxes(beam, 1, 2)
    one = _ALONG**2 * along + (_ACROSS + _PER_METRE * distance) ** 2 * (np.eye(3) - along)
    slopes = list(_slopes(cell, measured.world.command[rows], "zero"))
    moves = cell.kind.rest * np.stack(slopes, axis=-1)
    rest = moves @ np.swapaxes(moves, 1, 2)
    together = np.where(still[:, None, None], one / _READ + rest, one / _THIN)
    return np.asarray(np.linalg.cholesky(together))


def _divided(values: Array, sigma: Array) -> Array:
    """Values (n, 3, k) in standard deviations."""
    if sigma.ndim == 1:
        return np.asarray(values / sigma[:, None, None])
    return np.asarray(np.linalg.solve(sigma, values))


def _multiplied(values: Array, sigma: Array) -> Array:
    """Convert values in standard deviations back to metres."""
    return values * sigma[:, None, None] if sigma.ndim == 1 else sigma @ values


def _rest_errors(cell: Cell, command: Array, motion: NDArray[np.int64]) -> list[Array]:
    """Change of the reading by each motion's rest error of each joint, (n, 3) each."""
    slopes = list(_slopes(cell, command, "zero"))
    return [
        np.where((motion == number)[:, None], cell.kind.rest * slope, 0.0)
        for number in np.unique(motion[motion >= 0])
        for slope in slopes
    ]


def _columns(cell: Cell, command: Array) -> Iterator[Array]:
    """Derivatives of the reading by all fitted parameters, per expected size, (n, 3) each."""
    build, tracker, turn = cell.plain, cell.tracker, cell.tracker.turn.as_matrix().T
    stand = cell.kind.assemble(command, build)
    here = stand.point(tracker.reflector)
    for axis in np.eye(3):
        yield np.tile(_FREE * axis, (len(here), 1))
        yield _FREE * np.cross(axis, here) @ turn
        yield cell.kind.offset * (stand.point(tracker.reflector + axis) - here) @ turn
    for part in (field.name for field in fields(build)):
        expected = np.broadcast_to(cell.kind.expected[part], getattr(build, part).shape)
        for size, slope in zip(expected.ravel(), _slopes(cell, command, part), strict=True):
            yield cell.scatter * size * slope


def _slopes(cell: Cell, command: Array, part: str) -> Iterator[Array]:
    """d(reading) by each number of a part of the build, (n, 3)."""
    build, tracker, turn = cell.plain, cell.tracker, cell.tracker.turn.as_matrix().T
    stand = cell.kind.assemble(command, build)
    here, value = stand.point(tracker.reflector), getattr(build, part)
    for where in np.ndindex(value.shape):
        off = value.copy()
        off[where] += _STEP
        moved = cell.kind.assemble(command, replace(build, **{part: off}), None, stand)
        yield (moved.point(tracker.reflector) - here) @ turn / _STEP
