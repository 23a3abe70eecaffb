"""Model-free correction of tool points by a tracker or a camera, target after target.

First the tracker's frame or the camera's pose is determined, unless it is given. Then each target
gets several grid searches, and a stop with the mean correction as an independent check.
"""

from __future__ import annotations

import csv
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.cell.camera_frame import CameraFrame
from delta_calibration.compensation.grid_search import GridResult, GridSearch, Stop, averaged
from delta_calibration.compensation.joint_lattice import GridSettings
from delta_calibration.errors import DataError, InputError
from delta_calibration.files import read_bounded, written_whole
from delta_calibration.geometry import Frame, align
from delta_calibration.mechanisms import Mechanism
from delta_calibration.plans import make_plan, nominal_joints, tool_points
from delta_calibration.robot import Robot, Sight

Array = NDArray[np.float64]

FEWEST_FRAME_STOPS = 4
_IN_PLANE = (0, 1)  # coordinates of a position that a camera above the plane measures
_RIM = 24  # points of the plan `identify` that lie on its rim: twelve directions, two heights


@dataclass(frozen=True)
class TrackerFrame:
    """The tracker's frame, by a rigid best fit to stops of the robot itself.

    Errors are given in this frame. The part of the robot's error that moves all of its points like
    a rigid body is absorbed by the frame: it is neither visible nor corrected, whatever its size.
    """

    frame: Frame  # T_tracker_base
    stops: int
    rest: float  # [m] RMS distance of the stops from their commands in this frame

    @classmethod
    def on(cls, commanded: Array, readings: Array) -> TrackerFrame:
        """Fit the frame to tool points (n, 3) [m] in the base and their readings (n, 3) [m].

        Raises:
            DataError: too few points, or all on one line.
        """
        frame = align(commanded, readings)
        off = np.linalg.norm(frame.apply(commanded) - readings, axis=1)
        return cls(frame, len(commanded), float(np.sqrt(np.mean(off**2))))

    @property
    def std(self) -> float:
        """Standard deviation of a point due to the choice of stops [m].

        Treats the non-rigid part of the robot's error as random from stop to stop.
        """
        return self.rest * float(np.sqrt(6.0 / (3.0 * self.stops - 6.0)))

    def __str__(self) -> str:
        """Sentence on the uncertainty due to the fitted frame."""
        return (
            f"tracker frame from {self.stops} stops of the robot itself, which deviate from it "
            f"by {self.rest * 1e3:.3f} mm (RMS); other stops would shift it by about "
            f"{self.std * 1e3:.3f} mm. Points are corrected in this frame; an error that moves "
            "the whole robot relative to its base is not visible in it"
        )


@dataclass(frozen=True)
class Outcome:
    """Result for one target; the errors are measured distances from it."""

    target: Array  # (3,) [m] in the base
    command: Array  # (m,) [rad] nominal
    dq: Array  # (m,) [rad] mean correction
    std: Array  # (m,) [rad] its standard uncertainty
    before: float  # [m] mean error at the first stops of the searches
    after: float  # [m] error at a separate stop with the mean correction
    moves: int  # total number of stops
    stop: Stop  # why the searches ended: the first reason other than `FINEST`, if there is one

    @property
    def joint(self) -> Array:
        """Joint command that brings the tool to the target, (m,) [rad]."""
        return np.asarray(self.command + self.dq)


