"""Evidence for each candidate, tried alone on the calibrated model."""

from __future__ import annotations

import numpy as np

from delta_calibration.diagnosis.diagnose import Diagnosis
from delta_calibration.diagnosis.judge import Judgement
from delta_calibration.diagnosis.scan import Scan
from delta_calibration.diagnosis.scores import Score
from delta_calibration.diagnosis.verdict import Finding, Verdict
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
from delta_calibration.wording import NO_VALUE, chance, figures, listed, spoken, sure

_SHOWN = 20
_LEAST = 1.0  # smallest length of a bar
_IN_GEOMETRY = (
    "A named dimension is part of the calibrated geometry. It is compared with the scatter of all "
    "dimensions; in place of the decrease stands lambda, the rise of chi square if it had the "
    "value of the drawing."
)
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
    shown = _ordered(found)[:_SHOWN]
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
    own = [_named_dimension(s, found.verdict) for s in shown]
    size = [s.gain if f is None else f.signal for s, f in zip(shown, own, strict=True)]
    gain = np.maximum(size, _LEAST)
    marks = [
        Bars(
            name,
            np.array(rows, dtype=float),
            gain[rows],
            colour,
            tuple(_told(shown[row], own[row]) for row in rows),
        )
        for name, (colour, rows) in groups.items()
        if rows
    ]
    names = tuple(_called(s, f) for s, f in zip(shown, own, strict=True))
    return Figure(
        "evidence",
        "Evidence for each candidate",
        "Decrease of chi square by each candidate, tried alone on the calibrated model: the "
        "best shape and place of each cause, strongest evidence (ln B) first. Similar causes "
        "explain part of a strong cause, so long grey bars beside a named cause are not "
        "findings; what remains beside it decides. Noise alone gives about 1 for each "
        "parameter; from about 40 a cause is detected, from 80 it can be named. A smooth map is "
        f"not a cause; it shows which quantity the error varies with. {_IN_GEOMETRY}",
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


def _ordered(found: Diagnosis | Judgement) -> list[Score]:
    """The best score of each cause: named dimensions first, then by ln B."""
    every = best_of_each(found.found.first)
    return sorted(every, key=lambda score: _named_dimension(score, found.verdict) is None)


def _named_dimension(score: Score, verdict: Verdict) -> Finding | None:
    """The finding that names this dimension; None for an effect, or if it was not named."""
    if score.candidate.effect is not None:
        return None
    return next((f for f in verdict.findings if f.cause == score.candidate.cause), None)


def _called(score: Score, named: Finding | None) -> str:
    return spoken(score.candidate.label) if named is None else named.called()


def _told(score: Score, named: Finding | None) -> str:
    name = _called(score, named)
    if named is not None:
        return f"{name}: lambda {figures(named.signal, 4)}"
    return f"{name}: {figures(score.gain, 4)}, ln B {figures(score.log_bayes)}"


def evidence_table(found: Diagnosis) -> Table:
    """Table of each cause's chi square, parameters, ln B, p, tries and confidence."""
    scan = found.found.first
    return Table(
        "evidence_table",
        "Evidence in numbers",
        ("candidate", "chi square", "parameters", "ln B", "p", "tries", "confidence"),
        tuple(_row(score, scan, found.verdict) for score in _ordered(found)),
        "p: probability that chance gives as large a decrease, multiplied by the number of "
        "questions and shapes tried. ln B: logarithm of the Bayes factor, reduced by a penalty "
        "for the choice of a shape (for a map, of its size and width). Confidence: probability "
        "that the name in the verdict is right, "
        f"with everything else in the model. {_IN_GEOMETRY}",
    )


def _row(score: Score, scan: Scan, verdict: Verdict) -> tuple[str, ...]:
    named = _named_dimension(score, verdict)
    if named is not None:
        size, p = figures(named.signal, 4), chance(named.p_value)
        return (named.called(), size, "1", NO_VALUE, p, NO_VALUE, sure(named.confidence))
    p_value = float(np.exp(min(0.0, score.log_p + np.log(scan.tests))))
    found = [sure(f.confidence) for f in verdict.findings if f.cause == score.candidate.cause]
    return (
        spoken(score.candidate.label),
        figures(score.gain, 4),
        str(score.degrees),
        figures(score.log_bayes, 4),
        chance(p_value),
        figures(score.tries, 3),
        listed(found) or NO_VALUE,
    )
