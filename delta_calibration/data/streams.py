"""Raw data of a session: time-stamped streams, one per topic.

Stamps are those of the message headers (time of measurement), not the times of arrival. A stream
has one row or more, all of finite numbers; a stream that was not recorded is None in its session.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

# [ns] fixed start of simulated sessions, so that the same seed gives the same file
SIMULATED_NS = 1_700_000_000_000_000_000

# metadata of a session made of rows without times: seconds assumed from row to row
ASSUMED_INTERVAL = "assumed_row_interval_s"


@dataclass(frozen=True)
class JointStream:
    """Joint angles over time, commanded or measured by the encoders."""

    stamp_ns: Stamps  # (n,) [ns]
    names: tuple[str, ...]  # (m,)
    position: Array  # (n, m) [rad]


@dataclass(frozen=True)
class TrackerStream:
    """Readings of the laser tracker in its own frame."""

    stamp_ns: Stamps  # (n,) [ns]
    position: Array  # (n, 3) [m]
    quaternion: Array | None = None  # (n, 4) x y z w; None where only a point was measured


@dataclass(frozen=True)
class TemperatureStream:
    """Temperature by one sensor; `part` is what it is fixed to (`arm`, `base`, ...)."""

    part: str
    stamp_ns: Stamps  # (n,) [ns]
    celsius: Array  # (n,) [deg C]


@dataclass(frozen=True)
class PayloadStream:
    """Payload on the platform; a value is valid until the next one."""

    stamp_ns: Stamps  # (n,) [ns]
    mass: Array  # (n,) [kg]
    centre: Array  # (n, 3) [m], centre of mass in the platform's frame


Stream = TypeVar("Stream", JointStream, TrackerStream, TemperatureStream)


@dataclass(frozen=True)
class Session:
    """One recorded session of a cell, as its streams.

    `notes` are sentences for the user about what was lost or ignored in reading;
    `metadata` is the provenance that the recording carries (robot hash, seed, plan, ...).
    """

    source: str
    command: JointStream | None = None
    states: JointStream | None = None
    tracker: TrackerStream | None = None
    temperature: tuple[TemperatureStream, ...] = ()
    payload: PayloadStream | None = None
    notes: tuple[str, ...] = ()
    metadata: Mapping[str, str] = field(default_factory=dict)

    @property
    def assumed_interval(self) -> float | None:
        """Time assumed from row to row [s], if only the order of the rows is known; else None."""
        try:
            seconds = float(self.metadata.get(ASSUMED_INTERVAL, ""))
        except ValueError:
            return None
        return seconds if 0 < seconds < math.inf else None

    @property
    def clock_note(self) -> str:
        """Note that times are assumed and not measured; empty if they were measured."""
        seconds = self.assumed_interval
        if seconds is None:
            return ""
        return (
            f"times were not recorded: {seconds:g} s from row to row are assumed, in the order of "
            "the rows. Whatever is told per hour, in seconds or as a time constant depends on "
            "this; state the true interval on import (--row-interval, or row_interval_s in the "
            "mapping)"
        )

    def between(self, begin_ns: int, end_ns: int) -> Session:
        """The session between two stamps, ends included; the payload stream is kept whole."""

        def part(stream: Stream | None) -> Stream | None:
            if stream is None:
                return None
            keep = (stream.stamp_ns >= begin_ns) & (stream.stamp_ns <= end_ns)
            return _rows(stream, keep) if keep.any() else None

        warmth = (part(stream) for stream in self.temperature)
        return replace(
            self,
            command=part(self.command),
            states=part(self.states),
            tracker=part(self.tracker),
            temperature=tuple(stream for stream in warmth if stream is not None),
        )


def _rows(stream: Stream, keep: NDArray[np.bool_]) -> Stream:
    """Some rows of a stream."""
    each: dict[str, Any] = {
        name: value[keep] for name, value in vars(stream).items() if isinstance(value, np.ndarray)
    }
    return replace(stream, **each)
