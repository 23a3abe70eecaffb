"""Friction that winds up a drive leaves a joint behind as play does: which of both it can be."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from delta_calibration.data import at_rest
from delta_calibration.diagnosis.candidates import subsets
from delta_calibration.diagnosis.name_checks import with_alike
from delta_calibration.diagnosis.verdict import Finding
from delta_calibration.effects import effect_named
from delta_calibration.effects.stick_slip import StickSlip
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
MODEL = ROBOT.model()
LEVEL, GIVE = np.zeros((1, 3)), 4e-5  # arms stretched out level; [rad/(N m)]


def effect(cause, robot=ROBOT, **settings):
    return effect_named(cause, robot, MODEL, settings)


def at(payload):
    rest = at_rest(LEVEL)
    return replace(rest, payload=np.array([payload]), payload_centre=np.zeros((1, 3)))


def moment(payload):
    """Moment of an arm and a third of what it carries about its axis, level, by hand [N m]."""
    masses = ROBOT.masses
    carried = (masses.platform + payload) / 3 + 2 * masses.rod
    return 9.80665 * ROBOT.dimensions.arm * (masses.arm_centre * masses.arm + carried)


@pytest.mark.parametrize("payload", [0.0, 2.0])
def test_a_gap_less_than_its_friction_winds_up_is_friction(payload):
    """Friction that holds the arm in the gap exceeds the weight, and winds the drive up by it."""
    least = 2 * GIVE * moment(payload)
    for gap, friction in ((0.95 * least, True), (1.05 * least, False)):
        values, give = np.array([gap, 0.0, 0.5 * gap]), np.full(3, GIVE)
        found = effect("backlash").really(values, effect("joint_compliance"), give, at(payload))
        assert (found is not None) == friction
        if found is not None:
            assert isinstance(found, StickSlip)
            assert found.level == 1.0
            assert found.intervals() == ()


def test_play_is_possible_where_loads_decide_or_are_not_known():
    values, give, spring = np.full(3, 1e-6), np.full(3, GIVE), effect("joint_compliance")
    assert effect("backlash").really(values, spring, give, at(0.0)) is not None
    assert effect("backlash", held_by=3.0).really(values, spring, give, at(0.0)) is None
    assert effect("backlash").really(values, effect("joint_scale"), give, at(0.0)) is None
    assert effect("backlash").really(values, spring, give, at(np.nan)) is None
    light = effect("backlash", replace(ROBOT, masses=None))
    assert light.really(values, spring, give, at(0.0)) is None


def said(cause, place=None, equivalents=()):
    (term,) = (c for c in subsets(effect(cause)) if c.location == place and c.effect is not None)
    finding = Finding(
        cause, place, "drive", equivalents, None, {}, 0.98, 0.0, 0.1, 0.0, 1.0, 1.0, 1.0, 900.0
    )
    return term, finding


@pytest.mark.parametrize(
    ("causes", "alike"),
    [
        ([said("backlash"), said("joint_compliance")], ("stick_slip",)),
        ([said("backlash", "joint_1"), said("joint_compliance", "joint_1")], ("stick_slip",)),
        ([said("backlash", "joint_1"), said("joint_compliance", "joint_2")], ()),
        ([said("backlash"), said("joint_scale")], ()),
        ([said("backlash"), said("joint_compliance"), said("stick_slip")], ()),
        ([said("backlash", equivalents=("x",)), said("joint_compliance")], ("x", "stick_slip")),
    ],
)
def test_friction_is_an_equivalent_of_play_where_the_drive_yields(causes, alike):
    model = SimpleNamespace(values=lambda term: np.ones(len(term.rows)))
    first, *_ = with_alike(dict(causes), model).values()
    assert first.equivalents == alike
    assert (first.separated_by or "").startswith("hold the motor still") == bool(alike)
