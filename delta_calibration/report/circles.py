"""Report of a circle test: magnified polar plots, causes with shares, and remedies."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from delta_calibration.circle_test import (
    DIMENSIONS,
    FOLLOWING,
    NOISE,
    NOT_EXPLAINED,
    CircleTest,
    Measured,
    PartError,
    Share,
    pairs,
)
from delta_calibration.diagnosis.verdict import Estimate
from delta_calibration.report.document import KeyFigure, Report, Section, Statement, Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    PAPER,
    Axis,
    Figure,
    Line,
    Panel,
)
from delta_calibration.report.provenance import Provenance
from delta_calibration.report.words import between, estimate
from delta_calibration.robot import Robot
from delta_calibration.wording import NO_VALUE, capital, listed, spoken, sure

Array = NDArray[np.float64]
Key = tuple[str, str | None]

_UM = 1e6
_TOLD = 3  # number of values shown of a cause, the clearest ones
_HIGH = 0.3  # largest drawn deviation over the radius
_STEPS = (1, 2, 5, 10)  # magnifications are rounded down to these, times a power of ten
_SMALL = 0.5e-6  # [m] below which an error of a part is not mentioned
_LOBES = {2: "oval", 3: "three-lobed", 4: "four-lobed"}
_OTHER = {
    DIMENSIONS: (
        "dimensions of the parts",
        "usual deviations of the parts, none clear by itself",
        "compensate: calibrate the machine (delta-cal fit) and correct its commands",
    ),
    FOLLOWING: (
        "following error",
        "difference of encoders and commands",
        "adjust: the drives' gains or feed-forward, or drive slower",
    ),
    NOT_EXPLAINED: (
        "not explained",
        "not explained by any cause of the catalogue",
        "measure more: a session of the plan rich, then delta-cal diagnose",
    ),
    NOISE: (
        "measurement noise",
        "scatter of readings and of rest positions; not an error of a part",
        "nothing; slower feeds and more readings reduce it",
    ),
}


def circle_report(test: CircleTest, robot: Robot, provenance: Provenance) -> Report:
    """Make the report of a circle test."""
    verdict = test.verdict
    worst = max(test.circles, key=lambda m: m.deviation)
    senses = [m.hysteresis for m in test.circles if m.hysteresis is not None]
    untold = [f"{between(e)}: {e.why()}." for e in verdict.cannot_tell]
    sections = (
        Section("circles", "Circles", (), (_circles(test),), tuple(_plots(test))),
        Section(
            "causes",
            "Causes and what to do",
            (advice(test),),
            (_causes(test), _orders(test)),
            tuple(_cause_plots(test)),
        ),
        Section(
            "untold", "What this session cannot distinguish", tuple(untold) or ("Nothing asked.",)
        ),
        Section("terms", "Terms", (), (_TERMS,)),
    )
    return Report(
        title=f"Circle test of {robot.name}",
        subtitle=provenance.session,
        sentence=robot.named(capital(_sentence(test))),
        statements=(
            Statement("Do this first", robot.named(advice(test))),
            Statement("What is wrong", robot.named(verdict.sentence())),
        ),
        key_figures=(
            KeyFigure("circular deviation", _um(test.deviation), "µm", "mean of all circles"),
            KeyFigure("largest", _um(worst.deviation), "µm", _name(worst)),
            *(
                [KeyFigure("hysteresis", _um(max(senses)), "µm", "largest, of two senses")]
                if senses
                else []
            ),
        ),
        sections=(
            *(section.renamed(robot.named) for section in sections),
            Section("provenance", "Provenance", (), (provenance.table(),)),
        ),
        data={"verdict": verdict.as_dict()},
    )


def advice(test: CircleTest) -> str:
    """Sentence on the first remedy, and on the circular deviation expected after it."""
    if test.first is None:
        return "No known remedy makes these circles rounder."
    cause, location = test.first
    now, then = _um(test.deviation), _um(test.without(cause, location))
    return (
        f"{capital(called(cause, location))}: {_to_do(test, cause, location)}. This alone "
        f"reduces the mean circular deviation from {now} µm to {then} µm."
    )


def called(cause: str, location: str | None) -> str:
    """Name of a cause with its location, for display."""
    name = _OTHER[cause][0] if cause in _OTHER else spoken(cause)
    return name + (f" at {spoken(location)}" if location else "")


def on_a_part(error: PartError) -> str:
    """Describe the error that a cause makes on a round part."""
    told = []
    if abs(error.radius) >= _SMALL:
        way = "large" if error.radius > 0 else "small"
        told.append(f"radii {_um(abs(error.radius))} µm too {way}")
    if error.height >= _SMALL:
        shape = _LOBES.get(error.lobes, f"{error.lobes} waves a turn")
        told.append(f"{shape} by ± {_um(error.height)} µm")
    if error.senses >= _SMALL:
        told.append(f"up to {_um(error.senses)} µm between the two senses")
    return listed(told) or "nothing visible"


def _sentence(test: CircleTest) -> str:
    most = [s for s in test.shares if s.cause not in (NOISE, NOT_EXPLAINED)]
    of = f", most of it by {called(most[0].cause, most[0].location)}" if most else ""
    return f"circles are {_um(test.deviation)} µm out of round on average{of}."


def _to_do(test: CircleTest, cause: str, location: str | None) -> str:
    if cause in _OTHER:
        return _OTHER[cause][2]
    finding = test.finding(cause, location)
    if finding is None or finding.action is None:
        return NO_VALUE
    action = finding.action
    how = f": {action.how}" if action.how else ""
    return f"{action.do} the {spoken(action.part)}{how}. To confirm: {action.confirm}"


def _circles(test: CircleTest) -> Table:
    return Table(
        "circles",
        "Deviations",
        (
            "circle",
            "radius [mm]",
            "feed [mm/s]",
            "circular deviation G [µm]",
            "hysteresis H [µm]",
            "radial deviation F [µm]",
        ),
        tuple(
            (
                _name(m),
                f"{1e3 * m.circle.radius:.1f}",
                f"{1e3 * m.circle.feed:.0f}",
                _um(m.deviation),
                NO_VALUE if m.hysteresis is None else _um(m.hysteresis),
                f"{_um(float(m.radial.min()))} to {_um(float(m.radial.max()))}",
            )
            for m in test.circles
        ),
        caption="From the raw readings, including their noise.",
    )


def _causes(test: CircleTest) -> Table:
    return Table(
        "causes",
        "Shares of the mean circular deviation",
        (
            "cause",
            "share [µm]",
            "share [%]",
            "G without it [µm]",
            "value",
        ),
        tuple(_cause(test, share) for share in test.shares),
        caption=(
            f"The shares add up to {_um(test.deviation)} µm. The share of a cause is the "
            "decrease of the deviation when it is removed from the model, averaged over all "
            "orders of removal."
        ),
        words=(0, 4),
    )


def _orders(test: CircleTest) -> Table:
    return Table(
        "orders",
        "What each cause does to a part, and what to do",
        ("cause", "on a round part", "what to do"),
        tuple(
            (
                capital(called(share.cause, share.location)),
                _on_a_part(test, (share.cause, share.location)),
                capital(_to_do(test, share.cause, share.location)),
            )
            for share in test.shares
        ),
        words=(0, 1, 2),
    )


def _on_a_part(test: CircleTest, key: Key) -> str:
    if key not in test.circles[0].without:
        return NO_VALUE
    return capital(on_a_part(test.part_error(*key)))


def _cause(test: CircleTest, share: Share) -> tuple[str, ...]:
    key = share.cause, share.location
    known = key in test.circles[0].without
    return (
        _label(test, share),
        _um(share.size),
        f"{100 * share.size / test.deviation:.0f}",
        _um(test.without(*key)) if known else NO_VALUE,
        _value(test, share),
    )


def _label(test: CircleTest, share: Share) -> str:
    finding = test.finding(share.cause, share.location)
    if finding is None:
        return called(share.cause, share.location)
    others = f"; indistinguishable here: {listed(map(spoken, finding.equivalents))}"
    return f"{finding.called()}, {sure(finding.confidence)} sure" + (
        others if finding.equivalents else ""
    )


def _value(test: CircleTest, share: Share) -> str:
    finding = test.finding(share.cause, share.location)
    if share.cause == DIMENSIONS and test.dimensions:
        first = dict(islice(test.dimensions.items(), _TOLD))
        return f"off the drawing: {_estimates(first, len(test.dimensions))}"
    if finding is None:
        return _OTHER[share.cause][1] if share.cause in _OTHER else NO_VALUE
    return _estimates(finding.clearest(_TOLD), len(finding.parameters))


def _estimates(first: Mapping[str, Estimate], of: int) -> str:
    """Format some estimates, and the number of further ones."""
    more = f" and {of - len(first)} more" if of > len(first) else ""
    return ", ".join(estimate(name, e) for name, e in first.items()) + more


def _plots(test: CircleTest) -> list[Figure]:
    """Magnified polar plots of each circle in both senses, with the extended model's curve."""
    panels = []
    seen: list[str] = []
    circles = [m.circle for m in test.circles]
    both = [(test.circles[i], test.circles[k]) for i, k in pairs(circles)]
    alone = [m for m in test.circles if m.hysteresis is None]
    for group in (*both, *((m,) for m in alone)):
        title = f"{group[0].circle.plane}, {1e3 * group[0].circle.feed:.0f} mm/s"
        if title in seen:
            continue  # a repetition of the same circle
        seen.append(title)
        by = _magnified(group[0].circle.radius, *(m.radial for m in group))
        lines = [_nominal(group[0])]
        for m in group:
            colour = CALIBRATED if m.circle.anticlockwise else BEFORE
            lines += [
                _drawn(m, m.radial, by, m.circle.sense, colour, "solid"),
                _drawn(m, m.predicted, by, "according to the extended model", EXTENDED, "dot"),
            ]
        panels.append(_panel(title, group[0], by, lines))
    caption = (
        "Each circle about its own least-squares centre. Deviations from the nominal radius are "
        "magnified by the factor in the title."
    )
    return [Figure("circles", "Polar plots", caption, tuple(panels))]


