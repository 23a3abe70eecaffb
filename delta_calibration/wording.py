"""Formats numbers and names for readers, in the same way in all outputs."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from datetime import date, datetime, timezone
from math import floor, inf, isfinite, log10

from delta_calibration.data import SIMULATED_NS
from delta_calibration.effects import called

NO_VALUE = "–"
_LEAST_P = 1e-300
_PLAIN = 1e-3, 1e7  # numbers between these are written without a power of ten
_DATED_NS = 946_684_800_000_000_000  # [ns] the year 2000: earlier stamps count from zero, no date
_MINUTE_NS = 60_000_000_000
MINUS, _THIN = "\u2212", "\u202f"
_ASCII = str.maketrans({"\u2212": "-", "\u202f": " ", "\u00a0": " ", "µ": "u"})
# unit and factor for readers, by SI unit; other units are shown as they are
_COMMON = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
_SMALL = {"m": (1e6, "µm"), "rad": (1e6, "µrad")}
_SMALL_FROM = 1e-3  # [m, rad] values below it are shown in the small units
_COARSE = 1e-5  # a smaller standard error is shown with a power of ten
_ASIDE = {  # reasons for which readings are set aside
    "repeated": "with a stamp seen before",
    "frozen": "that only repeat a frozen value",
    "unmatched": "without joint angles near in time",
    "outlier": "far from the others of the same stop",
    "settling": "before the platform came to rest",
    "on_the_way": "on the way of a motion",
    "unlike_the_model": "unlike what any fit explains",
}
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_LOWERED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
_POWER = re.compile(" × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+)")


def mm(value: float | None) -> str:
    """A length in mm to a tenth of a micrometre."""
    return NO_VALUE if value is None else f"{value:.4f}"


def figures(value: float, digits: int = 3) -> str:
    """A number with `digits` figures: `93 300`, `4.2 × 10⁻⁸`, with a true minus sign."""
    if not isfinite(value):
        return NO_VALUE
    if value == 0:
        return "0"
    rounded = float(f"{value:.{digits}g}")
    if _PLAIN[0] <= abs(rounded) < _PLAIN[1]:
        places = max(0, digits - 1 - floor(log10(abs(rounded))))
        return f"{rounded:,.{places}f}".replace(",", _THIN).replace("-", MINUS)
    mantissa, _, power = f"{value:.{digits - 1}e}".partition("e")
    return f"{mantissa} × 10{str(int(power)).translate(_RAISED)}".replace("-", MINUS)


def reader_unit(unit: str, size: float) -> tuple[float, str]:
    """Factor that converts values of an SI unit for a reader, and the unit after that.

    Args:
        unit: SI unit of the values.
        size: typical size of the values.
    """
    return unit_in(_SMALL if abs(size) < _SMALL_FROM else _COMMON, unit)


def unit_in(units: Mapping[str, tuple[float, str]], unit: str) -> tuple[float, str]:
    """Factor and name of a unit by a table of units; what stands after a slash is kept.

    Args:
        units: factor and name by SI unit.
        unit: SI unit, such as `rad/h`.
    """
    of, slash, per = unit.partition("/")
    factor, shown = units.get(of, (1.0, of))
    return factor, f"{shown}{slash}{per}"


def measured(value: float, std: float | None, unit: str, size: float | None = None) -> str:
    """A value with its standard error, in a reader's unit, rounded to its significant figures.

    The unit suits the size of the value, or `size` if given: that of the value shown next to it.
    """
    factor, shown = reader_unit(unit, value if size is None else size)
    behind = "" if unit == "1" else f" {shown}"
    value, std = factor * value, factor * (std or 0.0)
    if not _COARSE <= std < inf:
        spread = f" ± {figures(std, 2)}" if std > 0 else ""
        return f"{figures(value, 4)}{spread}{behind}"
    places = max(0, 1 - floor(log10(std)))
    value = round(value, places) + 0.0  # no minus sign before a zero
    return f"{value:.{places}f} ± {std:.{places}f}{behind}".replace("-", MINUS)


def plain(text: str) -> str:
    """The text in ASCII, for a console."""
    text = _POWER.sub(lambda found: f"e{int(found[1].translate(_LOWERED)):+03d}", text)
    return text.translate(_ASCII).replace("±", "+-")


def places_for(uncertainty: float) -> int:
    """Number of decimals of a value, such that its uncertainty has two figures."""
    if not 0.0 < uncertainty < float("inf"):
        return 3
    first = floor(log10(float(f"{uncertainty:.1e}")))  # 0.0996 is 0.10
    return max(0, 1 - first)


def rounded(value: float, uncertainty: float, sign: bool = False) -> str:
    """A value rounded to two figures of its uncertainty, with a true minus sign."""
    text = f"{value:{'+' if sign else ''},.{places_for(uncertainty)}f}"
    if not any(digit in text for digit in "123456789"):
        text = text.lstrip("+-")
    return text.replace(",", _THIN).replace("-", MINUS)


def chance(p: float | None) -> str:
    """A p value as text."""
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
    """Words for the fixed name of a cause or part; for a cause the name that its effect states."""
    for cause, own in called().items():
        name = re.sub(rf"\b{re.escape(cause)}\b", own, name)
    return " ".join("SMR" if word == "smr" else word for word in name.split("_"))


def listed(items: Iterable[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    every = list(items)
    if len(every) < 2:
        return "".join(every)
    return f"{', '.join(every[:-1])} and {every[-1]}"


def set_aside(counts: Mapping[str, int]) -> str:
    """Numbers of readings that took no part, each with the reason in words; empty if none.

    Args:
        counts: number of readings by the fixed name of the reason.
    """
    return listed(f"{n} {_ASIDE.get(reason, spoken(reason))}" for reason, n in counts.items() if n)


def capital(text: str) -> str:
    """The text with a capital first letter."""
    return text[:1].upper() + text[1:]


def dated(start_ns: int) -> bool:
    """Whether stamps have a date; those that count from zero do not."""
    return start_ns >= _DATED_NS


def day(start_ns: int) -> date | None:
    """The day on which a session began, in UTC; None if it has no date or is simulated."""
    if not dated(start_ns) or 0 <= start_ns - SIMULATED_NS < _MINUTE_NS:
        return None
    return datetime.fromtimestamp(start_ns * 1e-9, tz=timezone.utc).date()


def moment(start_ns: int) -> str:
    """Date and time when a session began, in UTC, or the reason why there is none."""
    if not dated(start_ns):
        return "without a date"
    if 0 <= start_ns - SIMULATED_NS < _MINUTE_NS:
        return "in simulated time"
    start = datetime.fromtimestamp(start_ns * 1e-9, tz=timezone.utc)
    return start.strftime("%Y-%m-%d %H:%M UTC")
