"""Figures of a certificate: error histogram, error vectors and certified uncertainty."""

from __future__ import annotations

from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.budget import certified
from delta_calibration.report.certificate import MM, Certificate
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    GREY,
    Axis,
    Field,
    Figure,
    Line,
    Panel,
    Points,
    Rule,
    Scale,
)
from delta_calibration.wording import figures

Array = NDArray[np.float64]

_BINS = 24
_FAR = 20.0  # ratio of largest to smallest error above which an axis is logarithmic
_NODES = 41  # nodes along a side of a map
_FLAT = 0.01  # [m] extent along an axis above which its planes are shown
_LONG = 0.09  # drawn length of the 95 % quantile of the errors, over the plane's width
_ROUND = (1.0, 2.0, 5.0, 10.0)
_AXES = "xyz"


def histogram_figure(certificate: Certificate) -> Figure:
    """Histogram of the errors before and after; on a logarithmic axis if they differ much."""
    before, after = MM * certificate.error_before, MM * certificate.error_after
    both = np.concatenate([before, after])
    low, high = max(0.8 * both.min(), 1e-3 * both.max()), 1.1 * both.max()
    log = bool(high > _FAR * low)
    ends = np.geomspace(low, high, _BINS + 1) if log else np.linspace(0.0, high, _BINS + 1)
    marks: list[Line | Rule] = [
        _steps(name, ends, values, colour, dash)
        for name, values, colour, dash in (
            ("before", before, BEFORE, "dash"),
            ("after", after, CALIBRATED, "solid"),
        )
    ]
    tolerance, beyond = certificate.about.tolerance, ""
    if tolerance is not None and MM * tolerance > ends[-1]:
        beyond = f"The tolerance of {MM * tolerance:g} mm lies outside the plot, to the right."
    elif tolerance is not None and MM * tolerance < ends[0]:
        beyond = f"The tolerance of {MM * tolerance:g} mm lies outside the plot, to the left."
    elif tolerance is not None:
        marks.append(Rule("tolerance", MM * tolerance, GREY, upright=True))
    axis = Axis("3-D error [mm]", log=log, low=float(ends[0]), high=float(ends[-1]))
    return Figure(
        "error_histogram",
        "Distribution of the errors",
        beyond,
        (Panel("", axis, Axis("points"), tuple(marks), tall=0.85),),
        columns=1,
    )


def _steps(name: str, ends: Array, values: Array, colour: str, dash: str) -> Line:
    count = np.histogram(np.clip(values, ends[0], ends[-1]), ends)[0].astype(float)
    height = np.repeat(np.concatenate([[0.0], count, [0.0]]), 2)[1:-1]
    return Line(name, np.repeat(ends, 2), height, colour, dash, np.zeros(len(height)), height)


def planes_of(places: Array) -> tuple[tuple[int, int], ...]:
    """Pairs of axes of the at most two widest planes in which poses (n, 3) spread."""
    extent = np.ptp(places, axis=0)
    wide = [k for k in range(3) if extent[k] > _FLAT]
    pairs = sorted(combinations(wide, 2), key=lambda pair: -extent[pair[0]] * extent[pair[1]])
    return tuple(pairs[:2])


def vector_figure(certificate: Certificate) -> Figure:
    """Error vectors at their points, in projections along an axis."""
    examined = certificate.examined
    target = examined.target
    planes = planes_of(target)
    panels = []
    scales = []
    for name, error, colour in (
        ("before", examined.before, BEFORE),
        ("after", examined.after, CALIBRATED),
    ):
        width = max((float(np.ptp(target[:, i])) for i, _ in planes), default=1.0)
        usual = float(np.quantile(np.linalg.norm(error, axis=1), 0.95))
        scale = _round_down(_LONG * width / max(usual, 1e-9))
        scales.append(f"{name} {figures(scale, 2)} times")
        panels += [
            _arrows(f"{name}, {_AXES[i]}{_AXES[j]}", target, scale * error, i, j, colour)
            for i, j in planes
        ]
    return Figure(
        "error_vectors",
        "Error vectors",
        f"Scale of the errors: {', '.join(scales)}. The dot is the commanded position.",
        tuple(panels),
    )


