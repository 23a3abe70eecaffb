"""Decode the raw messages of one topic into its stream; notes say what was left out."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data.streams import (
    Array,
    JointStream,
    PayloadStream,
    Stamps,
    TemperatureStream,
    TrackerStream,
)
from delta_calibration.recording.layout import Batch, decode
from delta_calibration.recording.messages import POSE_STAMPED
from delta_calibration.recording.raw import RawTopic

Notes = tuple[str, ...]
Names = tuple[str, ...]
_POSE = 7  # numbers of a pose
_ABSURD = 1e9  # [m, rad, kg, deg C] that no machine reaches
_LEAST_PART = 1e-3  # of a quaternion's largest; drivers without orientation send zeros


@dataclass(frozen=True)
class _Readings:
    """Usable messages of a topic, in order of time."""

    stamp_ns: Stamps  # (n,) [ns]
    values: Array  # (n, c)
    frames: tuple[str, ...]  # distinct frame names, in order of appearance
    frame: NDArray[np.intp]  # (n,) index into `frames`

    def rows(self, index: NDArray[np.intp]) -> _Readings:
        return _Readings(self.stamp_ns[index], self.values[index], self.frames, self.frame[index])


def joint_stream(raw: RawTopic, wanted: Names | None = None) -> tuple[JointStream | None, Notes]:
    """Joint positions of one topic.

    The joints of every message are sorted into one order by their names. A message that lacks a
    joint or has no positions is left out.

    Args:
        raw: A JointState topic.
        wanted: Joints to read, if any message has them all; else those that most messages have.
    """
    batches, broken = decode(raw.records, raw.type_name)
    usable = [batch for batch in batches if 0 < len(batch.names) == batch.values.shape[1]]
    carrying = [batch for batch in usable if wanted and set(wanted) <= set(batch.names)]
    names = wanted if wanted and carrying else _most_common(usable)
    if not names:
        return None, (f"{raw.name}: no message carries joint names and as many positions",)
    taken = [batch for batch in usable if set(names) <= set(batch.names)]
    notes = [
        *_undecodable(raw, broken),
        *_left_out(raw, batches, taken, names),
    ]
    extra = sorted({name for batch in taken for name in batch.names} - set(names))
    if extra:
        notes.append(f"{raw.name}: joints {', '.join(extra)} ignored")
    ordered = [_in_order(batch, names) for batch in taken]
    readings, more = _readings(raw, ordered)
    stream = JointStream(readings.stamp_ns, names, readings.values) if readings else None
    return stream, (*notes, *more)


def tracker_stream(raw: RawTopic) -> tuple[TrackerStream | None, Notes]:
    """Tracker readings of a PoseStamped or PointStamped topic."""
    batches, broken = decode(raw.records, raw.type_name)
    notes = list(_undecodable(raw, broken))
    if raw.type_name == POSE_STAMPED and not any(_oriented(b.values).any() for b in batches):
        notes.append(f"{raw.name}: no pose has an orientation; the positions are read as points")
        batches = tuple(_columns(batch, slice(0, 3)) for batch in batches)
    readings, more = _readings(raw, batches)
    if readings is None:
        return None, (*notes, *more)
    quaternion = readings.values[:, 3:] if readings.values.shape[1] == _POSE else None
    position = readings.values[:, :3]
    return TrackerStream(readings.stamp_ns, position, quaternion), (*notes, *more)


def temperature_streams(raw: RawTopic) -> tuple[tuple[TemperatureStream, ...], Notes]:
    """Temperature streams, one per sensor; a message's frame names the part it is fixed to."""
    batches, broken = decode(raw.records, raw.type_name)
    readings, notes = _readings(raw, [_columns(batch, slice(0, 1)) for batch in batches])
    notes = (*_undecodable(raw, broken), *notes)
    if readings is None:
        return (), notes
    parts = []
    for number, part in enumerate(readings.frames):
        rows = readings.frame == number
        parts.append(TemperatureStream(part, readings.stamp_ns[rows], readings.values[rows, 0]))
    return tuple(parts), notes


def payload_stream(raw: RawTopic) -> tuple[PayloadStream | None, Notes]:
    """Mass and centre of mass of the payload on the platform."""
    batches, broken = decode(raw.records, raw.type_name)
    readings, notes = _readings(raw, [_columns(batch, slice(0, 4)) for batch in batches])
    notes = (*_undecodable(raw, broken), *notes)
    if readings is None:
        return None, notes
    mass, centre = readings.values[:, 0], readings.values[:, 1:4]
    return PayloadStream(readings.stamp_ns, mass, centre), notes


