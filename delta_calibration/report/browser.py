"""Conversion of panels to plotly: SVG traces only, all text escaped, no use of a network."""

from __future__ import annotations

from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.report.drawing import (
    INK,
    Axis,
    Bars,
    Field,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Scale,
)

Array = NDArray[np.float64]
Trace = dict[str, Any]

FONT = "system-ui, -apple-system, 'Segoe UI', 'Noto Sans', 'DejaVu Sans', sans-serif"
HEIGHT = 300  # [px] of a usual panel
_GRID, _LINE = "#e6e6e6", "#4d4d4d"
_DIVERGING = [[0.0, "#b35806"], [0.5, "#f7f7f7"], [1.0, "#542788"]]  # orange, white, purple
_SYMBOLS = {"triangle": "triangle-up"}
_TICKS = (1.0, 2.0, 5.0)
_TICKED, _LEAST = 7, 3  # number of ticks of a usual axis, and of a short one
_NARROW = 100.0  # ratio of an axis' ends below which ticks at the decades alone are too few
_PLAIN = 1e4  # high end above which an axis is labelled in powers of ten
_LOW = 0.7  # relative height of a panel below which there is room for few ticks only
_FEW = 16  # names that an axis has room for on a narrow page
_END_BESIDE = {"left": "right", "center": "center", "right": "left"}  # of a name, at its rule


def plot_of(panel: Panel) -> dict[str, Any]:
    """Convert a panel to `data` and `layout` of plotly."""
    marks = [trace for mark in panel.marks for trace in _traces(mark)]
    rules = [mark for mark in panel.marks if isinstance(mark, Rule)]
    above = any(rule.upright and rule.name for rule in rules)
    layout: dict[str, Any] = {
        "font": {"family": FONT, "size": 12, "color": INK},
        "height": round(HEIGHT * panel.tall),
        "margin": {"l": 8, "r": 12, "t": 22 if above else 8, "b": 8},
        "paper_bgcolor": "#ffffff",
        "plot_bgcolor": "#ffffff",
        "showlegend": False,  # a single legend for the whole figure stands beside it
        "hovermode": "closest",
        "hoverlabel": {"font": {"family": FONT, "size": 12}},
        "dragmode": "zoom",
        "barmode": "overlay",
        "bargap": 0.35,
        "xaxis": _axis(panel.x),
        "yaxis": _axis(panel.y),
        "shapes": [_rule(rule) for rule in rules],
        "annotations": [_rule_name(rule, panel) for rule in rules if rule.name],
    }
    if panel.tall < _LOW:
        layout["yaxis"]["nticks"] = 4
    if panel.y.names:
        layout["yaxis"]["autorange"] = "reversed"
        layout["yaxis"]["automargin"] = True
    if panel.equal:
        layout["yaxis"] |= _few_names(panel.y)  # as high as it is wide
        layout["yaxis"] |= {"scaleanchor": "x", "constrain": "domain"}
        layout["xaxis"] |= {"constrain": "domain", "tickangle": 0, **_few_across(panel)}
        if panel.y.names and 0 < (shape := _shape(panel)) < np.inf:
            layout["meta"] = {"shape": shape}  # the page makes it no higher than it need be
    return {"data": marks, "layout": layout}


def _shape(panel: Panel) -> float:
    """Height over width of the drawn data; 0 if they are flat along x, or if there are none."""
    drawn = [mark for mark in panel.marks if isinstance(mark, Points | Line | Field)]
    wide, high = (
        _extent(np.concatenate(each)) if each else 0.0
        for each in ([mark.x for mark in drawn], [mark.y for mark in drawn])
    )
    return high / wide if wide > 0 else np.inf if high > 0 else 0.0


def _few_across(panel: Panel) -> dict[str, Any]:
    """Fewer ticks along x where a panel of one scale is much higher than wide."""
    shape = _shape(panel)
    return {"nticks": max(_LEAST, round(_TICKED * min(1 / shape, 1.0)))} if shape > 0 else {}


