"""Rotations of a probe in the fit: derivatives, added information, and when they are used."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration.chain import Chain
from delta_calibration.circle_test import circle_test
from delta_calibration.data import at_rest, collect, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.effects import effect_named
from delta_calibration.errors import DataError
from delta_calibration.estimation import (
    chain_of,
    identify,
    most_evaluations,
    prepare,
    with_turns,
)
from delta_calibration.estimation import solve as solve_problem
from delta_calibration.estimation.measurements import PoseMeasured
from delta_calibration.estimation.problem import MOUNT_NAMES
from delta_calibration.estimation.turns import turns_of
from delta_calibration.geometry import Frame, rotations
from delta_calibration.history.few import pool
from delta_calibration.history.pooled import Dated
from delta_calibration.mechanisms.base import solve
from delta_calibration.papers import method_named
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session, standing
from machines import MODELS, places

SRBD = load_robot("srbd")
TURN = 20e-6  # [rad]
PROBED = replace(SRBD, tracker=replace(SRBD.tracker, measures="pose", turn=TURN))


@pytest.fixture(scope="module")
def cell():
    """A machine with a six-degree-of-freedom probe, its session, and its poses."""
    machine = draw_machine(PROBED, 4)
    plan = make_plan("identify", PROBED, count=60, seed=4)
    session = simulate_session(machine, plan, 4, rate=20.0)
    return machine, session, collect(session, PROBED.joints.names)


@pytest.fixture(scope="module")
def found(cell):
    return identify(cell[2], PROBED)


@pytest.fixture(scope="module")
def without(cell):
    """The same with positions only."""
    return identify(cell[2], SRBD)


@pytest.mark.parametrize(
    "mechanism", ["srbd-six_rod_delta", "ur10-serial_arm", "cdpr8-cable_robot"]
)
def test_slopes_by_differences(mechanism):
    """The pose by one Newton step from its present value, which is exact to first order."""
    model, rng = MODELS[mechanism], np.random.default_rng(1)
    q, x = places(model, model.parameters.nominal, rng, 4)
    chain = Chain(model, np.zeros(3), 1e-3)
    frame = np.array([0.4, -0.3, 1.2, 1.0, 2.0, 3.0])
    mount = np.array([0.2, 0.5, -0.1])
    theta = np.concatenate([model.parameters.nominal, np.zeros(3), frame, mount])
    p, at = len(model.parameters), at_rest(q)

    def turned(t):
        left = model.closure(q, x, t[:p])[..., None]
        moved = x - solve(model.closure_by_pose(q, x, theta[:p]), left)[..., 0]
        tracker, mount = rotations.exp(t[p + 3 : p + 6]), rotations.exp(t[-3:])
        return tracker @ rotations.exp(moved[:, 3:6]) @ mount

    still = turned(theta)
    h = 1e-6
    ways = [h * way for way in np.eye(len(theta))]
    by_theta = np.stack([(turned(theta + w) - turned(theta - w)) / (2 * h) for w in ways], -1)
    spin = np.einsum("nijp,nkj->nikp", by_theta, still)  # dR R^T, a cross product
    expected = np.stack([spin[:, 2, 1], spin[:, 0, 2], spin[:, 1, 0]], axis=1)
    seen = PoseMeasured(q, np.zeros((4, 3)), None, 1e-5, still, 1e-5)
    about = seen.linearized(chain.predictor(at), theta, x)
    missed, found = about.missed[:, 3:], about.by_theta[:, 3:]
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
    np.testing.assert_allclose(missed, 0.0, atol=1e-12)


def test_a_base_on_soft_feet_turns_the_probe():
    """Compared with the rotation of two points of the platform; derivatives by differences."""
    robot, rng = load_robot("srbd"), np.random.default_rng(7)
    effect = effect_named("base_compliance", robot, robot.detailed, {})
    chain = Chain(robot.detailed, np.zeros(3), 1e-3).with_effects((effect,))
    nominal = robot.detailed.parameters.nominal
    frame = Frame(rotations.exp(np.array([0.4, -0.3, 1.2])), np.zeros(3))
    theta = chain.join(nominal, np.zeros(3), frame)
    layout = chain.layout
    at = standing(rng.uniform(-0.2, 0.4, (5, 3)), payload=2.0)

    def points(value):
        moved = theta.copy()
        moved[layout.effects] = value
        return np.stack([chain.predict(at, shifted(moved, i)) for i in range(4)], axis=-1)

    def shifted(moved, i):
        other = moved.copy()
        if i:
            other[layout.offset.start + i - 1] = 0.1
        return other

    give = 3 * effect.parameters.prior[0]
    before, after = points(0.0), points(give)
    arms = [10 * (each[..., 1:] - each[..., :1]) for each in (before, after)]
    turn = rotations.log(arms[1] @ np.swapaxes(arms[0], 1, 2))
    assert np.abs(turn).max() > 1e-6
    theta[layout.effects] = give
    x = chain.pose(at, theta)
    still = theta.copy()
    still[layout.effects] = 0.0
    found = chain.rotation(at, theta, x) @ np.swapaxes(chain.rotation(at, still, x), 1, 2)
    np.testing.assert_allclose(rotations.log(found), turn, atol=1e-3 * np.abs(turn).max())
    seen = PoseMeasured(at.joint, np.zeros((5, 3)), None, 1e-5, chain.rotation(at, still, x), 1e-5)
    about = seen.linearized(chain.predictor(at), theta, x)
    np.testing.assert_allclose(about.missed[:, 3:], -turn, atol=1e-3 * np.abs(turn).max())
    np.testing.assert_array_equal(
        np.concatenate(seen.left(chain.predictor(at), theta, x), axis=1),
        np.concatenate([about.pose, about.missed], axis=1),
    )
    slope = about.by_theta[:, 3:, layout.effects][..., 0]
    np.testing.assert_allclose(give * slope, turn, atol=1e-3 * np.abs(turn).max())


def test_turns_set_four_more_combinations(found, without):
    """Six rods: 38 combinations from positions, 42 from poses; four only tilt the platform.

    The mounting of the probe has the same effect as rotating all joints of the platform together.
    """
    assert without.observability.rank == 38
    assert without.turn_missed is None
    assert found.observability.rank == 42
    assert found.observability.columns == without.observability.columns + 3
    assert [r.parameter for r in found.observability.redundancies][-3:] == list(MOUNT_NAMES)
    assert found.chi_square == pytest.approx(1.0, abs=0.25)
    assert len(found.theta) == len(without.theta) == len(found.covariance)


def test_the_tilt_of_the_platform_is_found(cell, found, without):
    """For the rotation of the platform without that of the mounting, at poses not fitted."""
    machine, _, poses = cell
    rng = np.random.default_rng(2)
    joint = poses.joint[rng.permutation(len(poses))[:30]] + 0.05 * rng.standard_normal((30, 3))
    at = at_rest(joint)

    def tilt_missed(theta):
        seen = [
            chain.split(t)[2].rotation @ chain.mechanism.rotation(chain.pose(at, t))
            for chain, t in ((machine.chain, machine.theta), (found.chain, theta))
        ]
        between = Rotation.from_matrix(np.swapaxes(seen[1], 1, 2) @ seen[0])
        return (between * between.mean().inv()).magnitude().mean()

    nominal = found.frame_only_theta
    assert tilt_missed(found.theta) < 60e-6
    assert tilt_missed(found.theta) < 0.2 * tilt_missed(without.theta)
    assert tilt_missed(found.theta) < 0.1 * tilt_missed(nominal)


@pytest.mark.parametrize(
    ("method", "lag"),
    [(method_named("alternating"), 30.0), (method_named("stepwise_qpso", 12, 30), 0.5)],
    ids=["alternating", "stepwise_qpso"],
)
def test_the_methods_of_the_papers_take_the_turns_as_well(cell, found, method, lag):
    """They reach the least-squares result with the number of evaluations that was announced."""
    poses, chain = cell[2], chain_of(PROBED)
    start, noise, problem = prepare(poses, PROBED, chain)
    problem = with_turns(problem, poses, PROBED, noise)
    told = []
    fit = method.fit(problem, np.random.default_rng(0), told.append)
    least = solve_problem(problem)
    assert least.theta[: len(start)] == pytest.approx(found.theta, abs=1e-12)
    assert fit.solution.cost < least.cost + lag  # alternating fits lag where only priors determine
    assert np.sqrt(np.mean((fit.solution.residual - least.residual) ** 2)) < 0.1  # of the noise
    assert 6 * sum(told) == most_evaluations(method, PROBED)  # with five held-out parts


def test_what_is_left_of_the_turns_is_their_noise(cell, found):
    """Expected: the noise averaged over the readings of a stop, plus the rest errors of joints."""
    machine, _, poses = cell
    x, theta = machine.chain.pose(poses.conditions, machine.theta), machine.theta
    slope = machine.chain.mechanism.turn_by_pose(x) @ machine.chain.mechanism.velocity_jacobian(
        poses.joint, x, theta[machine.chain.layout.geometry]
    )
    rest = SRBD.joints.repeatability**2 * np.sum(slope**2) / len(poses)
    expected = np.sqrt(3 * TURN**2 / poses.count.mean() + rest)
    assert 0.6 * expected < found.turn_missed < 1.1 * expected


def test_how_the_probe_is_mounted_does_not_matter(cell, found):
    _, _, poses = cell
    mounted = Rotation.from_quat(poses.quaternion) * Rotation.from_rotvec([0.7, -1.1, 2.0])
    other = identify(replace(poses, quaternion=mounted.as_quat()), PROBED)
    off = (other.theta - found.theta) / found.std
    assert np.abs(off).max() < 0.05


def test_a_session_keeps_its_turns(cell, tmp_path):
    _, session, _ = cell
    write_session(tmp_path / "session", session)
    back = read_session(tmp_path / "session")
    np.testing.assert_allclose(back.tracker.quaternion, session.tracker.quaternion, atol=1e-15)


def test_a_diagnosis_is_about_the_same_machine(cell, found):
    """Without a cause the result is that of the fit, by another algorithm."""
    diagnosis = diagnose(survey(cell[1], PROBED.joints.names), PROBED)
    assert not diagnosis.verdict.findings
    assert not diagnosis.verdict.unknown_structure.found
    told = diagnosis.identification
    assert len(told.theta) == len(found.theta)
    assert np.abs((told.theta - found.theta) / found.std).max() < 0.1
    np.testing.assert_allclose(np.sqrt(np.diag(told.covariance)), found.std, rtol=0.1)
    assert told.observability.rank == found.observability.rank
    assert not diagnosis.doubts


def test_turns_name_what_positions_do_not_show():
    """Rods that hardly stretch tilt the platform, because the loads of a pair differ."""
    give = (("forearm_compliance", {"strength": "0.1"}),)
    machine = draw_machine(PROBED, 41, hidden=give)
    session = simulate_session(machine, make_plan("rich", PROBED, count=60, seed=41), 41)
    seen = survey(session, PROBED.joints.names)
    probed, plain = (diagnose(seen, robot).verdict for robot in (PROBED, SRBD))
    assert [finding.cause for finding in probed.findings] == ["forearm_compliance"]
    assert not plain.findings


def test_a_probe_that_is_less_sure_than_stated_raises_no_alarm():
    """The repeats show that the noise is three times the stated noise."""
    loose = replace(PROBED, tracker=replace(PROBED.tracker, turn=3 * TURN))
    plan = make_plan("rich", loose, count=60, seed=42)
    session = simulate_session(draw_machine(loose, 42), plan, 42)
    diagnosis = diagnose(survey(session, PROBED.joints.names), PROBED)
    (measured,) = diagnosis.model.problem.measured
    assert measured.observation.turn_noise == pytest.approx(3 * TURN, rel=0.15)
    assert not diagnosis.verdict.findings
    assert not diagnosis.verdict.unknown_structure.found


def test_a_turn_that_never_changes_was_not_measured(cell):
    """Software without a probe writes a constant; only the position was measured."""
    stream = cell[1].tracker
    one = np.tile([0.0, 0.0, 0.0, 1.0], (len(stream.quaternion), 1))
    filled = replace(cell[1], tracker=replace(stream, quaternion=one))
    session = survey(filled, PROBED.joints.names)
    assert turns_of(session.poses, PROBED, chain_of(PROBED)) is None
    probed, plain = (diagnose(session, robot) for robot in (PROBED, SRBD))
    assert any("rotation never changes" in text for text in probed.doubts)
    assert not plain.doubts
    np.testing.assert_array_equal(probed.model.theta, plain.model.theta)


def test_a_circle_test_tells_the_same_with_a_probe():
    """Radii are from positions; the shares add up, and that of the backlash is the same."""
    play = (("backlash", {"strength": "1"}),)
    machine = draw_machine(PROBED, 43, hidden=play)
    session = simulate_session(machine, make_plan("circles", PROBED, seed=43), 43)
    seen = survey(session, PROBED.joints.names)
    probed, plain = (
        circle_test(session, robot, diagnose(seen, robot)) for robot in (PROBED, SRBD)
    )
    sizes = [{s.cause: s.size for s in test.shares} for test in (probed, plain)]
    assert sum(sizes[0].values()) == pytest.approx(probed.deviation, rel=0.1)
    assert sizes[0]["backlash"] == pytest.approx(sizes[1]["backlash"], rel=0.05)


def test_a_history_takes_turns_as_well():
    """With rotations the information is much larger for rods, and never less than half.

    Each is linear about its own fit. Without rotations the reflector offset is poorly determined,
    and the information about joints and rods depends on it.
    """
    plan = make_plan("identify", PROBED, count=20, seed=44)
    session = simulate_session(draw_machine(PROBED, 44), plan, 44, rate=20.0)
    day = [Dated("day_1", datetime(2026, 1, 5), survey(session, PROBED.joints.names))]
    probed, plain = (np.diag(pool(day, robot).said[0].information) for robot in (PROBED, SRBD))
    assert (probed >= 0.5 * plain).all()
    assert probed.max() > 100 * plain[np.argmax(probed)]


def test_when_turns_take_no_part(cell):
    """Unknown noise of rotations, a reflector, no rotations, or a model with a level platform."""
    _, _, poses = cell
    chain = chain_of(PROBED)
    assert turns_of(poses, PROBED, chain) is not None
    untold = replace(PROBED, tracker=replace(PROBED.tracker, turn=None))
    reflector = replace(PROBED, tracker=replace(PROBED.tracker, measures="position"))
    for robot in (untold, reflector):
        assert turns_of(poses, robot, chain) is None
    assert turns_of(replace(poses, quaternion=None), PROBED, chain) is None
    assert turns_of(poses, PROBED, chain_of(PROBED, "rotary_delta")) is None
    broken = poses.quaternion.copy()
    broken[2] = 0.0
    with pytest.raises(DataError, match=r"pose 3: quaternion \[0. 0. 0. 0.\] is no rotation"):
        turns_of(replace(poses, quaternion=broken), PROBED, chain)
