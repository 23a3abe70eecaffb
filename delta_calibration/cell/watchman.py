"""Monitor of a calibrated machine: records messages and has them evaluated batch by batch.

A batch begins with a tracker reading and is evaluated on another thread. If the tracker was silent
for minutes, it may have been moved: its frame is determined anew from the readings that follow.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.cell.background import Background
from delta_calibration.cell.capture import Capture
from delta_calibration.data import Poses, collect
from delta_calibration.errors import CalibrationError, DataError, InputError, RecordingError
from delta_calibration.wording import spoken

if TYPE_CHECKING:  # loaded only if monitoring is on
    from delta_calibration.cell.vigil import Vigil

Array = NDArray[np.float64]

SOURCE = "watched"
EVERY_S = 60.0  # [s] length of a batch
SILENT_S = 300.0  # [s] without readings, after which the tracker may have been moved


class Watchman:
    """Passes poses at rest to a `Vigil`, and reports its result.

    Args:
        names: (m,) names of the robot's joints.
        joint_size: joint displacement equivalent to one radian on a Delta, in the joints' unit.
        rate: largest allowed rate of false alarms [1/month]; 0 for no monitoring.
        limit: largest number of messages in a batch.
    """

    def __init__(self, names: Sequence[str], joint_size: float, rate: float, limit: int) -> None:
        self._names, self._joint_size, self._rate = tuple(names), joint_size, rate
        self.capture = Capture(names, limit)
        self._vigil: Vigil | None = None
        self._work: Background[None] | None = None
        self._since_s = self._heard_s = -np.inf
        self._anew = False
        self._trouble = ""

    def watch(self, calibration: Calibration | None) -> None:
        """Start monitoring against a calibration; data about the one before are dropped."""
        self._vigil, self._trouble = None, ""
        self.capture.stop()
        if calibration is None or self._rate == 0.0:
            return
        from delta_calibration.cell.vigil import Vigil

        try:
            self._vigil = Vigil(calibration, self._rate)
        except InputError as error:
            self._trouble = f"not watched: {error}"

    def add_tracker(
        self, stamp_ns: int, position: Array, quaternion: Array | None, now_s: float
    ) -> None:
        """Take a tracker reading; the first one starts a batch."""
        if self._vigil is None:
            return
        if now_s - self._heard_s > SILENT_S:
            self.capture.stop()
            self._anew = True
        self._heard_s = now_s
        if not self.capture.running:
            self.capture.start()
            self._since_s = now_s
        self.capture.add_tracker(stamp_ns, position, quaternion)

    def look(self, now_s: float) -> None:
        """Start the evaluation of a batch when it is due; to be called about every second."""
        if self._work is not None:
            if not self._work.done:
                return
            work, self._work = self._work, None
            self._trouble = ""
            try:
                work.result()
            except (DataError, RecordingError):  # no pose at rest, or too little data
                pass
            except CalibrationError as error:
                self._trouble = f"not watched: {error}"
            except Exception as error:  # it must not stop the processing of commands
                self._trouble = f"not watched: {error!r}"
        if self.capture.running and now_s - self._since_s >= EVERY_S:
            held = self.capture.frozen()
            self.capture.stop()
            self._work = Background(self._judging(held))

    def _judging(self, held: Capture) -> Callable[[], None]:
        vigil, anew = self._vigil, self._anew
        self._anew = False

        def work() -> None:
            if vigil is not None:
                if anew:
                    vigil.set_up()
                vigil.take(self._collected(held))

        return work

    def _collected(self, held: Capture) -> Poses:
        return collect(held.session(SOURCE), self._names, self._joint_size)

    @property
    def trouble(self) -> str:
        """Alarm or problem of the monitoring, as a sentence; empty if none."""
        vigil = self._vigil
        if vigil is None or not vigil.suspicion.changed:
            return self._trouble
        told = vigil.suspicion
        where = f" of {spoken(told.location)}" if told.location else ""
        what = f", most likely {spoken(told.cause)}{where}" if told.cause else ""
        return f"the machine is no longer what was calibrated{what}; calibrate it again"

    @property
    def values(self) -> dict[str, object]:
        """Values for diagnostics."""
        vigil = self._vigil
        if vigil is None:
            return {"watch": "off"}
        told = vigil.suspicion
        return {
            "watch": "no longer what was calibrated" if told.changed else "as calibrated",
            "watch stops examined": vigil.stops,
            "watch log odds of a change": f"{told.odds:.2f}",
            "watch alarm threshold": f"{told.limit:.2f}",
            "watch stops with a held reading": vigil.held,
            "watch stops that the calibration cannot predict": vigil.unknown,
        }
