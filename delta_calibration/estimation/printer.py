"""Calibration of a Delta printer from its own measurements: probed heights, caliper distances.

Nine parameters are identifiable: radius, two tower angles, three endstops and three arms. A
rotation of the whole about z changes no height or distance, so tower 3 keeps its nominal angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.estimation.measurements import (
    DistanceBetween,
    HeightAtContact,
    PlacedMachine,
)
from delta_calibration.estimation.mixed_measurements import MixedFit, fit_observations
from delta_calibration.mechanisms.linear_delta import (
    LinearDelta,
    LinearDeltaDimensions,
    LinearDeltaTolerances,
)

Array = NDArray[np.float64]
Touched = HeightAtContact | DistanceBetween

# Tolerances of a printer sold as a kit; endstops are screws set by hand.
KIT = LinearDeltaTolerances(radius=2e-3, angle=5e-3, endstop=10e-3, arm=1e-3)
_TURN = "tower_angle_3"


def printer(radius: float, angle: Array, arm: float, height: float) -> LinearDelta:
    """Return the nominal model of a printer.

    Args:
        radius: of the towers [m].
        angle: of the towers about z, (3,) [rad].
        arm: [m].
        height: of the nozzle over the bed's centre with all carriages at their endstops [m].

    Raises:
        ConfigError: arms that do not reach the middle, or towers at the same place.
    """
    return LinearDelta(LinearDeltaDimensions(radius, angle, arm, height), KIT)


def fit_printer(machine: LinearDelta, seen: Sequence[Touched], priors: bool = True) -> MixedFit:
    """Fit the nine identifiable parameters to these measurements.

    Raises:
        DataError: without priors, fewer measurements than parameters; joints out of reach.
    """
    free = np.array([name != _TURN for name in machine.parameters.names])
    return fit_observations(machine, seen, free=free, priors=priors)


def left_out(machine: LinearDelta, seen: Sequence[Touched], priors: bool = True) -> list[Array]:
    """Leave-one-out residual of each measurement, one array (n,) [m] for each kind."""
    missed = []
    for kind, observation in enumerate(seen):
        errors = np.zeros(len(observation.joint))
        for row in range(len(errors)):
            rest = [*seen[:kind], taken(observation, row, alone=False), *seen[kind + 1 :]]
            found = fit_printer(machine, [o for o in rest if len(o.joint)], priors).machine
            errors[row] = taken(observation, row, alone=True).missed(found)[0, 0]
        missed.append(errors)
    return missed


def taken(observation: Touched, row: int, alone: bool) -> Touched:
    """Return one measurement (`alone`), or all others."""
    kept = np.arange(len(observation.joint)) == row
    rows = kept if alone else ~kept
    return replace(
        observation, **{name: getattr(observation, name)[rows] for name in observation.each}
    )


def endstops(machine: PlacedMachine | Array) -> Array:
    """Height of the nozzle over the bed's centre by each carriage at its endstop, (3,) [m].

    Firmware calls this the endstop position: the height of the carriage's joint minus the height
    of an arm that leans in to the middle.
    """
    g = machine if isinstance(machine, np.ndarray) else machine.geometry
    return np.asarray(g[4:7] - np.sqrt(g[7:10] ** 2 - g[0] ** 2))
