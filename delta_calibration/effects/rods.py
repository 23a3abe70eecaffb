"""Rods of a Delta in both of its models: one length per pair, or six separate rods.

A pair has a mean length l and, in the six-rod model, a mismatch m: l_a = l - m/2 and
l_b = l + m/2. With U the potential of the masses, the pulls N_a and N_b follow from

    dU/dl = -(N_a + N_b)        dU/dm = -(N_b - N_a) / 2
"""

from __future__ import annotations

from collections.abc import Iterator

from delta_calibration.effects.signals import LOAD, NOTHING, Places
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.symbols import Symbol, column
from delta_calibration.model.terms import Term


def pulls(s: Symbol) -> tuple[Symbol, Symbol]:
    """Pull in rods a and b [N], from dU/dl and dU/dm; equal if the model has no mismatch."""
    both, apart = -s[0], -2 * s[1]
    return (both - apart) / 2, (both + apart) / 2


def lengthened(a: Symbol, b: Symbol) -> Symbol:
    """Change of a pair's mean length and mismatch if its rods lengthen by a and b [m]."""
    return column((a + b) / 2, b - a)


def pairs(mechanism: Mechanism, places: Places) -> Iterator[Term]:
    """Yield a term per pair: signals are its loads, outputs its mean length and mismatch."""
    names = mechanism.parameters.names
    for leg in range(1, mechanism.joints + 1):
        rows = [
            names.index(f"{what}_{leg}") if f"{what}_{leg}" in names else -1
            for what in ("rod", "rod_mismatch")
        ]
        load = places.begin(LOAD)
        signals = tuple(load + row if row >= 0 else places.begin(NOTHING) for row in rows)
        yield Term(signals, (0,), tuple(rows), ())
