"""What `delta-cal` does, for notebooks: things that show themselves, give tables and plots.

```python
from delta_calibration.notebook import open_session

session = open_session("bags/srbd_backlash", robot="srbd")
found = session.fit()
found.plot_residuals()
verdict = session.diagnose()
verdict.save("extended.yaml")
```

Each object is a thin cover over what the verbs use (`recorded`, `found`, `diagnosis`): the same
figures come out. Tables are pandas', plots matplotlib's.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.compensation import CommandStatus, JointCompensator, methods_for
from delta_calibration.data import Session as Recording
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import Diagnosis, diagnose
from delta_calibration.estimation import Identification, doubts, identify
from delta_calibration.plans.points import joints_toward
from delta_calibration.recording import Topics, read_session
from delta_calibration.report.missing import required
from delta_calibration.report.residual_plot import plot_errors
from delta_calibration.robot import Robot, load_robot
from delta_calibration.wording import measured, mm, spoken, sure

if TYPE_CHECKING:
    import pandas as pd

    from delta_calibration.report.residual_plot import Axes

Array = NDArray[np.float64]

_READERS = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}


def open_session(
    path: str | Path, robot: str | Path, topics: Sequence[str] = (), model: str | None = None
) -> Session:
    """A recorded session, of a robot by its name or file.

    Args:
        path: rosbag2 folder.
        robot: file, or the name of one that comes with the package.
        topics: where streams were recorded under other names, `command=/my/joint_command`.
        model: mechanism to fit; the robot file's own where not given.

    Raises:
        CalibrationError: no such session or robot, streams missing, nothing still; says what.
    """
    own = load_robot(robot)
    recorded = read_session(Path(path), Topics.from_options(tuple(topics)))
    return Session(own, recorded, model)


@dataclass(frozen=True)
class Session:
    """What a machine was told, and where it was seen to stand."""

    robot: Robot
    recorded: Recording
    model: str | None = None

    @cached_property
    def survey(self) -> Survey:
        """Poses at rest and readings in motion."""
        return survey(self.recorded, self.robot.joints.names, self.robot.commanded.joint_size)

    def to_frame(self) -> pd.DataFrame:
        """A row a pose at rest: time, joints, measured point, readings, payload, temperatures."""
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
        """What the machine really is, as `delta-cal fit`.

        Raises:
            CalibrationError: too few poses, nothing that can be set.
        """
        return Identified(self, identify(self.survey.poses, self.robot, self.model, seed))

    def diagnose(self, seed: int = 0, calibration: Calibration | None = None) -> Diagnosed:
        """What the calibrated model gets wrong, as `delta-cal diagnose`.

        Raises:
            CalibrationError: as a fit.
        """
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
    """The machine as a fit has it."""

    session: Session
    found: Identification

    @cached_property
    def calibration(self) -> Calibration:
        """As compensators take it."""
        return from_identification(self.found, self.session.robot, self.session.survey.poses)

    def to_frame(self) -> pd.DataFrame:
        """A row a dimension: drawn, identified, deviation, standard error, whether data set it."""
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
        """A row a pose: what is left before and after the fit, in the tracker's frame [mm]."""
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
        """Errors of all poses before and after the fit, in time; the poses that were fitted."""
        table = self.residuals()
        errors = {name: 1e-3 * table[f"{name}_mm"].to_numpy() for name in ("before", "calibrated")}
        return plot_errors(table["time_s"].to_numpy(), errors, self.found.noise.floor, axes=axes)

    def compensate(self, targets: Any, method: str | None = None) -> pd.DataFrame:
        """Joint commands that put the tool at places, as `delta-cal compensate`.

        Args:
            targets: (n, 3) [mm], or a table with x_mm, y_mm, z_mm.
            method: `apso`, `newton`, `table`; as the verb where not given.
        """
        return _commands(self.calibration, targets, method)

    def save(self, path: str | Path) -> None:
        """Write the calibration file."""
        save_calibration(Path(path), self.found, self.session.robot, self.session.survey.poses)

    def _repr_html_(self) -> str:
        found = self.found
        rows = {
            "held-out error before": f"{mm(1e3 * found.frame_only.held_out)} mm",
            "held-out error calibrated": f"{mm(1e3 * found.full.held_out)} mm",
            "noise of a pose": f"{mm(1e3 * found.noise.floor)} mm",
            "set by the data": f"{found.observability.rank} of {len(found.theta)} parameters",
        }
        return _page(f"{self.session.robot.name}, identified", rows, doubts(found))


@dataclass(frozen=True)
class Diagnosed:
    """The verdict on a session, and the model that it extends the calibration to."""

    session: Session
    diagnosis: Diagnosis

    @cached_property
    def calibration(self) -> Calibration:
        """As compensators take it, effects in it."""
        found = self.diagnosis.identification
        return from_identification(found, self.session.robot, self.session.survey.poses)

    def to_frame(self) -> pd.DataFrame:
        """A row a value found, in SI: cause, location, value, standard error, how sure."""
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
        """Errors of all poses, each by a fit that had not seen it, before and extended."""
        poses = self.session.survey.poses
        n = len(poses)
        errors = {
            "before": np.sqrt(self.diagnosis.before.square[:n]),
            "extended": np.sqrt(self.diagnosis.after.square[:n]),
        }
        floor = self.diagnosis.identification.noise.floor
        return plot_errors(poses.time, errors, floor, axes=axes)

    def compensate(self, targets: Any, method: str | None = None) -> pd.DataFrame:
        """Joint commands that put the tool at places, by the extended model."""
        return _commands(self.calibration, targets, method)

    def save(self, path: str | Path) -> None:
        """Write the calibration file, extended by what was found."""
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


def _commands(calibration: Calibration, targets: Any, method: str | None) -> pd.DataFrame:
    robot = calibration.robot
    if hasattr(targets, "columns"):
        targets = targets[[f"{axis}_mm" for axis in "xyz"]].to_numpy()
    places = 1e-3 * np.atleast_2d(np.asarray(targets, dtype=float))
    nominal = joints_toward(robot, places)
    method = method or methods_for(robot.commanded)[0]
    reached = np.isfinite(nominal).all(axis=1)
    command, status = nominal.copy(), np.full(len(places), CommandStatus.OUT_OF_REACH.name.lower())
    status = status.astype(object)
    if reached.any():
        done = JointCompensator(calibration, method).compensate(nominal[reached])
        status[reached] = [verdict.name.lower() for verdict in done.verdicts]
        command[reached] = nominal[reached] + done.correction
    columns: dict[str, Any] = {f"{axis}_mm": 1e3 * places[:, k] for k, axis in enumerate("xyz")}
    unit = robot.joints.unit
    for k, name in enumerate(robot.joints.names):
        columns |= {f"nominal_{name}_{unit}": nominal[:, k], f"{name}_{unit}": command[:, k]}
    return _frame({**columns, "status": status})


def _frame(columns: Mapping[str, Any]) -> pd.DataFrame:
    pandas = required("pandas", "a table")
    return pandas.DataFrame(dict(columns))  # type: ignore[no-any-return]


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in counts.items() if count) or "none"


def _page(title: str, rows: Mapping[str, str], notes: Sequence[str]) -> str:
    """A small table for a notebook; texts of files are escaped."""
    escape = required("markupsafe", "a notebook").escape
    body = "".join(
        f"<tr><th style='text-align:left'>{escape(key)}</th>"
        f"<td style='text-align:left'>{escape(value)}</td></tr>"
        for key, value in rows.items()
    )
    more = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<h4>{escape(title)}</h4><table>{body}</table>{more}"
