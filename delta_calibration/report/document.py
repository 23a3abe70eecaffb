"""A report as data: sections of sentences, tables and figures, before anything is drawn."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from delta_calibration.report.drawing import Figure


@dataclass(frozen=True)
class Table:
    """Rows as they are shown; numbers with their units in the head. `name` is that of its file."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: tuple[int, ...] = (0,)  # columns that hold words: set to the left


@dataclass(frozen=True)
class Section:
    """A heading with what belongs under it."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()

    def renamed(self, name: Callable[[str], str]) -> Section:
        """The same with what it says in other words."""
        tables = tuple(
            replace(t, rows=tuple(tuple(map(name, row)) for row in t.rows)) for t in self.tables
        )
        figures = tuple(figure.renamed(name) for figure in self.figures)
        return replace(self, text=tuple(map(name, self.text)), tables=tables, figures=figures)


@dataclass(frozen=True)
class Statement:
    """One of the answers on top."""

    question: str
    answer: str


@dataclass(frozen=True)
class KeyFigure:
    """A number that is read from across the room."""

    name: str
    value: str
    unit: str
    note: str = ""


@dataclass(frozen=True)
class Report:
    """All that a page shows, in its order. `data` goes into the JSON as it is."""

    title: str
    subtitle: str
    sentence: str
    statements: tuple[Statement, ...]
    key_figures: tuple[KeyFigure, ...]
    sections: tuple[Section, ...]
    data: Mapping[str, Any] = field(default_factory=dict)
    signatures: tuple[str, ...] = ()  # who signs; none: the usual lines, on paper

    def figures(self) -> Iterator[Figure]:
        """Every figure, in order."""
        for section in self.sections:
            yield from section.figures

    def tables(self) -> Iterator[Table]:
        """Every table, in order."""
        for section in self.sections:
            yield from section.tables
