"""Split names of columns, as people write them, into name and unit."""

from __future__ import annotations

import re

from delta_calibration.recording.table_found import UNIT

CLOCK = r"time|timestamp|zeit|stamp|t|clock|minutes?|seconds?"  # names of times
MEANT = {"minute": "min", "minutes": "min", "second": "s", "seconds": "s"}  # by the name alone
_UNIT = re.compile(rf"[\[(/\s_]+({UNIT})[\])]*$", re.IGNORECASE)
_CALLED = {  # unit as people write it: unit of a mapping
    **dict.fromkeys(("radian", "radians"), "rad"),
    **dict.fromkeys(("degree", "degrees", "grad", "°"), "deg"),
    **dict.fromkeys(("sec", "second", "seconds"), "s"),
    **dict.fromkeys(("minute", "minutes"), "min"),
    **{"turns": "turn", "µm": "um", "in": "inch", "°c": "degC", "degc": "degC", "k": "K"},
}
_WARMTH = re.compile(
    r"(?:[\s_\[(/,.-]+|(?<=temp)|(?<=erature)|(?<=eratur)|(?=°))"
    r"(?:deg(?:rees?)?[\s_.]*|°\s*)?(celsius|fahrenheit|kelvin|c|f|k)[\s\])]*$"
)
_WARM = re.compile(r"temp(?:eratures?|eratur)?|t")
_DEGREES = {"c": "degC", "f": "degF", "k": "K"}
_TWICE = re.compile(r" \(\d+\)$")  # ending of a name that occurs again
_PART = "machine"  # part of a temperature whose name has none


def bare_name(name: str) -> tuple[str, str]:
    """A column's name without its unit, in small letters, and the unit."""
    unit = _UNIT.search(name.strip())
    bare = name.strip()[: unit.start()] if unit and unit.start() else name.strip()
    said = unit[1].lower() if unit and unit.start() else ""
    return bare.strip(" _-[(").lower(), _CALLED.get(said, said)


def warm_name(name: str) -> tuple[str, str] | None:
    """Part and unit of a column of temperatures by its name, the unit empty if it has none.

    `T_arm_F` is the temperature of the arm in degrees Fahrenheit. None for other columns: `t` is a
    time, and `t_x` a coordinate.
    """
    text = _TWICE.sub("", name.strip().lower())
    match = _WARMTH.search(text)
    unit = _DEGREES[match[1][0]] if match and match.start() else ""
    words = re.findall(r"[^\W\d_]+|\d+", text[: match.start()] if match and unit else text)
    warm = next((w for k, w in enumerate(words) if _WARM.fullmatch(w) and (w != "t" or not k)), "")
    if not warm or (not unit and bare_name(text)[1]):
        return None
    words.remove(warm)
    if warm == "t" and not unit and (not "".join(words).isalpha() or words[0] in "xyz"):
        return None
    part = "_".join(words) or _PART
    return f"sensor_{part}" if part.isdigit() else part, unit
