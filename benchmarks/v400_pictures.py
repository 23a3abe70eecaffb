"""Pictures of the V400: mesh residuals, and uncertainty of nine parameters from 19 data."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    GREY,
    Axis,
    Bars,
    Field,
    Figure,
    Panel,
    Points,
    Rule,
    Scale,
)
from real_v400 import AUGUST, MEASURED, NINE, PRINTER, Array, beyond_geometry, fit, mesh, rms

MM = 1e3


def figures(root: Path) -> list[Figure]:
    """Figures of the meshes, then of the parameters."""
    return [_meshes(root), _parameters(root)]


def _meshes(root: Path) -> Figure:
    nodes = [mesh(root / day) for day in AUGUST]
    place = nodes[0].place
    one, two = (beyond_geometry(m) for m in nodes)
    shown = {
        "first mesh of August": one,
        "second mesh of August": two,
        "their mean: what stays": (one + two) / 2,
        "half their difference: what does not": (one - two) / 2,
    }
    scale = Scale("height [mm]", -0.12, 0.12, diverging=True)
    panels = [
        Panel(
            f"{name}, {rms(error) * MM:.3f} mm RMS",
            Axis("x [mm]"),
            Axis("y [mm]"),
            (Field("", *_gridded(place, MM * error), scale),),
            equal=True,
        )
        for name, error in shown.items()
    ]
    return Figure(
        "v400_meshes",
        "Bed meshes beyond what the nine parameters can do",
        "Height errors probed on two occasions in August 2023, less what a change of geometry "
        "could have made of each.",
        tuple(panels),
    )


def _gridded(place: Array, value: Array) -> tuple[Array, Array, Array]:
    """Axes [mm] and grid of nodes (n, 2) [m] with values (n,); NaN where there is no node."""
    x, y = (np.unique(np.round(MM * axis, 3)) for axis in place.T)
    grid = np.full((len(y), len(x)), np.nan)
    column, row = (
        np.searchsorted(axis, np.round(MM * of, 3))
        for axis, of in zip((x, y), place.T, strict=True)
    )
    grid[row, column] = value
    return x, y, grid


def _parameters(root: Path) -> Figure:
    alone, believed = (fit(root / MEASURED, priors) for priors in (False, True))
    prior = PRINTER.parameters.prior[NINE]
    names = tuple(name.replace("_", " ") for name in believed.names)
    place = np.arange(float(len(names)))
    nominal = PRINTER.parameters.nominal[NINE]
    moved = [(each.machine.geometry[NINE] - nominal) / prior for each in (alone, believed)]
    kinds = (("data alone", BEFORE, "diamond", -0.15), ("with priors", CALIBRATED, "circle", 0.15))
    values = [
        Points(name, value, place + aside, colour, symbol, 8.0, 1.96 * each.std / prior)
        for (name, colour, symbol, aside), value, each in zip(
            kinds, moved, (alone, believed), strict=True
        )
    ]
    return Figure(
        "v400_parameters",
        "How little 19 data say about nine parameters",
        "Left: deviations from the drawing with 95 % intervals, in units of what is expected of "
        "the part. Right: how uncertain each still is, over how uncertain it was.",
        (
            Panel(
                "found, in expected sizes",
                Axis("deviation over its prior standard deviation [1]", low=-4.5, high=4.5),
                Axis("", names=names),
                (*values, Rule("", 0.0, upright=True)),
            ),
            Panel(
                "with priors",
                Axis("standard deviation after over before [1]", low=0.0, high=1.05),
                Axis("", names=names),
                (
                    Bars("", place, believed.std / prior, GREY),
                    Rule("nothing said", 1.0, upright=True),
                ),
            ),
        ),
    )
