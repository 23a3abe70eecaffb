"""Warnings about fits whose residuals are far above the noise: the reason and the remedy."""

from __future__ import annotations

import numpy as np

from delta_calibration.estimation.fit import Identification
from delta_calibration.parameters import Parameter

_FOR_PEOPLE = {"m": (1e3, "mm"), "rad": (1e3, "mrad")}
_FAR = 2.0  # error left over the noise of a pose; 1.0 to 1.3 if there are enough places
_LACKING = 2.0  # chi square per degree of freedom from which the model, not the data, is lacking
FOUND = ("least_squares", "alternating")  # methods that converge to the least misfit
_MOVED = 5.0  # times the noise: difference of stops that shows an unrecorded motion between them
_TOO_FAR = 10.0  # tolerances: no part is made so badly; a value in the robot file is wrong
_TOLD = 3  # largest number of parameters that are named
DIAGNOSIS = "diagnosis"  # method name of a fit that a diagnosis has extended


def doubts(found: Identification) -> tuple[str, ...]:
    """All warnings about a fit, one sentence each; empty if there are none."""
    return tuple(filter(None, (doubt(found), off_the_drawing(found))))


def off_the_drawing(found: Identification) -> str:
    """Warning to check the robot file if a dimension is ten tolerances off; else empty.

    In a fit by least squares to the drawing its prior was made as wide as that.
    """
    geometry = found.chain.layout.geometry
    items = found.parameters.items[geometry]
    off = (found.theta - found.parameters.nominal)[geometry]
    times = np.abs(off) / found.parameters.prior[geometry]  # 0 where the tolerance is unbounded
    far = [int(k) for k in np.argsort(-times) if times[k] >= _TOO_FAR]
    if not far:
        return ""
    named = [f"{items[k].name} by {times[k]:.0f} ({_length(off[k], items[k])})" for k in far]
    more = f" and {len(far) - _TOLD} more" if len(far) > _TOLD else ""
    return (
        f"ten tolerances or more from the nominal value: {', '.join(named[:_TOLD])}{more}: check "
        "the values and units in the robot file first"
    )


def _length(off: float, item: Parameter) -> str:
    """Format a deviation, in mm for a length and mrad for an angle."""
    factor, unit = _FOR_PEOPLE.get(item.unit, (1.0, item.unit))
    return f"{factor * off:+.3f} {unit}"


def doubt(found: Identification) -> str:
    """Warning about an error left that is far above the noise, as a sentence; else empty.

    Either the model is incomplete, and chi square is large as well; or there were too few places
    to identify the parameters.
    """
    ratio = found.full.held_out / found.noise.floor
    if ratio <= _FAR:
        return ""
    far = f"the error left is {ratio:.1f} times the noise of a pose"
    if found.full.held_out > found.frame_only.held_out:
        far += " and larger than that of the nominal robot in its best-fit frame"
    if found.effort.method not in (*FOUND, DIAGNOSIS):
        return (
            f"{far}: the search by {found.effort.method} has not converged, or {FOUND[0]} leaves "
            f"as much error; fit with {FOUND[0]} first"
        )
    if found.chi_square <= _LACKING:
        return (
            f"{far}: {len(found.weight)} poses are too few for {found.observability.rank} "
            "parameter combinations; measure more places"
        )
    if found.unseen_motion > _MOVED * found.noise.floor:
        return (
            f"{far}: stops with the same command and no motion recorded between them differ by "
            f"{1e3 * found.unseen_motion:.3g} mm (median), so the joints did move in between. "
            "Record joint_states, or say from which side each stop was approached (`direction` in "
            "the mapping of a table)"
        )
    if found.effort.method == DIAGNOSIS:
        return f"{far}, and no known cause explains it: see the verdict"
    return f"{far}, even at places that were in the fit: the model is incomplete; run a diagnosis"
