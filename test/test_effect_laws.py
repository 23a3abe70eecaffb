"""Tests of the laws of effects: generated derivatives against differences, inputs of terms."""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

from cables import FOUR_CABLES, TOLERANCES, ZEROS_FREE
from delta_calibration.chain import Chain
from delta_calibration.data import at_rest
from delta_calibration.effects import EFFECTS, Effect, Stage, catalogue
from delta_calibration.effects.base import terms_of
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.signals import (
    CENTRE,
    DIRECTION,
    GEOMETRY,
    JOINT,
    NOTHING,
    PAYLOAD,
    POSE,
    PULL,
    PULL_HOME,
    TEMPERATURE,
    TIME,
    TRAVEL,
    Places,
    Signals,
)
from delta_calibration.effects.unexplained import FAMILIES, Unexplained
from delta_calibration.mechanisms import MECHANISMS, CableRobot
from delta_calibration.robot import load_robot
from machines import MODELS, ROBOTS, differences

PARTS = ("arm", "base")
COUNT = 12  # samples
MACHINES = [
    (robot, MODELS[name])
    for robot in ROBOTS
    for name in MODELS
    if name.startswith(f"{robot.name}-")
]
CABLES = load_robot("cdpr8")
POINTS = [(CABLES, CableRobot(FOUR_CABLES, tolerances)) for tolerances in (TOLERANCES, ZEROS_FREE)]
SCARA = load_robot("scara")
STATED = replace(SCARA, joints=replace(SCARA.joints, encoder_lines=7.0))  # states its encoders
CYCLE = {"period": 2500.0, "phase": 0.2}
# Settings for which a law differs from the default.
SHAPES = {
    "backlash": [{"held_by": 0.5}],
    "ball_joint_clearance": [{"force": 0.5}, {"end": -1.0}],
    "flange_compliance": [{"behind": 0.4}],
    "joint_zero_drift": [{"time_constant": 900.0}, {"step_at": 3000.0}, CYCLE],
    "pretension_loss": [{"time_constant": 900.0}],
    "pulley_radius": [{"radius": 0.03}, {"radius": 0.03, "upper": -1.0, "lower": 1.0}],
    "stick_slip": [{"level": 0.3}],
    "tracker_drift": [{"time_constant": 900.0}, {"step_at": 3000.0}, CYCLE],
    "transmission_error": [{"cycles": 7.5}, {"cycles": 7.5, "second": 2.0}],
    **{
        f"thermal_growth_{part}": [{"sensor": "arm"}, {"time_constant": 900.0}, CYCLE]
        for part in ("arm", "base", "forearm", "link", "screw")
    },
}
needs_casadi = pytest.mark.skipif(
    importlib.util.find_spec("casadi") is None, reason="generates code (extra [laws])"
)


def own_forms(robot, mechanism) -> list[Effect]:
    """Every effect that a machine can have, in every form of its law."""
    m, size, home = mechanism.joints, mechanism.joint_size, mechanism.home
    found: list[Effect] = []
    for effect in catalogue(robot, mechanism):
        found += [
            *effect.forms(),
            *(replace(effect, **shape) for shape in SHAPES.get(effect.cause, ())),
        ]
        if effect.cause == "backlash":
            found.append(replace(effect, width=(0.2 * size,) * m))
    low, high = home - 0.6 * size, home + 0.6 * size  # of some samples, not of others
    found.append(JointCurve.over(robot, mechanism, np.stack([low, high]), 0.3 * size))
    places = home + size * np.random.default_rng(2).uniform(-1, 1, (5, m))
    for family in FAMILIES:
        bumps = {"position": (0.5,), "joint angle": (None,), "payload": (0.0, 0.5)}
        for reach in bumps.get(family, (0.0,)):
            found.append(Unexplained.over(found[0], family, places, reach=reach))
    return found


EVERY = [
    effect
    for machine in (*MACHINES, *POINTS, (STATED, STATED.model()))
    for effect in own_forms(*machine)
]


def name_of(effect: Effect) -> str:
    shape = "-".join(str(v) for v in effect.settings.values() if isinstance(v, str | float))
    return f"{effect.mechanism.law_name}-{effect.cause}-{shape}"


