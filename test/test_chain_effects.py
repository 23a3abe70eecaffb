"""Tests of effects between joints and reading: where they are added, and their derivatives."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import EFFECTS, Effect, Stage, catalogue, effect_named
from delta_calibration.effects.signals import OF_JOINTS
from delta_calibration.effects.unexplained import Unexplained
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from delta_calibration.theta import entries
from six_rods import SixRods, workspace

ROBOT = load_robot("srbd")
MODELS = ("rotary_delta", "six_rod_delta")
OFFSET = np.array([0.06, -0.03, 0.02])
FRAME = Frame.from_vector(np.array([0.3, -0.2, 1.9, -2.0, 1.0, 0.5]))
CAUSES = [effect.cause for effect in catalogue(ROBOT, ROBOT.model())]
ALL = [(model, cause) for model in MODELS for cause in (*CAUSES, "unexplained")]
LOADED = {  # proportional to loads
    "joint_compliance",
    "forearm_compliance",
    "dynamic_deflection",
    "base_compliance",
}
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
    """Half of the samples are at rest, half move; all conditions are known."""
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
    """A chain with realistic errors, and effects of typical sizes."""
    chain, rng = Chain(ROBOT.model(model), OFFSET, 0.05, effects), np.random.default_rng(seed)
    p = chain.mechanism.parameters
    theta = chain.join(p.nominal + p.prior * rng.standard_normal(len(p)), OFFSET, FRAME)
    prior = chain.parameters.prior[chain.layout.effects] / 5
    theta[chain.layout.effects] = size * prior * rng.uniform(0.5, 1.5, len(prior))
    return chain, theta


def with_loads_kept(chain: Chain, at: Conditions, theta: np.ndarray):
    """The chain's prediction at other theta, with the effects under the loads of this theta.

    The derivatives of the chain are those of this function. The change of the loads with the pose
    is left out; it is a thousandth of the effect.
    """
    signals, (n, begin) = chain.signals(at, theta), (len(at), chain.layout.base.stop)
    alone, count = chain.with_effects(()), chain.layout.geometry_size

    def predict(changed: np.ndarray) -> np.ndarray:
        joint, g = at.joint.copy(), np.tile(changed[chain.layout.geometry], (n, 1))
        given = np.zeros((n, 6))
        for one, values in zip(chain.effects, chain.effect_values(changed), strict=True):
            shift = one.columns_of(signals) @ values
            if one.stage is Stage.DRIVE:
                joint += shift
            elif one.stage is Stage.BASE:
                given += shift
            else:
                g += shift
        bare = changed[:begin]
        rows = [
            alone.predict(at_rest(q[None]), np.concatenate([own, bare[count:]]))
            for q, own in zip(joint, g, strict=True)
        ]
        return with_base_moved(chain, changed, np.concatenate(rows), given)

    return predict


def with_base_moved(chain: Chain, theta: np.ndarray, readings: np.ndarray, given: np.ndarray):
    """Readings (n, 3) after shifts and rotations of the base in its own axes, (n, 6)."""
    frame = chain.split(theta)[2]
    inside = frame.inverse().apply(readings)
    return frame.apply(inside + given[:, :3] + np.cross(given[:, 3:], inside))


def displaced(chain: Chain, at: Conditions, theta: np.ndarray) -> float:
    """Largest displacement of a reading by the effects [m]."""
    alone = chain.with_effects(())
    moved = chain.predict(at, theta) - alone.predict(at, theta[chain.layout.base])
    return float(np.abs(moved).max())


def slope_of(function, theta: np.ndarray, column: int, step: float) -> np.ndarray:
    d = step * (np.arange(len(theta)) == column)
    return (function(theta + d) - function(theta - d)) / (2 * step)


@each_effect
def test_the_jacobian_is_that_of_the_prediction(model: str, cause: str) -> None:
    """Derivative by the effect's values, for a machine with errors and the effect."""
    at = conditions()
    chain, theta = crooked(model, effect(model, cause))
    loaded = cause in LOADED
    jacobian = chain.jacobian(at, theta)
    assert jacobian.shape == (len(at), 3, len(theta))
    predict = with_loads_kept(chain, at, theta) if loaded else lambda t: chain.predict(at, t)
    for column in entries(chain.layout.effects):
        step = chain.parameters.prior[column] / 5
        slope = slope_of(predict, theta, column, step)
        scale = np.abs(slope).max()
        np.testing.assert_allclose(jacobian[..., column], slope, rtol=0, atol=1e-5 * scale + 1e-12)
        if loaded:  # including what is left out
            slope = slope_of(lambda t: chain.predict(at, t), theta, column, step)
            np.testing.assert_allclose(jacobian[..., column], slope, rtol=0, atol=1e-3 * scale)
    if chain.effects[0].stage is Stage.MEASUREMENT:
        theta[chain.layout.effects] = (
            0.0  # its own part of the other derivatives is left out: 1e-3
        )
    jacobian = chain.jacobian(at, theta)
    for column in (*range(8), *range(chain.layout.offset.start, chain.layout.base.stop)):
        slope = slope_of(predict, theta, column, 1e-6)
        np.testing.assert_allclose(jacobian[..., column], slope, atol=1e-7)


