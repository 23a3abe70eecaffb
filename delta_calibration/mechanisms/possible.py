"""Dimensions that no machine can have."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.mechanisms.base import Mechanism

Array = NDArray[np.float64]

_MOST = {"m": 10.0, "rad": np.pi}  # of an error of a part
_FAR = 20.0  # a parameter whose nominal value exceeds this many priors is a length


def impossible(mechanism: Mechanism, geometry: Array) -> str:
    """What is not possible about these dimensions (p,), as a sentence; empty if nothing is.

    Lengths are positive, no part is off its drawing by more than 10 m or half a turn, and a
    machine has a pose at home.
    """
    for parameter, value in zip(mechanism.parameters, geometry.tolist(), strict=True):
        most = _MOST.get(parameter.unit, np.inf)
        if abs(value - parameter.nominal) > most:
            drawn = f"{parameter.nominal:g} {parameter.unit}"
            return (
                f"{parameter.name} is {value:g} {parameter.unit}; "
                f"at most {most:.4g} from its drawing, {drawn}, is allowed"
            )
        # Only a length is so many tolerances away from zero.
        if parameter.nominal > _FAR * parameter.prior and value <= 0.0:
            return f"{parameter.name} is {value:g} {parameter.unit}; it has to be above 0"
    with np.errstate(all="ignore"):
        pose = mechanism.forward(mechanism.home[None], geometry)
    if np.isfinite(pose).all():
        return ""
    home = mechanism.home.tolist()
    return f"a {mechanism.name} of these dimensions has no pose at home, joints at {home}"
