"""Compiled reading and writing of numbers in the bytes of a message with a known layout."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from delta_calibration.model.jit import compiled, record

Array = NDArray[np.float64]
Index = NDArray[np.int64]
Octets = NDArray[np.uint8]

_SEC, _NANOSEC = 4, 8  # where the two parts of the stamp begin


def _as_number(typing: Any, word: Any) -> Any:
    """Reinterpret 64 bits as a double."""
    del typing, word

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        return builder.bitcast(args[0], ir.DoubleType())

    return types.float64(types.uint64), generate


def _as_word(typing: Any, number: Any) -> Any:
    """Reinterpret a double as 64 bits."""
    del typing, number

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        del context, signature
        return builder.bitcast(args[0], ir.IntType(64))

    return types.uint64(types.float64), generate


_number: Any = intrinsic(_as_number)
_bits: Any = intrinsic(_as_word)


@record
class Wire(NamedTuple):
    """Layout of a message for compiled code; see `joint_bytes.Layout`."""

    size: int
    little: bool
    at: Index  # (b,) indices of the bytes that do not change
    fixed: Octets  # (b,) their values
    position: Index  # (m,) place of each joint's position, in the robot's order


@compiled(borrows=True)
def _word(message: bytes, at: int, count: int, little: bool) -> int:
    """Read an unsigned integer of `count` bytes."""
    word = np.uint64(0)
    for k in range(count):
        octet = np.uint64(message[at + (count - 1 - k if little else k)])
        word = (word << np.uint64(8)) | octet
    return word  # type: ignore[return-value]


@compiled(borrows=True)
def same(own: Wire, message: bytes) -> bool:
    """Whether a message has this layout."""
    if len(message) != own.size:
        return False
    for k in range(len(own.at)):  # noqa: SIM110 - nothing is made for it
        if message[own.at[k]] != own.fixed[k]:
            return False
    return True


@compiled(borrows=True)
def seconds(own: Wire, message: bytes) -> int:
    """Whole seconds of the stamp; they may be negative."""
    found = np.int64(_word(message, _SEC, 4, own.little))
    return found - (1 << 32) if found >= 1 << 31 else found  # type: ignore[return-value]


@compiled(borrows=True)
def nanoseconds(own: Wire, message: bytes) -> int:
    """Nanosecond part of the stamp [ns]."""
    return np.int64(_word(message, _NANOSEC, 4, own.little))  # type: ignore[return-value]


@compiled(borrows=True)
def positions(own: Wire, message: bytes, q: Array) -> bool:
    """Read the positions (m,) of a message into q; return whether all are finite."""
    good = True
    for j in range(len(q)):
        q[j] = _number(_word(message, own.position[j], 8, own.little))
        good = good and np.isfinite(q[j])
    return good


@compiled(borrows=True)
def write(word: int, count: int, out: Octets, at: int) -> None:
    """Write an integer into `count` bytes, little-endian."""
    rest = np.uint64(word)
    for k in range(count):
        out[at + k] = np.uint8(rest & np.uint64(255))
        rest >>= np.uint64(8)


@compiled(borrows=True)
def write_all(sec: int, nanosec: int, position: Array, out: Octets, at: int) -> None:
    """Fill a message: its stamp, and its positions (m,) from `at` on."""
    write(sec, 4, out, _SEC)
    write(nanosec, 4, out, _NANOSEC)
    for j in range(len(position)):
        write(_bits(position[j]), 8, out, at + 8 * j)


@compiled(alone=True)
def read(own: Wire, message: bytes, q: Array) -> bool:
    """Read the positions (m,) of a message into q; false if the layout differs or not finite."""
    return same(own, message) and positions(own, message, q)
