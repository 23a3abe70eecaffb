"""Description of a figure, independent of the renderer: arrays with axes, names and units.

Colours are those of Okabe and Ito, which are distinct for every kind of colour vision; lines also
differ in their dashes and points in their symbols, so that a grey print is readable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

BEFORE, CALIBRATED, EXTENDED = "#d55e00", "#0072b2", "#007a5a"
PLUS, MINUS, THIRD = "#0072b2", "#d55e00", "#9a4f7f"
PAPER, GREY, INK = "#6b6b6b", "#9aa0a6", "#1a1a1a"
SERIES = (CALIBRATED, BEFORE, EXTENDED, THIRD, "#8a6d00", "#4aa3d8")
SYMBOLS = ("circle", "diamond", "square", "triangle", "cross")


@dataclass(frozen=True)
class Axis:
    """Axis of a panel; its title contains the unit in square brackets."""

    title: str
    log: bool = False
    low: float | None = None
    high: float | None = None
    names: tuple[str, ...] = ()  # names of the positions 0, 1, ... on an axis of names

    @classmethod
    def side_by_side(cls, title: str, names: tuple[str, ...]) -> Axis:
        """Axis of names with a margin at both ends, so that the first and last are not cut off."""
        return cls(title, names=names, low=-0.5, high=len(names) - 0.5)


@dataclass(frozen=True)
class Scale:
    """Colour scale of a field, shared by panels."""

    title: str
    low: float
    high: float
    log: bool = False
    diverging: bool = False


@dataclass(frozen=True)
class Points:
    """Separate samples."""

    name: str
    x: Array  # (n,)
    y: Array  # (n,)
    colour: str = CALIBRATED
    symbol: str = "circle"
    size: float = 4.0
    error: Array | None = None  # (n,) half-width of the bar: along x if y has names, else along y
    told: tuple[str, ...] = ()  # hover text of each point
    edge: bool = False  # whether points have an outline, to be visible on a field


@dataclass(frozen=True)
class Line:
    """A curve, with a band about it if `low` and `high` are given."""

    name: str
    x: Array  # (n,)
    y: Array  # (n,)
    colour: str = CALIBRATED
    dash: str = "solid"  # solid, dash, dot
    low: Array | None = None  # (n,)
    high: Array | None = None  # (n,)


@dataclass(frozen=True)
class Bars:
    """Horizontal bars from zero, one at each name of the y axis."""

    name: str
    place: Array  # (n,) indices of the names
    length: Array  # (n,)
    colour: str = CALIBRATED
    told: tuple[str, ...] = ()


@dataclass(frozen=True)
class Field:
    """Values over a plane; NaN where nothing is known."""

    name: str
    x: Array  # (k,)
    y: Array  # (m,)
    value: Array  # (m, k)
    scale: Scale
    told: tuple[tuple[str, ...], ...] = ()  # (m, k) hover texts


@dataclass(frozen=True)
class Rule:
    """Reference line at a value, across the whole panel."""

    name: str
    value: float
    colour: str = PAPER
    dash: str = "dash"
    upright: bool = False  # vertical line at a value of x
    at: float = 1.0  # position of its name along the line, 0 to 1
    side: str = "center"  # side of its name, of a vertical line (left, center, right)


def course(
    name: str, x: Array, y: Array, colour: str, dash: str, symbol: str
) -> tuple[Line, Points]:
    """Line with points on it for a short series, with one legend entry."""
    return Line(name, x, y, colour, dash), Points("", x, y, colour, symbol, 7.0)


Mark = Points | Line | Bars | Field | Rule


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    equal: bool = False  # equal scale along x and y
    tall: float = 1.0  # height relative to the usual one

    def renamed(self, name: Callable[[str], str]) -> Panel:
        """Copy with the title, the axes and the names of marks translated by a function."""
        x, y = (
            replace(axis, title=name(axis.title), names=tuple(map(name, axis.names)))
            for axis in (self.x, self.y)
        )
        marks = tuple(replace(mark, name=name(mark.name)) for mark in self.marks)
        return replace(self, title=name(self.title), x=x, y=y, marks=marks)


@dataclass(frozen=True)
class Figure:
    """Figure of one or more panels; `name` is its file name."""

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 2  # on a wide page

    def renamed(self, name: Callable[[str], str]) -> Figure:
        """Copy with titles, caption, axes and names of marks translated by a function."""
        panels = tuple(panel.renamed(name) for panel in self.panels)
        title, caption = name(self.title), name(self.caption)
        return replace(self, title=title, caption=caption, panels=panels)

    @property
    def scale(self) -> Scale | None:
        """Colour scale shared by the fields of the figure; None without fields."""
        marks = (mark for panel in self.panels for mark in panel.marks)
        return next((mark.scale for mark in marks if isinstance(mark, Field)), None)

    @property
    def legend(self) -> tuple[Points | Line | Bars, ...]:
        """One mark of each name; empty if there is only one name."""
        named: dict[str, Points | Line | Bars] = {}
        for panel in self.panels:
            for mark in panel.marks:
                if isinstance(mark, Points | Line | Bars) and mark.name:
                    named.setdefault(mark.name, mark)
        return tuple(named.values()) if len(named) > 1 else ()
