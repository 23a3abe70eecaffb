"""Where the three legs of a Delta may stand about its axis."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.sections import as_written, refused

Array = NDArray[np.float64]

_APART = np.pi / 180  # [rad] of two about the axis, at least


def require_apart(section: Any, name: str, stands: Array, what: str) -> None:
    """Refuse two in one place; `what` names them.

    Args:
        section: of the robot file.
        name: its field that holds them.
        stands: angles about z (k,) [rad].
        what: how they are called, many.

    Raises:
        ConfigError: names the entry, its value and what is allowed.
    """
    apart = np.abs(np.exp(1j * stands[:, None]) - np.exp(1j * stands))
    if apart[np.triu_indices(len(stands), 1)].min() < _APART:
        raise refused(
            section,
            name,
            f"{len(stands)} {what} at least {as_written(_APART, 'deg')} deg apart: by two in one "
            "place the platform is not held",
        )
