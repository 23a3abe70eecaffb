"""Detection of a stop: joints at the commanded position, and tracker readings at rest."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError, InputError
from delta_calibration.robot import Tracker

Array = NDArray[np.float64]

SIGMAS = 6.0  # standard deviations of a reading within which readings count as one place


class StopDetector:
    """Detects one stop: joints at the commanded position, and a run of readings that agree.

    Only the last `count` readings since the joints arrived are used, and there is no mean until
    these agree: a platform that still swings has no mean.

    Args:
        names: (m,) names of the joints.
        told: (m,) [rad] commanded position.
        within: largest deviation of a joint from it [rad].
        count: number of readings to average.
        tracker: gives the noise; with a reading farther than SIGMAS standard deviations from the
            run's median, the platform is not at rest.
        last: (3,) [m] mean of the stop before: a tracker that repeats exactly this value has lost
            the reflector. None at the first stop and if the machine has not moved.
        unit: unit of the joints, for messages.
    """

    def __init__(
        self,
        names: Sequence[str],
        told: Array,
        within: float,
        count: int,
        tracker: Tracker,
        last: Array | None = None,
        unit: str = "rad",
    ) -> None:
        if count < 1:
            raise InputError(f"readings is {count}; it has to be at least 1")
        self._names, self._told, self._within = tuple(names), told, within
        self._unit = unit
        self._tracker, self._last = tracker, last
        self._run: deque[Array] = deque(maxlen=count)
        self._joint: Array | None = None
        self._heard = 0  # readings while the joints were there

    def joints(self, position: Array) -> None:
        """Take an encoder reading of the joints, (m,) [rad]."""
        self._joint = position
        if not self._there:
            self._run.clear()

    def reading(self, point: Array) -> None:
        """Take a tracker reading, (3,) [m]."""
        if self._there:
            self._heard += 1
            self._run.append(point)

    @property
    def mean(self) -> Array | None:
        """Mean of the run (3,) [m]; None as long as the machine is not at rest.

        Raises:
            DataError: the tracker repeats exactly the mean of the stop before.
        """
        if len(self._run) < (self._run.maxlen or 0) or self._spread > self._limit:
            return None
        mean = np.mean(self._run, axis=0)
        if self._last is not None and np.array_equal(mean, self._last):
            raise DataError(
                "the tracker repeats the reading of the previous stop exactly: it has lost the "
                "reflector"
            )
        return np.asarray(mean)

    @property
    def trouble(self) -> str:
        """Why there is no mean yet."""
        if self._joint is None:
            return "no joint_states"
        if not self._there:
            k = int(np.argmax(np.abs(self._joint - self._told)))
            return (
                f"{self._names[k]} is at {self._joint[k]:.6f} {self._unit} but was commanded "
                f"to {self._told[k]:.6f}; allowed difference: {self._within:.2g}. Switch "
                "compensation off"
            )
        if not self._heard:
            return "no tracker readings"
        if len(self._run) < (self._run.maxlen or 0):
            return f"{len(self._run)} tracker readings; {self._run.maxlen} are needed"
        return (
            f"tracker readings spread over {self._spread * 1e3:.4f} mm; "
            f"a machine at rest has {self._limit * 1e3:.4f} at most"
        )

    @property
    def _there(self) -> bool:
        return self._joint is not None and bool(
            np.abs(self._joint - self._told).max() <= self._within
        )

    @property
    def _limit(self) -> float:
        """Largest spread of a run at rest [m]."""
        distance = np.array([np.linalg.norm(np.mean(self._run, axis=0))])
        return float(SIGMAS * max(s[0] for s in self._tracker.sigmas(distance)))

    @property
    def _spread(self) -> float:
        """Largest distance of a reading from the median of the run [m]."""
        run = np.array(self._run)
        return float(np.linalg.norm(run - np.median(run, axis=0), axis=1).max())
