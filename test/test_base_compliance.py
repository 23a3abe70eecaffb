"""Tests of a base on soft feet: what is visible, how it is found, what is reported otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.chain import Chain
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

CAUSE = "base_compliance"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["srbd", "scara"])
def test_it_is_named_with_its_figures(name: str) -> None:
    """A machine on feet twice as soft as usual, 1.3 m below its base, 0.4 m from its centre."""
    robot = load_robot(name)
    hidden = {"strength": "2", "depth": "1.3", "radius": "0.4"}
    machine = draw_machine(robot, 3, 1.0, {CAUSE: hidden})
    (give,) = machine.theta[machine.chain.layout.effects]
    session = simulate_session(machine, make_plan("rich", robot, count=14, seed=3), 3)
    verdict = diagnose(survey(session, robot.joints.names), robot, seed=3).verdict
    assert [f.cause for f in verdict.findings] == [CAUSE]
    assert not verdict.unknown_structure.found
    found = {**verdict.findings[0].parameters, **verdict.findings[0].shape}
    for part, true in {"give": give, "depth_m": 1.3, "radius_m": 0.4}.items():
        assert abs(found[part].value - true) < 3 * found[part].std, part
    assert verdict.extended.held_out_rms_mm < 0.6 * verdict.calibrated.held_out_rms_mm


def test_feet_are_tried_no_deeper_than_a_file_may_say(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also for a platform that hangs far below the base."""
    robot = load_robot("srbd")
    effect = effect_named(CAUSE, robot, robot.model(), {})
    monkeypatch.setattr(type(effect), "_reach", 4.4)
    tried = list(effect.shapes(at_rest(np.zeros((2, 3)))))
    assert max(shape.depth for shape in tried) == effect.limits["depth"][1]
    assert [shape.wrong() for shape in tried] == [""] * len(tried)
    assert all(low <= s.depth <= high for s in tried for _, low, high in s.bounded_intervals()[:1])


def test_feet_below_lead_a_load_outwards_and_what_gives_above_it_inwards() -> None:
    """Rods, drives, and mounts in the plane of the drives have nearly the same influence."""
    robot = load_robot("srbd")
    model = robot.model()
    x = np.zeros((4, 3))
    x[:, 2], x[:, 0], x[:, 1] = -0.7, [0.3, -0.3, 0, 0], [0, 0, 0.3, -0.3]
    at = replace(at_rest(model.inverse(x, model.parameters.nominal)), payload=np.full(4, 2.0))
    at = replace(at, payload_centre=np.zeros((4, 3)))

    def outwards(cause: str, **shape: float) -> float:
        """Mean shift away from the centre by a typical effect [m]."""
        effect = effect_named(cause, robot, model, shape)
        chain = Chain(model, np.zeros(3), 0.05, (effect,))
        theta = chain.parameters.nominal
        plain = chain.predict(at, theta)
        theta[chain.layout.effects] = effect.parameters.prior
        shift = chain.predict(at, theta) - plain
        return float(np.mean(np.sum(shift[:, :2] * x[:, :2], axis=1)) / 0.3)

    for depth in (0.9, 1.3, 1.9):
        assert outwards(CAUSE, depth=depth) > 1e-6
    for cause, shape in (
        ("forearm_compliance", {}),
        ("joint_compliance", {}),
        (CAUSE, {"depth": 0.0}),
    ):
        assert outwards(cause, **shape) < -1e-6


def test_what_never_changes_is_the_frame_s() -> None:
    """With one place and one payload its signal is that of a displaced base."""
    robot = load_robot("srbd")
    effect = effect_named(CAUSE, robot, robot.model(), {})
    n = 6
    at = replace(
        at_rest(np.full((n, 3), 0.3)), payload=np.ones(n), payload_centre=np.zeros((n, 3))
    )
    columns = effect.columns(at)
    assert np.ptp(columns, axis=0).max() == 0.0
    assert np.abs(columns).max() > 1.0
    lighter = effect.columns(replace(at, payload=np.zeros(n)))
    assert np.abs(lighter - columns).max() == pytest.approx(9.80665)  # [N] of the payload


def test_a_robot_without_masses_is_told_so() -> None:
    arm, cables = load_robot("ur10"), load_robot("cdpr8")
    effect = effect_named(CAUSE, arm, arm.model(), {})
    lacking = effect.missing(at_rest(arm.model().home[None]))
    assert lacking == "the robot file states no masses"
    assert "mass_kg" in effect.remedied(lacking)
    assert effect.remedied("the payload is not known") == "record it: payload"
    assert CAUSE not in {e.cause for e in catalogue(cables, cables.model())}