class Positioning:
    """Corrects target points: drive to `step`, `tell` the mean reading there, until `done`.

    Readings are the tracker's, (3,) [m] in its own frame, or the camera's, (2,) [px]. With a
    camera, the tool is assumed to be at the target's height; the errors are those in that plane.

    Args:
        robot: gives nominal joints, limits and the expected noise.
        targets: (n, 3) [m] tool points in the base.
        settings: settings of the lattice; a noise of 0 is replaced by the robot file's.
        repeats: searches for each target, 2 or more.
        readings: number of readings averaged at a stop.
        frame: calibration with the tracker's frame, or pose of the camera, or number of stops to
            determine it from.
        camera: camera that measures instead of the tracker.

    Raises:
        InputError: too few repeats, readings or stops; or a robot that also commands the tool's
            orientation, more coordinates than an image shows, or has redundant joints.
        ReachError: a target out of reach.
    """

    def __init__(
        self,
        robot: Robot,
        targets: Array,
        settings: GridSettings,
        repeats: int,
        readings: int,
        frame: Calibration | CameraFrame | int,
        camera: Sight | None = None,
    ) -> None:
        _require_least("repeats", repeats, 2)
        _require_least("readings", readings, 1)
        if isinstance(frame, int):
            _require_least("frame_stops", frame, FEWEST_FRAME_STOPS)
        self._model = robot.commanded
        _require_places(self._model, robot.name)
        if camera is not None and self._model.freedoms != _IN_PLANE:
            raise InputError(
                f"robot {robot.name}: its joints command {self._model.task_size} coordinates of a "
                "place; one image shows 2, x and y"
            )
        self._axes = list(self._model.freedoms)  # position coordinates that the joints command
        self._robot, self._targets, self._settings = robot, targets, settings
        self._repeats, self._readings, self._given = repeats, readings, frame
        self._camera = camera
        self._commands = nominal_joints(robot, targets)
        self.frame: TrackerFrame | CameraFrame | None = None
        if isinstance(frame, CameraFrame):
            self.frame = frame
        self.outcomes: list[Outcome] = []
        self.doing = ""  # description of the next step
        self._way = self._run()
        self._next: Array | None = next(self._way)

    @property
    def step(self) -> Array:
        """Joint command to drive to next, (m,) [rad].

        Raises:
            InputError: all targets are done, or an error ended the work.
        """
        if self._next is None:
            raise InputError(f"no targets left: {len(self.outcomes)} are done")
        return self._next

    @property
    def done(self) -> bool:
        """Whether all targets are done."""
        return len(self.outcomes) == len(self._targets)

    def tell(self, reading: Array) -> None:
        """Take the mean reading at `step`.

        Raises:
            DataError: the reading is not finite (the step then still waits for a finite one); or
                the readings of the frame's stops lie on one line, which ends the work.
        """
        if not np.isfinite(reading).all():
            raise DataError(f"{self.doing}: reading {reading}; finite values are needed")
        try:
            self._next = self._way.send(reading)
        except StopIteration:
            self._next = None

    def _run(self) -> Generator[Array, Array, None]:
        if isinstance(self._given, int):
            yield from self._lay_frame(self._given)
        for number in range(len(self._targets)):
            yield from self._right(number)

    def _lay_frame(self, stops: int) -> Generator[Array, Array, None]:
        joints = frame_joints(self._robot, stops)
        readings = []
        for number, joint in enumerate(joints, start=1):
            device = "tracker" if self._camera is None else "camera"
            self.doing = f"{device} frame, stop {number} of {stops}"
            readings.append((yield joint))
        if self._camera is None:
            self.frame = TrackerFrame.on(tool_points(self._robot, joints), np.array(readings))
        else:
            self.frame = CameraFrame.on(self._robot, self._camera, joints, np.array(readings))

    def _right(self, number: int) -> Generator[Array, Array, None]:
        """Repeat the search for one target, then measure the error with the mean correction."""
        target, command = self._targets[number], self._commands[number]
        settings, edges = self._laid(target, command)
        found: list[GridResult] = []
        for repeat in range(1, self._repeats + 1):
            search = GridSearch(command, target[self._axes], settings, edges)
            while not search.done:
                self.doing = (
                    f"target {number + 1} of {len(self._targets)}, search {repeat} of "
                    f"{self._repeats}, move {search.moves + 1}"
                )
                joint = search.step
                search.tell(self._in_base((yield joint), joint, target))
            found.append(search.result)
            edges = search.result.edges
        mean = averaged(found, settings.unit)
        self.doing = f"target {number + 1} of {len(self._targets)}, corrected"
        joint = command + mean.dq
        after = self._in_base((yield joint), joint, target)
        ends = [result.stop for result in found if result.stop is not Stop.FINEST]
        self.outcomes.append(
            Outcome(
                target=target,
                command=command,
                dq=mean.dq,
                std=mean.std,
                before=float(np.mean([result.before for result in found])),
                after=float(np.linalg.norm(after - target[self._axes])),
                moves=sum(result.moves for result in found) + 1,
                stop=ends[0] if ends else Stop.FINEST,
            )
        )

    def _laid(self, target: Array, command: Array) -> tuple[GridSettings, Array]:
        """Lattice settings with the expected noise at a target, and the nominal lattice edges."""
        model, q = self._model, command[None]
        x, g = model.forward(q, model.parameters.nominal), model.parameters.nominal
        slope = model.point_by_pose(x, self._robot.tool_offset) @ model.velocity_jacobian(q, x, g)
        slope = slope[0, self._axes]
        settings = self._settings
        if settings.noise == 0.0:
            settings = replace(settings, noise=self._noise(target, slope))
        return settings, slope * settings.unit

    def _noise(self, target: Array, slope: Array) -> float:
        """Standard uncertainty of a coordinate at a stop [m]: joint repeatability and readings."""
        rest = self._robot.joints.repeatability**2 * float(np.sum(slope**2))
        if isinstance(self.frame, CameraFrame):
            read = 2.0 * self.frame.noise(target) ** 2 / self._readings
            return float(np.sqrt((read + rest) / 2.0))
        distance = np.array([np.linalg.norm(self._placed.apply(target))])
        along, across = (float(s[0]) for s in self._robot.tracker.sigmas(distance))
        read = (along**2 + 2.0 * across**2) / self._readings
        return float(np.sqrt((read + rest) / 3.0))

    def _in_base(self, reading: Array, joint: Array, target: Array) -> Array:
        """Measured tool position in the base, only the commanded coordinates, (axes,) [m]."""
        if isinstance(self.frame, CameraFrame):
            point = self.frame.in_plane(reading, float(target[2]))
        elif isinstance(self._given, Calibration):
            point = self._given.tool_points(reading[None], joint[None])[0]
        else:
            point = self._placed.inverse().apply(reading)
        return np.asarray(point[self._axes])

    @property
    def _placed(self) -> Frame:
        """`T_tracker_base`."""
        if isinstance(self._given, Calibration):
            return self._given.frame
        if self.frame is None:
            raise InputError("the tracker's frame is not known yet")
        return self.frame.frame


