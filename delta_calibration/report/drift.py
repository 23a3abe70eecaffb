"""Comparison of calibrations of one robot: change of the machine over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.documents import load_schema, read_document
from delta_calibration.errors import DataError
from delta_calibration.geometry import align
from delta_calibration.geometry.halton import halton
from delta_calibration.mechanisms import Mechanism
from delta_calibration.report.document import Report, Section, Statement, Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    PAPER,
    SERIES,
    Axis,
    Figure,
    Panel,
    Points,
    course,
)
from delta_calibration.report.glossary import glossary_section
from delta_calibration.robot import Robot
from delta_calibration.wording import NO_VALUE, figures, listed, mm, moment, spoken

Array = NDArray[np.float64]

MM = 1e3
_DRAWS = 4096  # poses sampled to compare two machines; only those valid for both are used
_FEWEST = 4  # smallest number of valid poses
_SHOWN = 6  # number of parameters shown, those that drift most
UNITS = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}


@dataclass(frozen=True)
class CalibrationRecord:
    """Calibration with the additional data for a comparison."""

    name: str
    start: str  # start of the session, ISO 8601
    calibration: Calibration
    std: Array  # (p,) standard errors of the geometry
    error_left: float  # [m]

    @property
    def when(self) -> str:
        """Start of the session, for display."""
        return moment(int(datetime.fromisoformat(self.start).timestamp()) * 1_000_000_000)


def read_calibration(path: Path, robot: Robot) -> CalibrationRecord:
    """Read a calibration file made for this robot.

    Raises:
        ConfigError: see `load_calibration`.
    """
    calibration = load_calibration(path, robot)
    data = read_document(path, lambda _: load_schema("calibration"))
    geometry = calibration.chain.layout.geometry
    return CalibrationRecord(
        path.stem,
        str(data["provenance"]["session_start"]),
        calibration,
        np.array([entry["std"] for entry in data["parameters"][geometry]], dtype=float),
        float(data["residuals"]["full"]["error_left_rms_mm"]) / MM,
    )


def drift_of_calibrations(records: Sequence[CalibrationRecord]) -> Report:
    """Report the change of the machine from the oldest calibration to each later one.

    Raises:
        DataError: calibrations of different models, or without a common region.
    """
    records = sorted(records, key=lambda record: record.start)
    first = records[0]
    shifts = [shift(first.calibration, record.calibration) for record in records]
    last, largest = shifts[-1]
    change = standardised(first, records[-1])
    order = np.argsort(-np.abs(change))[:_SHOWN]
    items = first.calibration.chain.mechanism.parameters.items
    names = tuple(record.name for record in records)
    return Report(
        title=f"Comparison of {len(records)} calibrations: {first.calibration.robot.name}",
        subtitle=f"sessions recorded {' to '.join(dict.fromkeys([first.when, records[-1].when]))}",
        sentence=(
            f"From {first.name} to {records[-1].name} the machine changed by {mm(MM * last)} mm "
            f"RMS, at most {mm(MM * largest)} mm, over their common region."
        ),
        statements=(
            Statement(
                "What changed most",
                listed(f"{spoken(items[k].name)} ({figures(change[k], 2)} σ)" for k in order[:3])
                + ".",
            ),
            Statement(
                "Method",
                "Tool positions of both geometries at the same joint angles, at rest and "
                "without effects. The best rigid motion between them is removed, because the "
                "tracker may have been moved.",
            ),
        ),
        key_figures=(),
        sections=(
            Section(
                "drift",
                "The machine over time",
                (),
                (_calibration_table(records, shifts),),
                (_shift_figure(names, shifts, records), _parameter_figure(records, order)),
            ),
            glossary_section(),
        ),
        data={
            "calibrations": [
                {
                    "name": record.name,
                    "session_start": record.start,
                    "sha256": record.calibration.seal,
                    "shift_rms_mm": MM * rms,
                    "shift_max_mm": MM * most,
                }
                for record, (rms, most) in zip(records, shifts, strict=True)
            ]
        },
    )


def shift(a: Calibration, b: Calibration) -> tuple[float, float]:
    """Root mean square and largest distance between two machines at the same joints [m].

    Raises:
        DataError: different models, or too few joint angles in the range of both calibrations.
    """
    mechanism = a.chain.mechanism
    if mechanism.name != b.chain.mechanism.name:
        raise DataError(
            f"{a.source} is of model {mechanism.name!r}, {b.source} of "
            f"{b.chain.mechanism.name!r}: only calibrations of one model can be compared"
        )
    low = np.maximum(a.joints_lower, b.joints_lower)
    high = np.minimum(a.joints_upper, b.joints_upper)
    if (high <= low).any():
        raise _apart(a, b)
    joint = _known(mechanism, _drawn(mechanism, a, low, high), a, b)
    one, other = (mechanism.position(mechanism.forward(joint, c.geometry)) for c in (a, b))
    there = np.isfinite(one).all(axis=1) & np.isfinite(other).all(axis=1)
    if there.sum() < _FEWEST:
        raise _apart(a, b)
    one, other = one[there], other[there]
    apart = np.linalg.norm(align(one, other).apply(one) - other, axis=1)
    return float(np.sqrt(np.mean(apart**2))), float(apart.max())


def _drawn(mechanism: Mechanism, a: Calibration, low: Array, high: Array) -> Array:
    """Sample joints (n, m) of poses in a's region; rows may be NaN.

    Samples positions and the rotations of the robot file's workspace; if it states none, joints
    evenly between the ends (m,). A grid over the joints would have 43 million nodes on eight
    cables, of which hardly any are consistent.
    """
    nominal, box = mechanism.parameters.nominal, a.robot.workspace
    if box is not None:
        rng = np.random.default_rng(0)
        places = a.region.sample(_DRAWS, 0.0, rng)
        turns = rng.uniform(-box.turn, box.turn, places.shape)
        return mechanism.inverse(mechanism.task(places, turns), nominal)
    joint = low + halton(_DRAWS, len(low)) * (high - low)
    if mechanism.joints == mechanism.task_size:
        return np.asarray(joint)
    nearest = mechanism.forward(joint, nominal)[:, : mechanism.task_size]
    return mechanism.inverse(nearest[np.isfinite(nearest).all(axis=1)], nominal)


def _known(mechanism: Mechanism, joint: Array, a: Calibration, b: Calibration) -> Array:
    """Joints (n, m) that lie in the ranges and regions of both calibrations and are regular."""
    joint, nominal = joint[np.isfinite(joint).all(axis=1)], mechanism.parameters.nominal
    x = mechanism.forward(joint, nominal)
    good = mechanism.condition(joint, x, nominal) <= a.robot.limits.condition
    for each in (a, b):
        within = (joint >= each.joints_lower) & (joint <= each.joints_upper)
        good &= within.all(axis=1) & (each.region.outside(mechanism.position(x)) <= 0)
    return np.asarray(joint[good])


def _apart(a: Calibration, b: Calibration) -> DataError:
    return DataError(f"{a.source} and {b.source} have no region in common")


def standardised(a: CalibrationRecord, b: CalibrationRecord) -> Array:
    """Change of each dimension divided by its standard error, (p,)."""
    spread = np.hypot(a.std, b.std)
    change = b.calibration.geometry - a.calibration.geometry
    return np.divide(change, spread, out=np.zeros_like(change), where=spread > 0)


def _calibration_table(
    records: Sequence[CalibrationRecord], shifts: Sequence[tuple[float, float]]
) -> Table:
    rows = tuple(
        (
            record.name,
            record.when,
            mm(MM * record.error_left),
            mm(MM * rms),
            mm(MM * most),
            listed(spoken(e.cause) for e in record.calibration.chain.effects) or NO_VALUE,
            record.calibration.seal[:12],
        )
        for record, (rms, most) in zip(records, shifts, strict=True)
    )
    head = (
        "calibration",
        "session",
        "error left, RMS [mm]",
        "from the first, RMS [mm]",
        "largest [mm]",
        "effects",
        "SHA-256",
    )
    return Table("calibrations", "Calibrations, oldest first", head, rows, words=(0, 1, 5, 6))


def _shift_figure(
    names: tuple[str, ...],
    shifts: Sequence[tuple[float, float]],
    records: Sequence[CalibrationRecord],
) -> Figure:
    place = np.arange(len(names), dtype=float)
    rms, most = (MM * np.array(each) for each in zip(*shifts, strict=True))
    left = MM * np.array([record.error_left for record in records])
    return Figure(
        "shift",
        "Distance from the first",
        "Root mean square and largest distance over the common region, and the error left of "
        "each calibration: a smaller distance is not significant.",
        (
            Panel(
                "",
                Axis.side_by_side("calibration", names),
                Axis("distance [mm]"),
                (
                    *course("RMS", place, rms, CALIBRATED, "solid", "circle"),
                    *course("largest", place, most, BEFORE, "dash", "diamond"),
                    *course("error left", place, left, PAPER, "dot", "square"),
                ),
            ),
        ),
        columns=1,
    )


def _parameter_figure(records: Sequence[CalibrationRecord], order: NDArray[np.intp]) -> Figure:
    items = records[0].calibration.chain.mechanism.parameters.items
    place = np.arange(len(records), dtype=float)
    panels = []
    for number, k in enumerate(order.tolist()):
        factor, unit = UNITS.get(items[k].unit, (1.0, items[k].unit))
        value = np.array([r.calibration.geometry[k] - items[k].nominal for r in records])
        std = np.array([r.std[k] for r in records])
        colour = SERIES[number % len(SERIES)]
        panels.append(
            Panel(
                spoken(items[k].name),
                Axis.side_by_side("calibration", tuple(r.name for r in records)),
                Axis(f"deviation [{unit}]"),
                (Points("", place, factor * value, colour, size=7.0, error=1.96 * factor * std),),
            )
        )
    return Figure(
        "parameters",
        "Dimensions that changed most",
        "Deviation from the drawing with 95 % intervals; the largest changes in units of their "
        "standard errors.",
        tuple(panels),
        columns=3,
    )