def _arrows(title: str, place: Array, error: Array, i: int, j: int, colour: str) -> Panel:
    gap = np.full(len(place), np.nan)
    x, y = (
        MM * np.column_stack([place[:, k], place[:, k] + error[:, k], gap]).ravel() for k in (i, j)
    )
    return Panel(
        title,
        Axis(f"{_AXES[i]} [mm]"),
        Axis(f"{_AXES[j]} [mm]"),
        (
            Line("", x, y, colour),
            Points("", MM * place[:, i], MM * place[:, j], "#1a1a1a", size=3.0),
        ),
        equal=True,
        tall=_tall(place, i, j),
    )


def _tall(place: Array, i: int, j: int) -> float:
    aspect = float(np.ptp(place[:, j])) / max(float(np.ptp(place[:, i])), 1e-9)
    return float(np.clip(0.2 + 1.0 * aspect, 0.45, 1.4))


def _round_down(value: float) -> float:
    decade = 10.0 ** np.floor(np.log10(value))
    return float(max(r for r in _ROUND if r * decade <= value * 1.001) * decade)


def certified_figure(certificate: Certificate) -> Figure:
    """Maps of the 95 % radius of corrected positions, in the planes that the machine works in."""
    examined = certificate.examined
    planes = planes_of(examined.target)
    maps = [_map(certificate, i, j) for i, j in planes]
    known = np.concatenate([values[np.isfinite(values)] for _, _, values in maps] or [np.zeros(0)])
    if not known.size:
        known = certificate.certified[np.isfinite(certificate.certified)]
    low, high = MM * float(known.min()), MM * float(known.max())
    scale = _scale(low, high)
    middle = np.median(examined.target, axis=0)
    panels = tuple(
        _certified_panel(examined.target, middle, scale, plane, drawn)
        for plane, drawn in zip(planes, maps, strict=True)
    )
    turned = any(k >= len(_AXES) for k in examined.robot.commanded.freedoms)
    steps = (
        " The platform is turned as at the nearest measured pose, so the radius changes in steps."
        if turned
        else ""
    )
    return Figure(
        "certified_map",
        "Corrected positions, 95 %",
        "Radius around the target that contains a corrected position with 95 % probability. "
        f"White: not measured, or out of reach. Dots: all measured poses.{steps}",
        panels,
    )


def _scale(low: float, high: float) -> Scale:
    """Scale from a round value below to one above, in four round steps."""
    step = _round_down(max(high - low, 0.05 * high) / 2)
    begin = np.floor(low / step) * step
    while begin + 4 * step < high:
        step *= 2
        begin = np.floor(low / step) * step
    ends = (float(f"{value:.6g}") for value in (begin, begin + 4 * step))
    return Scale("95 % radius [mm]", next(ends), next(ends))


def _map(certificate: Certificate, i: int, j: int) -> tuple[Array, Array, Array]:
    examined = certificate.examined
    target = examined.target
    x, y = (np.linspace(target[:, k].min(), target[:, k].max(), _NODES) for k in (i, j))
    nodes = np.tile(np.median(target, axis=0), (_NODES * _NODES, 1))
    nodes[:, i], nodes[:, j] = (grid.ravel() for grid in np.meshgrid(x, y))
    value = certified(examined, certificate.about, nodes)
    return x, y, value.reshape(_NODES, _NODES)


def _certified_panel(
    target: Array,
    middle: Array,
    scale: Scale,
    plane: tuple[int, int],
    drawn: tuple[Array, Array, Array],
) -> Panel:
    i, j = plane
    k = 3 - i - j
    x, y, value = drawn
    across = f", {_AXES[k]} = {MM * middle[k]:.0f} mm".replace("-", "−")
    return Panel(
        f"{_AXES[i]}{_AXES[j]}{across}",
        Axis(f"{_AXES[i]} [mm]"),
        Axis(f"{_AXES[j]} [mm]"),
        (
            Field("certified", MM * x, MM * y, MM * value, scale),
            Points("", MM * target[:, i], MM * target[:, j], "#ffffff", size=3.0, edge=True),
        ),
        equal=True,
        tall=_tall(target, i, j),
    )
