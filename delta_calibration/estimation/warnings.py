"""Whether a fit leaves far more than the noise, why, and what to do about it."""

from __future__ import annotations

import numpy as np

from delta_calibration.estimation.fit import Identification
from delta_calibration.parameters import Parameter

_FOR_PEOPLE = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
_FAR = 2.0  # times the noise of a pose; a fit to enough places leaves 1.0 to 1.3 times
_LACKING = 2.0  # chi square per degree of freedom from which it is not the number of places
FOUND = ("least_squares", "alternating")  # methods that come to rest where the misfit is least
_TOO_FAR = 10.0  # tolerances: no part is made so badly, somebody mistook a figure
_TOLD = 3  # parameters by name, at most
DIAGNOSIS = "diagnosis"  # the method of a fit that has been asked for what it lacks


def doubts(found: Identification) -> tuple[str, ...]:
    """What to know before a fit is relied on, a sentence each; none where all is well."""
    return tuple(filter(None, (doubt(found), off_the_drawing(found))))


def off_the_drawing(found: Identification) -> str:
    """That the drawing itself is to be checked, where a dimension is ten tolerances off it.

    The tolerance holds an estimate back: data that take it as far are sure of it.
    """
    geometry = found.chain.layout.geometry
    items = found.parameters.items[geometry]
    off = (found.theta - found.parameters.nominal)[geometry]
    times = np.abs(off) / found.parameters.prior[geometry]  # 0 of a tolerance without bounds
    far = [int(k) for k in np.argsort(-times) if times[k] >= _TOO_FAR]
    if not far:
        return ""
    named = [f"{items[k].name} by {times[k]:.0f} ({_length(off[k], items[k])})" for k in far]
    more = f" and {len(far) - _TOLD} more" if len(far) > _TOLD else ""
    return (
        f"off the drawing by ten tolerances or more: {', '.join(named[:_TOLD])}{more}: check the "
        "drawing and its units before the part"
    )


def _length(off: float, item: Parameter) -> str:
    """A deviation for people: mm and mrad where it is a length or an angle."""
    factor, unit = _FOR_PEOPLE.get(item.unit, (1.0, item.unit))
    return f"{factor * off:+.3f} {unit}"


def doubt(found: Identification) -> str:
    """What to know before a fit is relied on, as a sentence; nothing where all is well.

    A fit that leaves more than the noise at places it has not seen either lacks something, and
    leaves as much at those it has seen; or it had too few places to learn its parameters from.
    """
    ratio = found.full.held_out / found.noise.floor
    if ratio <= _FAR:
        return ""
    far = f"the error left is {ratio:.1f} times the noise of a pose"
    if found.full.held_out > found.frame_only.held_out:
        far += " and more than that of the drawing in its best frame"
    if found.effort.method not in (*FOUND, DIAGNOSIS):
        return (
            f"{far}: the search by {found.effort.method} has not come to rest, or what "
            f"{FOUND[0]} leaves is as much; fit by that first"
        )
    if found.chi_square <= _LACKING:
        return (
            f"{far}, as {len(found.weight)} poses are few for the {found.observability.rank} "
            "combinations of parameters that they have to set: measure more places"
        )
    if found.effort.method == DIAGNOSIS:
        return f"{far}, and nothing known explains it: see the verdict"
    return f"{far}, also where it has seen the place: the model lacks something, diagnose it"
