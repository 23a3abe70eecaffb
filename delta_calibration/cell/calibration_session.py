"""Calibration of a live cell: capture, fit, save, reload and switch on.

Every request returns a sentence, or raises a CalibrationError with the reason and leaves the state
unchanged.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration, require_ours
from delta_calibration.cell.archive import Archive
from delta_calibration.cell.backlog import Backlog
from delta_calibration.cell.capture import Capture
from delta_calibration.cell.command_path import PASS_THROUGH, REFUSE, CommandPath, Sent
from delta_calibration.cell.fitting import COMPENSATOR, FittedCalibration, Step, fit, silent
from delta_calibration.cell.health import Health, Level, Watch
from delta_calibration.cell.surroundings import TEMPERATURE_TIMEOUT_S, Surroundings
from delta_calibration.cell.trajectory import Points, TrajectoryPath
from delta_calibration.cell.trajectory import Sent as TrajectorySent
from delta_calibration.cell.usual import UsualWay, warm_up
from delta_calibration.cell.watchman import Watchman
from delta_calibration.compensation import TABLE, Follow, JointCompensator, Table, load_table
from delta_calibration.data import Session
from delta_calibration.errors import (
    ContentError,
    DataError,
    InputError,
    MistakeError,
    RefusedFileError,
)
from delta_calibration.robot import Robot, load_robot

Array = NDArray[np.float64]

SOURCE = "captured"
RATE = 5.0  # [rad/s] default limit of the rate of a correction of a Delta's joint
NAMED = 3  # largest number of problems in one message
AT_ONCE_S = 0.1  # [s] longest part of a ramp that one output may advance


@dataclass(frozen=True)
class Settings:
    """Settings of a calibration session."""

    robot: str  # file or name
    calibration: str = ""  # file; empty for none
    method: str = "newton"
    table: str = ""  # file of the correction table, for method table; computed if empty
    on_failure: str = PASS_THROUGH
    beyond_limits: str = REFUSE
    ramp_s: float = 1.0  # [s]
    # limit of the rate of a joint's correction, in the joint's unit [rad/s or m/s]; 0: default
    rate: float = 0.0
    command_timeout_s: float = 0.0  # [s]; 0 for none
    temperature_timeout_s: float = TEMPERATURE_TIMEOUT_S
    payload_timeout_s: float = 0.0  # [s]; 0 for none
    model: str = ""  # mechanism to fit; empty for the robot file's
    capture_limit: int = 1_000_000  # messages
    seed: int = 0
    false_alarms: float = 0.0  # allowed rate for the drift monitor [1/month]; 0 for no monitoring
    history: str = ""  # store that fits are added to, a file or URL; empty for none
    machine: str = ""  # name of the machine in the history
    bags: str = ""  # folder for the bags of the history
    update: bool = False  # use the history in the fit of every session


class CalibrationSession:
    """A robot with its capture, its command path and its calibration.

    `follow` wraps the blocks of work while a correction table is computed, to show the progress.

    Raises:
        CalibrationError: robot, calibration or table cannot be loaded, or the table is stale; no
            partly initialised session is left then.
    """

    def __init__(self, settings: Settings, follow: Follow = iter) -> None:
        if settings.table and settings.method != TABLE:
            raise InputError(f"parameter table: is for method {TABLE!r}, not {settings.method!r}")
        self.settings, self._follow = settings, follow
        self.robot = load_robot(settings.robot)
        self._archive = Archive.of(
            settings.history,
            settings.machine,
            settings.bags,
            self.robot,
            settings.robot,
            settings.update,
        )
        self._model = self.robot.model(settings.model or None).name
        self._joints = len(self.robot.joints.names)
        self.capture = Capture(self.robot.joints.names, settings.capture_limit)
        self.path = CommandPath(
            settings.on_failure,
            settings.ramp_s,
            self._rate(settings.rate),
            settings.command_timeout_s,
            self.robot.joints.speed,
            self.robot.joints.unit,
            (self.robot.joints.lower, self.robot.joints.upper),
            settings.beyond_limits,
            AT_ONCE_S,
        )
        self.trajectories = TrajectoryPath(self.path)
        self.around = Surroundings(
            len(self.robot.joints.names),
            settings.temperature_timeout_s,
            settings.payload_timeout_s,
            self.robot.commanded.joint_size,
        )
        joints = self.robot.joints
        self.usual = UsualWay(joints.names, self.path, self.around, joints.passed_through)
        self._by_conditions, self._way = False, settings.method
        self.watch = Watch()
        self.watchman = Watchman(
            joints.names,
            self.robot.commanded.joint_size,
            settings.false_alarms,
            settings.capture_limit,
        )
        self.backlog: Backlog[Any] = Backlog()
        self.fitted: FittedCalibration | None = None
        self.calibration: Calibration | None = None
        self._capture_since_s = 0.0
        self._mistake = ""  # mistake in the last capture because of which a fit was refused
        if settings.calibration:
            self.reload(settings.calibration, settings.table)

    def set_options(
        self, on_failure: str, ramp_s: float, rate: float, timeout_s: float, beyond_limits: str
    ) -> None:
        """Change options of the command path; see `CommandPath.set_options` and `Settings`."""
        self.path.set_options(on_failure, ramp_s, self._rate(rate), timeout_s, beyond_limits)

    def _rate(self, asked: float) -> float:
        """Limit of the rate of a correction [rad/s or m/s]; `RATE` in this joint's unit if 0."""
        return RATE * self.robot.commanded.joint_size if asked == 0.0 else asked

    def follow(self, message: bytes, now_s: float, age_s: float = 0.0) -> bytes | None:
        """Process a command on the fast path; return the output, or None if `send` is needed.

        Command and output are serialized messages. After an output, call `usual.went`.
        """
        if self.trajectories.under_way or not self.path.in_time(age_s):
            self.usual.seen = False
            return None
        return self.usual.take(message, now_s)

    def send(
        self,
        q: Array,
        stamp_ns: int,
        now_s: float,
        already: bool,
        age_s: float = 0.0,
        seen: bool = False,
    ) -> Sent | None:
        """Output to the drives for a command (m,), or (m + k,) with pass-through axes [rad or m].

        See `CommandPath.send`. If the motion of the command was `seen` already, it is not recorded
        again.
        """
        self.trajectories.settle(now_s)
        q, carried = q[: self._joints], q[self._joints :]
        at = None
        if self.path.takes(q, age_s):
            if not seen:  # also while compensation is off: backlash depends on the past motion
                self.around.moved(q, stamp_ns)
            at = self.around.at(q, now_s) if self._by_conditions else None
        return self.path.send(q, stamp_ns, now_s, already, at, age_s, carried)

    def keep(self, q: Array, stamp_ns: int, already: bool) -> None:
        """Record a command as given to `send`; to be called after the drives have their output."""
        if not already:
            self.capture.add_command(stamp_ns, q[: self._joints])
            self.watchman.capture.add_command(stamp_ns, q[: self._joints])

    def begin_all(
        self, points: Callable[[], tuple[Points, bool]], now_s: float
    ) -> Callable[[], TrajectorySent]:
        """Return a function that computes the trajectory to send; see `TrajectoryPath.begin`."""
        around = self.around if self._by_conditions else None
        return self.trajectories.begin(points, now_s, around)

    def nominal(self, measured: Array, now_s: float) -> Array:
        """Measured joint angles less the correction, for upstream, (m,) or (m + k,) [rad or m]."""
        self.trajectories.settle(now_s)
        own, carried = measured[: self._joints], measured[self._joints :]
        return np.concatenate([self.path.nominal(own), carried])

    def stand(self, measured: Array, now_s: float) -> None:
        """Update the measured position of the drives, (m,) or (m + k,) as in `send` [rad or m]."""
        self.path.stand(measured[: self._joints], now_s, measured[self._joints :])

    def measured(self, q: Array, stamp_ns: int) -> None:
        """Record the measured position of the drives, as given to `stand`."""
        self.capture.add_states(stamp_ns, q[: self._joints])
        self.watchman.capture.add_states(stamp_ns, q[: self._joints])

    def read(self, stamp_ns: int, position: Array, quaternion: Array | None, now_s: float) -> None:
        """Take a reading of the tracker: (3,) [m], of a probe also (4,) x y z w."""
        self.capture.add_tracker(stamp_ns, position, quaternion)
        self.watchman.add_tracker(stamp_ns, position, quaternion, now_s)

    def is_warm(self, part: str, stamp_ns: int, celsius: float, now_s: float) -> None:
        """Take the temperature of a part [deg C]."""
        self.around.is_warm(part, celsius, now_s)
        self.usual.prepare(now_s)
        self.capture.add_temperature(part, stamp_ns, celsius)
        self.watchman.capture.add_temperature(part, stamp_ns, celsius)

    def carries(self, stamp_ns: int, mass: float, centre: Array, now_s: float) -> None:
        """Take the payload valid from now on: mass [kg], centre of mass (3,) [m]."""
        self.around.carries(mass, centre, now_s)
        self.usual.prepare(now_s)
        self.capture.add_payload(stamp_ns, mass, centre)
        self.watchman.capture.add_payload(stamp_ns, mass, centre)

    def reset(self) -> None:
        """Forget the past motion, after a pause of unknown length, and switch compensation off."""
        self.trajectories.reset()
        self.backlog.forget()
        self.path.reset()
        self.around.reset()

    @property
    def left_out(self) -> str:
        """Effects in the calibration that are not compensated, with reasons; empty if none."""
        if self.calibration is None or not self.calibration.left_out:
            return ""
        causes: dict[str, list[str]] = {}
        for cause in self.calibration.left_out:
            causes.setdefault(self.calibration.why_left_out(cause), []).append(cause)
        return "; ".join(
            f"{', '.join(each)}: found in the session but not compensated, because {why}"
            for why, each in causes.items()
        )

    @property
    def _doubt(self) -> str:
        """Doubts about the active calibration; empty unless it was fitted in this session."""
        fitted = self.fitted
        if fitted is None or self.calibration is not fitted.calibration:
            return ""
        return "; ".join(fitted.doubts)

    def start_capture(self, now_s: float) -> str:
        """Start recording the measured streams; earlier ones are discarded."""
        if self.capture.running:
            raise DataError(f"capturing already, {self.capture.held} messages so far")
        before, self._mistake = self.capture.held, ""
        self.capture.start()
        self._capture_since_s = now_s
        return f"capturing; {before} earlier messages were discarded" if before else "capturing"

    def stop_capture(self) -> str:
        """Stop recording; the recorded messages can then be fitted."""
        if not self.capture.running:
            raise DataError("nothing is being captured")
        self.capture.stop()
        notes = "".join(f"; {note}" for note in self.capture.notes())
        counts = ", ".join(f"{n} {stream}" for stream, n in self.capture.counts.items())
        return f"captured {counts}{notes}"

    def prepare_fit(
        self,
        way: Callable[[Session, Robot, str, int, Step], FittedCalibration] = fit,
        step: Step = silent,
    ) -> Callable[[], tuple[FittedCalibration, JointCompensator]]:
        """Return a function that fits a snapshot of the capture; it may run on another thread.

        Args:
            way: `fit`, or `diagnosed` to extend the model as well.
            step: callback that gets the name of each step when it begins.

        Raises:
            DataError: nothing was captured.
        """
        if not self.capture.held:
            raise DataError("nothing was captured; call start_capture and measure first")
        held = self.capture.frozen()
        if way is fit and self._archive is not None:
            way = partial(fit, ask=self._archive.known)

        def work() -> tuple[FittedCalibration, JointCompensator]:
            session = held.session(SOURCE)
            self._mistake = ""
            try:
                fitted = way(session, self.robot, self._model, self.settings.seed, step)
            except MistakeError as error:
                self._mistake = f"not fitted: {error}"
                raise
            step(COMPENSATOR)
            compensator = self._compensator(fitted.calibration)
            if self._archive is not None:
                fitted = replace(fitted, kept=self._archive.add(session, fitted))
            return fitted, compensator

        return work

    def take(self, fitted: FittedCalibration, compensator: JointCompensator) -> str:
        """Load the fitted calibration; compensation, if on, ramps over to it, else stays off."""
        self.fitted = fitted
        self._load(fitted.calibration, compensator)
        return f"{self.robot.named(fitted.sentence())}; {self._loaded_sentence()}"

    def save(self, path: str) -> str:
        """Write the fitted calibration to a file atomically."""
        return self.prepare_save(path)()

    def prepare_save(self, path: str) -> Callable[[], str]:
        """Return the function that does the work of `save`; it may run on another thread.

        Raises:
            DataError: nothing was fitted, or the last fit was refused.
            InputError: no path.
        """
        fitted, robot = self.fitted, self.robot
        if self._mistake:
            raise MistakeError(f"nothing to save: {self._mistake}")
        if fitted is None:
            raise DataError("nothing to save: nothing was fitted since the node was configured")
        if not path:
            raise InputError("parameter output: is empty; it names the calibration file to write")
        file = Path(path).expanduser()

        def work() -> str:
            require_ours(file)
            fitted.save(file, robot)
            return f"saved to {file}"

        return work

    def reload(self, path: str, table: str = "") -> str:
        """Load a calibration file; if that fails, the active calibration stays in use."""
        return self.take_file(path, *self.prepare_reload(path, table)())

    def prepare_reload(
        self, path: str, table: str = ""
    ) -> Callable[[], tuple[Calibration, JointCompensator]]:
        """Return a function that reads a calibration and its table, also on another thread.

        If the method needs a table and no file is given, the table is computed.

        Raises:
            InputError: no path.
        """
        if not path:
            raise InputError("parameter calibration: is empty; it names the file to load")

        def work() -> tuple[Calibration, JointCompensator]:
            try:
                calibration = load_calibration(Path(path).expanduser(), self.robot)
            except ContentError as error:  # the caller must not see the content of the file
                message = f"{path}: is not a calibration file of this package; the log says why"
                raise RefusedFileError(message, str(error)) from error
            read = load_table(Path(table).expanduser(), calibration) if table else None
            return calibration, self._compensator(calibration, read)

        return work

    def take_file(self, path: str, calibration: Calibration, compensator: JointCompensator) -> str:
        """Load the calibration read; compensation, if on, ramps over to it, else stays off."""
        self._load(calibration, compensator)
        return f"{path}, made from {calibration.source}, {self._loaded_sentence()}"

    def enable(self, on: bool) -> str:
        """Switch compensation on or off."""
        self.path.enable(on)
        ramp = f"over {self.path.ramp_s:g} s"
        return f"compensation fades in {ramp}" if on else f"compensation fades out {ramp}"

    def captured(self, now_s: float) -> tuple[str, dict[str, object]]:
        """Progress of the capture: a sentence, and numbers."""
        held, limit = self.capture.held, self.settings.capture_limit
        figures: dict[str, object] = {
            "elapsed [s]": f"{now_s - self._capture_since_s:.1f}",
            **{f"{stream} messages": n for stream, n in self.capture.counts.items()},
            "of the limit [%]": f"{100 * held / limit:.1f}",
            "lost messages": self.capture.lost,
        }
        return f"{held} messages held", figures

    def health(self, now_s: float, tracker_timeout_s: float) -> Health:
        """Health of the cell: level, message and values for diagnostics."""
        troubles = self._silent(now_s, tracker_timeout_s) + self.watch.recent(now_s)
        troubles += self.capture.notes() if self.capture.running else ()
        troubles += tuple(filter(None, [self._mistake, self._doubt]))
        troubles = [*filter(None, [self.watchman.trouble]), *troubles]
        message = "; ".join([self._state(), *troubles[:NAMED]])
        return Health(Level.WARN if troubles else Level.OK, message, self._values())

    def _silent(self, now_s: float, limit_s: float) -> list[str]:
        if not self.capture.running:
            return []
        since_s = self._capture_since_s
        silent = {s: self.watch.silent_s(s, since_s, now_s) for s in ("tracker", "joint_states")}
        return [f"{s} silent for {t:.1f} s" for s, t in silent.items() if t > limit_s]

    def _state(self) -> str:
        if self.path.enabled:
            state = f"compensating by {self._way}"
        else:
            state = "passing commands through, " + (
                "compensation is off" if self.path.loaded else "no calibration"
            )
        return f"{state}, capturing" if self.capture.running else state

    def _values(self) -> dict[str, object]:
        calibration, fitted = self.calibration, self.fitted
        return {
            "robot": self.robot.name,
            "enabled": self.path.enabled,
            "on failure": self.path.on_failure,
            "calibration": "none" if calibration is None else calibration.seal[:12],
            "calibration made from": "" if calibration is None else calibration.source,
            "effects compensated": ""
            if calibration is None
            else ", ".join(calibration.live_causes),
            "effects left out": self.left_out,
            "effects by the clock": "" if calibration is None else calibration.as_it_ended,
            "error left of the last poses fitted [mm]": fitted.last_errors() if fitted else "",
            f"correction [{self.robot.joints.unit}]": f"{self.path.applied:.3e}",
            "command slowest [ms]": f"{self.watch.slowest_s * 1e3:.1f}",
            "command took longer than its period": self.watch.late,
            "command lost while the process was interrupted": self.backlog.lost,
            "command late, a newer one sent": self.backlog.superseded,
            **{f"captured {stream}": n for stream, n in self.capture.counts.items()},
            "captured lost": self.capture.lost,
            **self.watchman.values,
            **{f"command {what}": n for what, n in self.path.counts.items()},
            **{f"{stream} refused": n for stream, n in self.watch.refused.items()},
            **{f"{stream} lost in transport": n for stream, n in self.watch.lost.items()},
        }

    def _compensator(
        self, calibration: Calibration, table: Table | None = None
    ) -> JointCompensator:
        method, seed = self.settings.method, self.settings.seed
        compensator = JointCompensator(calibration, method, seed, table=table, follow=self._follow)
        # The first use is slow (imports, buffers), so it is done here, not at the first command.
        compensator.compensate(self.robot.model().home[None])
        warm_up(compensator)
        return compensator

    def _load(self, calibration: Calibration, compensator: JointCompensator) -> None:
        self.calibration = calibration
        self._by_conditions, self._way = compensator.needs_conditions, compensator.way
        self.path.load(compensator)
        self.watchman.watch(calibration)

    def _loaded_sentence(self) -> str:
        return "; ".join(filter(None, (self._loaded(), self.left_out)))

    def _loaded(self) -> str:
        if self.path.enabled:
            return f"loaded; compensation is on and changes over to it in {self.path.ramp_s:g} s"
        return "loaded, not enabled"
