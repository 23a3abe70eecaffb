"""Likelihood of a machine's parameters from its calibrations, without their prior.

A calibration is the posterior N(d, C) of dimensions and effects under the tolerances of the
drawing and the usual spread of effects. Divided by that prior it gives the likelihood of its data,
in units of the prior

    L = C^-1 - 1,    l = C^-1 d

Parameter combinations whose variance is no smaller than the prior's contribute nothing. Nuisance
parameters of a session (reflector offset, effects on readings or by the session's clock) are
integrated out, and so are effects that most machines do not have; C has the tracker's frame
integrated out already. The likelihoods of a machine's sessions are added.
"""

from __future__ import annotations

import json
import tempfile
from collections import defaultdict
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import load_calibration
from delta_calibration.chain import Chain
from delta_calibration.effects import Effect
from delta_calibration.effects.base import SENSOR
from delta_calibration.estimation import DIAGNOSIS, Likelihood
from delta_calibration.robot import Robot
from delta_calibration.theta import entries

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Index = NDArray[np.int64]

_NOTHING = 1e-9  # [tolerances^2] least variance, of what was held fixed in a fit
_SAID = 0.999  # [tolerances^2] variance below which a combination was identified from data


@dataclass(frozen=True)
class Fitted:
    """Calibrations of one machine."""

    machine: str
    calibrations: tuple[Calibration, ...]
    diagnosed: Calibration | None = None  # the last one with a diagnosis

    @property
    def found(self) -> tuple[Effect, ...]:
        """Effects of the machine that its last diagnosis found."""
        return () if self.diagnosed is None else tuple(e for e, _ in self.diagnosed.live)

    @property
    def all_found(self) -> tuple[Effect, ...]:
        """All effects of its last diagnosis: also those on readings or by the session's clock."""
        return () if self.diagnosed is None else self.diagnosed.chain.effects

    def has(self, effects: Sequence[Effect]) -> Bools:
        """Which parameters of some effects its last diagnosis found, (k,)."""
        have = {alike(effect) for effect in self.found}
        return np.concatenate(
            [
                np.zeros(0, dtype=bool),
                *(
                    _free(self.diagnosed, e)
                    if self.diagnosed is not None and alike(e) in have
                    else np.zeros(len(e.parameters), dtype=bool)
                    for e in effects
                ),
            ]
        )

    def likelihood(self, effects: Sequence[Effect] = ()) -> Likelihood:
        """Likelihood of the dimensions and of some effects, summed over all calibrations."""
        each = [likelihood_of_calibration(one, effects) for one in self.calibrations]
        return Likelihood(
            np.sum([one.information for one in each], axis=0),
            np.sum([one.along for one in each], axis=0),
        )


def fitted(machine: str, documents: Iterable[Any], robot: Robot) -> Fitted:
    """Load the calibrations of a machine from documents in a store.

    Raises:
        ConfigError: a calibration was made for another robot.
    """
    calibrations, diagnosed = [], None
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "calibration.json"
        for document in documents:
            if "prior" in document["provenance"]:  # a fit with a prior from others
                continue
            file.write_text(json.dumps(document), encoding="utf-8")
            calibrations.append(load_calibration(file, robot))
            if document["provenance"]["method"] == DIAGNOSIS:
                diagnosed = calibrations[-1]
    return Fitted(machine, tuple(calibrations), diagnosed)


def common_effects(machines: Sequence[Fitted]) -> tuple[Effect, ...]:
    """Effects that most of the diagnosed machines have, in the same shape."""
    asked = sum(machine.diagnosed is not None for machine in machines)
    having: dict[Hashable, list[Effect]] = defaultdict(list)
    for machine in machines:
        for key, effect in {alike(effect): effect for effect in machine.found}.items():
            having[key].append(effect)
    return tuple(some[0] for some in having.values() if len(some) > asked / 2)


