"""Evidence for each candidate, tried alone on the calibrated model."""

from __future__ import annotations

import numpy as np

from delta_calibration.diagnosis.diagnose import Diagnosis
from delta_calibration.diagnosis.judge import Judgement
from delta_calibration.diagnosis.scan import Scan
from delta_calibration.diagnosis.scores import Score
from delta_calibration.diagnosis.verdict import Finding
from delta_calibration.report.document import Table
from delta_calibration.report.drawing import (
    CALIBRATED,
    EXTENDED,
    GREY,
    Axis,
    Bars,
    Figure,
    Panel,
    Rule,
)
from delta_calibration.wording import NO_VALUE, chance, figures, spoken, sure

_SHOWN = 20
_LEAST = 1.0  # smallest length of a bar
_DETECTED, _NAMED = 40.0, 80.0  # lambda from which a cause is detected, and can be named


def best_of_each(scan: Scan) -> tuple[Score, ...]:
    """The best score of each cause, best ln B first."""
    kept: list[Score] = []
    for score in scan.scores:
        if not any(score.candidate.same_cause(other.candidate) for other in kept):
            kept.append(score)
    return tuple(kept)


def evidence_figure(found: Diagnosis | Judgement) -> Figure:
    """Decrease of chi square by each candidate, on a logarithmic axis."""
    shown = best_of_each(found.found.first)[:_SHOWN]
    named = {f.cause for f in found.verdict.findings}
    same = {cause for f in found.verdict.findings for cause in f.equivalents}
    groups = {
        "named": (EXTENDED, [k for k, s in enumerate(shown) if s.candidate.cause in named]),
        "indistinguishable in this session": (
            CALIBRATED,
            [k for k, s in enumerate(shown) if s.candidate.cause in same - named],
        ),
        "others": (
            GREY,
            [k for k, s in enumerate(shown) if s.candidate.cause not in same | named],
        ),
    }
    gain = np.array([max(s.gain, _LEAST) for s in shown])
    marks = [
        Bars(
            name,
            np.array(rows, dtype=float),
            gain[rows],
            colour,
            tuple(_told(shown[row]) for row in rows),
        )
        for name, (colour, rows) in groups.items()
        if rows
    ]
    names = tuple(spoken(s.candidate.label) for s in shown)
    return Figure(
        "evidence",
        "Evidence for each candidate",
        "Decrease of chi square by each candidate, tried alone on the calibrated model: the "
        "best shape and place of each cause, strongest evidence (ln B) first. Similar causes "
        "explain part of a strong cause, so long grey bars beside a named cause are not "
        "findings; what remains beside it decides. Noise alone gives about 1 for each "
        "parameter; from about 40 a cause is detected, from 80 it can be named. A smooth map is "
        "not a cause; it shows which quantity the error varies with.",
        (
            Panel(
                "",
                Axis(
                    "decrease of chi square [1]",
                    log=True,
                    low=_LEAST,
                    high=3 * float(max(gain.max(initial=0.0), _NAMED)),
                ),
                Axis("", names=names),
                (
                    *marks,
                    Rule(f"{_DETECTED:g}", _DETECTED, dash="dot", upright=True, side="left"),
                    Rule(f"{_NAMED:g}", _NAMED, upright=True, side="right"),
                ),
                tall=max(1.0, 0.22 * len(shown) / 3 + 0.35),
            ),
        ),
        columns=1,
    )


def _told(score: Score) -> str:
    name = spoken(score.candidate.label)
    return f"{name}: {figures(score.gain, 4)}, ln B {figures(score.log_bayes)}"


def evidence_table(found: Diagnosis) -> Table:
    """Table of each cause's chi square, parameters, ln B, p, tries and confidence."""
    scan = found.found.first
    findings = {f.cause: f for f in found.verdict.findings}
    return Table(
        "evidence_table",
        "Evidence in numbers",
        ("candidate", "chi square", "parameters", "ln B", "p", "tries", "confidence"),
        tuple(_row(score, scan, findings) for score in best_of_each(scan)),
        "p: probability that chance gives as large a decrease, multiplied by the number of "
        "questions and shapes tried. ln B: logarithm of the Bayes factor, reduced by a penalty "
        "for the choice of a shape (for a map, of its size and width). Confidence: probability "
        "that the name in the verdict is right, "
        "with everything else in the model.",
    )


def _row(score: Score, scan: Scan, findings: dict[str, Finding]) -> tuple[str, ...]:
    p = float(np.exp(min(0.0, score.log_p + np.log(scan.tests))))
    finding = findings.get(score.candidate.cause)
    return (
        spoken(score.candidate.label),
        figures(score.gain, 4),
        str(score.degrees),
        figures(score.log_bayes, 4),
        chance(p),
        figures(score.tries, 3),
        sure(finding.confidence) if finding else NO_VALUE,
    )