def anything(mechanism, rng, parts=PARTS) -> Signals:
    """Signals of samples that need not be possible on a machine, each number different."""
    places = Places.of(mechanism, parts)
    rest = np.random.default_rng(1)  # separate: an additional signal changes none of the others
    found = Signals(places, rest.uniform(-1.0, 1.0, (COUNT, places.size)))
    m, size = mechanism.joints, mechanism.joint_size
    return found.with_(
        **{
            JOINT: mechanism.home + size * rng.uniform(-1, 1, (COUNT, m)),
            DIRECTION: rng.choice([-1.0, 1.0], (COUNT, m)),
            TRAVEL: size * rng.uniform(0, 0.4, (COUNT, m)),
            PULL: rng.uniform(20, 90, (COUNT, m)),
            PULL_HOME: rng.uniform(20, 90, (COUNT, m)),
            POSE: mechanism.home_pose + rng.uniform(-0.1, 0.1, (COUNT, mechanism.pose_size)),
            GEOMETRY: mechanism.parameters.nominal * rng.uniform(0.95, 1.05, (COUNT, 1)),
            TIME: rng.uniform(0, 7200, (COUNT, 1)),
            PAYLOAD: rng.uniform(0, 3, (COUNT, 1)),
            TEMPERATURE: rng.uniform(15, 35, (COUNT, len(parts))),
            NOTHING: np.zeros((COUNT, 1)),
        }
    )


def values_of(effect: Effect, rng) -> np.ndarray:
    p = effect.parameters
    low, high = ([getattr(item, end) for item in p] for end in ("lower", "upper"))
    return np.clip(effect.about + p.prior * rng.uniform(0.3, 2.0, len(p)), low, high)


def test_every_effect_is_among_them():
    assert {effect.cause for effect in EVERY} == {
        *(cause for cause, kind in EFFECTS.items() if kind.__module__.startswith("delta_cal")),
        Unexplained.cause,
        JointCurve.cause,
    }
    assert {effect.mechanism.name for effect in EVERY} == {*MECHANISMS}


@pytest.mark.parametrize("effect", EVERY, ids=name_of)
def test_derivatives_are_slopes_of_the_shift(effect):
    rng = np.random.default_rng(12)
    signals, v = anything(effect.mechanism, rng), values_of(effect, rng)
    stage = terms_of((effect,), signals.places)
    columns = effect.columns_of(signals, v)
    assert columns.shape == (COUNT, effect.stage_size, len(v))
    assert np.abs(columns).max() > 0
    scale = effect.parameters.prior
    slope = differences(lambda z: stage.shifts(signals, z * scale), v / scale, step=0.02)
    off = 1e-10 * max(np.abs(slope).max(), np.abs(stage.shifts(signals, v)).max())
    np.testing.assert_allclose(columns * scale, slope, rtol=0, atol=off)


@pytest.mark.parametrize("effect", EVERY, ids=name_of)
def test_nothing_moves_at_zero_and_shifts_follow_the_columns(effect):
    """Linear, except for a pulley's radius, whose columns are those at the fitted radius."""
    rng = np.random.default_rng(4)
    signals, v = anything(effect.mechanism, rng), values_of(effect, rng)
    stage = terms_of((effect,), signals.places)
    still = stage.shifts(signals, np.zeros(len(v)))
    shift = stage.shifts(signals, v)
    # Terms that are subtracted again, such as a cable's length at home, leave rounding errors.
    np.testing.assert_allclose(still, 0.0, rtol=0, atol=1e-13 * effect.mechanism.joint_size)
    assert np.abs(shift).max() > 0
    if effect.cause != "pulley_radius":
        expected = (effect.columns_of(signals) @ v[:, None])[..., 0]
        np.testing.assert_allclose(shift, expected, rtol=1e-12, atol=1e-14 * np.abs(shift).max())


