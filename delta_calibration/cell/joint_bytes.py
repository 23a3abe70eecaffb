"""Serialized JointState messages: positions of their numbers in the bytes, and their writing.

A serialized `sensor_msgs/msg/JointState` in plain CDR (XCDR version 1) begins with an
encapsulation of four bytes, which gives the byte order. Then, each number aligned to its size:

    int32 sec, uint32 nanosec, string frame_id, sequences of: string name, double position,
    double velocity, double effort

A string is its length, with the terminating zero, and its characters; a sequence its length and
its entries. As long as names, frame and sizes do not change, no number changes its place.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError

Array = NDArray[np.float64]
Index = NDArray[np.int64]

STAMP = 4  # where the stamp's eight bytes begin
LITTLE, BIG = b"\x00\x01", b"\x00\x00"  # encapsulations of plain CDR
_HEAD = LITTLE + b"\x00\x00"
_ALIGNED_FROM = 4  # alignment is counted from the end of the encapsulation
_STAMPS = {LITTLE: struct.Struct("<iI"), BIG: struct.Struct(">iI")}
_TAIL = 16  # padding bytes that a sender may leave behind the message


@dataclass(frozen=True)
class Layout:
    """Layout of one sender's serialized JointState: places of its numbers in the bytes.

    Attributes:
        size: length of all messages of this layout [bytes].
        little: whether the byte order is little-endian.
        frame_id: frame of the header.
        names: (n,) names of the joints.
        position: byte offset of the first position.
        positions: number of positions.
        changing: whether a byte may differ from message to message, (size,): those of the stamp,
            of positions, velocities and efforts, and padding.
    """

    size: int
    little: bool
    frame_id: str
    names: tuple[str, ...]
    position: int
    positions: int
    changing: NDArray[np.bool_] = field(repr=False, compare=False)

    @classmethod
    def of(cls, message: bytes) -> Layout | None:
        """Layout of a message; None if it is no JointState in plain CDR."""
        try:
            return _Walk(message).layout()
        except (_NotPlainError, UnicodeDecodeError):
            return None

    def read(self, message: bytes) -> Array:
        """Read the positions (n,) of a message of this layout, in the order of the message."""
        kind = "<f8" if self.little else ">f8"
        found = np.frombuffer(message, kind, self.positions, self.position)
        return found.astype(np.float64)

    def fixed(self, message: bytes) -> tuple[Index, NDArray[np.uint8]]:
        """Indices and values of the bytes that are equal in all messages of this layout."""
        at = np.flatnonzero(~self.changing)
        return at, np.frombuffer(message, np.uint8)[at]


def stamp_of(message: bytes) -> tuple[int, int] | None:
    """Seconds and nanoseconds of the stamp; None if this is no message in plain CDR."""
    kind = _STAMPS.get(message[:2])
    if kind is None or len(message) < STAMP + 8:
        return None
    sec, nanosec = kind.unpack_from(message, STAMP)
    return int(sec), int(nanosec)


class Bytes:
    """Writer of serialized JointState messages of one set of joints, without velocity and effort.

    Args:
        names: (m,) names of the joints.
        frame_id: frame of the header.
    """

    def __init__(self, names: Sequence[str], frame_id: str = "") -> None:
        self._names = tuple(names)
        made = bytearray(_HEAD + bytes(8) + _string(frame_id))
        _pad(made, 4)
        made += struct.pack("<I", len(names))
        for name in names:
            _pad(made, 4)
            made += _string(name)
        _pad(made, 4)
        made += struct.pack("<I", len(names))
        if names:
            _pad(made, 8)
        self.position = len(made)
        made += bytes(8 * len(names)) + struct.pack("<II", 0, 0)
        self.template = bytes(made)
        self._between = self.template[STAMP + 8 : self.position]
        self._end = self.template[self.position + 8 * len(names) :]

    def message(self, position: Array, stamp: tuple[int, int]) -> bytes:
        """Serialize a message with positions (m,) and a stamp of seconds and nanoseconds.

        Raises:
            InputError: the number of positions differs from that of the names, or one is not
                finite.
        """
        if position.shape != (len(self._names),) or not np.isfinite(position).all():
            raise InputError(f"JointState: {position} for {list(self._names)} is not to be sent")
        numbers = position.astype("<f8", copy=False).tobytes()
        written = _STAMPS[LITTLE].pack(*stamp)
        return b"".join((_HEAD, written, self._between, numbers, self._end))


class _NotPlainError(Exception):
    """Raised if the bytes are no JointState in plain CDR."""


class _Walk:
    """Parser that reads the bytes of a message from beginning to end."""

    def __init__(self, message: bytes) -> None:
        if message[:2] not in _STAMPS:
            raise _NotPlainError
        self._message, self._little = message, message[:2] == LITTLE
        self._size = struct.Struct("<I" if self._little else ">I")
        self._at = STAMP
        self._changing = np.zeros(len(message), np.bool_)

    def layout(self) -> Layout:
        self._numbers(8)  # the stamp
        frame_id = self._string()
        names = tuple(self._string() for _ in range(self._count(1)))
        position, positions = self._doubles()
        self._doubles()
        self._doubles()
        end = self._at
        if len(self._message) - end > _TAIL:
            raise _NotPlainError
        self._changing[end:] = True
        size = len(self._message)
        return Layout(size, self._little, frame_id, names, position, positions, self._changing)

    def _step(self, count: int) -> int:
        """Advance by that many bytes; return the offset of the first."""
        begin = self._at
        if count > len(self._message) - begin:
            raise _NotPlainError
        self._at += count
        return begin

    def _numbers(self, count: int) -> int:
        """Advance by that many bytes, marked as changing; return the offset of the first."""
        begin = self._step(count)
        self._changing[begin : self._at] = True
        return begin

    def _align(self, size: int) -> None:
        self._numbers((_ALIGNED_FROM - self._at) % size)

    def _count(self, least: int) -> int:
        """Read the length of a string or sequence whose entries have at least `least` bytes."""
        self._align(4)
        count = int(self._size.unpack_from(self._message, self._step(4))[0])
        if count * least > len(self._message) - self._at:
            raise _NotPlainError
        return count

    def _string(self) -> str:
        count = self._count(1)
        begin = self._step(count)
        text = self._message[begin : self._at]
        if count and text[-1:] != b"\x00":
            raise _NotPlainError
        return text[:-1].decode("utf-8")

    def _doubles(self) -> tuple[int, int]:
        count = self._count(8)
        if count:  # an empty sequence has no padding
            self._align(8)
        return self._numbers(8 * count), count


def _string(text: str) -> bytes:
    coded = text.encode("utf-8") + b"\x00"
    return struct.pack("<I", len(coded)) + coded


def _pad(made: bytearray, size: int) -> None:
    made += bytes((_ALIGNED_FROM - len(made)) % size)
