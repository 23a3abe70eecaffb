"""Figures as PNG files by matplotlib, without browser and network.

(Plotly's own export needs Chrome, which a cell's computer rarely has.)
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from delta_calibration.errors import InputError
from delta_calibration.report.browser import ticks_of
from delta_calibration.report.document import Report
from delta_calibration.report.drawing import (
    INK,
    Axis,
    Bars,
    Field,
    Figure,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Scale,
)
from delta_calibration.report.missing import required

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure as Canvas

Style = dict[str, Any]

DPI = 150
_LOW = 0.6  # relative height of a panel below which tick labels would overlap
_THIN = 0.06  # height over width of the data below which there is room for one label
_FEW = 24  # names for which an axis has room
_NARROW = 100.0  # ratio of a logarithmic axis' ends below which 2 and 5 are labelled as well
_WIDE, _TALL = 4.6, 3.5  # [inch] size of a panel
_ALONE = 7.5  # [inch] width of a panel that fills the page
_SYMBOLS = {"circle": "o", "diamond": "D", "square": "s", "triangle": "^", "cross": "x"}
_DASHES = {"solid": "-", "dash": "--", "dot": ":"}
STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "grid.color": "#e6e6e6",
    "axes.axisbelow": True,
    "legend.frameon": False,
    "text.parse_math": False,  # a dollar in a name is not mathematics
}


def write_figures(report: Report, folder: Path) -> tuple[Path, ...]:
    """Write the figures of a report as PNG files to a folder, which is created if necessary.

    Raises:
        InputError: matplotlib is not installed, or the folder cannot be written.
    """
    pyplot = required("matplotlib.pyplot", "figures as PNG")
    required("matplotlib").use("Agg")
    paths = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with pyplot.rc_context(STYLE):
            for figure in report.figures():
                path = folder / f"{figure.name}.png"
                canvas = draw(figure)
                canvas.savefig(path, dpi=DPI)
                pyplot.close(canvas)
                paths.append(path)
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {error.strerror or error}") from error
    return tuple(paths)


def draw(figure: Figure) -> Canvas:
    """Draw a figure on a matplotlib canvas."""
    pyplot = required("matplotlib.pyplot", "figures as PNG")
    columns = min(figure.columns, len(figure.panels))
    rows = -(-len(figure.panels) // columns)
    tall = max(panel.tall for panel in figure.panels)
    canvas: Canvas
    canvas, every = pyplot.subplots(
        rows,
        columns,
        squeeze=False,
        layout="constrained",
        figsize=(_ALONE if figure.columns == 1 else _WIDE * columns, _TALL * tall * rows + 0.7),
    )
    canvas.suptitle(figure.title, x=0.01, ha="left", weight="bold")
    for axes, panel in zip(every.flat, figure.panels, strict=False):
        _panel(axes, panel)
    for axes in every.flat[len(figure.panels) :]:
        axes.set_visible(False)
    _bars(canvas, every.flat, figure)
    if figure.legend:
        handles, names = every.flat[0].get_legend_handles_labels()
        canvas.legend(handles, names, loc="outside lower left", ncols=4, fontsize=8)
    return canvas


def _bars(canvas: Canvas, every: Iterable[Axes], figure: Figure) -> None:
    """Add a colour bar for every scale, beside the panels that use it."""
    of: dict[Scale, list[Axes]] = {}
    for axes, panel in zip(every, figure.panels, strict=False):
        for mark in panel.marks:
            if isinstance(mark, Field):
                of.setdefault(mark.scale, []).append(axes)
    for scale, panels in of.items():
        bar = canvas.colorbar(panels[0].collections[0], ax=panels, shrink=0.9)
        ticks = ticks_of(scale)
        bar.set_ticks(ticks, labels=[f"{t:g}" for t in ticks], minor=False)
        bar.set_label(scale.title)


def _panel(axes: Axes, panel: Panel) -> None:
    axes.set_title(panel.title, loc="left", fontsize=9)
    _axis(axes, "x", panel.x)
    _axis(axes, "y", panel.y)
    for mark in panel.marks:
        _mark(axes, panel, mark)
    if panel.y.names:
        axes.set_ylim(len(panel.y.names) - 0.4, -0.6)
    if panel.equal:
        axes.set_aspect("equal")
        if panel.tall < _LOW:
            axes.locator_params(axis="y", nbins=2)
        if axes.get_data_ratio() < _THIN:
            axes.set_yticks([float(f"{np.mean(axes.get_ylim()):.2g}")])


def _axis(axes: Axes, which: str, axis: Axis) -> None:
    settings: Style = {f"{which}label": axis.title}
    if axis.log:
        settings[f"{which}scale"] = "log"
    if axis.low is not None and axis.high is not None:
        settings[f"{which}lim"] = (axis.low, axis.high)
    axes.set(**settings)
    if axis.log:
        own = axes.xaxis if which == "x" else axes.yaxis
        own.set_major_formatter(lambda value, _: f"{value:g}")
        own.set_minor_formatter(lambda value, _: "")
        if axis.low is not None and axis.high is not None and axis.high < _NARROW * axis.low:
            locator = required("matplotlib.ticker", "figures as PNG").LogLocator
            own.set_major_locator(locator(subs=(1.0, 2.0, 5.0)))
    if axis.names:
        ticks = axes.set_yticks if which == "y" else axes.set_xticks
        step = max(1, len(axis.names) // _FEW)
        ticks(range(0, len(axis.names), step), axis.names[::step])
        axes.grid(visible=False, axis="y" if which == "y" else "x")


def _mark(axes: Axes, panel: Panel, mark: Mark) -> None:
    name = mark.name or "_nolegend_"
    match mark:
        case Points():
            style: Style = {"color": mark.colour, "marker": _SYMBOLS[mark.symbol], "label": name}
            edge: Style = {"mec": INK, "mew": 0.5} if mark.edge else {"alpha": 0.75}
            axes.plot(mark.x, mark.y, linestyle="", ms=mark.size * 0.7, **style, **edge)
            if mark.error is not None:
                way: Style = {"xerr" if panel.y.names else "yerr": mark.error}
                axes.errorbar(mark.x, mark.y, fmt="none", ecolor=mark.colour, capsize=2, **way)
        case Line():
            if mark.low is not None and mark.high is not None:
                axes.fill_between(mark.x, mark.low, mark.high, color=mark.colour, alpha=0.18, lw=0)
            axes.plot(mark.x, mark.y, color=mark.colour, ls=_DASHES[mark.dash], label=name)
        case Bars():
            axes.barh(mark.place, mark.length, color=mark.colour, height=0.65, label=name)
        case Field():
            _field(axes, mark)
        case Rule():
            _rule(axes, mark)


def _rule(axes: Axes, mark: Rule) -> None:
    """Draw a line across the panel, with its name at its end."""
    style: Style = {"color": mark.colour, "ls": _DASHES[mark.dash], "lw": 1.2}
    words: Style = {"color": mark.colour, "fontsize": 7, "va": "bottom"}
    if mark.upright:
        axes.axvline(mark.value, **style)
        place = axes.get_xaxis_transform()
        end = {"left": "right", "center": "center", "right": "left"}[mark.side]
        axes.text(mark.value, mark.at, mark.name, transform=place, ha=end, **words)
    else:
        axes.axhline(mark.value, **style)
        place = axes.get_yaxis_transform()
        axes.text(mark.at, mark.value, mark.name, transform=place, ha="right", **words)


def _field(axes: Axes, mark: Field) -> None:
    colors = required("matplotlib.colors", "figures as PNG")
    scale = mark.scale
    norm = (colors.LogNorm if scale.log else colors.Normalize)(scale.low, scale.high)
    value = np.clip(mark.value, scale.low, scale.high)
    colours = "PuOr" if scale.diverging else "viridis"
    axes.pcolormesh(mark.x, mark.y, value, norm=norm, cmap=colours, shading="nearest")
