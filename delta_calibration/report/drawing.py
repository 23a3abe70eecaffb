"""What a figure shows, apart from what draws it: arrays with their axes, names and units.

Colours are those of Okabe and Ito, which stay apart for every kind of colour vision; lines differ
in their dashes and points in their symbols as well, so that a grey print can be read.
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
    """An axis, its unit within the title in square brackets."""

    title: str
    log: bool = False
    low: float | None = None
    high: float | None = None
    names: tuple[str, ...] = ()  # of the places 0, 1, ... where the axis holds names

    @classmethod
    def side_by_side(cls, title: str, names: tuple[str, ...]) -> Axis:
        """Names with room beside the first and the last, which else would be left away."""
        return cls(title, names=names, low=-0.5, high=len(names) - 0.5)


@dataclass(frozen=True)
class Scale:
    """Colours of a field, the same in all panels that share it."""

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
    error: Array | None = None  # (n,) either way along x where the axis of y holds names, else y
    told: tuple[str, ...] = ()  # of each point, shown when pointed at
    edge: bool = False  # drawn round, to be seen on a field


@dataclass(frozen=True)
class Line:
    """A curve, with a band about it where `low` and `high` are given."""

    name: str
    x: Array  # (n,)
    y: Array  # (n,)
    colour: str = CALIBRATED
    dash: str = "solid"  # solid, dash, dot
    low: Array | None = None  # (n,)
    high: Array | None = None  # (n,)


@dataclass(frozen=True)
class Bars:
    """Lengths along x from zero, one at each name of y."""

    name: str
    place: Array  # (n,) of the names
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
    told: tuple[tuple[str, ...], ...] = ()  # (m, k) shown when pointed at


@dataclass(frozen=True)
class Rule:
    """A value to compare with, right across the panel."""

    name: str
    value: float
    colour: str = PAPER
    dash: str = "dash"
    upright: bool = False  # a value of x
    at: float = 1.0  # where its name stands along it, 0 to 1
    side: str = "center"  # of an upright one: where its name stands beside it (left, right)


def course(
    name: str, x: Array, y: Array, colour: str, dash: str, symbol: str
) -> tuple[Line, Points]:
    """A few values in a row: a line with points on it, named once."""
    return Line(name, x, y, colour, dash), Points("", x, y, colour, symbol, 7.0)


Mark = Points | Line | Bars | Field | Rule


@dataclass(frozen=True)
class Panel:
    """One pair of axes."""

    title: str
    x: Axis
    y: Axis
    marks: tuple[Mark, ...]
    equal: bool = False  # a metre is as long along x as along y
    tall: float = 1.0  # height over the usual one

    def renamed(self, name: Callable[[str], str]) -> Panel:
        """The same with all its words changed."""
        x, y = (
            replace(axis, title=name(axis.title), names=tuple(map(name, axis.names)))
            for axis in (self.x, self.y)
        )
        marks = tuple(replace(mark, name=name(mark.name)) for mark in self.marks)
        return replace(self, title=name(self.title), x=x, y=y, marks=marks)


@dataclass(frozen=True)
class Figure:
    """Panels that belong together. `name` is that of its files."""

    name: str
    title: str
    caption: str
    panels: tuple[Panel, ...]
    columns: int = 2  # on a wide page

    def renamed(self, name: Callable[[str], str]) -> Figure:
        """The same with all its words changed: titles, axes, names of marks and of places."""
        panels = tuple(panel.renamed(name) for panel in self.panels)
        title, caption = name(self.title), name(self.caption)
        return replace(self, title=title, caption=caption, panels=panels)

    @property
    def scale(self) -> Scale | None:
        """Of its fields; they share it."""
        marks = (mark for panel in self.panels for mark in panel.marks)
        return next((mark.scale for mark in marks if isinstance(mark, Field)), None)

    @property
    def legend(self) -> tuple[Points | Line | Bars, ...]:
        """One mark of each name; none where a single name says nothing."""
        named: dict[str, Points | Line | Bars] = {}
        for panel in self.panels:
            for mark in panel.marks:
                if isinstance(mark, Points | Line | Bars) and mark.name:
                    named.setdefault(mark.name, mark)
        return tuple(named.values()) if len(named) > 1 else ()