@pytest.mark.parametrize(("model", "cause"), [a for a in ALL if a[1] != "joint_zero_drift"])
def test_slopes_are_by_what_is_behind_the_drives(model: str, cause: str) -> None:
    """A further shift of the joints, equal for all samples; a further change of a dimension."""
    at = conditions()
    before = effect(model, cause)
    chain, theta = crooked(model, before, effect(model, "joint_zero_drift", step_at=0.0))
    theta[chain.layout.effects][: len(before.parameters)] *= before.stage is not Stage.MEASUREMENT
    seen = chain.see(at, theta)
    by_joints, by_geometry = seen.by_joints, seen.jacobian[..., chain.layout.geometry]
    predicts = [(lambda t: chain.predict(at, t), 1e-7)]
    if cause in LOADED:
        # Exact except for the change of loads: the effect itself times the fraction by which a
        # dimension changes a load. The smallest levers are the half widths of the pairs, 0.04 m.
        own = theta * (np.arange(len(theta)) < len(theta) - 3)
        part = displaced(chain, at, own) / 0.02
        predicts = [(with_loads_kept(chain, at, theta), 1e-7), (predicts[0][0], part)]
    for predict, tolerance in predicts:
        for joint in range(3):
            slope = slope_of(predict, theta, len(theta) - 3 + joint, 1e-6)
            np.testing.assert_allclose(by_joints[..., joint], slope, atol=tolerance)
        for column in range(0, chain.layout.geometry_size, 5):
            slope = slope_of(predict, theta, column, 1e-6)
            np.testing.assert_allclose(by_geometry[..., column], slope, atol=tolerance)


@each_effect
def test_a_stage_shifts_in_proportion_and_not_at_all_at_zero(model: str, cause: str) -> None:
    """Joints, dimensions or reading of a chain with this effect alone."""
    at = conditions()
    chain, theta = crooked(model, effect(model, cause))
    base = chain.layout.base.stop
    bare = theta[:base]

    def stages(size: float) -> tuple[np.ndarray, ...]:
        seen = chain.see(at, np.concatenate([bare, size * theta[base:]]))
        _, offset, frame = chain.split(bare)
        still = frame.apply(chain.point(seen.x, offset))
        dimensions = seen.geometry + np.zeros((10, 1))
        return seen.joint, dimensions, seen.before - still, seen.reading - seen.before

    zero, one, three = stages(0.0), stages(1.0), stages(3.0)
    drawn = np.tile(bare[chain.layout.geometry], (10, 1))
    without = at.joint, drawn, np.zeros((10, 3)), np.zeros((10, 3))
    of = (Stage.DRIVE, Stage.STRUCTURE, Stage.BASE, Stage.MEASUREMENT)
    moved = of.index(chain.effects[0].stage)
    for stage in range(4):
        np.testing.assert_allclose(zero[stage], without[stage], rtol=0, atol=1e-15)
        shift = one[stage] - zero[stage]
        assert (np.abs(shift).max() > 1e-6) == (stage == moved)
        # Loads are those of the displaced machine: three times as far, other loads.
        rounding = 1e-14 + (cause in LOADED) * 2e-3 * np.abs(3 * shift).max()
        np.testing.assert_allclose(three[stage] - zero[stage], 3 * shift, atol=rounding)


