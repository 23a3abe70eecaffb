"""Tests of encoder interpolation errors: for which machines they are tried, and what is named."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from blind import hide
from blind.drives import LINES
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.robot import Robot, load_robot

CAUSE = "encoder_interpolation"


def stating(name: str, periods: float) -> Robot:
    """A robot whose file states its encoders' periods."""
    robot = load_robot(name)
    return replace(robot, joints=replace(robot.joints, encoder_lines=periods))


def tried(robot: Robot) -> bool:
    return CAUSE in {effect.cause for effect in catalogue(robot, robot.model())}


def test_it_is_tried_where_it_is_stated_and_could_be_seen() -> None:
    assert not tried(load_robot("scara"))
    assert tried(stating("scara", 1024))
    assert not tried(stating("scara", 1024 * 100))  # behind a gear: 3 urad of 12 at rest
    assert not tried(stating("scara", 2048))  # readings in motion are averaged over its periods
    assert tried(stating("linear_delta", 2 * np.pi * 500))  # a tape of 2 mm


@pytest.mark.parametrize(("name", "stated"), [("scara", 1024), ("linear_delta", 2 * np.pi * 500)])
def test_signals_off_their_ideal_are_told_by_what_the_law_says(name: str, stated: float) -> None:
    """Offsets, amplitude and phase of sine and cosine, through the arc tangent (Heydemann)."""
    robot = stating(name, stated)
    arm = robot.model()
    effect = effect_named(CAUSE, robot, arm, {})
    period = 2 * np.pi / stated
    own = np.linspace(0.0, 2 * period, 60)
    angle = arm.home + own[:, None]
    one, two, more, skew = 3e-3, -2e-3, 4e-3, 1e-3
    phase = stated * angle
    told = np.arctan2((1 + more) * np.sin(phase + skew) + two, np.cos(phase) + one)
    off = (told - phase + np.pi) % (2 * np.pi) - np.pi
    m = arm.joints
    values = np.repeat([one, -two, -more / 2, -skew / 2], m) / stated
    shift = effect.columns(at_rest(angle)) @ values
    expected = -off / stated + skew / 2 / stated  # the constant part is the joint's zero
    np.testing.assert_allclose(shift, expected, atol=3e-5 / stated)
    assert np.abs(shift).max() > 3e-3 / stated


@pytest.mark.slow
def test_it_is_named_with_its_figures() -> None:
    """A SCARA with encoders of 1024 lines at its joints, 0.3 % of a period."""
    trial = hide({CAUSE: 0.3}, 5, "rich", robot="scara")
    robot = stating("scara", LINES)
    verdict = diagnose(survey(trial.session, robot.joints.names), robot, seed=5).verdict
    assert [finding.cause for finding in verdict.findings] == [CAUSE]
    assert not verdict.unknown_structure.found
    found, hidden = verdict.findings[0].parameters, trial.hidden.values[CAUSE]
    for name, true in hidden.items():
        assert abs(found[name].value - float(true)) < 3 * found[name].std, name


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden() -> None:
    robot = stating("scara", LINES)
    for seed in (1, 2, 4):
        trial = hide({}, seed, "rich", robot="scara")
        verdict = diagnose(survey(trial.session, robot.joints.names), robot, seed=seed).verdict
        assert not verdict.findings
        assert not verdict.unknown_structure.found
