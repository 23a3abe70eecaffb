"""Error along the line of the plan `line`.

This is the line of the Delta paper, x = -y, z = -711 mm, with the errors measured there; or, if
the robot file states a workspace, a line through its middle.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import DataError
from delta_calibration.plans import make_plan
from delta_calibration.report.document import Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    GREY,
    PAPER,
    Axis,
    Figure,
    Line,
    Panel,
    Rule,
)
from delta_calibration.report.judged import Judged
from delta_calibration.robot import Robot
from delta_calibration.trial import Errors
from delta_calibration.wording import capital, mm

Array = NDArray[np.float64]

MM = 1e3
PAPER_MAX, PAPER_MEAN, PAPER_THREE_STD = 3.305, 0.803, 2.086  # [mm] table 3, not compensated
_POINTS = 181
_AXES = "xyz"
_SURE = 1.96
_FEWEST = 3  # smallest number of points for statistics


@dataclass(frozen=True)
class AlongLine:
    """Errors of the models along the line; the first axis is the point."""

    target: Array  # (n, 3) [m]
    papers: bool  # whether it is the paper's line
    before: Array  # (n,) [m] extended minus nominal model, root mean square of both sides
    calibrated: Array  # (n,) [m] extended minus calibrated model, likewise
    spread: Array  # (n,) [m] standard error of the extended model's point, 3-D
    inside: NDArray[np.bool_]  # (n,) within the measured region
    extended: bool  # whether the extended model has effects that the calibrated one has not

    @property
    def way(self) -> int:
        """Index of the coordinate along the line, 0 to 2 for x, y, z."""
        return int(np.argmax(np.abs(self.target[-1] - self.target[0])))

    @property
    def along(self) -> Array:
        """Coordinate along the line, (n,) [m]."""
        return np.asarray(self.target[:, self.way])

    @property
    def title(self) -> str:
        """Title of the line on a page."""
        return "Along the paper's line" if self.papers else "Along a line"

    @property
    def bound(self) -> Array:
        """95 % bound of the error of the last model's point, (n,) [m]."""
        return _SURE * self.spread

    @property
    def words(self) -> str:
        """Sentences that define the errors."""
        last = "extended" if self.extended else "calibrated"
        between = "Calibrated: extended model minus calibrated geometry. " if self.extended else ""
        return (
            f"Before: {last} model minus nominal robot in its best-fit frame. {between}"
            f"{capital(last)}: 95 % bound of the {last} model, from the covariance of the fit."
        )

    @property
    def errors(self) -> tuple[Line, ...]:
        """Curves of the errors; without effects, the calibrated model is the last one."""
        x = MM * self.along
        before = Line("before", x, MM * self.before, BEFORE)
        if not self.extended:
            bound = Line("calibrated, 95 % bound", x, MM * self.bound, CALIBRATED, "dot")
            return before, bound
        calibrated = Line("calibrated", x, MM * self.calibrated, CALIBRATED, "dash")
        return (
            before,
            calibrated,
            Line("extended, 95 % bound", x, MM * self.bound, EXTENDED, "dot"),
        )

    @property
    def where(self) -> str:
        """Equations of the line, for display."""
        if self.papers:
            return "x = −y, z = −711 mm"
        still = (k for k in range(3) if k != self.way)
        rest = (f"{_AXES[k]} = {_plain(MM * self.target[0, k])}" for k in still)
        return f"{', '.join(rest)} mm"


