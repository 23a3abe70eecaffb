"""What is said of structure that is left: derived from the tests, and from nothing else.

A test says how likely chance, with structure too small to matter beside the noise, leaves as much
(`residual_tests.py`). Several are asked, each charged with their number (Bonferroni); that of a smooth map
has been charged with all that was tried already. Verdict, page and console ask here.
"""

from __future__ import annotations

from collections.abc import Mapping

ALPHA = 0.002  # chance that a clean session raises any alarm
LACK_OF_FIT, MOTION, MAP, SET_ASIDE = "lack_of_fit", "moran_motion", "map", "set_aside"
_NEIGHBOURS = "moran_"


def shown(tests: Mapping[str, float | None]) -> tuple[str, ...]:
    """Tests that chance does not explain, the least likely first; none: nothing is left."""
    known = {name: p for name, p in tests.items() if p is not None}
    asked = sum(name != MAP for name in known)
    good = [n for n, p in known.items() if p * (1 if n == MAP else asked) <= ALPHA]
    return tuple(sorted(good, key=lambda name: (name != MAP, known[name])))


def moves_with(test: str) -> str | None:
    """What structure that a test shows moves with; None where the test does not say."""
    if test == SET_ASIDE:
        return "position"
    return test.removeprefix(_NEIGHBOURS) if test.startswith(_NEIGHBOURS) else None
