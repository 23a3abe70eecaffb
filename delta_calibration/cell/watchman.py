"""Looks after a calibrated machine: keeps what arrives, and has it judged every so often.

A batch begins with a reading of the tracker and is judged on another thread. Where the tracker was
silent for minutes it may stand elsewhere: its frame is found anew from what follows.
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

if TYPE_CHECKING:  # nobody waits for it who does not watch
    from delta_calibration.cell.vigil import Vigil

Array = NDArray[np.float64]

SOURCE = "watched"
EVERY_S = 60.0  # [s] between two batches
SILENT_S = 300.0  # [s] without readings after which the tracker may stand elsewhere


class Watchman:
    """Hands what was measured at rest to a `Vigil`, and tells what that says.

    Args:
        names: (m,) the robot's joints.
        joint_size: of the joints' unit, that does what one radian does on a Delta.
        rate: false alarms a month at most; 0 for no watch.
        limit: messages that a batch holds at most.
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
        """Begin with a calibration; what was seen of the one before is forgotten."""
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
        """A reading; the first of a batch begins it."""
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
        """Have a batch judged where it is time; call it every second or so."""
        if self._work is not None:
            if not self._work.done:
                return
            work, self._work = self._work, None
            self._trouble = ""
            try:
                work.result()
            except (DataError, RecordingError):  # nothing at rest, or not enough of a stream
                pass
            except CalibrationError as error:
                self._trouble = f"not watched: {error}"
            except Exception as error:  # it must not take the commands with it
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
        """That the machine is not what was calibrated, as a sentence, or nothing."""
        vigil = self._vigil
        if vigil is None or not vigil.suspicion.changed:
            return self._trouble
        told = vigil.suspicion
        where = f" of {spoken(told.location)}" if told.location else ""
        what = f", most likely {spoken(told.cause)}{where}" if told.cause else ""
        return f"the machine is no longer what was calibrated{what}; calibrate it again"

    @property
    def values(self) -> dict[str, object]:
        """Figures for diagnostics."""
        vigil = self._vigil
        if vigil is None:
            return {"watch": "off"}
        told = vigil.suspicion
        return {
            "watch": "no longer what was calibrated" if told.changed else "as calibrated",
            "watch stops looked at": vigil.stops,
            "watch ln of the odds of a change": f"{told.odds:.2f}",
            "watch alarm from": f"{told.limit:.2f}",
            "watch stops with a held reading": vigil.held,
            "watch stops that the calibration cannot foretell": vigil.unknown,
        }
