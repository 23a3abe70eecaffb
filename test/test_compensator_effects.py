"""Compensation by an extended calibration, against scipy's root on the chain run forward."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import JointCompensator, Verdict
from delta_calibration.effects import effect_named
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from delta_calibration.samples import Conditions, at_rest

ROBOT = load_robot("srbd")
NOMINAL = ROBOT.model("rotary_delta")
Q = np.array([[0.2, 0.1, 0.3], [0.6, 0.0, 0.2], [0.1, 0.5, 0.4], [0.3, 0.3, -0.1]])
CASES = {
    "backlash": ({}, 3e-4),
    "joint_compliance": ({}, 4e-5),
    "forearm_compliance": ({}, 6e-7),
    "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),
    "joint_lag": ({}, 5e-3),
    "transmission_error": ({"cycles": 66.0}, 1e-4),
    "encoder_eccentricity": ({}, 3e-4),
    "joint_scale": ({}, 5e-4),
}


def conditions(q: np.ndarray) -> Conditions:
    rng = np.random.default_rng(3)
    n = len(q)
    return replace(
        at_rest(q),
        velocity=rng.uniform(-0.5, 0.5, q.shape),
        direction=rng.choice([-1.0, 1.0], q.shape),
        travel=np.full(q.shape, 0.1),
        payload=np.full(n, 2.0),
        payload_centre=np.tile([0.0, 0.0, -0.03], (n, 1)),
        temperature_parts=("arm",),
        temperature=np.full((n, 1), 31.0),
    )


def calibration(*causes: str) -> Calibration:
    mechanism = ROBOT.model()
    effects = tuple(effect_named(c, ROBOT, mechanism, CASES[c][0]) for c in causes)
    chain = Chain(mechanism, np.zeros(3), 0.05, effects)
    rng = np.random.default_rng(1)
    parameters = mechanism.parameters
    geometry = parameters.nominal + parameters.prior * rng.standard_normal(len(parameters))
    theta = chain.join(geometry, np.zeros(3), Frame.identity())
    values = [CASES[e.cause][1] * np.ones(len(e.parameters)) for e in effects]
    theta[chain.base_size :] = np.concatenate([*values, np.zeros(0)])
    corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1.5, 0.0)], float)
    lower, upper = ROBOT.joints.lower, ROBOT.joints.upper
    return Calibration(ROBOT, chain, theta, Region(corners), lower, upper, 1e-5, "t", "s")


def by_root(made: Calibration, at: Conditions, row: int) -> np.ndarray:
    """The command that brings the whole chain to where the nominal robot means."""
    target = NOMINAL.forward(at.joint, NOMINAL.parameters.nominal)[row]

    def missed(q: np.ndarray) -> np.ndarray:
        here = replace(at.take(slice(row, row + 1)), joint=q[None])
        return (made.chain.predict(here, made.theta)[0] - target) * 1e3

    found = root(missed, at.joint[row], tol=1e-13)
    assert np.abs(found.fun).max() < 1e-9
    return found.x


@pytest.mark.parametrize("causes", [*((c,) for c in CASES), ("backlash", "forearm_compliance")])
@pytest.mark.parametrize("compiled", [False, True])
def test_the_whole_chain_ends_where_the_nominal_robot_means(
    causes: tuple[str, ...], compiled: bool
) -> None:
    made, at = calibration(*causes), conditions(Q)
    done = JointCompensator(made, compiled=compiled).compensate(Q, at)
    assert set(done.verdicts) == {Verdict.CORRECTED}
    expected = [by_root(made, at, row) for row in range(len(Q))]
    # loads are those at the nominal command: a correction of mrad changes them by a thousandth,
    # and with them 20 um of stretch by less than 0.1 um
    np.testing.assert_allclose(done.joint, expected, atol=3e-7)


def test_play_is_taken_back_by_the_side_it_is_on() -> None:
    made = calibration("backlash")
    compensator = JointCompensator(made)
    up, down = (
        compensator.compensate(Q, replace(conditions(Q), direction=np.full(Q.shape, side)))
        for side in (1.0, -1.0)
    )
    np.testing.assert_allclose(up.joint - down.joint, 3e-4, atol=1e-10)
    unknown = compensator.compensate(Q, replace(conditions(Q), direction=np.zeros(Q.shape)))
    np.testing.assert_allclose(unknown.joint, (up.joint + down.joint) / 2, atol=1e-10)


@pytest.mark.parametrize("cause", ["joint_compliance", "thermal_growth_arm"])
def test_without_a_condition_that_the_model_needs_nothing_is_corrected(cause: str) -> None:
    compensator = JointCompensator(calibration(cause))
    unknown = replace(
        conditions(Q), payload=np.full(len(Q), np.nan), temperature=np.full((len(Q), 1), np.nan)
    )
    for at in (None, unknown):
        done = compensator.compensate(Q, at)
        assert set(done.verdicts) == {Verdict.MISSING_CONDITION}
        np.testing.assert_array_equal(done.joint, Q)
        assert "not known" in compensator.missing(unknown)


def test_what_went_by_a_sessions_clock_is_left_out_and_said() -> None:
    mechanism = ROBOT.model()
    drift = effect_named("joint_zero_drift", ROBOT, mechanism, {})
    made = calibration()
    chain = made.chain.with_effects((drift,))
    made = replace(made, chain=chain, theta=np.concatenate([made.theta, np.full(3, 1e-3)]))
    assert made.left_out == ("joint_zero_drift",)
    plain = JointCompensator(calibration()).compensate(Q)
    np.testing.assert_array_equal(JointCompensator(made).compensate(Q).joint, plain.joint)
