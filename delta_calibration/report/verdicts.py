"""Comparison of verdicts in the order given; a single one gives a short report."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from delta_calibration.diagnosis.verdict import Finding
from delta_calibration.report.document import Report, Section, Table
from delta_calibration.report.drawing import (
    BEFORE,
    CALIBRATED,
    EXTENDED,
    PAPER,
    SERIES,
    SYMBOLS,
    Axis,
    Figure,
    Panel,
    Points,
    course,
)
from delta_calibration.report.drift import UNITS
from delta_calibration.report.glossary import glossary_section
from delta_calibration.report.verdict_file import VerdictFile
from delta_calibration.report.words import estimate, key_figures, statements
from delta_calibration.wording import listed, mm, spoken, sure, unit_in

Array = NDArray[np.float64]
Values = dict[str, list[tuple[int, float, float]]]  # number of the file, value, std


def drift_of_verdicts(files: Sequence[VerdictFile]) -> Report:
    """Report on verdicts in the order given: errors, noise, findings and their values."""
    last = files[-1]
    one = len(files) == 1
    sections = [
        Section("verdicts", "Verdicts", (), (_verdict_table(files), _findings_table(files)))
    ]
    if not one:
        shown = (_errors_figure(files), *_values_figures(files))
        sections[0] = Section("verdicts", "Verdicts", (), sections[0].tables, shown)
    return Report(
        title="Verdict" if one else f"Comparison of {len(files)} verdicts",
        subtitle=listed(file.name for file in files),
        sentence=last.verdict.sentence() if one else f"{last.name}: {last.verdict.sentence()}",
        statements=statements(last.verdict),
        key_figures=key_figures(last.verdict),
        sections=(*sections, glossary_section()),
        data={"verdicts": {file.name: file.verdict.as_dict() for file in files}},
    )


def _verdict_table(files: Sequence[VerdictFile]) -> Table:
    rows = tuple(
        (
            file.name,
            *(
                mm(value)
                for value in (
                    file.verdict.baseline.held_out_rms_mm,
                    file.verdict.calibrated.held_out_rms_mm,
                    file.verdict.extended.held_out_rms_mm,
                    file.verdict.noise_mm,
                )
            ),
            str(file.verdict.session.poses),
            listed(f.called() for f in file.verdict.findings)
            or ("unknown structure" if file.verdict.unknown_structure.found else "none"),
        )
        for file in files
    )
    head = (
        "verdict",
        "before [mm]",
        "calibrated [mm]",
        "extended [mm]",
        "noise of a pose [mm]",
        "poses",
        "findings",
    )
    return Table("verdicts", "Held-out error, RMS in 3-D", head, rows, words=(0, 6))


def _findings_table(files: Sequence[VerdictFile]) -> Table:
    rows = tuple(
        (
            file.name,
            finding.called(),
            "; ".join(estimate(name, e) for name, e in finding.clearest(6).items()),
            sure(finding.confidence),
            f"{mm(finding.rms_before_mm)} → {mm(finding.rms_after_mm)}",
        )
        for file in files
        for finding in file.verdict.findings
    )
    head = (
        "verdict",
        "cause",
        "parameters",
        "confidence",
        "held-out error, without it → with it [mm]",
    )
    return Table(
        "findings", "Findings", head, rows, "" if rows else "No findings.", words=(0, 1, 2)
    )


def _errors_figure(files: Sequence[VerdictFile]) -> Figure:
    place = np.arange(len(files), dtype=float)

    def values(of: str) -> Array:
        held = [getattr(file.verdict, of).held_out_rms_mm for file in files]
        return np.array([np.nan if v is None else v for v in held], dtype=float)

    noise = np.array([file.verdict.noise_mm or np.nan for file in files], dtype=float)
    return Figure(
        "errors",
        "Held-out error, verdict by verdict",
        "Verdicts in the order given.",
        (
            Panel(
                "",
                Axis.side_by_side("verdict", tuple(file.name for file in files)),
                Axis("held-out error, RMS [mm]", log=True),
                (
                    *course("before", place, values("baseline"), BEFORE, "solid", "circle"),
                    *course(
                        "calibrated", place, values("calibrated"), CALIBRATED, "dash", "diamond"
                    ),
                    *course("extended", place, values("extended"), EXTENDED, "dot", "square"),
                    *course("noise of a pose", place, noise, PAPER, "solid", "cross"),
                ),
            ),
        ),
        columns=1,
    )


def _values_figures(files: Sequence[VerdictFile]) -> tuple[Figure, ...]:
    """Figures of the parameters of each cause that was found more than once, a panel per unit."""
    names = tuple(file.name for file in files)
    found: dict[str, dict[str, Values]] = {}
    for number, file in enumerate(files):
        for cause, finding in _numbered(file.verdict.findings):
            of_cause = found.setdefault(cause, {})
            for name, e in finding.parameters.items():
                values = of_cause.setdefault(e.unit, {})
                values.setdefault(name, []).append((number, e.value, e.std or 0.0))
    return tuple(
        Figure(
            f"values_{'_'.join(cause.split())}",
            f"{cause} over time",
            "With 95 % intervals.",
            tuple(
                _values_panel(cause, names, unit, values)
                for unit, values in of_cause.items()
                if _comparable(values)
            ),
            columns=1,
        )
        for cause, of_cause in found.items()
        if any(_comparable(values) for values in of_cause.values())
    )


def _numbered(findings: Sequence[Finding]) -> Iterator[tuple[str, Finding]]:
    """Findings with their names, numbered from the second of a name: a machine has two gears."""
    before: Counter[str] = Counter()
    for finding in findings:
        name = finding.called()
        before[name] += 1
        yield (name if before[name] == 1 else f"{name} {before[name]}"), finding


def _comparable(values: Values) -> bool:
    """Whether some parameter has several values, and there are not too many for one panel."""
    return max(map(len, values.values())) >= 2 and len(values) <= len(SERIES)


def _values_panel(cause: str, names: tuple[str, ...], own: str, values: Values) -> Panel:
    factor, unit = unit_in(UNITS, own)
    marks = []
    for (name, rows), colour, symbol in zip(
        values.items(), SERIES, (*SYMBOLS, *SYMBOLS), strict=False
    ):
        place, value, std = (np.array([row[k] for row in rows], dtype=float) for k in range(3))
        marks.append(
            Points(spoken(name), place, factor * value, colour, symbol, 7.0, 1.96 * factor * std)
        )
    return Panel("", Axis.side_by_side("verdict", names), Axis(f"{cause} [{unit}]"), tuple(marks))
