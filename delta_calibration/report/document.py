"""Data model of a report: sections of sentences, tables and figures, independent of drawing."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from delta_calibration.report.drawing import Figure


@dataclass(frozen=True)
class Table:
    """Table of texts with the units in the head; `name` is its file name."""

    name: str
    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    words: tuple[int, ...] = (0,)  # columns of words, aligned to the left


@dataclass(frozen=True)
class Section:
    """Section with heading, text, tables and figures."""

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    figures: tuple[Figure, ...] = ()

    def renamed(self, name: Callable[[str], str]) -> Section:
        """Copy with all texts, table cells and figures translated by a function."""
        tables = tuple(
            replace(t, rows=tuple(tuple(map(name, row)) for row in t.rows)) for t in self.tables
        )
        figures = tuple(figure.renamed(name) for figure in self.figures)
        return replace(self, text=tuple(map(name, self.text)), tables=tables, figures=figures)


@dataclass(frozen=True)
class Statement:
    """Question with its answer, at the top of a report."""

    question: str
    answer: str


@dataclass(frozen=True)
class KeyFigure:
    """Main result, displayed as a large number."""

    name: str
    value: str
    unit: str
    note: str = ""


@dataclass(frozen=True)
class Report:
    """Content of a report in its order; `data` is copied to the JSON file unchanged."""

    title: str
    subtitle: str
    sentence: str
    statements: tuple[Statement, ...]
    key_figures: tuple[KeyFigure, ...]
    sections: tuple[Section, ...]
    data: Mapping[str, Any] = field(default_factory=dict)
    signatures: tuple[str, ...] = ()  # who signs; if empty, the usual lines, on paper only

    def figures(self) -> Iterator[Figure]:
        """Every figure, in order."""
        for section in self.sections:
            yield from section.figures

    def tables(self) -> Iterator[Table]:
        """Every table, in order."""
        for section in self.sections:
            yield from section.tables