def _cause_plots(test: CircleTest) -> list[Figure]:
    """Polar plots of each cause alone, on the circle with its largest effect."""
    panels = []
    for share in test.shares:
        key = share.cause, share.location
        if key not in test.circles[0].moved:
            continue
        worst = max(test.circles, key=lambda m: float(np.ptp(m.moved[key])))
        alike = [m for m in test.circles if _same(m, worst)]
        group = [next(m for m in alike if m.circle.sense == s) for s in _senses(alike)]
        by = _magnified(worst.circle.radius, *(m.moved[key] for m in group))
        lines = [
            _drawn(
                m,
                m.moved[key],
                by,
                m.circle.sense,
                CALIBRATED if m.circle.anticlockwise else BEFORE,
                "solid" if m.circle.anticlockwise else "dash",
            )
            for m in group
        ]
        title = f"{called(*key)}: {worst.circle.plane}"
        panels.append(_panel(title, worst, by, [_nominal(worst), *lines]))
    if not panels:
        return []
    caption = "Deviation that disappears without the cause, in the plane where it is largest."
    return [Figure("cause_circles", "Each cause alone", caption, tuple(panels))]


def _same(one: Measured, other: Measured) -> bool:
    near = abs(one.circle.feed - other.circle.feed) < 0.2 * other.circle.feed
    return one.circle.plane == other.circle.plane and near