def _readings(
    raw: RawTopic, batches: tuple[Batch, ...] | list[Batch]
) -> tuple[_Readings | None, Notes]:
    """Merge the batches, leave out readings that are not finite, and sort by stamp."""
    if not batches:
        return None, ()
    everything = _merged(batches)
    notes = []
    if not everything.stamp_ns.any() and any(raw.log_time_ns):
        index = np.sort(np.concatenate([batch.index for batch in batches]))
        everything = replace(everything, stamp_ns=_arrivals(raw)[index])
        notes.append(f"{raw.name}: all stamps are zero; the times of arrival are used instead")
    finite = np.isfinite(everything.values).all(axis=1)
    if raw.type_name == POSE_STAMPED and everything.values.shape[1] == _POSE:
        finite &= _oriented(everything.values)
    if not finite.all():
        count = np.count_nonzero(~finite)
        notes.append(f"{raw.name}: {count} readings that are not finite numbers were left out")
        everything = everything.rows(np.flatnonzero(finite))
    absurd = (np.abs(everything.values) > _ABSURD).any(axis=1)
    if absurd.any():
        notes.append(f"{raw.name}: {absurd.sum()} readings beyond {_ABSURD:g} were left out")
        everything = everything.rows(np.flatnonzero(~absurd))
    backwards = int(np.count_nonzero(np.diff(everything.stamp_ns) < 0))
    if backwards:
        notes.append(
            f"{raw.name}: stamps run backwards {backwards} times; the messages were "
            "sorted by stamp"
        )
        everything = everything.rows(np.argsort(everything.stamp_ns, kind="stable"))
    return (everything if everything.stamp_ns.size else None), tuple(notes)


def _arrivals(raw: RawTopic) -> Stamps:
    # Times are unsigned in the file; those of a damaged file must not overflow.
    return np.array(raw.log_time_ns, np.uint64).astype(np.int64)


def _merged(batches: tuple[Batch, ...] | list[Batch]) -> _Readings:
    """All batches in the order of recording."""
    by_first = sorted(batches, key=lambda batch: int(batch.index[0]))
    frames = tuple(dict.fromkeys(batch.frame for batch in by_first))
    order = np.argsort(np.concatenate([batch.index for batch in batches]))
    return _Readings(
        stamp_ns=np.concatenate([batch.stamp_ns for batch in batches])[order],
        values=np.concatenate([batch.values for batch in batches])[order],
        frames=frames,
        frame=np.repeat(
            [frames.index(batch.frame) for batch in batches],
            [batch.index.size for batch in batches],
        )[order],
    )


def _oriented(values: Array) -> NDArray[np.bool_]:
    """Mask (n,) of the poses (n, 7) that have a quaternion."""
    largest = np.abs(values[:, 3:]).max(axis=1)
    oriented: NDArray[np.bool_] = np.isfinite(largest) & (largest > _LEAST_PART)
    return oriented


def _columns(batch: Batch, columns: slice) -> Batch:
    return Batch(batch.frame, batch.names, batch.index, batch.stamp_ns, batch.values[:, columns])


def _in_order(batch: Batch, names: Names) -> Batch:
    columns = [batch.names.index(name) for name in names]
    return Batch("", names, batch.index, batch.stamp_ns, batch.values[:, columns])


def _most_common(batches: list[Batch]) -> Names:
    """The order of joint names that most messages have."""
    counts: Counter[Names] = Counter()
    for batch in batches:
        counts[batch.names] += batch.index.size
    return counts.most_common(1)[0][0] if counts else ()


def _undecodable(raw: RawTopic, broken: int) -> Notes:
    if not broken:
        return ()
    return (
        f"{raw.name}: {broken} messages do not contain a valid {raw.type_name} and were left out",
    )


def _left_out(
    raw: RawTopic, batches: tuple[Batch, ...], taken: list[Batch], names: Names
) -> Notes:
    kept = {id(batch) for batch in taken}
    out = [batch for batch in batches if id(batch) not in kept]
    if not out:
        return ()
    count = sum(batch.index.size for batch in out)
    seen = ", ".join(out[0].names) or "no names"
    return (
        f"{raw.name}: {count} messages without a position for each of {', '.join(names)}"
        f" left out (the first has {seen} and {out[0].values.shape[1]} positions)",
    )
