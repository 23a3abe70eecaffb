"""The short way of a usual command: from its bytes to those that are sent, in one compiled call.

It takes a command while the path is steady (compensation on, no ramp, no hold) and all that the
model needs is known. What is not usual it leaves to `CommandPath.send`; what it does itself comes
out as it would there, to the last bit. See usual_kernel.py.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import is_
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell.command_path import CommandPath, Sent
from delta_calibration.cell.joint_bytes import Bytes, Layout
from delta_calibration.cell.surroundings import Surroundings
from delta_calibration.compensation import JointCompensator, SingleWay
from delta_calibration.effects.signals import (
    ACCELERATION,
    CENTRE,
    DIRECTION,
    JOINT,
    PAYLOAD,
    RATE,
)
from delta_calibration.errors import DataError, InputError
from delta_calibration.texts import listed

Array = NDArray[np.float64]

MARK = "compensated"  # header.frame_id of a command that has been compensated
_LAYOUTS = 4  # senders of different messages at a time
_SEEN, _CORRECTED = 1, 2  # of what usual_kernel.follow says
_MOTION = (JOINT, RATE, ACCELERATION, DIRECTION)


@dataclass(frozen=True)
class _Ready:
    """What the compiled call takes, and the arrays that it leaves its answer in."""

    basis: tuple[object, ...]  # compensator, what is known, outputs, motion: what it is made of
    follow: Callable[..., int]  # the compiled call
    own: Any  # usual_kernel.Usual
    joints: int  # m
    q: Array  # (m + k,) [rad], with what is passed through
    answer: Array  # (2, m + k) [rad]
    stamp: NDArray[np.int64]  # (2,)
    out: NDArray[np.uint8]


class UsualWay:
    """Corrects usual commands of one robot.

    Attributes:
        seen: whether the motion of the command that was refused last has been taken notice of.

    Args:
        names: (m,) of the robot's joints.
        path: whose commands these are.
        around: conditions that they are given under.
        passed_through: (k,) of axes that commands may carry besides, all or none of them.
    """

    def __init__(
        self,
        names: Sequence[str],
        path: CommandPath,
        around: Surroundings,
        passed_through: Sequence[str] = (),
    ) -> None:
        self._names, self._path, self._around = tuple(names), path, around
        self._beside = tuple(passed_through)
        self._marked = {
            len(told): Bytes(told, MARK) for told in (self._names, self._names + self._beside)
        }
        self._wires: dict[int, Any] = {}  # by the size of their messages
        self._ready: dict[int, _Ready] = {}  # the same
        self._lacking: tuple[object, ...] = ()  # what it cannot be made of
        self._last: tuple[_Ready, float, bool] | None = None
        self.seen = False

    def learn(self, layout: Layout, message: bytes) -> None:
        """Expect messages laid out as this one, which has each joint once and no mark.

        The oldest layout is forgotten where there are too many.
        """
        if layout.frame_id != MARK:
            self._wires.pop(layout.size, None)
            told = named_in(layout.names, self._names, self._beside)
            self._wires[layout.size] = wire_of(layout, message, told)
            while len(self._wires) > _LAYOUTS:
                del self._wires[next(iter(self._wires))]
            self._ready.clear()

    def take(self, message: bytes, now_s: float) -> bytes | None:
        """What is to be sent for a command; None where it is not usual.

        Where something is returned, `went` has to be called after it has been sent.
        """
        self.seen = False
        path, ramp = self._path, self._path.ramp
        if not path.steady or path.last_stamp is None or not isinstance(ramp.applied, np.ndarray):
            return None
        ready = self._prepared(len(message), now_s)
        if ready is None:
            return None
        became = ready.follow(
            ready.own,
            message,
            path.last_stamp,
            now_s,
            ramp.last_s,
            ramp.rate,
            path.at_once_s,
            ramp.applied,
        )
        if became < _CORRECTED:
            self.seen = became == _SEEN
            return None
        self._last = ready, now_s, became > _CORRECTED
        return ready.out.tobytes()

    def went(self) -> tuple[Array, int, Sent]:
        """Let the path know of what `take` returned: its command, stamp [ns], and output.

        The command has (m,) positions, or (m + k,) with what is passed through.

        Raises:
            DataError: there is nothing that the path does not know of.
        """
        if self._last is None:
            raise DataError("no usual command was sent")
        ready, now_s, blended = self._last
        (dq, joint), m = ready.answer.copy(), ready.joints
        sec, nanosec = ready.stamp.tolist()
        stamp_ns = sec * 1_000_000_000 + nanosec
        sent = self._path.went(dq[:m], joint[:m], stamp_ns, now_s, blended, joint[m:])
        return ready.q.copy(), stamp_ns, sent

    def prepare(self, now_s: float) -> None:
        """Take what is known by now into account, before a command has to wait for it."""
        for size in self._wires:
            self._prepared(size, now_s)

    def _prepared(self, size: int, now_s: float) -> _Ready | None:
        """What the compiled call takes for messages of a size; None where it cannot be asked."""
        path, around, ready = self._path, self._around, self._ready.get(size)
        compensator, kept, motion = path.compensator, path.echo.kept, around.motion
        known = around.known(now_s)
        if ready is not None:
            basis = ready.basis
            same = compensator is basis[0] and kept is basis[2] and motion is basis[3]
            if same and (basis[1] is None or known is basis[1]):
                return ready
        if size not in self._wires or kept is None:
            return None
        if not isinstance(compensator, JointCompensator):
            return None
        by_conditions = compensator.needs_conditions
        basis = compensator, known if by_conditions else None, kept, motion
        if len(self._lacking) == 4 and all(map(is_, basis, self._lacking)):
            return None
        way = self._found(compensator, by_conditions, now_s)
        self._lacking = basis if way is None else ()
        if way is not None:
            self._ready[size] = self._made(self._wires[size], way, basis)
        return self._ready[size] if way is not None else None

    def _found(
        self, compensator: JointCompensator, by_conditions: bool, now_s: float
    ) -> SingleWay | None:
        nowhere = compensator.robot.model().home
        at = self._around.at(nowhere, now_s) if by_conditions else None
        return compensator.single_way(at)

    def _made(self, wire: Any, way: SingleWay, basis: tuple[Any, ...]) -> _Ready:
        places, m, every = way.places, len(self._names), len(wire.position)
        where, q, answer = places.slices, np.zeros(every), np.zeros((2, every))
        stamp, marked = np.zeros(2, np.int64), self._marked[every]
        out = np.frombuffer(marked.template, np.uint8).copy()
        own = _kernel().Usual(
            wire,
            way.held,
            basis[3],
            basis[2],
            basis[1] is not None,
            way.signals,
            way.signals.copy(),
            np.array([places.begin(name) for name in _MOTION]),
            np.concatenate([way.signals[where[PAYLOAD]], way.signals[where[CENTRE]]]),
            np.zeros(m),
            q,
            np.zeros(way.aimed),
            np.zeros(4),
            answer,
            stamp,
            out,
            marked.position,
        )
        return _Ready(basis, _kernel().follow, own, m, q, answer, stamp, out)


def named_in(
    found: Sequence[str], names: tuple[str, ...], passed_through: tuple[str, ...]
) -> tuple[str, ...]:
    """What is read of a message with these names: the joints, with what is passed through or not.

    Raises:
        InputError: a part only of what is passed through is in it, or a name twice.
    """
    there = [name for name in passed_through if name in found]
    if not there:
        return names
    if len(there) < len(passed_through) or any(list(found).count(n) > 1 for n in there):
        raise InputError(
            f"JointState: of what is passed through ({', '.join(passed_through)}) all are "
            f"expected once, or none; found {listed(list(found))}"
        )
    return names + passed_through


def wire_of(layout: Layout, message: bytes, names: Sequence[str]) -> Any:
    """What compiled code reads messages of a layout by, each of the joints being there once."""
    from delta_calibration.cell import wire_kernel

    at, fixed = layout.fixed(message)
    place = [layout.position + 8 * layout.names.index(name) for name in names]
    return wire_kernel.Wire(layout.size, layout.little, at, fixed, np.array(place))


def warm_up(compensator: JointCompensator) -> None:
    """Load what is compiled on first use, so that the first usual command need not wait for it.

    Once while nothing is known of what effects go by, and once while all of it is.
    """
    names = compensator.robot.joints.names
    path, around = CommandPath(), Surroundings(len(names))
    way = UsualWay(names, path, around)
    q = compensator.robot.model().home
    path.load(compensator)
    path.enable(True)
    path.ramp.seconds = 0.0
    given = Bytes(names, "given").message
    for k in range(6):
        if k == 3:
            _tell_all(around, compensator.sensors)
        around.moved(q, k)
        at = around.at(q, 0.0) if compensator.needs_conditions else None
        path.send(q + 1e-3 * k, k, 1e-3 * k, at=at)
    message = given(q, (0, 9))
    layout = Layout.of(message)
    if layout is not None:
        way.learn(layout, message)
        way.take(message, 0.01)


def _tell_all(around: Surroundings, sensors: Sequence[str]) -> None:
    """Something for each of the conditions that a command may be given under."""
    around.carries(0.0, np.zeros(3), 0.0)
    for part in sensors:
        around.is_warm(part, 20.0, 0.0)


def _kernel() -> Any:
    """The compiled call; numba is loaded with the first use."""
    from delta_calibration.cell import usual_kernel

    return usual_kernel
