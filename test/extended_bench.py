"""Calibrations with effects, made from a fit and given effects."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from delta_calibration.effects import effect_named
from delta_calibration.estimation import Identification
from delta_calibration.robot import Robot

Effects = Mapping[str, tuple[Mapping[str, object], object]]


def with_effects(found: Identification, robot: Robot, effects: Effects) -> Identification:
    """The fit with these effects added: settings and values of each, by its cause."""
    mechanism = found.chain.mechanism
    made = [effect_named(cause, robot, mechanism, shape) for cause, (shape, _) in effects.items()]
    values = [
        np.broadcast_to(np.asarray(value, dtype=float), len(effect.parameters))
        for effect, (_, value) in zip(made, effects.values(), strict=True)
    ]
    theta = np.concatenate([found.theta, *values])
    covariance = np.diag(1e-10 * np.arange(1.0, len(theta) + 1))
    covariance[: len(found.theta), : len(found.theta)] = found.covariance
    chain = found.chain.with_effects(tuple(made))
    told = replace(found.uncertainty, covariance=covariance)
    return replace(found, chain=chain, theta=theta, covariance=covariance, uncertainty=told)
