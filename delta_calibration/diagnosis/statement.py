"""Statement about structure left in the residuals, derived only from the tests.

The p of a test is the probability that noise, with structure too small to matter, leaves as much
(`residual_tests.py`). Each p is multiplied by the number of tests (Bonferroni); that of a smooth
map is already corrected for all that was tried. Verdict, page and console use this statement.
"""

from __future__ import annotations

from collections.abc import Mapping

from delta_calibration.diagnosis.constants import ALPHA

LACK_OF_FIT, MOTION, MAP, SET_ASIDE = "lack_of_fit", "moran_motion", "map", "set_aside"
_NEIGHBOURS = "moran_"


def shown(tests: Mapping[str, float | None]) -> tuple[str, ...]:
    """Tests that are significant, the map first, then by p; if there is none, nothing is left."""
    known = {name: p for name, p in tests.items() if p is not None}
    asked = sum(name != MAP for name in known)
    good = [n for n, p in known.items() if p * (1 if n == MAP else asked) <= ALPHA]
    return tuple(sorted(good, key=lambda name: (name != MAP, known[name])))


def moves_with(test: str) -> str | None:
    """Quantity with which the structure shown by a test varies; None if the test has none."""
    if test == SET_ASIDE:
        return "position"
    return test.removeprefix(_NEIGHBOURS) if test.startswith(_NEIGHBOURS) else None
