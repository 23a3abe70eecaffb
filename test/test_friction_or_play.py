"""Friction that winds up a drive leaves a joint behind as play does: which of both it can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.data import at_rest
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.other_names import renamed, told_again, with_same_signal
from delta_calibration.diagnosis.verdict import Estimate, Finding
from delta_calibration.effects import effect_named
from delta_calibration.effects.stick_slip import StickSlip
from delta_calibration.robot import load_robot

ROBOT = load_robot("srbd")
MODEL = ROBOT.model()
LEVEL, GIVE = np.zeros(3), 4e-5  # arms stretched out level; [rad/(N m)]


def effect(cause, robot=ROBOT, **settings):
    return effect_named(cause, robot, MODEL, settings)


def at(*payloads):
    n = len(payloads)
    rest = at_rest(np.tile(LEVEL, (n, 1)))
    return replace(rest, payload=np.array(payloads, float), payload_centre=np.zeros((n, 3)))


def moment(payload):
    """Moment of an arm and a third of what it carries about its axis, level, by hand [N m]."""
    masses = ROBOT.masses
    carried = (masses.platform + payload) / 3 + 2 * masses.rod
    return 9.80665 * ROBOT.dimensions.arm * (masses.arm_centre * masses.arm + carried)


def must_be(gap, conditions, give=GIVE, other="joint_compliance", robot=ROBOT, **settings):
    play = effect("backlash", robot, **settings)
    return play.must_be(np.asarray(gap), effect(other), np.full(3, give), conditions)


@pytest.mark.parametrize("payload", [0.0, 2.0])
def test_a_gap_less_than_its_friction_winds_up_is_friction(payload):
    """Friction that holds the arm in the gap exceeds the weight, and winds the drive up by it."""
    least = 2 * GIVE * moment(payload)
    assert must_be([1.05 * least, 0.0, 0.5 * least], at(payload)) is None
    found = must_be([0.95 * least, 0.0, 0.5 * least], at(payload))
    assert isinstance(found, StickSlip)
    assert found.level == 1.0
    assert found.intervals() == ()
    assert found.chosen == {"friction": "the same at all speeds"}


def test_a_load_at_few_poses_only_decides_nothing():
    few, many = at(*[0.0] * 29, 2.0), at(*[0.0] * 15, *[2.0] * 15)
    between = GIVE * (moment(0.0) + moment(2.0))
    assert must_be([between] * 3, few) is None
    assert must_be([between] * 3, many) is not None


def test_play_is_possible_where_loads_decide_or_are_not_known():
    small, level = [1e-6] * 3, at(0.0)
    assert must_be(small, level) is not None
    assert must_be([0.0] * 3, level) is None
    assert must_be(small, level, held_by=3.0) is None
    assert must_be(small, level, other="joint_scale") is None
    assert must_be(small, level, give=0.0) is None
    assert must_be(small, at(np.nan)) is None
    assert must_be(small, level, robot=replace(ROBOT, masses=None)) is None


def said(cause, value, place=None, equivalents=(), std=0.01, **settings):
    """A cause of all joints or one, and its finding; the value of each joint or of all."""
    own = effect(cause, **settings)
    items, values = own.parameters.items, np.broadcast_to(value, len(own.parameters))
    rows = tuple(i for i, p in enumerate(items) if place in (None, p.location))
    estimates = {items[i].name: Estimate(values[i], std * values.max(), "rad") for i in rows}
    gains = 0.98, 0.0, 0.1, 0.0, 1.0, 1.0, 1.0, 900.0
    finding = Finding(cause, place, "drive", equivalents, None, estimates, *gains)
    return Candidate(cause, "drive", place, own, rows), finding


SMALL, LARGE = 1e-4, 1e-2  # [rad] gaps, below and above what the weight winds up
GIVES = said("joint_compliance", GIVE)


@pytest.mark.parametrize(
    ("causes", "names"),
    [
        ([said("backlash", SMALL), GIVES], ["stick_slip", "joint_compliance"]),
        ([said("backlash", LARGE), GIVES], ["backlash", "joint_compliance"]),
        ([said("backlash", SMALL, "joint_2"), GIVES], ["stick_slip", "joint_compliance"]),
        # one joint by chance, the others by friction
        ([said("backlash", [SMALL, SMALL, 1e-7]), GIVES], ["stick_slip", "joint_compliance"]),
        ([said("backlash", SMALL), said("joint_compliance", GIVE, "joint_2")], ["backlash"]),
        ([said("backlash", SMALL), said("joint_compliance", GIVE, std=0.6)], ["backlash"]),
        ([said("backlash", SMALL), said("joint_scale", GIVE)], ["backlash"]),
        ([said("backlash", SMALL), GIVES, said("stick_slip", SMALL)], ["backlash"]),
    ],
)
def test_play_is_renamed_where_it_is_impossible(causes, names):
    every = dict(causes)
    found = renamed(every, at(0.0))
    assert [term.cause for term in found][: len(names)] == names
    (place,) = {(term.location, term.rows) for term in (found[0], causes[0][0])}
    assert place == (causes[0][0].location, causes[0][0].rows)


def test_what_is_renamed_is_no_surer_than_before():
    (_, old), (_, new) = said("backlash", SMALL), said("stick_slip", SMALL)
    old = replace(old, confidence=0.6)
    new = replace(new, equivalents=("backlash", "joint_lag"), separated_by="circles")
    told = told_again(old, new)
    assert (told.confidence, told.equivalents) == (0.6, ("joint_lag",))
    assert told.separated_by == "circles"
    alone = told_again(old, replace(new, equivalents=("backlash",)))
    assert (alone.equivalents, alone.separated_by) == ((), None)
    _, gives = GIVES
    assert told_again(replace(gives, confidence=0.7), gives) == replace(gives, confidence=0.7)


ALIKE = ("stick_slip",)


@pytest.mark.parametrize(
    ("causes", "alike"),
    [
        ([said("backlash", LARGE), GIVES], ALIKE),
        ([said("backlash", LARGE, "joint_1"), said("joint_compliance", GIVE, "joint_1")], ALIKE),
        ([said("backlash", LARGE, "joint_1"), said("joint_compliance", GIVE, "joint_2")], ()),
        ([said("backlash", LARGE, "joint_1"), said("joint_compliance", [0, GIVE, GIVE])], ()),
        ([said("backlash", LARGE), said("joint_scale", GIVE)], ()),
        ([said("backlash", LARGE, held_by=3.0), GIVES], ()),
        ([said("backlash", LARGE), GIVES, said("stick_slip", SMALL)], ()),
        ([said("backlash", LARGE, "joint_1"), GIVES, said("stick_slip", SMALL, "joint_2")], ALIKE),
        ([said("backlash", LARGE, equivalents=("x", *ALIKE)), GIVES], ("x", *ALIKE)),
    ],
)
def test_friction_is_an_equivalent_of_play_where_the_drive_yields(causes, alike):
    """A push by hand separates both, and no motion of the machine does."""
    first, *_ = with_same_signal(dict(causes)).values()
    assert first.equivalents == alike
    assert (first.separated_by or "").startswith("hold the motor still") == bool(alike)
