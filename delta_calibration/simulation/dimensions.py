"""Causes that are dimensions of the machine: its geometry, and the reflector's place on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.parameters import Parameter
from delta_calibration.simulation.options import LOCATION, Options, require_known, sizes

Array = NDArray[np.float64]

SCATTER = "geometry"  # errors of all parts, none of them dominant
OFFSET = "smr_offset"
# Standard deviations of a part: an error this large stands out from those of other parts.
_PLAIN = 3.0
# Which of a cause's parameters a hidden error changes: the same shift of a base joint and of its
# platform joint would have no effect, and a mismatch is of the rods, not of widths and tilts too.
_HIDDEN_IN = {"base_joint_position": "base_", "parallelogram_mismatch": "rod_mismatch"}


def dimensions(chain: Chain) -> tuple[Parameter, ...]:
    """Geometry of the mechanism and place of the reflector, in the order of theta."""
    return chain.parameters.items[chain.layout.dimensions]


def dimension_causes(chain: Chain) -> tuple[str, ...]:
    """Causes of errors in the dimensions."""
    return (SCATTER, *dict.fromkeys(p.cause for p in dimensions(chain)))


def rows_of(chain: Chain, cause: str, location: str | None) -> list[int]:
    """Rows of the dimensions that a hidden cause changes; none if there is no such location."""
    part = _HIDDEN_IN.get(cause, "")
    return [
        row
        for row, p in enumerate(dimensions(chain))
        if (p.cause != OFFSET if cause == SCATTER else p.cause == cause)
        and location in (None, p.location)
        and p.name.startswith(part)
    ]


def shift_of(chain: Chain, cause: str, options: Options, rng: np.random.Generator) -> Array:
    """Shift of the dimensions by a cause, (p + 3,) [m, rad].

    All parameters of the cause, at its location if one is given, are shifted by the size in the
    options; a reflector by that size in a random direction; `geometry` draws errors of all parts
    in addition to their scatter.

    Raises:
        InputError: an unknown option, or a value that is not a number.
    """
    rows = rows_of(chain, cause, options.get(LOCATION))
    every = dimensions(chain)
    typical = np.array([every[row].prior for row in rows])
    shift = np.zeros(len(every))
    if cause == SCATTER:
        require_known(cause, options, (LOCATION, "strength"))
        drawn = rng.standard_normal(chain.layout.geometry_size)[rows]
        shift[rows] = drawn * sizes(cause, options, typical, 1.0, "")
    elif cause == OFFSET:
        require_known(cause, options, ("value", "strength"))
        way = rng.standard_normal(3)
        shift[rows] = way / np.linalg.norm(way) * sizes(cause, options, typical, 1.0, "m")
    else:
        require_known(cause, options, (LOCATION, "value", "strength"))
        shift[rows] = sizes(cause, options, typical, _PLAIN, every[rows[0]].unit)
    return shift
