"""Decode recorded messages in batches of thousands.

Messages of one topic differ in their stamp and their numbers; lengths and strings repeat. So the
first record is walked field by field, which gives its `Layout`: where the stamp and the block of
float64 lie, and which bytes (array lengths, strings) *fixed* that. Every record of the same size
whose fixed bytes are the same has the same layout, and all of them are taken out by one slice:

    rows (n, L) uint8  ->  values (n, c) float64 = rows[:, first : first + 8 c]

A record that differs starts a layout of its own; if there are too many layouts, the remaining
records are walked one by one. Nothing is assumed of a record that was not compared.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.streams import Array, Stamps
from delta_calibration.recording.messages import (
    INERTIA_STAMPED,
    JOINT_STATE,
    POINT_STAMPED,
    POSE_STAMPED,
    TEMPERATURE,
)

# Number of float64 that follow the header directly; an inertia's 10 include its 6 moments.
PLAIN_VALUES = {POSE_STAMPED: 7, POINT_STAMPED: 3, TEMPERATURE: 2, INERTIA_STAMPED: 10}
DECODABLE = frozenset((JOINT_STATE, *PLAIN_VALUES))

_LAYOUTS_AT_ONCE = 8  # at most, per record size; each publisher on a topic has one layout
_BODY = 4  # bytes of encapsulation before the stamp
_BYTE_ORDER = {b"\x00\x01": "<", b"\x00\x00": ">"}


class UndecodableError(ValueError):
    """A record that isn't a message of its topic's type."""


@dataclass(frozen=True)
class Layout:
    """Offsets of the fields in a record, and the bytes that determine them."""

    order: str  # "<" or ">"
    frame: str
    names: tuple[str, ...]  # of the joints, empty for other types
    first: int  # byte at which the float64 block starts
    count: int  # numbers in that block
    fixed: NDArray[np.bool_]  # (L,) True where a byte decides the layout


@dataclass(frozen=True)
class Batch:
    """Messages that share a layout."""

    frame: str
    names: tuple[str, ...]
    index: NDArray[np.intp]  # (n,) position of each message in its topic
    stamp_ns: Stamps  # (n,) [ns]
    values: Array  # (n, c)


def decode(records: Sequence[bytes], type_name: str) -> tuple[tuple[Batch, ...], int]:
    """Decode all messages of one topic.

    Args:
        records: CDR bytes of each message, in the order of recording.
        type_name: One of `DECODABLE`.

    Returns:
        Batches, each of messages with one layout, and the number of records that failed to decode.
    """
    sizes = np.fromiter(map(len, records), np.intp, len(records))
    batches: list[Batch] = []
    for size in np.unique(sizes).tolist():
        index = np.flatnonzero(sizes == size)
        data = b"".join([records[i] for i in index.tolist()])
        rows = np.frombuffer(data, np.uint8).reshape(len(index), size)
        batches.extend(_of_one_size(rows, index, type_name))
    return tuple(batches), len(records) - sum(batch.index.size for batch in batches)


def layout_of(record: bytes, type_name: str) -> Layout:
    """Walk one record field by field.

    Raises:
        UndecodableError: Its lengths or strings do not fit its size.
    """
    walk = _Walk(record)
    frame = walk.header()
    names: tuple[str, ...] = ()
    if type_name == JOINT_STATE:
        names = tuple(walk.string() for _ in range(walk.length()))
        first, count = walk.sequence()
        walk.sequence()  # velocity
        walk.sequence()  # effort
    else:
        first, count = walk.numbers(PLAIN_VALUES[type_name]), PLAIN_VALUES[type_name]
    return Layout(walk.order, frame, names, first, count, walk.fixed)


def _of_one_size(
    rows: NDArray[np.uint8], index: NDArray[np.intp], type_name: str
) -> Iterator[Batch]:
    for _ in range(_LAYOUTS_AT_ONCE):
        if not index.size:
            return
        alike = np.zeros(index.size, bool)
        alike[0] = True
        layout = _try_layout(rows[0], type_name)
        if layout is not None:
            alike = (rows[:, layout.fixed] == rows[0, layout.fixed]).all(axis=1)
            yield _extract(layout, rows[alike], index[alike])
        rows, index = rows[~alike], index[~alike]
    for k in range(index.size):
        layout = _try_layout(rows[k], type_name)
        if layout is not None:
            yield _extract(layout, rows[k : k + 1], index[k : k + 1])


def _try_layout(row: NDArray[np.uint8], type_name: str) -> Layout | None:
    try:
        return layout_of(row.tobytes(), type_name)
    except UndecodableError:
        return None


def _extract(layout: Layout, rows: NDArray[np.uint8], index: NDArray[np.intp]) -> Batch:
    def block(start: int, count: int, kind: str, size: int) -> NDArray[np.generic]:
        part = np.ascontiguousarray(rows[:, start : start + count * size])
        return part.view(layout.order + kind).reshape(len(rows), count)

    seconds = block(_BODY, 1, "i4", 4)[:, 0].astype(np.int64)
    nanoseconds = block(_BODY + 4, 1, "u4", 4)[:, 0].astype(np.int64)
    values = (
        block(layout.first, layout.count, "f8", 8).astype(np.float64)
        if layout.count
        else np.empty((len(rows), 0))
    )
    stamp_ns = seconds * 1_000_000_000 + nanoseconds
    return Batch(layout.frame, layout.names, index, stamp_ns, values)


class _Walk:
    """A walk through one record, marking the bytes that decide where the next field lies."""

    def __init__(self, record: bytes) -> None:
        self.order = _BYTE_ORDER.get(record[:2], "")
        if not self.order:
            raise UndecodableError(f"encapsulation {record[:2].hex()} is not plain CDR")
        self._record = record
        self._offset = _BODY
        self._length = struct.Struct(self.order + "I")
        self.fixed = np.zeros(len(record), bool)
        self.fixed[:2] = True  # the next two bytes are options, which may differ

    def header(self) -> str:
        self._take(8, 4)  # the stamp
        return self.string()

    def length(self) -> int:
        start = self._take(4, 4)
        self.fixed[start : start + 4] = True
        length: int = self._length.unpack_from(self._record, start)[0]
        if length > len(self._record):
            raise UndecodableError(f"a length of {length} in {len(self._record)} bytes")
        return length

    def string(self) -> str:
        length = self.length()
        start = self._take(length, 1)
        self.fixed[start : start + length] = True
        raw = self._record[start : start + length]
        try:
            return raw.rstrip(b"\0").decode()
        except UnicodeDecodeError:
            raise UndecodableError("a string that is not UTF-8") from None

    def numbers(self, count: int) -> int:
        """Skip `count` float64; returns where they start."""
        return self._take(8 * count, 8)

    def sequence(self) -> tuple[int, int]:
        """Skip a float64 sequence; returns where it starts and its length."""
        count = self.length()
        return (self.numbers(count) if count else self._offset), count

    def _take(self, size: int, align: int) -> int:
        start = self._offset + (_BODY - self._offset) % align
        if start + size > len(self._record):
            raise UndecodableError(f"{len(self._record)} bytes end within a field")
        self._offset = start + size
        return start