@pytest.mark.parametrize("stage", Stage)
def test_effects_of_a_stage_add_up_in_one_table(stage):
    """Each takes its own values from theta, and none disturbs another's workspace."""
    rng = np.random.default_rng(5)
    for robot, mechanism in (*MACHINES, *POINTS):
        effects = [e for e in own_forms(robot, mechanism) if e.stage is stage]
        if not effects:
            continue
        signals = anything(mechanism, rng)
        each = [values_of(effect, rng) for effect in effects]
        alone = [
            terms_of((effect,), signals.places).shifts(signals, v)
            for effect, v in zip(effects, each, strict=True)
        ]
        together = terms_of(effects, signals.places)
        size = max(np.abs(shift).max() for shift in alone)
        for order in (slice(None), slice(None, None, -1)):  # of samples
            shift = together.shifts(signals.take(order), np.concatenate(each))
            np.testing.assert_allclose(shift, sum(alone)[order], rtol=0, atol=1e-13 * size)
        columns = together.columns(signals, np.concatenate(each))
        own = [e.columns_of(signals, v) for e, v in zip(effects, each, strict=True)]
        np.testing.assert_array_equal(columns, np.concatenate(own, axis=2))


def test_growth_by_a_sensor_that_was_not_recorded_is_not_a_number():
    """Not that of a part at 0 deg C."""
    robot = load_robot("srbd")
    growth = EFFECTS["thermal_growth_arm"](robot, robot.model(), sensor="arm")
    signals = anything(growth.mechanism, np.random.default_rng(6), parts=("base",))
    grown = growth.lengths() != 0
    assert np.isnan(growth.columns_of(signals)[:, grown]).all()
    assert not growth.columns_of(signals)[:, ~grown].any()
    chain = Chain(growth.mechanism, np.zeros(3), 0.05, (growth,))
    theta = np.append(chain.with_effects(()).parameters.nominal, 1e-5)
    assert np.isnan(chain.predict(at_rest(np.zeros((2, 3))), theta)).all()


@dataclass(frozen=True)
class Sway(Effect):
    """A law of payload and its centre, a signal of three numbers, and of tensions."""

    cause: ClassVar[str] = "sway"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE
    takes: ClassVar[tuple[str, ...]] = (JOINT, CENTRE, PAYLOAD, PULL)

    @property
    def parameters(self):
        return self.each_joint("sway", "rad", 1e-4)

    @staticmethod
    def law(s, v, c):
        return v[0] * s[0] * (s[1] + 2 * s[2] + 4 * s[3]) * s[4] + s[5]


@needs_casadi
def test_a_joint_is_given_all_of_what_all_joints_share(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = load_robot("srbd")
    sway = Sway(robot, robot.model("six_rod_delta"))
    signals = anything(sway.mechanism, np.random.default_rng(7)).with_(pull=np.zeros((COUNT, 3)))
    centre = signals.of(CENTRE) @ [1, 2, 4] * signals.of(PAYLOAD)[:, 0]
    expected = (centre[:, None] * signals.of(JOINT))[:, :, None] * np.eye(3)
    np.testing.assert_allclose(sway.columns_of(signals), expected, rtol=1e-14)


@needs_casadi
def test_limbs_that_can_push_have_no_pulls(tmp_path, monkeypatch):
    """Six rods on three joints: six numbers would not fit where three are expected."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = load_robot("srbd")
    mechanism = robot.model("six_rod_delta")
    chain = Chain(mechanism, np.zeros(3), 0.05, (Sway(robot, mechanism),))
    theta = np.append(chain.with_effects(()).parameters.nominal, [1e-3, 2e-3, 3e-3])
    at = replace(
        at_rest(np.full((4, 3), 0.3)),
        payload=np.full(4, 2.0),
        payload_centre=np.tile([0.01, 0.02, 0.03], (4, 1)),
    )
    moved = 0.3 * (1 + 1e-3 * np.array([1, 2, 3]) * (0.01 + 0.04 + 0.12) * 2.0)
    x = mechanism.forward(moved[None], mechanism.parameters.nominal)
    np.testing.assert_allclose(chain.pose(at, theta), np.tile(x, (4, 1)), atol=1e-12)
    assert not chain.signals(at, theta).of(PULL).any()
