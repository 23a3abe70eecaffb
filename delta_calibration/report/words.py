"""Formatting of numbers and verdicts as text for readers."""

from __future__ import annotations

from delta_calibration.diagnosis.verdict import (
    CannotTell,
    Estimate,
    Finding,
    UnknownStructure,
    Verdict,
)
from delta_calibration.effects.unexplained import UNEXPLAINED
from delta_calibration.report.document import KeyFigure, Statement
from delta_calibration.wording import MINUS, capital, chance, listed, measured, mm, spoken, sure


def estimate(name: str, e: Estimate) -> str:
    """Format a parameter with its standard error, in a usual unit, to the significant figures."""
    told = measured(e.value, e.std, e.unit)
    return f"{spoken(name)} = {told}".replace(" ", "\u00a0")


def statements(verdict: Verdict) -> tuple[Statement, ...]:
    """Statements of a verdict: causes, confidence, gain, remedy and what is indistinguishable."""
    return (
        Statement("What is wrong", _wrong(verdict)),
        Statement("How sure", _how_sure(verdict)),
        Statement("What it gains", _gains(verdict)),
        *([Statement("What to do", _to_do(verdict))] if verdict.findings else []),
        Statement("What cannot be distinguished", _untold(verdict)),
    )


def _wrong(verdict: Verdict) -> str:
    unknown = verdict.unknown_structure
    parts = []
    for finding in verdict.findings:
        values = [estimate(name, e) for name, e in finding.clearest(3).items()]
        more = len(finding.parameters) - len(values)
        rest = f" and {more} more" if more else ""
        parts.append(f"{finding.called()}: {', '.join(values)}{rest}.")
    if unknown.found:
        parts.append(f"{structure(unknown)}.")
    nothing = "nothing beyond the errors of the parts, which calibration sets."
    return " ".join(map(capital, parts or [nothing]))


def _how_sure(verdict: Verdict) -> str:
    parts = []
    for finding in verdict.findings:
        others = listed(map(spoken, finding.equivalents))
        class_ = f"; indistinguishable in this session: {others}" if others else ""
        parts.append(
            f"{finding.called()} {sure(finding.confidence)}, p = {chance(finding.p_value)}"
            f"{class_}."
        )
    tests = verdict.unknown_structure.tests.values()
    least = chance(min((p for p in tests if p is not None), default=None))
    if verdict.unknown_structure.found and _mapped(verdict):
        parts.append(
            "that there is an error: a smooth map of it predicts poses it has not seen "
            f"(smallest p of {len(tests)} tests: {least}). Its cause is not known."
        )
    elif not parts or verdict.unknown_structure.found:
        parts.append(f"smallest p of {len(tests)} tests of the remaining errors: {least}.")
    return " ".join(map(capital, parts)).replace("p = <", "p <")


def _gains(verdict: Verdict) -> str:
    if not verdict.findings and not _mapped(verdict):
        before, after = verdict.baseline.held_out_rms_mm, verdict.calibrated.held_out_rms_mm
        return f"Calibration: held-out error {mm(before)} mm before, {mm(after)} mm calibrated."
    parts = [f"{f.called()}: {f.errors()}, {_share(f)}." for f in verdict.findings]
    if _mapped(verdict):
        before, after = verdict.calibrated.held_out_rms_mm, verdict.extended.held_out_rms_mm
        parts.append(
            f"all with the map of the unexplained error: held-out error {mm(before)} mm "
            f"calibrated, {mm(after)} mm extended."
        )
    return " ".join(map(capital, parts))


def _to_do(verdict: Verdict) -> str:
    """Remedy of each cause, the error expected after it, and how to confirm it."""
    told = []
    for finding in verdict.findings:
        if finding.action is not None:
            order = finding.action.sentence().removeprefix("to do: ")
            told.append(f"{finding.called()}: {order}. To confirm: {finding.action.confirm}.")
    return " ".join(map(capital, told))


def _mapped(verdict: Verdict) -> bool:
    """Whether the extended model contains a smooth map of the unexplained error."""
    return UNEXPLAINED in verdict.extended.model


def structure(unknown: UnknownStructure) -> str:
    """Describe the structure without a known cause: size, related quantity and location."""
    where = f", {unknown.where.replace('= -', '= ' + MINUS)}" if unknown.where else ""
    size = "" if unknown.rms_mm is None else f", {mm(unknown.rms_mm)} mm RMS"
    return f"error without a known cause{size}; it varies with {unknown.moves()}{where}"


def _share(finding: Finding) -> str:
    if finding.gain <= 0.0:
        return "no gain that held-out data show"
    return f"{100 * finding.gain:.0f} % of the avoidable error"


def _untold(verdict: Verdict) -> str:
    if not verdict.cannot_tell:
        return "Nothing that was looked for in this session."
    return " ".join(f"{between(e)}: {e.because}." for e in verdict.cannot_tell)


def between(entry: CannotTell) -> str:
    """Names of the causes that cannot be distinguished."""
    names = [spoken(name) for name in entry.between if name != "none"]
    nothing = ", or none at all" if "none" in entry.between else ""
    return capital(" or ".join(names)) + nothing


def key_figures(verdict: Verdict) -> tuple[KeyFigure, ...]:
    """Key figures: held-out errors before, calibrated and extended, and the noise of a pose."""
    parts = [
        KeyFigure(name, mm(model.held_out_rms_mm), "mm RMS", f"held-out error: {model.model}")
        for name, model in verdict.models()
    ]
    note = "about what a perfect model leaves"
    return (*parts, KeyFigure("noise of a pose", mm(verdict.noise_mm), "mm RMS", note))
