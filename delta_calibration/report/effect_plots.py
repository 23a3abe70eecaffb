"""Plots of residuals and predicted effect against the quantity that a cause depends on.

Component-plus-residual plots: all terms but one are in the model, so that the residual contains
that term's part and the noise. A drive's part is shown as the equivalent joint error; any other
part in mm, along the direction in which it moves the reflector most.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.regressor import ANGLE, CLOCK, LOAD, Groups, Regressor, temperature
from delta_calibration.mechanisms.base import solve
from delta_calibration.report.drawing import (
    GREY,
    INK,
    MINUS,
    PLUS,
    THIRD,
    Axis,
    Figure,
    Panel,
    Points,
    Rule,
)
from delta_calibration.report.judged import Judged
from delta_calibration.robot import Robot
from delta_calibration.wording import capital, chance, spoken

Array = NDArray[np.float64]
Index = NDArray[np.intp]

MM, UM = 1e3, 1e6
_MOVING = 0.25  # ratio of the part at rest to that in motion below which motion is shown
_MOST = 1200  # largest number of samples in a panel
_COLOURS = ((PLUS, "circle"), (MINUS, "diamond"), (THIRD, "square"))
_SPREAD = 0.2  # [°C] range of a temperature above which it is plotted


@dataclass(frozen=True)
class _Seen:
    """Residual without a term, and the term's prediction of it."""

    measured: Array  # (n, panels)
    predicted: Array  # (n, panels)
    titles: tuple[str, ...]  # of the panels
    joints: tuple[int, ...]  # joint whose regressor each panel uses
    unit: str


def giveaways(judged: Judged, robot: Robot) -> tuple[Figure, ...]:
    """Make one figure for each term that is an effect."""
    model = judged.diagnosis.model
    return tuple(
        _figure(judged, robot, term, term.effect, number)
        for number, term in enumerate(model.terms, start=1)
        if term.effect is not None
    )


def _figure(judged: Judged, robot: Robot, term: Candidate, effect: Effect, number: int) -> Figure:
    rows = _rows(judged, term)
    at = judged.evidence.seen.take(rows)
    against = effect.regressor(at).of_joints(robot.joints.unit)
    seen = _seen(judged, robot, term, rows)
    panels = [
        _panel(seen, k, against, at, effect.groups(at, joint))
        for k, joint in enumerate(seen.joints)
    ]
    where = "in motion" if rows[0] >= judged.evidence.poses else "at rest"
    thinned = f", {len(rows)} of them shown" if len(rows) == _MOST else ""
    agree = (
        "The map follows the error; it does not explain it."
        if term.unexplained
        else "The cause explains the residual where both agree."
    )
    name = "error without a known cause" if term.unexplained else spoken(term.label)
    return Figure(
        f"giveaway_{number}_{term.cause}",
        f"{capital(name)}: residual against {against.title.partition(' [')[0]}",
        f"Residual {where} with everything except this cause in the model{thinned}, and the "
        f"error predicted by this cause (crosses). {agree}",
        tuple(panels),
        columns=min(3, len(panels)),
    )


def _rows(judged: Judged, term: Candidate) -> Index:
    """Rows to show: the poses, or readings in motion for a term that only shows there."""
    evidence = judged.evidence
    moving = np.flatnonzero(evidence.believed)
    moving = moving[moving >= evidence.poses]
    if not moving.size:
        return judged.rows
    size = [np.mean(judged.moved_by(term, rows) ** 2) for rows in (judged.rows, moving)]
    if size[0] >= _MOVING**2 * size[1]:
        return judged.rows
    return moving[np.linspace(0, len(moving) - 1, min(len(moving), _MOST)).astype(np.intp)]


