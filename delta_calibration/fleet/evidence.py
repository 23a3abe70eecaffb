"""What the fits of a machine say of its dimensions, apart from what they were told before.

A calibration is the posterior N(d, C) of dimensions under the tolerances of the drawing. Divided
by that prior the likelihood of its data is left, in tolerances about the drawing

    L = C^-1 - 1,    l = C^-1 d

Combinations of which a fit is no surer than the tolerances say nothing. What belongs to a session
or to an effect, the reflector's place and the values of the effect, is integrated out first; the
tracker's frame is by C itself. The sessions of a machine add up.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.estimation import Likelihood
from delta_calibration.robot import Robot

Array = NDArray[np.float64]

_NOTHING = 1e-9  # [tolerances^2] variance of what was held in a fit
_SAID = 0.999  # [tolerances^2] variance up to which a combination is known from data


@dataclass(frozen=True)
class Fitted:
    """Calibrations of one machine."""

    machine: str
    calibrations: tuple[Calibration, ...]

    @property
    def likelihood(self) -> Likelihood:
        """What all of them say of the dimensions."""
        each = [likelihood_of_calibration(one) for one in self.calibrations]
        return Likelihood(
            np.sum([one.information for one in each], axis=0),
            np.sum([one.along for one in each], axis=0),
        )


def fitted(machine: str, documents: Iterable[Any], robot: Robot) -> Fitted:
    """The calibrations of a machine as a store keeps them.

    Raises:
        ConfigError: one was made for another robot.
    """
    calibrations = []
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.json"
        for document in documents:
            if "prior" in document["provenance"]:  # a fit that was told of others already
                continue
            file.write_text(json.dumps(document), encoding="utf-8")
            calibrations.append(load_calibration(file, robot))
    return Fitted(machine, tuple(calibrations))


def together(machines: Sequence[Fitted]) -> Likelihood:
    """What each of several machines says, (N, p, p) and (N, p)."""
    each = [machine.likelihood for machine in machines]
    return Likelihood(
        np.stack([one.information for one in each]), np.stack([one.along for one in each])
    )


def likelihood_of_calibration(calibration: Calibration) -> Likelihood:
    """What the data of a calibration say of the dimensions, in tolerances off the drawing."""
    chain, size = calibration.chain, calibration.chain.layout.geometry_size
    parameters = chain.parameters
    if calibration.uncertainty is None:  # of a file from before it was told
        return Likelihood(np.zeros((size, size)), np.zeros(size))
    variance = np.diag(calibration.uncertainty.covariance)
    known = np.isfinite(parameters.prior) & (variance > 0)
    prior = parameters.prior[known]
    off = (calibration.theta - parameters.nominal)[known] / prior
    covariance = calibration.uncertainty.covariance[np.ix_(known, known)] / np.outer(prior, prior)
    value, way = np.linalg.eigh(covariance)
    said = value < _SAID
    value = np.maximum(value, _NOTHING)
    sure = np.where(said, 1 / value, 1.0)
    information = (way * (sure - 1)) @ way.T
    along = way @ (np.where(said, sure, 0.0) * (way.T @ off))
    return _of_geometry(information, along, np.flatnonzero(known), size)


def _of_geometry(
    information: Array, along: Array, rows: NDArray[np.intp], size: int
) -> Likelihood:
    """Integrate out all that is not geometry, by its prior of one tolerance."""
    here = rows < size
    rest = information[~here][:, ~here] + np.eye(int(np.count_nonzero(~here)))
    carried = np.linalg.solve(rest, information[~here][:, here]).T
    own = information[here][:, here] - carried @ information[~here][:, here]
    whole, sums = np.zeros((size, size)), np.zeros(size)
    whole[np.ix_(rows[here], rows[here])] = own
    sums[rows[here]] = along[here] - carried @ along[~here]
    return Likelihood(whole, sums)
