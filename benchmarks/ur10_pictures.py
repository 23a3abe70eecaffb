"""Pictures for the page of the UR10: joint error curves and the gain of each extension."""

from __future__ import annotations

import numpy as np

from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    Axis,
    Figure,
    Line,
    Panel,
    Points,
    Rule,
)
from real_ur10 import Gained, Left, curve_of, without_course


def figures(lefts: dict[str, Left], gains: dict[str, list[Gained]]) -> list[Figure]:
    """Error curves of joints from both series; gain of each extension on held-out blocks."""
    return [_curves(lefts), _gains(gains)]


_STYLES = {"A": (CALIBRATED, "solid", "circle"), "C": (BEFORE, "dash", "diamond")}


def _curves(lefts: dict[str, Left]) -> Figure:
    panels = []
    for joint in (0, 1, 2, 4):
        marks = []
        for name, left in lefts.items():
            low, high = np.quantile(left.series.joint[:, joint], [0.02, 0.98])
            at = np.linspace(low, high, 400)
            curve = without_course(curve_of(left, joint, at))
            colour, dash, _ = _STYLES[name]
            marks.append(Line(f"series {name}", np.degrees(at), 1e3 * curve, colour, dash))
        panels.append(
            Panel(
                f"joint {joint + 1}",
                Axis("commanded angle [deg]"),
                Axis("error [mrad]", low=-1.2, high=1.2),
                (*marks, Rule("", 0.0)),
            )
        )
    return Figure(
        "ur10_curves",
        "Error of each joint over its own angle, found in two series apart",
        "Less a fourth-order course, which other parameters share.",
        tuple(panels),
    )


def _gains(gains: dict[str, list[Gained]]) -> Figure:
    names = tuple(gained.name for gained in next(iter(gains.values())))
    marks = []
    for i, (series, each) in enumerate(gains.items()):
        colour, _, symbol = _STYLES[series]
        place = np.arange(float(len(names))) + 0.3 * (i - 0.5)
        value, half = (1e3 * np.array([getattr(g, of) for g in each]) for of in ("gain", "half"))
        marks.append(Points(f"series {series}", value, place, colour, symbol, 8.0, half))
    return Figure(
        "ur10_gains",
        "Gain of each extension on blocks of time held out",
        "Mean over ten blocks with its 95 % interval.",
        (
            Panel(
                "",
                Axis("RMS gained over geometry alone [mm]"),
                Axis("", names=names),
                (*marks, Rule("", 0.0, upright=True)),
                tall=1.3,
            ),
        ),
        columns=1,
    )