def alike(effect: Effect) -> Hashable:
    """Key of an effect's cause, parameters and shape: its searched fields, to two digits.

    Fields that follow from fitted values, such as the width of a play, are not part of the shape.
    """
    settings = effect.settings
    shape = {name: settings[name] for name in (*effect.told, SENSOR) if name in settings}
    return (
        effect.cause,
        effect.parameters.names,
        *(
            (name, float(f"{value:.2g}") if isinstance(value, float) else value)
            for name, value in shape.items()
            if isinstance(value, float | str)
        ),
    )


def together(machines: Sequence[Fitted], effects: Sequence[Effect] = ()) -> Likelihood:
    """Stack the likelihoods of N machines, of p dimensions and k parameters of effects.

    Information (N, p + k, p + k) and vectors (N, p + k).
    """
    each = [machine.likelihood(effects) for machine in machines]
    return Likelihood(
        np.stack([one.information for one in each]), np.stack([one.along for one in each])
    )


def likelihood_of_calibration(
    calibration: Calibration, effects: Sequence[Effect] = ()
) -> Likelihood:
    """Likelihood of a calibration's data, in units of the chain's priors about the drawing.

    Args:
        calibration: calibration of a machine.
        effects: effects to include with the dimensions; information 0 for those it does not have.
    """
    chain = calibration.chain
    rows = _rows(chain, effects)
    whole, sums = np.zeros((len(rows), len(rows))), np.zeros(len(rows))
    if calibration.uncertainty is None:  # an older file without uncertainty
        return Likelihood(whole, sums)
    parameters, prior = chain.parameters, chain.parameters.prior
    variance = np.diag(calibration.uncertainty.covariance)
    known = np.isfinite(prior) & (variance > 0)
    prior = prior[known]
    off = (calibration.theta - parameters.nominal)[known] / prior
    covariance = calibration.uncertainty.covariance[np.ix_(known, known)] / np.outer(prior, prior)
    value, way = np.linalg.eigh(covariance)
    said = value < _SAID
    value = np.maximum(value, _NOTHING)
    sure = np.where(said, 1 / value, 1.0)
    information = (way * (sure - 1)) @ way.T
    along = way @ (np.where(said, sure, 0.0) * (way.T @ off))
    numbers = np.flatnonzero(known)
    here = np.isin(numbers, rows)
    information, along = _integrated(information, along, here)
    where = {int(entry): row for row, entry in enumerate(rows)}
    place = np.array([where[int(entry)] for entry in numbers[here]], dtype=np.int64)
    whole[np.ix_(place, place)], sums[place] = information, along
    return Likelihood(whole, sums)


def _rows(chain: Chain, effects: Sequence[Effect]) -> Index:
    """Entries in theta of the dimensions and of these effects; -1 for effects it does not have."""
    have = {alike(e): own for e, own in zip(chain.effects, chain.layout.each, strict=True)}
    parts = [entries(chain.layout.geometry)]
    for effect in effects:
        own = have.get(alike(effect))
        missing = np.full(len(effect.parameters), -1)
        parts.append(missing if own is None else entries(own))
    return np.concatenate(parts)


def _integrated(information: Array, along: Array, here: Bools) -> tuple[Array, Array]:
    """Integrate out all parameters that are not in the mask `here`, with their prior."""
    rest = information[~here][:, ~here] + np.eye(int(np.count_nonzero(~here)))
    carried = np.linalg.solve(rest, information[~here][:, here]).T
    return (
        information[here][:, here] - carried @ information[~here][:, here],
        along[here] - carried @ along[~here],
    )


def _free(calibration: Calibration, effect: Effect) -> Bools:
    """Which parameters of an effect were fitted, (k,); the others are exactly 0."""
    for own, part in zip(calibration.chain.effects, calibration.chain.layout.each, strict=True):
        if alike(own) == alike(effect) and calibration.uncertainty is not None:
            return np.asarray(np.diag(calibration.uncertainty.covariance)[part] > 0)
    return np.zeros(len(effect.parameters), dtype=bool)