def _seen(judged: Judged, robot: Robot, term: Candidate, rows: Index) -> _Seen:
    whole, part = judged.beside_term(term, rows), judged.moved_by(term, rows)
    joints = judged.evidence.at.joint.shape[1]
    if term.effect is not None and term.effect.stage is Stage.DRIVE and joints == 3:
        chosen = _joints(term, joints)
        evidence = judged.evidence
        slope, root = evidence.by_joints[rows, :3], evidence.whiten[rows, :3, :3]
        angles = [UM * solve(slope, root @ moved[..., None])[..., 0] for moved in (whole, part)]
        return _Seen(
            angles[0][:, chosen],
            angles[1][:, chosen],
            tuple(robot.joints.names[j] for j in chosen),
            tuple(chosen),
            f"stand-off of the joint [{'µrad' if robot.joints.unit == 'rad' else 'µm'}]",
        )
    along = np.linalg.svd(part, full_matrices=False)[2][0]
    along = along * np.sign(along[np.argmax(np.abs(along))])
    return _Seen(
        MM * (whole @ along)[:, None],
        MM * (part @ along)[:, None],
        ("",),
        (_joints(term, joints)[0],),
        "residual along the effect [mm]",
    )


def _joints(term: Candidate, count: int) -> list[int]:
    """Index of the joint at which a term is located, or all joints."""
    if term.location and term.location.startswith("joint_"):
        return [int(term.location.removeprefix("joint_")) - 1]
    return list(range(count))


def _panel(seen: _Seen, k: int, against: Regressor, at: Conditions, groups: Groups) -> Panel:
    x = against.of(at, seen.joints[k])
    marks: list[Points | Rule] = [Rule("", 0.0, GREY, "dot")]
    for (name, rows), (colour, symbol) in zip(groups, _COLOURS, strict=False):
        marks.append(Points(name, x[rows], seen.measured[rows, k], colour, symbol, 5.0))
    marks.append(Points("predicted", x, seen.predicted[:, k], INK, "cross", 4.0))
    return Panel(seen.titles[k], Axis(against.title), Axis(seen.unit), tuple(marks))


def leftovers(judged: Judged, robot: Robot) -> Figure:
    """Residuals of the extended model at the poses, against quantities that may explain them."""
    rows = judged.rows
    at = judged.evidence.at.take(rows)
    left = MM * judged.left()[rows]
    noise = MM * judged.diagnosis.model.cell.noise.floor / np.sqrt(3)
    panels = tuple(
        Panel(
            "",
            Axis(against.title),
            Axis("residual [mm]"),
            (
                *(Rule("", sign * 2 * noise, GREY, "dot") for sign in (-1, 1)),
                *_by_axis(against.of(at, 0), left),
            ),
        )
        for against in _recorded(at, robot)
    )
    tests = judged.diagnosis.audit.p
    near = ", ".join(
        f"{spoken(name.removeprefix('moran_'))} {chance(p)}"
        for name, p in tests.items()
        if name.startswith("moran_")
    )
    model = "extended" if judged.diagnosis.model.terms else "calibrated"
    return Figure(
        "residual_left",
        f"Residuals of the {model} model",
        "Residuals of the fit at the poses; dotted: two standard deviations of the noise. "
        f"Probability that neighbours are as similar by chance, in: {near}.",
        panels,
        columns=3,
    )


def _by_axis(x: Array, left: Array) -> Iterator[Points]:
    """Points of the residuals (n, 3) [mm] over x (n,), for each axis."""
    for k, (name, (colour, symbol)) in enumerate(zip("xyz", _COLOURS, strict=True)):
        yield Points(f"along {name} of the tracker", x, left[:, k], colour, symbol)


def _recorded(at: Conditions, robot: Robot) -> Iterator[Regressor]:
    """Quantities that changed in the session."""
    yield CLOCK
    own = ANGLE.of_joints(robot.joints.unit)
    for j, name in enumerate(robot.joints.names):
        title = own.title.replace("the joint", name)
        yield Regressor(title, lambda at, _, joint=j: own.of(at, joint))  # type: ignore[misc]
    if np.isfinite(at.payload).all() and np.ptp(at.payload) > 0:
        yield LOAD
    for k, part in enumerate(at.temperature_parts):
        if np.isfinite(at.temperature[:, k]).all() and np.ptp(at.temperature[:, k]) > _SPREAD:
            yield temperature(part)
