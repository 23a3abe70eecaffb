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


def bare_name(name: str) -> tuple[str, str]:
    """A column's name without its unit, in small letters, and the unit."""
    unit = _UNIT.search(name.strip())
    bare = name.strip()[: unit.start()] if unit and unit.start() else name.strip()
    said = unit[1].lower() if unit and unit.start() else ""
    return bare.strip(" _-[(").lower(), _CALLED.get(said, said)
