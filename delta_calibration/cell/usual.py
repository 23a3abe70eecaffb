"""Fast path for usual commands: from the received bytes to those sent, in one compiled call.

It takes a command while the command path is steady (compensation on, no ramp, no hold) and all
conditions that the model needs are known. All other commands are left to `CommandPath.send`; both
give the same result, to the last bit. See usual_kernel.py.
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
_LAYOUTS = 4  # message layouts remembered at a time
_SEEN, _CORRECTED = 1, 2  # return values of usual_kernel.follow
_MOTION = (JOINT, RATE, ACCELERATION, DIRECTION)


@dataclass(frozen=True)
class _Ready:
    """Inputs of the compiled call, and the arrays that it writes its results to."""

    basis: tuple[object, ...]  # compensator, known conditions, outputs, motion: its sources
    follow: Callable[..., int]  # the compiled call
    own: Any  # usual_kernel.Usual
    joints: int  # m
    q: Array  # (m + k,) [rad] joints, then pass-through axes
    answer: Array  # (2, m + k) [rad]
    stamp: NDArray[np.int64]  # (2,)
    out: NDArray[np.uint8]


class UsualWay:
    """Corrects usual commands of one robot.

    Attributes:
        seen: whether the motion of the last command that was not usual has been recorded.

    Args:
        names: (m,) names of the robot's joints.
        path: command path whose commands these are.
        around: conditions of the commands.
        passed_through: (k,) names of pass-through axes; a command contains all or none of them.
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
        self._lacking: tuple[object, ...] = ()  # sources from which no `_Ready` can be made
        self._last: tuple[_Ready, float, bool] | None = None
        self.seen = False

    def learn(self, layout: Layout, message: bytes) -> None:
        """Remember the layout of a message that contains each joint once; a marked one is ignored.

        If there are too many layouts, the oldest is forgotten.
        """
        if layout.frame_id != MARK:
            self._wires.pop(layout.size, None)
            told = named_in(layout.names, self._names, self._beside)
            self._wires[layout.size] = wire_of(layout, message, told)
            while len(self._wires) > _LAYOUTS:
                del self._wires[next(iter(self._wires))]
            self._ready.clear()

    def take(self, message: bytes, now_s: float) -> bytes | None:
        """Return the output for a command; None if the command is not usual.

        After an output has been sent, call `went`.
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
        """Update the path with the last output of `take`; return command, stamp [ns] and output.

        The command has (m,) positions, or (m + k,) with the pass-through axes.

        Raises:
            DataError: `take` has not returned an output.
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
        """Prepare the compiled call for the present conditions, before a command needs it."""
        for size in self._wires:
            self._prepared(size, now_s)

    def _prepared(self, size: int, now_s: float) -> _Ready | None:
        """Inputs of the compiled call for messages of a size; None if it cannot be used."""
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
    """Names to read from a message: the joints, and the pass-through axes if it contains them.

    Raises:
        InputError: only a part of the pass-through axes is in the message, or one of them twice.
    """
    there = [name for name in passed_through if name in found]
    if not there:
        return names
    if len(there) < len(passed_through) or any(list(found).count(n) > 1 for n in there):
        raise InputError(
            f"JointState: the passed-through axes ({', '.join(passed_through)}) are expected "
            f"once each, or none of them; found {listed(list(found))}"
        )
    return names + passed_through


def wire_of(layout: Layout, message: bytes, names: Sequence[str]) -> Any:
    """Make the record by which compiled code reads messages of a layout with each joint once."""
    from delta_calibration.cell import wire_kernel

    at, fixed = layout.fixed(message)
    place = [layout.position + 8 * layout.names.index(name) for name in names]
    return wire_kernel.Wire(layout.size, layout.little, at, fixed, np.array(place))


def warm_up(compensator: JointCompensator) -> None:
    """Trigger the compilation on first use, so that the first usual command does not wait for it.

    Done once with unknown conditions, and once with all conditions known.
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
    """Set an arbitrary value for each condition that an effect may depend on."""
    around.carries(0.0, np.zeros(3), 0.0)
    for part in sensors:
        around.is_warm(part, 20.0, 0.0)


def _kernel() -> Any:
    """Module of the compiled call; numba is loaded at the first use."""
    from delta_calibration.cell import usual_kernel

    return usual_kernel
