"""The functions of `delta-cal` for notebooks: objects that display themselves, tables and plots.

```python
from delta_calibration.notebook import open_session

session = open_session("bags/srbd_backlash", robot="srbd")
found = session.fit()
found.plot_residuals()
verdict = session.diagnose()
verdict.save("extended.yaml")
```

Each object wraps the object that the commands use (`recorded`, `found`, `diagnosis`), so the
numbers are the same. Tables are pandas', plots matplotlib's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any
from warnings import warn

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.commands import commands_for, warmth_by_part
from delta_calibration.compensation import JointCompensator, methods_for, require_method
from delta_calibration.data import Session as Recording
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import Diagnosis, diagnose
from delta_calibration.doctor import Mistake, check
from delta_calibration.errors import InputError, MistakeError
from delta_calibration.estimation import Identification, doubts, identify
from delta_calibration.lazy import cached_property
from delta_calibration.plans.target_file import NAME, PLACE, TURN, commanded_columns
from delta_calibration.recording import Topics, read_session
from delta_calibration.report.missing import required
from delta_calibration.report.residual_plot import plot_errors
from delta_calibration.robot import Robot, load_robot
from delta_calibration.tables import Row, require_columns
from delta_calibration.wording import listed, measured, mm, spoken, sure

if TYPE_CHECKING:
    import pandas as pd

    from delta_calibration.report.residual_plot import Axes

Array = NDArray[np.float64]

_SOURCE = Path("targets")  # name of the targets in messages
_READERS = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}


def open_session(
    path: str | Path, robot: str | Path, topics: Sequence[str] = (), model: str | None = None
) -> Session:
    """Open a recorded session of a robot.

    Args:
        path: rosbag2 folder.
        robot: robot file, or the name of one that comes with the package.
        topics: names of streams that were recorded on other topics, `command=/my/joint_command`.
        model: mechanism to fit; the robot file's own where not given.

    Raises:
        CalibrationError: no such session or robot, streams missing, nothing at rest; names it.
    """
    own = load_robot(robot)
    recorded = read_session(Path(path), Topics.from_options(tuple(topics)))
    return Session(own, recorded, model)


@dataclass(frozen=True)
class Session:
    """A recorded session: joint commands, joint states and tracker readings of a robot."""

    robot: Robot
    recorded: Recording
    model: str | None = None

    @cached_property
    def survey(self) -> Survey:
        """Poses at rest and readings in motion."""
        return survey(self.recorded, self.robot.joints.names, self.robot.commanded.joint_size)

    @cached_property
    def mistakes(self) -> tuple[Mistake, ...]:
        """Mistakes of units, wiring, clocks and frames, as `delta-cal check` finds them."""
        return tuple(check(self.recorded, self.robot).found)

    def _warn(self) -> None:
        for mistake in self.mistakes:
            warn(mistake.sentence(), stacklevel=3)

    def to_frame(self) -> pd.DataFrame:
        """Table of the poses at rest: time, joints, measured point, readings, place, conditions.

        The conditions are payload and temperatures; one row per pose.
        """
        poses, names = self.survey.poses, self.robot.joints.names
        unit = self.robot.joints.unit
        columns: dict[str, Array | NDArray[np.int64]] = {"time_s": poses.time}
        columns |= {f"{name}_{unit}": poses.joint[:, k] for k, name in enumerate(names)}
        columns |= {f"{axis}_mm": 1e3 * poses.point[:, k] for k, axis in enumerate("xyz")}
        columns |= {"readings": poses.count, "place": poses.place, "payload_kg": poses.payload}
        parts = enumerate(poses.temperature_parts)
        columns |= {f"{part}_deg_c": poses.temperature[:, k] for k, part in parts}
        return _frame(columns)

    def fit(self, seed: int = 0) -> Identified:
        """Identify the geometry, as `delta-cal fit` does; warns of mistakes in the session.

        Raises:
            CalibrationError: too few poses, or no parameter is identifiable.
        """
        self._warn()
        return Identified(self, identify(self.survey.poses, self.robot, self.model, seed))

    def diagnose(self, seed: int = 0, calibration: Calibration | None = None) -> Diagnosed:
        """Diagnose the errors that the calibrated model leaves, as `delta-cal diagnose` does.

        Warns of mistakes in the session.

        Raises:
            CalibrationError: as `fit`.
        """
        self._warn()
        found = diagnose(self.survey, self.robot, self.model, seed=seed, calibration=calibration)
        return Diagnosed(self, found)

    def _repr_html_(self) -> str:
        poses = self.survey.poses
        rows = {
            "robot": f"{self.robot.name} ({self.robot.mechanism})",
            "duration": f"{poses.duration / 60:.1f} min",
            "poses at rest": f"{len(poses)} in {len(np.unique(poses.place))} places",
            "readings of the tracker": f"{poses.readings}",
            "set aside": _listed(poses.rejected.counts()),
        }
        return _page(f"Session {Path(poses.source).name}", rows, poses.notes)


@dataclass(frozen=True)
class Identified:
    """Result of a fit: the identified machine."""

    session: Session
    found: Identification

    @cached_property
    def calibration(self) -> Calibration:
        """The result as a calibration, which a compensator uses."""
        return from_identification(self.found, self.session.robot, self.session.survey.poses)

    def to_frame(self) -> pd.DataFrame:
        """Table of the dimensions: nominal, identified, deviation, standard error, tolerance."""
        found = self.found
        geometry = found.chain.layout.geometry
        rows = []
        for item, value, std in zip(
            found.parameters.items[geometry],
            found.theta[geometry].tolist(),
            found.std[geometry].tolist(),
            strict=True,
        ):
            factor, unit = _READERS.get(item.unit, (1.0, item.unit))
            rows.append(
                {
                    "dimension": item.name,
                    "unit": unit,
                    "drawn": factor * item.nominal,
                    "identified": factor * value,
                    "deviation": factor * (value - item.nominal),
                    "std": factor * std,
                    "tolerance": factor * item.prior,
                }
            )
        return _frame({key: [row[key] for row in rows] for key in rows[0]}).set_index("dimension")

    def residuals(self) -> pd.DataFrame:
        """Table of the poses: residuals before and after the fit, in the tracker's frame [mm]."""
        poses, at = self.session.survey.poses, self.session.survey.poses.conditions
        chain = self.found.chain
        after = poses.point - chain.predict(at, self.found.theta)
        before = poses.point - chain.predict(at, self.found.frame_only_theta)
        columns: dict[str, Array] = {"time_s": poses.time}
        for name, gap in (("before", before), ("calibrated", after)):
            columns |= {f"{name}_d{axis}_mm": 1e3 * gap[:, k] for k, axis in enumerate("xyz")}
            columns[f"{name}_mm"] = 1e3 * np.linalg.norm(gap, axis=1)
        columns["weight"] = self.found.weight
        return _frame(columns)

    def plot_residuals(self, axes: Any = None) -> Axes:
        """Plot the residuals of the fitted poses, before and after the fit, over time."""
        table = self.residuals()
        errors = {name: 1e-3 * table[f"{name}_mm"].to_numpy() for name in ("before", "calibrated")}
        return plot_errors(table["time_s"].to_numpy(), errors, self.found.noise.floor, axes=axes)

    def compensate(
        self,
        targets: Any,
        method: str | None = None,
        payload: float | None = None,
        temperature: Mapping[str, float] | None = None,
    ) -> pd.DataFrame:
        """Joint commands that put the tool at targets, as `delta-cal compensate` computes them.

        Args:
            targets: a table with the columns of a file of targets (x_mm, y_mm, z_mm, name, and
                turn_x_deg, turn_y_deg, turn_z_deg where the joints turn the platform; other
                columns are left out), or (n, 3) [mm].
            method: `apso` or `newton`; the command's default where not given.
            payload: [kg] at the centre of the platform.
            temperature: by part [deg C].

        Raises:
            InputError: no such targets, a payload or temperature that none can be, or one that the
                calibration needs is not given.
        """
        return _commands(self.calibration, targets, method, payload, temperature)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the calibration file.

        Raises:
            MistakeError: the session was recorded with a mistake, and `force` is not given.
        """
        _require_sound(self.session, force=force)
        save_calibration(Path(path), self.found, self.session.robot, self.session.survey.poses)

    def _repr_html_(self) -> str:
        found = self.found
        rows = {
            "error left, before": f"{mm(1e3 * found.frame_only.held_out)} mm",
            "error left, calibrated": f"{mm(1e3 * found.full.held_out)} mm",
            "noise of a pose": f"{mm(1e3 * found.noise.floor)} mm",
            "determined by the "
            "data": f"{found.observability.rank} of {len(found.theta)} parameters",
        }
        return _page(f"{self.session.robot.name}, identified", rows, doubts(found))


@dataclass(frozen=True)
class Diagnosed:
    """Result of a diagnosis: the verdict on a session, and the extended model."""

    session: Session
    diagnosis: Diagnosis

    @cached_property
    def calibration(self) -> Calibration:
        """The extended model as a calibration, which a compensator uses."""
        found = self.diagnosis.identification
        return from_identification(found, self.session.robot, self.session.survey.poses)

    def to_frame(self) -> pd.DataFrame:
        """Table of the identified values, in SI: cause, location, value, std, confidence."""
        rows: list[dict[str, Any]] = [
            {
                "cause": finding.cause,
                "location": finding.location or "",
                "parameter": name,
                "value": value.value,
                "std": value.std,
                "unit": value.unit,
                "confidence": finding.confidence,
            }
            for finding in self.diagnosis.verdict.findings
            for name, value in finding.parameters.items()
        ]
        names = ("cause", "location", "parameter", "value", "std", "unit", "confidence")
        return _frame({name: [row[name] for row in rows] for name in names})

    def plot_residuals(self, axes: Any = None) -> Axes:
        """Plot the held-out errors of all poses, before and with the extended model, over time."""
        poses = self.session.survey.poses
        n = len(poses)
        errors = {
            "before": np.sqrt(self.diagnosis.before.square[:n]),
            "extended": np.sqrt(self.diagnosis.after.square[:n]),
        }
        floor = self.diagnosis.identification.noise.floor
        return plot_errors(poses.time, errors, floor, axes=axes)

    def compensate(
        self,
        targets: Any,
        method: str | None = None,
        payload: float | None = None,
        temperature: Mapping[str, float] | None = None,
    ) -> pd.DataFrame:
        """Joint commands for targets by the extended model, see `Identified.compensate`."""
        return _commands(self.calibration, targets, method, payload, temperature)

    def save(self, path: str | Path, *, force: bool = False) -> None:
        """Write the calibration file of the extended model.

        Raises:
            MistakeError: the session was recorded with a mistake, and `force` is not given.
        """
        _require_sound(self.session, force=force)
        found, robot = self.diagnosis.identification, self.session.robot
        save_calibration(Path(path), found, robot, self.session.survey.poses)

    def _repr_html_(self) -> str:
        verdict = self.diagnosis.verdict
        named = self.session.robot.named
        rows = {f"held-out error {k}": f"{mm(m.held_out_rms_mm)} mm" for k, m in verdict.models()}
        for finding in verdict.findings:
            values = (
                f"{spoken(name)} {measured(e.value, e.std, e.unit)}"
                for name, e in finding.parameters.items()
            )
            told = f"{', '.join(values)} ({sure(finding.confidence)} sure)"
            rows[named(finding.called())] = named(told)
        return _page(named(verdict.sentence()), rows, self.diagnosis.doubts)


def _require_sound(session: Session, *, force: bool) -> None:
    """Refuse to write a calibration of a session that was recorded with a mistake."""
    if session.mistakes and not force:
        named = listed(dict.fromkeys(spoken(mistake.mistake) for mistake in session.mistakes))
        raise MistakeError(
            f"{session.recorded.source}: no calibration is written from a session with a mistake "
            f"({named}): `delta-cal check` explains it; force=True writes the calibration anyway"
        )


def _commands(
    calibration: Calibration,
    targets: Any,
    method: str | None,
    payload: float | None,
    temperature: Mapping[str, float] | None,
) -> pd.DataFrame:
    robot = calibration.robot
    rows = _rows(robot, targets)
    method = method or methods_for(robot.commanded)[0]
    require_method(robot.commanded, method, robot.name)
    warm = warmth_by_part(tuple((temperature or {}).items()), calibration, warn)
    compensator = JointCompensator(calibration, method)
    made = commands_for(compensator, rows, payload, warm, _SOURCE, warn)
    command, left, _ = made.by_target()
    columns: dict[str, Any] = {
        name: [row.text[name] if name == NAME else row.number(name) for row in rows]
        for name in rows[0].text
    }
    unit = robot.joints.unit
    for k, name in enumerate(robot.joints.names):
        columns |= {
            f"nominal_{name}_{unit}": made.nominal[:, k],
            f"{name}_{unit}": command[:, k],
        }
    more = {"status": made.status, "u95_mm": 1e3 * made.u95(), "error_mm": 1e3 * left}
    return _frame(columns | more)


def _rows(robot: Robot, targets: Any) -> list[Row]:
    """Convert targets to rows like those of a target file.

    Raises:
        InputError: a column is missing, or there is no target.
    """
    places = [name for name in commanded_columns(robot) if name in PLACE]
    if not hasattr(targets, "columns"):
        values = _numbers(targets)
        names = PLACE if values.shape[1] == len(PLACE) else tuple(places)
        if values.shape[1] != len(names):
            raise InputError(
                f"{_SOURCE}: {values.shape[1]} numbers a target; expected: {', '.join(names)}"
            )
        targets = _frame(dict(zip(names, values.T, strict=True)))
    found = [name for name in (NAME, *PLACE, *TURN) if name in targets.columns]
    require_columns(_SOURCE, [str(name) for name in targets.columns], places, (), ",")
    lines = zip(*(targets[name] for name in found), strict=True)
    rows = [
        Row(_SOURCE, number, dict(zip(found, map(str, line), strict=True)))
        for number, line in enumerate(lines, 1)
    ]
    if not rows:
        raise InputError(f"{_SOURCE}: contains no points")
    return rows


def _numbers(targets: Any) -> Array:
    """Convert targets to an array with a row of numbers for each target, (n, k) [mm].

    Raises:
        InputError: there is no target, or the targets are not a table of numbers.
    """
    try:
        values = np.atleast_2d(np.asarray(targets, dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(f"{_SOURCE}: not a table of numbers: {error}") from error
    if values.ndim != 2 or not values.size:
        raise InputError(f"{_SOURCE}: shape {values.shape}; expected: (n, 3) [mm], n at least 1")
    return values


def _frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    pandas = required("pandas", "a table")
    return pandas.DataFrame(dict(columns))  # type: ignore[no-any-return]


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count) or "none"


def _page(title: str, rows: Mapping[str, str], notes: Sequence[str]) -> str:
    """A small HTML table for a notebook; all texts are escaped."""
    escape = required("markupsafe", "a notebook").escape
    body = "".join(
        f"<tr><th style='text-align:left'>{escape(key)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for key, value in rows.items()
    )
    more = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<h4>{escape(title)}</h4><table>{body}</table>{more}"