def _extent(values: Array) -> float:
    """Range of the finite values."""
    finite = values[np.isfinite(values)]
    return float(np.ptp(finite)) if finite.size else 0.0


def _axis(axis: Axis) -> dict[str, Any]:
    shown: dict[str, Any] = {
        "title": {"text": escape(axis.title), "standoff": 6, "font": {"size": 12}},
        "automargin": True,
        "gridcolor": _GRID,
        "linecolor": _LINE,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "tickcolor": _LINE,
        "zeroline": False,
        "nticks": _TICKED,
    }
    if axis.log:
        shown |= {"type": "log", **_decade_ticks(axis)}
        shown["exponentformat"] = "power" if (axis.high or 1.0) > _PLAIN else "none"
        shown["minor"] = {"ticks": "outside", "ticklen": 2, "dtick": "D1"}
    if axis.low is not None and axis.high is not None:
        ends = [axis.low, axis.high]
        shown["range"] = np.log10(ends).tolist() if axis.log else ends
    if axis.names:
        shown |= {"tickmode": "array", "ticks": "", "showgrid": False}
        shown |= _few_names(axis, 2 * _FEW)
        shown.pop("nticks")
    return shown


def _few_names(axis: Axis, most: int = _FEW) -> dict[str, Any]:
    """Tick names of an axis; only every n-th if there are more than `most`."""
    step = -(-len(axis.names) // _FEW) if len(axis.names) > most else 1
    if not axis.names:
        return {}
    return {
        "tickvals": list(range(0, len(axis.names), step)),
        "ticktext": [escape(name) for name in axis.names[::step]],
    }


def _decade_ticks(axis: Axis) -> dict[str, Any]:
    """Ticks at decades; if few, at 1, 2 and 5 of each, in full (plotly omits their power)."""
    if axis.low is None or axis.high is None or axis.high >= _NARROW * axis.low:
        return {"dtick": 1}
    ticks = ticks_of(Scale("", axis.low, axis.high, log=True))
    return {"tickmode": "array", "tickvals": ticks, "ticktext": [f"{t:g}" for t in ticks]}


def _traces(mark: Mark) -> list[Trace]:
    match mark:
        case Points():
            return [_points(mark)]
        case Line():
            return _line(mark)
        case Bars():
            return [_bars(mark)]
        case Field():
            return [_field(mark)]
        case Rule():
            return []


def _points(mark: Points) -> Trace:
    symbol = _SYMBOLS.get(mark.symbol, mark.symbol)
    trace: Trace = {
        "type": "scatter",
        "mode": "markers",
        "name": escape(mark.name),
        "x": numbers(mark.x),
        "y": numbers(mark.y),
        "marker": {
            "color": mark.colour,
            "size": mark.size,
            "symbol": symbol,
            "opacity": 1.0 if mark.edge else 0.75,
            "line": {"width": 1.0 if mark.edge else 0.0, "color": INK},
        },
    }
    if mark.error is not None:
        along = "error_x" if mark.told else "error_y"
        trace[along] = {
            "type": "data",
            "array": numbers(mark.error),
            "color": mark.colour,
            "thickness": 1.2,
            "width": 3,
        }
    return _told(trace, mark.told)


def _told(trace: Trace, told: tuple[str, ...]) -> Trace:
    """Add hover texts; without any, plotly shows the coordinates."""
    if not told:
        return trace
    text = [escape(each) for each in told]
    return {**trace, "text": text, "hovertemplate": "%{text}<extra></extra>"}


def _line(mark: Line) -> list[Trace]:
    line = {"color": mark.colour, "width": 2, "dash": mark.dash}
    x, y = numbers(mark.x), numbers(mark.y)
    own: Trace = {
        "type": "scatter",
        "mode": "lines",
        "name": escape(mark.name),
        "x": x,
        "y": y,
        "line": line,
    }
    if mark.low is None or mark.high is None:
        return [own]
    band: Trace = {
        "type": "scatter",
        "mode": "lines",
        "x": x + x[::-1],
        "y": numbers(mark.low) + numbers(mark.high)[::-1],
        "fill": "toself",
        "fillcolor": _faint(mark.colour),
        "line": {"width": 0},
        "hoverinfo": "skip",
    }
    return [band, own]


def _faint(colour: str) -> str:
    r, g, b = (int(colour[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({r},{g},{b},0.18)"


def _bars(mark: Bars) -> Trace:
    trace: Trace = {
        "type": "bar",
        "orientation": "h",
        "name": escape(mark.name),
        "x": numbers(mark.length),
        "y": numbers(mark.place),
        "marker": {"color": mark.colour},
        "textposition": "none",
    }
    return _told(trace, mark.told)


def _field(mark: Field) -> Trace:
    scale = mark.scale
    with np.errstate(divide="ignore", invalid="ignore"):
        value = np.log10(mark.value) if scale.log else mark.value
    low, high = np.log10([scale.low, scale.high]) if scale.log else (scale.low, scale.high)
    shown = [["" if np.isnan(v) else f"{v:.3g}" for v in row] for row in mark.value]
    told = [[escape(text) for text in row] for row in mark.told]
    return {
        "type": "heatmap",
        "name": escape(mark.name),
        "x": numbers(mark.x),
        "y": numbers(mark.y),
        "z": [numbers(row) for row in value],
        "zmin": float(low),
        "zmax": float(high),
        "colorscale": _DIVERGING if scale.diverging else "Viridis",
        "showscale": False,  # one for the whole figure stands beside it
        "hoverongaps": False,
        "text": told or shown,
        "hovertemplate": f"{'' if told else '%{x:.4g}, %{y:.4g}: '}%{{text}}<extra></extra>",
    }


def ticks_of(scale: Scale) -> list[float]:
    """Round values of a scale: 1, 2 and 5 of each decade, or five equal steps."""
    if not scale.log:
        return [float(t) for t in np.linspace(scale.low, scale.high, 5)]
    decades = range(int(np.floor(np.log10(scale.low))), int(np.ceil(np.log10(scale.high))) + 1)
    every = [first * 10.0**decade for decade in decades for first in _TICKS]
    return [float(t) for t in every if scale.low <= t * 1.001 and t <= scale.high * 1.001]


def places_of(scale: Scale) -> list[tuple[str, float]]:
    """Labels of a scale's ticks, and their positions along it [%]."""
    of = np.log10 if scale.log else np.asarray
    low, high = of([scale.low, scale.high])
    return [
        (f"{t:g}".replace("-", "\u2212"), float(100 * (of(t) - low) / (high - low)))
        for t in ticks_of(scale)
    ]


def _rule(mark: Rule) -> dict[str, Any]:
    across = {"xref": "paper", "x0": 0, "x1": 1, "y0": mark.value, "y1": mark.value}
    up = {"yref": "paper", "y0": 0, "y1": 1, "x0": mark.value, "x1": mark.value}
    style = {"color": mark.colour, "width": 1.3, "dash": mark.dash}
    return {"type": "line", "layer": "above", "line": style, **(up if mark.upright else across)}


def _rule_name(mark: Rule, panel: Panel) -> dict[str, Any]:
    """Name of a rule at its end; plotly needs logarithms as positions on logarithmic axes here."""
    log = panel.x.log if mark.upright else panel.y.log
    value = float(np.log10(mark.value)) if log else mark.value
    end = _END_BESIDE[mark.side]
    place = (
        {"x": value, "yref": "paper", "y": mark.at, "xanchor": end, "yanchor": "bottom"}
        if mark.upright
        else {"xref": "paper", "x": mark.at, "y": value, "xanchor": "right", "yanchor": "bottom"}
    )
    font = {"size": 11, "color": mark.colour}
    box = {"bgcolor": "rgba(255,255,255,0.75)", "borderpad": 1}
    return {"text": escape(mark.name), "showarrow": False, "font": font, **place, **box}


def numbers(values: Array) -> list[float | None]:
    """Numbers to five figures; None (a gap) for values that are not finite."""
    return [float(f"{v:.5g}") if np.isfinite(v) else None for v in np.asarray(values, dtype=float)]