def along_line(judged: Judged, robot: Robot) -> AlongLine | None:
    """Compute the models' differences along the line; None for a robot that does not reach it.

    The extended model stands for the true machine. Its difference from the nominal robot, in the
    best frame of the session, is the error before; that from the calibrated geometry is the error
    left by compensation with it. The error of the extended model itself is only known by its
    standard error.
    """
    try:
        plan = make_plan("line", robot, count=_POINTS, both_sides=False)
    except DataError:
        return None
    found = judged.diagnosis.identification
    base = judged.diagnosis.model.problem.chain
    drawing, change = found.frame_only_theta[base.layout.base], found.theta.copy()
    change[base.layout.base] -= judged.calibrated_theta
    square = np.zeros((2, _POINTS))
    for side in (-1.0, 1.0):
        at = judged.usual(plan.joint, side)
        seen = found.chain.see(at, found.theta)
        slope = seen.jacobian
        # linear, as in the fit: offset and frame may differ much, but compensate each other
        for row, missed in enumerate((seen.reading - base.predict(at, drawing), slope @ change)):
            square[row] += np.sum(missed**2, axis=1) / 2
    spread = np.sqrt(np.einsum("nip,pq,niq->n", slope, found.uncertainty.covariance, slope))
    # the region is that of the platform's centre, not of the tool
    meant = robot.commanded.forward(plan.joint, robot.commanded.parameters.nominal)
    inside = judged.region.outside(robot.commanded.position(meant)) <= 0
    before, calibrated = np.sqrt(square)
    more = found.chain.effects != base.effects
    papers = robot.workspace is None
    return AlongLine(plan.target, papers, before, calibrated, spread, inside, more)


def line_figure(line: AlongLine) -> Figure:
    """Figure of the errors along the line; on the paper's line with its mean and maximum."""
    x, axis = MM * line.along, _AXES[line.way]
    beyond = (
        f" {np.sum(~line.inside)} of {len(x)} points are outside the measured region, where the "
        "models extrapolate."
        if not line.inside.all()
        else ""
    )
    everything = np.concatenate([error.y for error in line.errors])
    low, high = max(float(everything.min()), 1e-5), float(everything.max())
    measured, rules = "", _ends(x, line.inside)
    if line.papers:
        measured = (
            " Dashed: what Pan, Qiu and Liu (2017) measured on their machine before compensation."
        )
        high = max(high, PAPER_MAX)
        rules = (
            Rule("the paper, largest: 3.305 mm", PAPER_MAX, PAPER, at=0.62),
            Rule("the paper, mean: 0.803 mm", PAPER_MEAN, PAPER, at=0.62),
            *rules,
        )
    return Figure(
        "error_line",
        line.title,
        f"Errors of the tool point on {line.where} according to the models, approached from both "
        f"sides under the session's median conditions. {line.words}{measured}{beyond}",
        (
            Panel(
                "",
                Axis(f"{axis} along the line [mm]"),
                Axis("error, 3-D [mm]", log=True, low=0.5 * low, high=2 * high),
                (*line.errors, *rules),
                tall=1.25,
            ),
        ),
        columns=1,
    )


def _ends(x: Array, inside: NDArray[np.bool_]) -> tuple[Rule, ...]:
    """Marks at the ends of the measured region along the line (n,) [mm], if it ends there."""
    if inside.all() or not inside.any():
        return ()
    ends = ("measured from", x[inside].min()), ("to", x[inside].max())
    return tuple(Rule(name, float(end), GREY, "dot", upright=True) for name, end in ends)


def line_table(line: AlongLine) -> Table:
    """Mean, largest and three standard deviations, as in the paper's table 3."""
    rows: list[tuple[str, float, float, float]] = []
    if line.papers:
        rows.append(("the paper's machine, measured", PAPER_MEAN, PAPER_MAX, PAPER_THREE_STD))
    parts = {"": np.ones(len(line.target), dtype=bool)}
    if _FEWEST <= line.inside.sum() < len(line.target):
        parts[", in the region measured"] = line.inside
    for part, rows_of in parts.items():
        for error in line.errors:
            each = Errors.of(error.y[rows_of])
            rows.append((error.name + part, each.mean, each.maximum, each.three_std))
    return Table(
        "error_line_table",
        "The line in numbers",
        ("", "mean [mm]", "largest [mm]", "3 std [mm]"),
        tuple((name, mm(a), mm(b), mm(c)) for name, a, b, c in rows),
    )


def _plain(value: float) -> str:
    """Format an integer with a typographic minus; never −0."""
    return f"{round(value)}".replace("-", "−")