@each_effect
def test_what_a_machine_does_is_seen_through_the_slopes_of_its_stage(model, cause) -> None:
    """J dq or dx/dg dg of the machine by differences; a tracker error does not move the robot."""
    at = conditions()
    chain, theta = crooked(model, effect(model, cause))
    (one,) = chain.effects
    bare, v = theta[chain.layout.base], theta[chain.layout.effects]
    alone = chain.with_effects(())
    seen = chain.predict(at, theta) - alone.predict(at, bare)
    if one.stage is Stage.MEASUREMENT:
        np.testing.assert_array_equal(chain.pose(at, theta), alone.pose(at, bare))
        assert not {*one.takes} & {*OF_JOINTS}  # independent of the joints
        return
    shift, h = one.columns_of(chain.signals(at, theta)) @ v, 1e-6  # with the loads that it bears
    total = np.zeros_like(seen)
    if one.stage is Stage.BASE:
        still = alone.predict(at, bare)
        total, shift = with_base_moved(chain, bare, still, shift) - still, shift[:, :0]
    for k in range(shift.shape[1]):
        if one.stage is Stage.DRIVE:
            step = h * np.eye(3)[k]
            ends = [alone.predict(replace(at, joint=at.joint + s), bare) for s in (step, -step)]
            total += (ends[0] - ends[1]) / (2 * h) * shift[:, k : k + 1]
        elif shift[:, k].any():
            total += slope_of(lambda t: alone.predict(at, t), bare, k, h) * shift[:, k : k + 1]
    assert np.abs(seen).max() > 2e-6
    np.testing.assert_allclose(seen, total, atol=3e-3 * np.abs(seen).max() + 1e-11)


def test_stages_follow_each_other_as_in_the_machine() -> None:
    """Joints from the encoder values, then dimensions, then the reading that results from both."""
    at, model = conditions(), "six_rod_delta"
    causes = ("tracker_scale", "thermal_growth_arm", "backlash", "joint_scale")
    each = tuple(effect(model, cause) for cause in causes)
    chain = Chain(ROBOT.model(model), OFFSET, 0.05, each)
    theta = chain.join(chain.mechanism.parameters.nominal, OFFSET, FRAME)
    scale, alpha, gap, ratio = 4e-4, 3e-5, np.array([3e-4, 2e-4, 1e-4]), np.array([2e-3, 0, -1e-3])
    theta[chain.layout.effects] = [scale, alpha, *gap, *ratio]
    play = -gap / 2 * at.direction * np.clip(2 * at.travel / gap - 1, -1, 1)
    joint = at.joint + play + ratio * at.joint  # both depend on the encoder: neither on the other
    point = []
    for q, celsius in zip(joint, at.temperature[:, 0], strict=True):
        longer = {f"arm_{leg}": alpha * 0.32 * (celsius - 20.0) for leg in (1, 2, 3)}
        point.append(SixRods(longer).point(q[None], OFFSET)[0])
    expected = (1 + scale) * FRAME.apply(np.array(point))
    np.testing.assert_allclose(chain.predict(at, theta), expected, atol=1e-12)
    unscaled = FRAME.inverse().apply(expected / (1 + scale))
    assert np.abs(unscaled - SixRods().point(at.joint, OFFSET)).max() > 1e-4


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("backlash", "joint_compliance"),
        ("forearm_compliance", "thermal_growth_base"),
        ("tracker_scale", "tracker_drift"),
        ("joint_lag", "timestamp_latency"),
    ],
)
@pytest.mark.parametrize("model", MODELS)
def test_two_effects_add_in_either_order(model: str, one: str, other: str) -> None:
    """Exactly at the same stage; through different stages except for products of both."""
    at, pair = conditions(), (effect(model, one), effect(model, other))
    chain, theta = crooked(model, *pair)
    turned, base = chain.with_effects(pair[::-1]), chain.layout.base.stop
    v, w = chain.effect_values(theta)
    both = chain.predict(at, theta)
    other_way = turned.predict(at, np.concatenate([theta[:base], w, v]))
    np.testing.assert_allclose(other_way, both, atol=1e-14)
    none, first, second = (
        chain.predict(at, np.concatenate([theta[:base], a * v, b * w]))
        for a, b in ((0, 0), (1, 0), (0, 1))
    )
    moved = np.abs(first - none).max(), np.abs(second - none).max()
    assert min(moved) > 1e-6
    np.testing.assert_allclose(both - none, first - none + second - none, atol=0.02 * min(moved))
    if pair[0].stage is Stage.MEASUREMENT and pair[1].stage is Stage.MEASUREMENT:
        np.testing.assert_allclose(both + none, first + second, atol=1e-15)


