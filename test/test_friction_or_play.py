"""Friction that winds up a drive leaves a joint behind as play does: which of both it can be."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from delta_calibration.data import at_rest
from delta_calibration.diagnosis.candidates import Candidate
from delta_calibration.diagnosis.other_names import with_same_signal
from delta_calibration.diagnosis.verdict import Estimate, Finding
from delta_calibration.effects import effect_named
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


LIKELIER = "friction is likelier"


def told(gap, conditions, give=GIVE, other="joint_compliance", robot=ROBOT, **settings):
    """What a gap of each joint is told with beside drives of this compliance."""
    play, most, least = effect("backlash", robot, **settings), np.asarray(gap), np.full(3, give)
    return play.same_signal_beside(most, effect(other), least, conditions)


@pytest.mark.parametrize("payload", [0.0, 2.0])
def test_a_gap_less_than_its_friction_winds_up_is_likelier_friction(payload):
    """Friction that holds the arm in the gap exceeds the weight, and winds the drive up by it."""
    least = 2 * GIVE * moment(payload)
    cause, larger = told([1.05 * least, 0.0, 0.5 * least], at(payload))
    same, smaller = told([0.95 * least, 0.0, 0.5 * least], at(payload))
    assert cause == same == "stick_slip"
    assert not larger.startswith(LIKELIER)
    assert smaller.startswith(LIKELIER)


def test_a_load_at_few_poses_only_decides_nothing():
    few, many = at(*[0.0] * 29, 2.0), at(*[0.0] * 15, *[2.0] * 15)
    between = GIVE * (moment(0.0) + moment(2.0))
    assert not told([between] * 3, few)[1].startswith(LIKELIER)
    assert told([between] * 3, many)[1].startswith(LIKELIER)


def test_nothing_is_likelier_where_loads_are_not_known():
    small, level = [1e-6] * 3, at(0.0)
    assert told(small, level)[1].startswith(LIKELIER)
    assert told(small, level, held_by=3.0) is None
    assert told(small, level, other="joint_scale") is None
    for unsure in (
        told([0.0] * 3, level),
        told(small, level, give=0.0),
        told(small, at(np.nan)),
        told(small, level, robot=replace(ROBOT, masses=None)),
    ):
        assert unsure == ("stick_slip", unsure[1])
        assert unsure[1].startswith("hold the motor still")


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
    evidence = SimpleNamespace(at=at(0.0), poses=1)
    first, *_ = with_same_signal(dict(causes), evidence).values()
    assert first.equivalents == alike
    assert (first.separated_by or "").startswith("hold the motor still") == bool(alike)


@pytest.mark.parametrize(
    ("gap", "give", "likelier"),
    [
        (said("backlash", SMALL), GIVES, True),
        # a gap by chance, at one joint, decides nothing
        (said("backlash", [SMALL, SMALL, 1e-7]), GIVES, True),
        (said("backlash", SMALL, "joint_2"), GIVES, True),
        (said("backlash", LARGE), GIVES, False),
        (said("backlash", SMALL), said("joint_compliance", GIVE, "joint_2"), False),
        (said("backlash", SMALL), said("joint_compliance", GIVE, std=0.49), False),
    ],
)
def test_friction_is_likelier_only_for_sure(gap, give, likelier):
    """By the bounds of the values, and if it is so at every joint that surely has a gap."""
    evidence = SimpleNamespace(at=at(0.0), poses=1)
    first, *_ = with_same_signal(dict([gap, give]), evidence).values()
    assert first.separated_by.startswith(LIKELIER) == likelier
