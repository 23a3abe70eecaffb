"""Numbers and verdicts as people read them."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor, log10

from delta_calibration.diagnosis.verdict import (
    CannotTell,
    Estimate,
    Finding,
    UnknownStructure,
    Verdict,
)
from delta_calibration.effects.unexplained import UNEXPLAINED
from delta_calibration.report.document import KeyFigure, Statement

MM = 1e3
NO_VALUE = "–"
# a reader's unit for each of the code's; the rest is shown as it is
_SHOWN = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
_LEAST_P = 1e-300
_PLAIN = 1e-3, 1e7  # numbers between are written out
_MINUS, _THIN = "\u2212", "\u202f"
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_SMALL = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}
_SMALL_FROM = 1e-3  # [m, rad] below


def mm(value: float | None) -> str:
    """A length in mm to a tenth of a micrometre."""
    return NO_VALUE if value is None else f"{value:.4f}"


def figures(value: float, digits: int = 3) -> str:
    """A number to so many figures: `93 300`, `4.2 × 10⁻⁸`, with a true minus sign."""
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits}g}")
    if _PLAIN[0] <= abs(rounded) < _PLAIN[1]:
        places = max(0, digits - 1 - floor(log10(abs(rounded))))
        return f"{rounded:,.{places}f}".replace(",", _THIN).replace("-", _MINUS)
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return f"{mantissa} × 10{str(int(power)).translate(_RAISED)}".replace("-", _MINUS)


def chance(p: float | None) -> str:
    """A p value."""
    if p is None:
        return NO_VALUE
    if p < _LEAST_P:
        return "< 10\u207b\u00b3\u2070\u2070"
    return figures(p, 2) if p < _PLAIN[0] else f"{p:.3f}"


def sure(confidence: float) -> str:
    """A probability in percent, never rounded up to certainty."""
    if confidence > 0.999:
        return "> 99.9 %"
    return f"{100 * confidence:.1f} %" if confidence > 0.99 else f"{100 * confidence:.0f} %"


def spoken(name: str) -> str:
    """A cause or part by its fixed name, as words."""
    words = ["SMR" if word == "smr" else word for word in name.split("_")]
    return " ".join(words).replace(UNEXPLAINED, "smooth map")


def listed(items: Iterable[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    every = list(items)
    if len(every) < 2:
        return "".join(every)
    return f"{', '.join(every[:-1])} and {every[-1]}"


def called(finding: Finding) -> str:
    """A cause and its place."""
    where = f" at {spoken(finding.location)}" if finding.location else ""
    return f"{spoken(finding.cause)}{where}"


def estimate(name: str, e: Estimate) -> str:
    """A parameter with its standard error, in a reader's unit, to the figures that hold."""
    units = _SMALL if abs(e.value) < _SMALL_FROM else _SHOWN
    factor, unit = units.get(e.unit, (1.0, e.unit))
    unit = "" if unit == "1" else f" {unit}"
    value, std = e.value * factor, (e.std or 0.0) * factor
    if std <= 0 or std < _PLAIN[0]:
        spread = f" ± {figures(std, 2)}" if std > 0 else ""
        shown = f"{figures(value, 4)}{spread}"
    else:
        places = max(0, 1 - floor(log10(std)))
        shown = f"{value:.{places}f} ± {std:.{places}f}".replace("-", _MINUS)
    return f"{spoken(name)} = {shown}{unit}".replace(" ", "\u00a0")


def sentence(verdict: Verdict) -> str:
    """The verdict in a sentence: what, how sure, what it gains."""
    before, after = verdict.calibrated.held_out_rms_mm, verdict.extended.held_out_rms_mm
    if verdict.findings:
        causes = listed(f"{called(f)} ({sure(f.confidence)} sure)" for f in verdict.findings)
        if verdict.extended.model != verdict.calibrated.model:
            gain = f"in the model, it takes the held-out error from {mm(before)} to {mm(after)} mm"
        else:
            drawn = mm(verdict.baseline.held_out_rms_mm)
            gain = f"calibration takes the held-out error from {drawn} to {mm(before)} mm"
        return f"{capital(causes)}: {gain}."
    if verdict.unknown_structure.found:
        moves = spoken(verdict.unknown_structure.moves_with or "nothing that was recorded")
        return f"Something that no known cause explains is left; it moves with {moves}."
    drawn = mm(verdict.baseline.held_out_rms_mm)
    return (
        f"The calibrated geometry explains the data: held-out error from {drawn} to {mm(before)} "
        "mm, and nothing else is found."
    )