def test_theta_holds_the_effects_in_their_order_behind_the_cell() -> None:
    model, causes = "six_rod_delta", ("stick_slip", "tracker_drift", "forearm_compliance")
    chain, theta = crooked(model, *(effect(model, cause) for cause in causes))
    sizes = [3, 6, 1]
    assert (chain.layout.geometry_size, chain.layout.base.stop, len(theta)) == (66, 75, 85)
    names = chain.parameters.names
    assert names[:75] == chain.with_effects(()).parameters.names
    assert names[75:78] == ("stick_slip.stick_1", "stick_slip.stick_2", "stick_slip.stick_3")
    assert names[-1] == "forearm_compliance.rod_compliance"
    values = chain.effect_values(theta)
    assert [len(value) for value in values] == sizes
    np.testing.assert_array_equal(np.concatenate(values), theta[75:])
    typical = np.concatenate([e.parameters.prior for e in chain.effects])
    np.testing.assert_allclose(chain.parameters.prior[75:], 5 * typical)  # five typical sizes
    g, offset, frame = chain.split(theta)
    bare = chain.join(g, offset, frame)
    np.testing.assert_allclose(bare[:75], theta[:75], atol=1e-14)
    assert not bare[75:].any()
    assert chain.with_effects(()).effect_values(theta[:75]) == ()
    with pytest.raises(InputError, match=r"found twice: stick_slip\.stick_1"):
        _ = chain.with_effects((*chain.effects, effect(model, "stick_slip", speed=0.3))).parameters


def test_out_of_reach_by_an_effect_is_its_own_row() -> None:
    """An arm so warm that its machine cannot be assembled does not affect the other samples."""
    at = conditions()
    temperature = at.temperature.copy()
    temperature[3] = 1e6
    at = replace(at, temperature=temperature)
    chain, theta = crooked("six_rod_delta", effect("six_rod_delta", "thermal_growth_arm"))
    seen = np.isfinite(chain.predict(at, theta)).all(axis=1)
    assert seen.tolist() == [row != 3 for row in range(10)]


@pytest.mark.parametrize("cause", sorted(LOADED))
@pytest.mark.parametrize("model", MODELS)
def test_loads_are_those_of_the_machine_that_is_looked_at(model: str, cause: str) -> None:
    """The same samples with other masses, then in a machine with errors, and back."""
    heavy = replace(ROBOT, masses=replace(ROBOT.masses, platform=12.0))
    at = conditions()
    one, other = (EFFECTS[cause](robot, robot.model(model)) for robot in (ROBOT, heavy))
    drawn = one.columns(at)
    scale = np.abs(drawn).max()
    assert np.abs(other.columns(at) - drawn).max() > 0.5 * scale
    chain, theta = crooked(model, one)
    stands = one.columns_of(chain.signals(at, theta))
    assert 1e-4 * scale < np.abs(stands - drawn).max() < 0.1 * scale
    np.testing.assert_array_equal(one.columns(replace(at)), drawn)
