"""Sizes of joint errors are given in radians of a Delta and mean the same on every mechanism."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from delta_calibration.data import Conditions, at_rest, motion_of, survey
from delta_calibration.data.motion import TURNED
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.proposals import Session
from delta_calibration.diagnosis.shared_path_error import SharedPathError
from delta_calibration.effects import EFFECTS, catalogue
from delta_calibration.effects.base import Array, Effect
from delta_calibration.effects.catalogue import effect_named
from delta_calibration.effects.joint_curve import JointCurve
from delta_calibration.effects.stick_slip import StickSlip
from delta_calibration.effects.unexplained import (
    DIRECTION,
    FAMILIES,
    POSITION,
    SPEED,
    UNEXPLAINED,
    Unexplained,
    reaches,
)
from delta_calibration.plans import make_plan
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session

DELTA = "srbd"
MAPS = [(family, reach) for family in FAMILIES for reach in reaches(family)]
MORE = {  # times the Delta's displacement; a plane over the many joints of an arm adds up
    "ur10": 5.0
}
PLACES = 40
BUMP = 100e-6  # [m] root mean square of the hidden structure over the poses of the plan
TRIED = ("backlash", "encoder_eccentricity", "joint_zero_drift")
each_robot = pytest.mark.parametrize("name", known_robots())


def conditions(name: str) -> Conditions:
    """Poses of a plan, with similar conditions for all robots."""
    robot, rng = load_robot(name), np.random.default_rng(1)
    joint = make_plan("identify", robot, count=PLACES, seed=1).joint
    n, hot = len(joint), np.linspace(20.0, 30.0, len(joint))
    return replace(
        at_rest(joint),
        direction=rng.choice([-1.0, 1.0], joint.shape),
        velocity=robot.model().joint_size * rng.standard_normal(joint.shape),
        payload=rng.choice([0.0, 2.0], n),
        time=np.linspace(0.0, 3600.0, n),
        temperature_parts=("arm",),
        temperature=hot[:, None],
    )


def map_over(name: str, family: str, reach: float | None = None) -> Unexplained:
    robot = load_robot(name)
    any_effect = catalogue(robot, robot.model())[0]
    return Unexplained.over(any_effect, family, conditions(name).joint, reach=reach)


def displacement(effect: Effect, at: Conditions) -> Array:
    """Displacement of the platform for a unit of each parameter, (n, 3, k) [m]."""
    mechanism, g = effect.mechanism, effect.mechanism.parameters.nominal
    slope = mechanism.velocity_jacobian(at.joint, mechanism.forward(at.joint, g), g)
    return np.asarray(slope[:, :3] @ effect.columns(at))


@cache
def reach_of(name: str, family: str, reach: float) -> float:
    """Root mean square displacement that the prior of a map allows [m]."""
    effect = map_over(name, family, reach)
    moved = displacement(effect, conditions(name)) * effect.parameters.prior
    return float(np.sqrt(np.sum(moved**2, axis=(1, 2)).mean()))


@each_robot
@pytest.mark.parametrize(("family", "reach"), MAPS)
def test_maps_reach_as_far_on_every_machine(name: str, family: str, reach: float) -> None:
    """If the size were 300e-6 rad for all, a cable robot moved by 4 um and a Delta by 600 um."""
    share = reach_of(name, family, reach) / reach_of(DELTA, family, reach)
    assert 1 / 3 < share < MORE.get(name, 3.0)


@each_robot
@pytest.mark.parametrize("family", FAMILIES)
def test_features_of_maps_are_of_the_order_of_one(name: str, family: str) -> None:
    """Largest features: those of a plane over all joints, and of a bump at its centre."""
    effect = map_over(name, family)
    largest = np.abs(effect.columns(conditions(name))).max(axis=(0, 1))
    assert largest.max() < 20.0
    assert effect.parameters.units[0] == effect.mechanism.joint_unit


@each_robot
@pytest.mark.parametrize("family", [DIRECTION, SPEED])
def test_a_map_of_an_older_file_means_what_it_meant(name: str, family: str) -> None:
    """Such a file has no joint size: features are plain joint values or speeds, in rad."""
    robot, at = load_robot(name), conditions(name)
    model = robot.model()
    settings = {"family": family, "size": 1e-4, "width": 0.0, "centres": ()}
    effect = effect_named(UNEXPLAINED, robot, model, settings)
    condition = at.direction if family == DIRECTION else at.velocity
    plane = np.column_stack([np.ones(len(at)), at.joint])
    features = (condition[:, :, None] * plane[:, None, :]).reshape(len(at), -1)
    first = effect.columns(at)[:, 0, :: model.joints]
    np.testing.assert_array_equal(first, features)
    assert set(effect.parameters.units) == {"rad"}
    np.testing.assert_array_equal(effect.parameters.prior, 1e-4 / 5)


@each_robot
def test_effects_of_joints_go_by_the_joint_size(name: str) -> None:
    robot = load_robot(name)
    model = robot.model()
    size, lower = model.joint_size, (0.0,) * model.joints
    stick = StickSlip(robot, model)
    assert stick.speed == 0.1 * size
    speeds = sorted({shape.settings["speed"] for shape in stick.shapes(at_rest(model.home[None]))})
    np.testing.assert_allclose(speeds, size * np.array([0.01, 0.03, 0.1, 0.3]), rtol=1e-12)
    assert not any(shape.wrong() for shape in stick.shapes(at_rest(model.home[None])))
    curve = JointCurve(robot, model, lower=lower, upper=(size,) * model.joints)
    assert (curve.width, curve.size) == (0.07 * size, 0.15e-3 * size)
    assert set(curve.parameters.units) == {model.joint_unit}
    assert not curve.wrong()
    error = EFFECTS["transmission_error"](robot, model)
    (_, low, high) = error.intervals()[0]
    assert high - low == pytest.approx(3.0 / size) or low == 0.1 / size


@each_robot
def test_motion_goes_by_the_joint_size(name: str) -> None:
    """The thresholds for a reversal and for the continuation of a path are scaled likewise."""
    model = load_robot(name).model()
    size, time = model.joint_size, np.arange(3.0)
    for back, turned in ((0.9, False), (1.1, True)):
        way = size * np.array([0.0, 0.1, 0.1 - back * TURNED])[:, None] * np.ones(model.joints)
        motion = motion_of(time, model.home + way, size)
        assert (motion.direction[-1] < 0).all() == turned
    number = np.array([0, 0, 1, 1])
    for away, apart in ((0.015, False), (0.025, True)):
        joint = model.home + size * away * np.array([0, 0, 1, 1])[:, None]
        at = replace(at_rest(joint), time=np.arange(4.0))
        rest = SharedPathError.of(number, at, np.zeros((4, 3, model.joints)), size)
        assert (rest.row[0] != rest.row[-1]) == apart
    stops = Session(at_rest(model.home[None]), 0.0, model, model.home, model.home).ten(1)
    np.testing.assert_allclose(stops.travel, 0.01 * size, rtol=1e-12)


def with_bump(machine: TrueMachine, joint: Array) -> TrueMachine:
    """Return the machine with a bump of `BUMP` about the middle of the poses of a plan, (n, m).

    The joint errors are those of a map, with weights that displace the platform in this way.
    """
    mechanism, at = machine.chain.mechanism, at_rest(joint)
    place = mechanism.position(mechanism.forward(joint, mechanism.parameters.nominal))
    size = np.ptp(place, axis=0)
    free = size > 0.05  # coordinates over which the plan extends
    off = (place - place.min(axis=0) - size / 2)[:, free] / size[free]
    wanted = free * np.exp(-np.sum(off**2, axis=1) / (2 * 0.3**2))[:, None]
    any_effect = catalogue(machine.robot, mechanism)[0]
    hidden = Unexplained.over(any_effect, POSITION, joint)
    columns = displacement(hidden, at)
    prior = hidden.parameters.prior[0]
    flat = prior * columns.reshape(wanted.size, -1)
    normal = flat @ flat.T
    normal += 1e-3 * np.diag(normal).mean() * np.eye(len(normal))  # smooth between the poses
    weights = flat.T @ np.linalg.solve(normal, wanted.ravel()) * prior
    moved = columns @ weights
    weights *= BUMP / np.sqrt(np.sum(moved**2, axis=1).mean())
    return replace(
        machine,
        chain=machine.chain.with_effects((hidden,)),
        theta=np.append(machine.theta, weights),
    )


@each_robot
def test_the_same_structure_gets_the_same_verdict(name: str) -> None:
    """A bump of 100 um without a known cause is reported with similar size on every robot."""
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=PLACES, both_sides=False, seed=3)
    machine = with_bump(draw_machine(robot, 3), plan.joint)
    session = simulate_session(machine, plan, 3)
    seen = survey(session, robot.joints.names, robot.commanded.joint_size)
    none, paths = np.zeros(0, dtype=np.intp), seen.paths  # poses only: fewer samples
    seen = replace(
        seen,
        paths=replace(
            paths,
            conditions=paths.conditions.take(none),
            count=paths.count[none],
            path=paths.path[none],
        ),
    )
    tried = tuple(e for e in catalogue(robot, robot.model()) if e.cause in TRIED)
    said = diagnose(seen, robot, effects=tried).verdict
    assert not said.findings
    assert said.unknown_structure.found
    assert 0.015 < said.unknown_structure.rms_mm < 0.1
    assert 0.025 < said.calibrated.held_out_rms_mm < 0.1