def frame_joints(robot: Robot, count: int) -> Array:
    """Joint positions of stops for a frame fit, (count, m) [rad]: along the rim, at two heights.

    A small number goes once around, alternately high and low, as two directions alone would lie in
    one plane.
    """
    rim = make_plan("identify", robot, count=max(count, _RIM), both_sides=False).joint
    number, half = np.arange(count), len(rim) // 2
    if count <= half:
        return np.asarray(rim[number * half // count + half * (number % 2)])
    return np.asarray(rim[number * len(rim) // count])


def require_outcomes(path: Path, names: Sequence[str]) -> None:
    """Refuse to overwrite an existing file unless it is a table of outcomes of these joints.

    Raises:
        InputError: the file is something else, or cannot be read.
    """
    if not path.exists() and not path.is_symlink():
        return
    first = read_bounded(path).split(b"\n", 1)[0].strip()
    if first != ",".join(_head(names)).encode():
        raise InputError(
            f"{path}: exists and is not a table of these joints: it is not overwritten"
        )


def _head(names: Sequence[str]) -> list[str]:
    """Column names of a table of outcomes."""
    head = ["x_mm", "y_mm", "z_mm", *names]
    head += [f"correction_{name}" for name in names] + [f"std_{name}" for name in names]
    return [*head, "moves", "before_mm", "after_mm", "ended"]


def write_outcomes(path: Path, names: Sequence[str], outcomes: Sequence[Outcome]) -> None:
    """Write corrected commands and their errors to a CSV file atomically.

    Columns: target x_mm, y_mm, z_mm; the joints' corrected commands [rad]; the corrections in them
    and their standard uncertainty [rad]; number of stops; measured errors; why the search ended.

    Raises:
        InputError: the file cannot be written, or exists and is something else.
    """
    require_outcomes(path, names)
    with written_whole(path) as beside, beside.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(_head(names))
        for o in outcomes:
            angles = [f"{v:.9f}" for v in (*o.joint, *o.dq, *o.std)]
            errors = [f"{o.before * 1e3:.4f}", f"{o.after * 1e3:.4f}"]
            place = [f"{v * 1e3:.6f}" for v in o.target]
            writer.writerow([*place, *angles, o.moves, *errors, o.stop.value])


def _require_places(model: Mechanism, robot: str) -> None:
    """Refuse a robot that also commands the tool's orientation, or has redundant joints."""
    if max(model.freedoms) >= 3 or model.joints != model.task_size:
        raise InputError(
            f"robot {robot}: {model.joints} joints of a {model.name} command {model.task_size} "
            "coordinates; positioning without a model needs a robot whose joints command only "
            "the position of the tool, one joint per coordinate"
        )


def _require_least(name: str, value: int, least: int) -> None:
    if value < least:
        raise InputError(f"{name} is {value}; it has to be at least {least}")
