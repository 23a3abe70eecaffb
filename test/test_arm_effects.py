"""Effects on serial arms against textbook dynamics and plain arithmetic."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data.conditions import at_rest
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.effects.reducer_compliance import ReducerCompliance
from delta_calibration.effects.signals import GRAVITY, INERTIA
from delta_calibration.effects.thermal_growth_link import ThermalGrowthLink
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms.serial_arm import SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmTolerances
from delta_calibration.robot import load_robot

ROBOT = load_robot("scara")
SCARA = ROBOT.dimensions
UR10 = load_robot("ur10").dimensions

TOLERANCES = ArmTolerances(0.5e-3, 1e-3, 1e-3, 2e-3, 5e-3)
SCARA_ARM = SerialArm(SCARA, TOLERANCES)


def moving(joint, velocity, acceleration, payload):
    n = len(joint)
    return replace(
        at_rest(joint),
        velocity=velocity,
        acceleration=acceleration,
        payload=np.full(n, payload),
        payload_centre=np.zeros((n, 3)),
    )


def joint_torque(arm, at):
    """Torques borne by the reducers of the nominal arm, (n, m) [N m]."""
    signals = ReducerCompliance(ROBOT, arm).nominal(at)
    return signals.of(GRAVITY) + signals.of(INERTIA)


def test_torques_of_a_plane_arm_are_the_textbook_ones():
    """Two uniform rods and a point mass (Lagrange's equations, written out)."""
    rng = np.random.default_rng(1)
    q, w, a = (rng.uniform(-2, 2, (20, 2)) for _ in range(3))
    l1 = l2 = 0.5
    m1, m2, mp = 8.0, 5.0, 3.0
    c, s = np.cos(q[:, 1]), np.sin(q[:, 1])
    m11 = m1 * l1**2 / 3 + m2 * (l1**2 + l2**2 / 3 + l1 * l2 * c)
    m11 = m11 + mp * (l1**2 + l2**2 + 2 * l1 * l2 * c)
    m12 = m2 * (l2**2 / 3 + l1 * l2 * c / 2) + mp * (l2**2 + l1 * l2 * c)
    m22 = m2 * l2**2 / 3 + mp * l2**2
    h = (m2 / 2 + mp) * l1 * l2 * s
    one = m11 * a[:, 0] + m12 * a[:, 1] - h * (2 * w[:, 0] * w[:, 1] + w[:, 1] ** 2)
    two = m12 * a[:, 0] + m22 * a[:, 1] + h * w[:, 0] ** 2
    torque = joint_torque(SCARA_ARM, moving(q, w, a, mp))
    np.testing.assert_allclose(torque, np.stack([one, two], axis=1), atol=2e-3)


def test_weight_does_not_twist_upright_joints_but_others():
    """A horizontal arm bears m g times the lever of its centre."""
    q = np.array([[0.3, 0.7]])
    assert np.abs(joint_torque(SCARA_ARM, moving(q, 0 * q, 0 * q, 3.0))).max() < 1e-9
    base, upper, fore, *wrist = UR10.links
    links = (base, replace(upper, mass=10.0), replace(fore, mass=7.0), *wrist)
    arm = SerialArm(replace(UR10, links=links), TOLERANCES)
    level = np.zeros((1, 6))
    torque = joint_torque(arm, moving(level, 0 * level, 0 * level, 0.0))
    shoulder = 9.80665 * (10.0 * 0.612 / 2 + 7.0 * (0.612 + 0.5723 / 2))
    elbow = 9.80665 * 7.0 * 0.5723 / 2
    np.testing.assert_allclose(np.abs(torque[0, 1:3]), [shoulder, elbow], rtol=1e-9)
    assert abs(torque[0, 0]) < 1e-9


def test_reducer_gives_way_against_its_load_and_the_same_both_ways_round():
    q, w = np.array([[0.5, 0.8]]), np.array([[1.0, -2.0]])
    effect = ReducerCompliance(ROBOT, SCARA_ARM)
    a = np.array([[20.0, 0.0]])
    columns = effect.columns(moving(q, w, a, 2.0))
    assert columns.shape == (1, 2, 2)
    assert columns[0, 0, 0] < 0  # the link lags behind
    np.testing.assert_allclose(columns, effect.columns(moving(q, -w, a, 2.0)), atol=1e-3)
    assert effect.missing(at_rest(q)) == "the payload is not known"


def test_reducers_suit_arms_of_known_mass_only():
    robots = [load_robot(name) for name in ("scara", "ur10", "linear_delta", "srbd")]
    have = {r.name: {effect.cause for effect in catalogue(r, r.model())} for r in robots}
    assert {name for name, causes in have.items() if "reducer_compliance" in causes} == {"scara"}
    assert {n for n, c in have.items() if "thermal_growth_link" in c} == {"scara", "ur10"}
    delta = load_robot("linear_delta")
    with pytest.raises(InputError, match="robot linear_delta has no such part"):
        effect_named("reducer_compliance", delta, delta.model(), {})


def test_ten_kelvin_lengthen_a_metre_of_aluminium_by_a_quarter_millimetre():
    growth = ThermalGrowthLink(ROBOT, SCARA_ARM, sensor="link")
    chain = Chain(SCARA_ARM, np.zeros(3), 1e-3, (growth,))
    theta = chain.join(SCARA_ARM.parameters.nominal, np.zeros(3), Frame.identity())
    theta[-1] = 23e-6
    at = replace(
        at_rest(np.zeros((2, 2))),
        temperature_parts=("link",),
        temperature=np.array([[20.0], [30.0]]),
    )
    reach = chain.predict(at, theta)
    np.testing.assert_allclose(reach[:, 0], [1.0, 1.0 + 0.23e-3], atol=1e-12)


def test_a_length_at_fault_is_named_link_length():
    """Causes of geometric parameters: both links' lengths, zeros, axes."""
    cause = {p.name: p.cause for p in SCARA_ARM.parameters}
    assert cause["length_2"] == cause["tool_x"] == "link_length"
    assert cause["zero_2"] == "joint_zero_offset"
    assert cause["skew_2"] == "joint_axis_tilt"


@pytest.mark.parametrize("twist", [0.0, np.pi])
def test_an_arm_that_grows_is_one_drawn_larger(twist: float):
    """Including offsets along parallel axes, whichever way these point."""
    base, upper, elbow, fore, *wrist = UR10.links
    elbow, fore = replace(elbow, offset=0.05), replace(fore, twist=twist)
    drawn = replace(UR10, links=(base, upper, elbow, fore, *wrist))
    arm = SerialArm(drawn, TOLERANCES)
    chain = Chain(arm, np.zeros(3), 1e-3, (ThermalGrowthLink(ROBOT, arm, sensor="link"),))
    theta = chain.join(arm.parameters.nominal, np.zeros(3), Frame.identity())
    theta[-1] = 23e-6
    q = np.random.default_rng(3).uniform(-2.0, 2.0, (10, 6))
    warm = replace(at_rest(q), temperature_parts=("link",), temperature=np.full((10, 1), 30.0))
    larger = 1 + 23e-5
    links = [
        replace(link, length=larger * link.length, offset=larger * link.offset)
        for link in drawn.links
    ]
    other = SerialArm(replace(drawn, links=tuple(links)), TOLERANCES)
    expected = other.forward(q, other.parameters.nominal)[:, :3]
    np.testing.assert_allclose(chain.predict(warm, theta), expected, atol=1e-12)