def _senses(circles: list[Measured]) -> list[str]:
    return sorted({m.circle.sense for m in circles})


def _panel(title: str, m: Measured, by: float, lines: list[Line]) -> Panel:
    plane = m.circle.plane
    first, second = (plane[0], plane[1]) if len(plane) == 2 else ("u", "v")
    edge = 1e3 * m.circle.radius * (1 + 1.2 * _HIGH)
    return Panel(
        f"{title}, deviations × {by:,.0f}",
        Axis(f"{first} from the centre [mm]", low=-edge, high=edge),
        Axis(f"{second} [mm]", low=-edge, high=edge),
        tuple(lines),
        equal=True,
        tall=1.4,
    )


def _nominal(m: Measured) -> Line:
    turn = np.linspace(0, 2 * np.pi, 181)
    return Line("nominal circle", *_round(m, turn, np.zeros(len(turn))), PAPER, "dash")


def _drawn(m: Measured, radial: Array, by: float, name: str, colour: str, dash: str) -> Line:
    return Line(name, *_round(m, m.circle.angle, by * radial), colour, dash)


def _round(m: Measured, angle: Array, out: Array) -> tuple[Array, Array]:
    radius = 1e3 * (m.circle.radius + out)
    return radius * np.cos(angle), radius * np.sin(angle)


def _magnified(radius: float, *radial: Array) -> float:
    """Round magnification that draws the largest deviation at up to `_HIGH` of the radius."""
    most = max(float(np.abs(each).max()) for each in radial)
    whole = _HIGH * radius / max(most, 1e-9)
    power = 10.0 ** np.floor(np.log10(whole))
    return float(max(step for step in _STEPS if step * power <= whole) * power)


def _name(m: Measured) -> str:
    return f"{m.circle.plane}, {m.circle.sense}"


def _um(value: float) -> str:
    return f"{_UM * value:.1f}".replace("-", "\u2212")


_TERMS = Table(
    "terms",
    "",
    ("term", "meaning"),
    (
        (
            "circular deviation G",
            "ISO 230-4: largest less smallest radius of one actual path, about the centre of its "
            "least squares circle.",
        ),
        (
            "circular hysteresis H",
            "ISO 230-4: largest radial difference between the paths of the two senses, about the "
            "centre of their common least squares circle.",
        ),
        (
            "radial deviation F",
            "ISO 230-4: actual less nominal radius, from the least to the greatest, the centre by "
            "least squares.",
        ),
        (
            "dimensions",
            (
                "Deviations of the identified dimensions from their nominal values, as far as "
                "none is a cause of its own. Parts are never exactly as drawn; a calibration "
                "corrects them. A share is the mean over all orders in which the causes can be "
                "removed, so that shares add up; removed first, a cause may take away less."
            ),
        ),
        (
            "not explained, measurement noise",
            (
                "Error that the extended model leaves, split by variance into noise of readings "
                "and rest positions, and the remainder."
            ),
        ),
    ),
    words=(0, 1),
)
