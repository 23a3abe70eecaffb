"""Effects on the way from joints to reading: where they add, and what the derivatives say of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from six_rods import SixRods, workspace

from delta_calibration.chain import Chain
from delta_calibration.effects import EFFECTS, Effect, Stage, effect_named
from delta_calibration.effects.unexplained import Unexplained
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from delta_calibration.samples import Conditions, at_rest

ROBOT = load_robot("srbd")
MODELS = ("rotary_delta", "six_rod_delta")
OFFSET = np.array([0.06, -0.03, 0.02])
FRAME = Frame.from_vector(np.array([0.3, -0.2, 1.9, -2.0, 1.0, 0.5]))
ALL = [(model, cause) for model in MODELS for cause in (*EFFECTS, "unexplained")]
each_effect = pytest.mark.parametrize(("model", "cause"), ALL)
SETTINGS = {
    "tracker_drift": {"time_constant": 1800.0},
    "thermal_growth_arm": {"sensor": "arm"},
    "thermal_growth_base": {"sensor": "base"},
    "thermal_growth_forearm": {"time_constant": 2400.0},
    "joint_zero_drift": {"step_at": 1000.0},
    "transmission_error": {"cycles": 66.0},
    "backlash": {"width": (3e-4, 2e-4, 1e-4)},
}


def conditions(n: int = 10, seed: int = 1) -> Conditions:
    """Half of the samples stand, half move; everything is known."""
    rng = np.random.default_rng(seed)
    moving = (np.arange(n) % 2)[:, None]
    return replace(
        at_rest(workspace(n, rng)),
        time=np.linspace(0.0, 7200.0, n),
        velocity=moving * rng.uniform(-1.0, 1.0, (n, 3)),
        acceleration=moving * rng.uniform(-5.0, 5.0, (n, 3)),
        direction=rng.choice([-1.0, 1.0], (n, 3)),
        travel=rng.uniform(0.0, 1e-3, (n, 3)),
        payload=rng.choice([0.5, 2.0], n),
        payload_centre=rng.uniform(-0.03, 0.03, (n, 3)),
        temperature_parts=("arm", "base"),
        temperature=rng.uniform(22.0, 32.0, (n, 2)),
    )


def effect(model: str, cause: str, **settings: object) -> Effect:
    if cause == "unexplained":
        plain = effect(model, "backlash")
        return Unexplained.over(plain, "position", workspace(6, np.random.default_rng(3)))
    shape = settings or SETTINGS.get(cause, {})
    return effect_named(cause, ROBOT, ROBOT.model(model), shape)


def crooked(model: str, *effects: Effect, size: float = 1.0, seed: int = 2):
    """A chain with a real machine's errors, and effects of typical sizes on it."""
    chain, rng = Chain(ROBOT.model(model), OFFSET, 0.05, effects), np.random.default_rng(seed)
    p = chain.mechanism.parameters
    theta = chain.join(p.nominal + p.prior * rng.standard_normal(len(p)), OFFSET, FRAME)
    prior = chain.parameters.prior[chain.base_size :] / 5
    theta[chain.base_size :] = size * prior * rng.uniform(0.5, 1.5, len(prior))
    return chain, theta


def slope_of(function, theta: np.ndarray, column: int, step: float) -> np.ndarray:
    d = step * (np.arange(len(theta)) == column)
    return (function(theta + d) - function(theta - d)) / (2 * step)


@each_effect
def test_the_jacobian_is_that_of_the_prediction(model: str, cause: str) -> None:
    """In the effect's own values, about a machine with errors and the effect in it."""
    at = conditions()
    chain, theta = crooked(model, effect(model, cause))
    jacobian = chain.jacobian(at, chain.pose(at, theta), theta)
    assert jacobian.shape == (len(at), 3, len(theta))
    for column in range(chain.base_size, len(theta)):
        step = chain.parameters.prior[column] / 5
        slope = slope_of(lambda t: chain.predict(at, t), theta, column, step)
        scale = np.abs(slope).max()
        np.testing.assert_allclose(jacobian[..., column], slope, rtol=0, atol=1e-5 * scale + 1e-12)
    if chain.effects[0].stage is Stage.MEASUREMENT:
        theta[chain.base_size :] = 0.0  # its own part of the other slopes is left out: parts in 1e3
    jacobian = chain.jacobian(at, chain.pose(at, theta), theta)
    for column in (*range(8), *range(chain.geometry_size, chain.base_size)):
        slope = slope_of(lambda t: chain.predict(at, t), theta, column, 1e-6)
        np.testing.assert_allclose(jacobian[..., column], slope, atol=1e-7)


@each_effect
def test_slopes_are_by_what_is_behind_the_drives(model: str, cause: str) -> None:
    """One more shift of the joints, the same for all samples; one more change of a dimension."""
    if cause == "joint_zero_drift":
        return  # the shift itself
    at = conditions()
    before = effect(model, cause)
    chain, theta = crooked(model, before, effect(model, "joint_zero_drift", step_at=0.0))
    theta[chain.base_size :][: len(before.parameters)] *= before.stage is not Stage.MEASUREMENT
    by_joints, by_geometry = chain.slopes(at, chain.pose(at, theta), theta)
    for joint in range(3):
        slope = slope_of(lambda t: chain.predict(at, t), theta, joint - 3, 1e-6)
        np.testing.assert_allclose(by_joints[..., joint], slope, atol=1e-7)
    for column in range(0, chain.geometry_size, 5):
        slope = slope_of(lambda t: chain.predict(at, t), theta, column, 1e-6)
        np.testing.assert_allclose(by_geometry[..., column], slope, atol=1e-7)
