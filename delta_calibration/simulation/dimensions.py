"""Causes that are dimensions of the machine: its geometry, and the reflector's place on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.parameters import Parameter
from delta_calibration.simulation.options import LOCATION, Options, require_known, sizes

Array = NDArray[np.float64]

SCATTER = "geometry"  # errors of all parts, none of them most of all
OFFSET = "smr_offset"
# Standard deviations of a part: so large, an error of one is plain among those of the others.
_PLAIN = 3.0
# What of a cause's parameters a hidden one goes into: the same shift of a base joint and of its
# platform joint would do nothing, and a mismatch is of the rods, not of widths and tilts as well.
_HIDDEN_IN = {"base_joint_position": "base_", "parallelogram_mismatch": "rod_mismatch"}


def dimensions(chain: Chain) -> tuple[Parameter, ...]:
    """Geometry of the mechanism and place of the reflector, in the order of theta."""
    return chain.parameters.items[chain.layout.dimensions]


def dimension_causes(chain: Chain) -> tuple[str, ...]:
    """Causes that a dimension can have."""
    return (SCATTER, *dict.fromkeys(p.cause for p in dimensions(chain)))


def rows_of(chain: Chain, cause: str, location: str | None) -> list[int]:
    """Which of the dimensions a hidden cause goes into; none if there is no such place."""
    part = _HIDDEN_IN.get(cause, "")
    return [
        row
        for row, p in enumerate(dimensions(chain))
        if (p.cause != OFFSET if cause == SCATTER else p.cause == cause)
        and location in (None, p.location)
        and p.name.startswith(part)
    ]


def shift_of(chain: Chain, cause: str, options: Options, rng: np.random.Generator) -> Array:
    """What a cause adds to the dimensions, (p + 3,) [m, rad].

    One part is moved as far as the options say, all parameters of the cause alike; a reflector so
    far in a direction that is drawn; `geometry` draws all parts anew, beside their scatter.

    Raises:
        InputError: an option that there is not, or a value that is no number.
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
