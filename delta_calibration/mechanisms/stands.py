"""Check of the directions of a Delta's legs or towers about its axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.sections import as_written, refused

Array = NDArray[np.float64]

_APART = np.pi / 180  # [rad] smallest angle between two directions about the axis


def require_apart(section: Any, name: str, stands: Array, what: str) -> None:
    """Refuse legs or towers of which two have nearly the same direction.

    Args:
        section: section of the robot file.
        name: field of the section that holds the directions.
        stands: angles about z (k,) [rad].
        what: plural word for them, for the message.

    Raises:
        ConfigError: names the entry, its value and what is allowed.
    """
    apart = np.abs(np.exp(1j * stands[:, None]) - np.exp(1j * stands))
    if apart[np.triu_indices(len(stands), 1)].min() < _APART:
        raise refused(
            section,
            name,
            f"{len(stands)} {what} at least {as_written(_APART, 'deg')} deg apart: two in the "
            "same place do not hold the platform",
        )
