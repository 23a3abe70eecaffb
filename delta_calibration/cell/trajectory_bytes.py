"""Serialized trajectory_msgs/JointTrajectory, read and written by arrays, not point by point.

Deserializing ten thousand points creates as many objects and blocks Python meanwhile, so that no
command is processed. In plain CDR (XCDR1, little-endian) the place of every number follows from
the sizes before it, counted from the end of the four bytes that name the encoding:

    header      sec i32, nanosec u32, frame_id string
    names       count u32, strings
    points      count u32, each: positions, velocities, accelerations, effort, sec i32, nanosec u32

A string is its length with the terminating zero (u32) and its bytes; an array its length (u32) and
its doubles at a multiple of 8; all else is at a multiple of 4. For any other layout the reader
returns None, and the bytes have to be deserialized as a message.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Index = NDArray[np.int64]

_PLAIN = b"\x00\x01"  # XCDR1, little-endian
_HEAD = 4  # bytes
_ARRAYS = 4  # arrays of a point
_LONGEST = 1 << 20  # bytes of a string


@dataclass(frozen=True)
class TrajectoryBytes:
    """Trajectory as received: n points with arrays of equal sizes."""

    stamp: tuple[int, int]  # [s], [ns]
    frame: str
    names: tuple[str, ...]
    joint: Array  # (n, names)
    velocity: Array | None  # (n, names)
    seconds: NDArray[np.int32]  # (n,) whole seconds from the start
    nanoseconds: NDArray[np.uint32]  # (n,) remaining nanoseconds

    @property
    def time(self) -> Array:
        """Time of each point from the start, (n,) [s]."""
        return np.asarray(self.seconds + self.nanoseconds * 1e-9)


def read_trajectory(data: bytes) -> TrajectoryBytes | None:
    """Parse a message; None if its points differ in their sizes, or it is not plain CDR."""
    if data[:2] != _PLAIN:
        return None
    try:
        return _read(np.frombuffer(data, np.uint8)[_HEAD:], data[_HEAD:])
    except (struct.error, ValueError, IndexError, UnicodeDecodeError):
        return None


def _read(plain: NDArray[np.uint8], data: bytes) -> TrajectoryBytes | None:
    stamp = struct.unpack_from("<iI", data)
    frame, at = _string(data, 8)
    (count,) = struct.unpack_from("<I", data, at)
    at += 4
    names = []
    for _ in range(min(count, len(data))):
        name, at = _string(data, at)
        names.append(name)
    (n,) = struct.unpack_from("<I", data, at)
    at += 4
    if not 0 < n <= len(data):
        return None
    sizes = _sizes(data, at)
    parts, end = _places(at, sizes, n)
    fits = sizes[0] == len(names) and sizes[1] in (0, len(names)) and not any(sizes[2:])
    if end > len(data) or not fits:  # bytes behind the end do not belong to the message
        return None
    words = plain[: len(plain) // 4 * 4].view(np.uint32)
    for part, size in zip(parts, sizes, strict=True):
        if (words[part // 4] != size).any():
            return None
    joint, velocity = (_doubles(words, parts[k], sizes[k]) for k in range(2))
    last = (parts[-1] + 4) // 4
    return TrajectoryBytes(
        (int(stamp[0]), int(stamp[1])),
        frame,
        tuple(names),
        joint,
        velocity if sizes[1] else None,
        words[last].view(np.int32),
        words[last + 1],
    )


def write_trajectory(
    stamp: tuple[int, int],
    frame: str,
    names: Sequence[str],
    joint: Array,
    velocity: Array | None,
    seconds: NDArray[np.int32],
    nanoseconds: NDArray[np.uint32],
) -> bytes:
    """Serialize points (n, names), with velocities or none, and their times from the start."""
    front = struct.pack("<iI", *stamp) + _packed(frame, 8)
    front += struct.pack("<I", len(names))
    for name in names:
        front += _packed(name, len(front))
    n, m = joint.shape
    front += struct.pack("<I", n)
    sizes = (m, 0 if velocity is None else m, 0, 0)
    parts, end = _places(len(front), sizes, n)
    words = np.zeros(end // 4, np.uint32)
    words[: len(front) // 4] = np.frombuffer(front, np.uint32)
    for part, size, values in zip(parts, sizes, (joint, velocity, None, None), strict=True):
        words[part // 4] = size
        if values is not None:
            words[_words_of(part, size)] = np.ascontiguousarray(values).view(np.uint32)
    last = (parts[-1] + 4) // 4
    words[last], words[last + 1] = seconds.view(np.uint32), nanoseconds
    return _PLAIN + b"\x00\x00" + words.tobytes()


def _places(at: int, sizes: Sequence[int], n: int) -> tuple[list[Index], int]:
    """Byte offsets at which each array of the points begins, (n,) each, and end of the last point.

    The length of a point and the offsets in it depend on whether it begins at a multiple of 8.
    """
    within = {begin: _within(begin, sizes) for begin in (0, 4)}
    starts = np.empty(n, np.int64)
    for row in range(n):
        starts[row] = at
        at += within[at % 8][1]
    odd = starts % 8 == 4
    parts = [starts + np.where(odd, within[4][0][k], within[0][0][k]) for k in range(_ARRAYS)]
    return parts, at


def _within(begin: int, sizes: Sequence[int]) -> tuple[list[int], int]:
    """Offsets of the arrays of a point from its beginning, and its length [bytes]."""
    at, places = begin, []
    for size in sizes:
        places.append(at - begin)
        at += 4
        if size:
            at += -at % 8 + 8 * size
    return places, at + 8 - begin


def _sizes(data: bytes, at: int) -> list[int]:
    """Lengths of the first point's arrays."""
    sizes = []
    for _ in range(_ARRAYS):
        (size,) = struct.unpack_from("<I", data, at)
        at += 4
        if size:
            at += -at % 8 + 8 * size
        sizes.append(int(size))
        if at > len(data):
            raise ValueError("cut off")
    return sizes


def _words_of(part: Index, size: int) -> Index:
    """Indices of the 4-byte words of the doubles of arrays at byte offsets `part`, (n, 2 size)."""
    first = part + 4
    first = first + (-first) % 8
    return np.asarray(first[:, None] // 4 + np.arange(2 * size))


def _doubles(words: NDArray[np.uint32], part: Index, size: int) -> Array:
    return np.ascontiguousarray(words[_words_of(part, size)]).view(np.float64)


def _string(data: bytes, at: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, at)
    at += 4
    if not 0 < length <= min(_LONGEST, len(data) - at):
        raise ValueError("a string of no length")
    text = data[at : at + length - 1].decode()
    at += length
    return text, at + -at % 4


def _packed(text: str, at: int) -> bytes:
    """Serialize a string at a multiple of 4, padded to the next multiple."""
    data = text.encode() + b"\x00"
    assert at % 4 == 0
    return struct.pack("<I", len(data)) + data + b"\x00" * (-len(data) % 4)