def capital(text: str) -> str:
    """A text that begins with a capital letter."""
    return text[:1].upper() + text[1:]


def statements(verdict: Verdict) -> tuple[Statement, ...]:
    """What is wrong, how sure, what it gains, what cannot be told."""
    return (
        Statement("What is wrong", _wrong(verdict)),
        Statement("How sure", _how_sure(verdict)),
        Statement("What it gains", _gains(verdict)),
        Statement("What cannot be told", _untold(verdict)),
    )


def _wrong(verdict: Verdict) -> str:
    unknown = verdict.unknown_structure
    parts = []
    for finding in verdict.findings:
        values = [estimate(name, e) for name, e in finding.parameters.items()][:3]
        more = len(finding.parameters) - len(values)
        rest = f" and {more} more" if more else ""
        parts.append(f"{called(finding)}: {', '.join(values)}{rest}.")
    if unknown.found:
        parts.append(f"{structure(unknown)}.")
    nothing = "nothing beyond the errors of the parts, which calibration sets."
    return capital(" ".join(parts) or nothing)


def _how_sure(verdict: Verdict) -> str:
    parts = []
    for finding in verdict.findings:
        others = listed(map(spoken, finding.equivalents))
        class_ = f"; the same on this session: {others}" if others else ""
        parts.append(
            f"{called(finding)} {sure(finding.confidence)}, p = {chance(finding.p_value)}"
            f"{class_}."
        )
    tests = verdict.unknown_structure.tests.values()
    least = chance(min((p for p in tests if p is not None), default=None))
    if verdict.unknown_structure.found and _mapped(verdict):
        parts.append(
            "that something is there: a smooth map that follows it foretells poses it has not "
            f"seen, and leaves nothing but noise (least p of {len(tests)} tests: {least}). "
            "What it is: not known."
        )
    elif not parts or verdict.unknown_structure.found:
        parts.append(f"least p of {len(tests)} tests of what is left: {least}.")
    joined = " ".join(parts).replace("p = <", "p <")
    return capital(joined)


def _gains(verdict: Verdict) -> str:
    if not verdict.findings and not _mapped(verdict):
        before, after = verdict.baseline.held_out_rms_mm, verdict.calibrated.held_out_rms_mm
        return f"Calibration: {mm(before)} → {mm(after)} mm on poses that the fit has not seen."
    parts = [
        f"{called(f)}: {mm(f.rms_before_mm)} → {mm(f.rms_after_mm)} mm held out, {_share(f)}."
        for f in verdict.findings
    ]
    if _mapped(verdict):
        before, after = verdict.calibrated.held_out_rms_mm, verdict.extended.held_out_rms_mm
        parts.append(f"all with the map of what has no name: {mm(before)} → {mm(after)} mm.")
    return capital(" ".join(parts))


def _mapped(verdict: Verdict) -> bool:
    """Whether what nothing explains is in the extended model, as a smooth map."""
    return UNEXPLAINED in verdict.extended.model


def structure(unknown: UnknownStructure) -> str:
    """Structure that no cause explains: how large, what it moves with, where."""
    where = f", {unknown.where.replace('= -', '= ' + _MINUS)}" if unknown.where else ""
    moves = spoken(unknown.moves_with or "nothing recorded")
    size = "" if unknown.rms_mm is None else f", {mm(unknown.rms_mm)} mm RMS"
    return f"structure of no known cause{size}; it moves with {moves}{where}"


def _share(finding: Finding) -> str:
    return f"{100 * finding.gain:.0f} % of the avoidable error"


def _untold(verdict: Verdict) -> str:
    if not verdict.cannot_tell:
        return "Nothing that was asked of this session."
    return " ".join(f"{between(e)}: {e.because}." for e in verdict.cannot_tell)


def between(entry: CannotTell) -> str:
    """What cannot be told from what."""
    names = [spoken(name) for name in entry.between if name != "none"]
    nothing = ", or none at all" if "none" in entry.between else ""
    return capital(" or ".join(names)) + nothing


def key_figures(verdict: Verdict) -> tuple[KeyFigure, ...]:
    """Errors held out before, calibrated, extended; the noise under them."""
    shown = [("before", verdict.baseline), ("calibrated", verdict.calibrated)]
    shown.append(("extended", verdict.extended))
    parts = [
        KeyFigure(name, mm(model.held_out_rms_mm), "mm RMS", spoken(model.model))
        for name, model in shown
    ]
    note = "of a pose measured at rest"
    return (*parts, KeyFigure("noise", mm(verdict.noise_mm), "mm RMS", note))
