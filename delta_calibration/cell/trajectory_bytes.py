"""trajectory_msgs/JointTrajectory as bytes, read and written by arrays instead of point by point.

A message of ten thousand points becomes as many objects, and python stands still meanwhile: no
command is answered. Plain CDR (XCDR1, little-endian) has every number at a place that follows from
the sizes before it, counted behind the four bytes that name the encoding:

    header      sec i32, nanosec u32, frame_id string
    names       count u32, strings
    points      count u32, each: positions, velocities, accelerations, effort, sec i32, nanosec u32

A string is its length with the zero at its end u32, its bytes; an array its length u32, its
doubles at a multiple of 8; all else at a multiple of 4. What is laid out otherwise is None here,
and has to be read as a message.
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
_ARRAYS = 4  # of a point
_LONGEST = 1 << 20  # bytes of a string


@dataclass(frozen=True)
class TrajectoryBytes:
    """A trajectory as it came: n points of the same sizes."""

    stamp: tuple[int, int]  # [s], [ns]
    frame: str
    names: tuple[str, ...]
    joint: Array  # (n, names)
    velocity: Array | None  # (n, names)
    seconds: NDArray[np.int32]  # (n,) from the start, whole
    nanoseconds: NDArray[np.uint32]  # (n,) and the rest

    @property
    def time(self) -> Array:
        """Of each point from the start, (n,) [s]."""
        return np.asarray(self.seconds + self.nanoseconds * 1e-9)


def read_trajectory(data: bytes) -> TrajectoryBytes | None:
    """A message taken apart; None where its points differ in their sizes, or it is not plain."""
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
    if end > len(data) or not fits:  # what lies behind the end is no part of it
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
    """A message of points (n, names) with these velocities or none, and times from the start."""
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
    """Where each array of the points begins, (n,) each, and where the last point ends.

    A point's length depends on whether it begins at a multiple of 8: so do the places in it.
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
    """Where the arrays of a point begin behind its begin, and its length."""
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
    """The words of the doubles of arrays that begin at bytes `part`, (n, 2 size)."""
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
    """A string at a multiple of 4, and what fills up to the next."""
    data = text.encode() + b"\x00"
    assert at % 4 == 0
    return struct.pack("<I", len(data)) + data + b"\x00" * (-len(data) % 4)
