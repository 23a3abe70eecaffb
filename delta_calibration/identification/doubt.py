"""Whether a fit leaves far more than the noise, why, and what to do about it."""

from __future__ import annotations

from delta_calibration.identification.fit import Identification

_FAR = 2.0  # times the noise of a pose; a fit to enough places leaves 1.0 to 1.3 times
_LACKING = 2.0  # chi square per degree of freedom from which it is not the number of places
FOUND = ("least_squares", "alternating")  # methods that come to rest where the misfit is least
DIAGNOSIS = "diagnosis"  # the method of a fit that has been asked for what it lacks


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
