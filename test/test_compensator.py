"""Corrected commands bring an independent six-rod machine to its targets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.errors import InputError
from delta_calibration.estimation import identify
from delta_calibration.geometry import Frame, align
from delta_calibration.plans import make_plan
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from six_rods import Cell, SixRods, drawing_joints, workspace

ROBOT = load_robot("srbd")
METHODS = ("newton", "apso")
# Points off the line, which also help to determine a frame.
SPREAD = np.array([[x, y, z] for x in (-0.3, 0.3) for y in (-0.3, 0.3) for z in (-0.8, -0.65)])


def errors(rng):
    parameters = ROBOT.model("six_rod_delta").parameters
    drawn = parameters.prior * rng.standard_normal(len(parameters))
    return dict(zip(parameters.names, drawn, strict=True))


def line(n):
    x = np.linspace(-0.45, 0.45, n)
    return np.stack([x, -x, np.full_like(x, -0.711)], axis=1)


def calibration(wrong, robot=ROBOT, reach=0.66):
    """A calibration with the true parameters, over a cylinder."""
    mechanism = robot.model("six_rod_delta")
    chain = Chain(mechanism, np.zeros(3), 0.05)
    theta = chain.join(mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    theta[: len(mechanism.parameters)] += [wrong.get(n, 0.0) for n in mechanism.parameters.names]
    turn = np.linspace(0, 2 * np.pi, 60)
    rim = [[reach * np.cos(a), reach * np.sin(a), z] for a in turn for z in (-0.95, -0.55)]
    return Calibration(
        robot=robot,
        chain=chain,
        theta=theta,
        region=Region.of(np.array(rim)),
        joints_lower=robot.joints.lower,
        joints_upper=robot.joints.upper,
        noise_floor=1e-5,
        source="made",
        seal="0" * 64,
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_compensated_machine_goes_where_the_drawing_meant(method, seed):
    wrong, target = errors(np.random.default_rng(seed)), line(31)
    q = drawing_joints(target)
    done = JointCompensator(calibration(wrong), method).compensate(q)
    truth = SixRods(wrong)
    before = np.linalg.norm(truth.point(q) - target, axis=1)
    after = np.linalg.norm(truth.point(done.joint) - target, axis=1)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    assert before.mean() > 2e-4
    assert after.max() < 1e-6
    np.testing.assert_allclose(done.model_error, after, atol=1e-9)  # the model is exact here
    np.testing.assert_array_equal(done.joint, q + done.correction)
    assert (done.evaluations > 0).all()
    assert np.abs(done.correction).max() <= ROBOT.limits.correction


def test_swarm_and_newton_agree():
    wrong = errors(np.random.default_rng(3))
    q = workspace(20, np.random.default_rng(4))
    newton, swarm = (JointCompensator(calibration(wrong), m).compensate(q) for m in METHODS)
    assert newton.verdicts == swarm.verdicts
    np.testing.assert_allclose(swarm.correction, newton.correction, atol=2e-6)
    assert (newton.evaluations < swarm.evaluations)[np.isfinite(newton.model_error)].all()


def test_no_error_needs_no_correction():
    q = workspace(20, np.random.default_rng(5))
    done = JointCompensator(calibration({})).compensate(q)
    np.testing.assert_allclose(done.correction, 0, atol=1e-12)


def test_a_tool_off_the_centre_is_what_is_brought_there():
    """100 mm below a platform that tilts by 1 mrad: 0.1 mm that the centre does not show."""
    robot = replace(ROBOT, tool_offset=np.array([0.02, 0.0, -0.1]))
    wrong = {"rod_mismatch_1": 2e-4, "rod_mismatch_2": -2e-4, "arm_3": 2e-4}
    target = line(9)
    q = drawing_joints(target)
    done = JointCompensator(calibration(wrong, robot)).compensate(q)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    truth = SixRods(wrong)
    tool = truth.point(done.joint, robot.tool_offset)
    assert np.abs(tool - robot.tool_offset - target).max() < 1e-6
    assert np.abs(truth.point(done.joint) - target).max() > 5e-5


# Guards


def verdict(q, wrong=None, robot=ROBOT, method="newton", **change):
    done = JointCompensator(calibration(wrong or {}, robot, **change), method).compensate(
        np.atleast_2d(q)
    )
    if done.verdicts[0] is not CommandStatus.CORRECTED:
        np.testing.assert_array_equal(done.correction[0], 0)
        np.testing.assert_array_equal(done.joint[0], np.atleast_2d(q)[0])
        assert np.isinf(done.model_error[0])
    return done.verdicts[0]


@pytest.mark.parametrize("method", METHODS)
def test_each_verdict_by_a_command_made_for_it(method):
    home = np.array([0.1, 0.2, 0.15])
    assert verdict(home, method=method) is CommandStatus.CORRECTED
    for bad in (np.nan, np.inf, -np.inf):
        assert verdict([0.1, bad, 0.1], method=method) is CommandStatus.NOT_FINITE
    beyond = ROBOT.joints.upper + np.array([0, 1e-6, 0])
    assert verdict(beyond, method=method) is CommandStatus.JOINT_LIMIT
    out = drawing_joints(np.array([[0.3, 0.0, -0.711]]))
    assert verdict(out, method=method, reach=0.25) is CommandStatus.OUTSIDE_REGION
    assert verdict(out, method=method, reach=0.295) is CommandStatus.CORRECTED  # within the margin
    tight = replace(ROBOT, limits=replace(ROBOT.limits, correction=1e-4))
    assert verdict(home, {"joint_zero_1": 1e-3}, tight, method) is CommandStatus.NOT_REACHED
    strict = replace(ROBOT, limits=replace(ROBOT.limits, condition=1.01))
    assert verdict(out, robot=strict, method=method) is CommandStatus.SINGULAR


def test_stretched_legs_are_singular():
    deep = -np.sqrt((0.32 + 0.85) ** 2 - 0.145**2) + 1e-4
    limits = replace(ROBOT.limits, region_margin=1.0)
    q = drawing_joints(np.array([[0.0, 0.0, deep]]))
    wide = replace(ROBOT.joints, lower=np.full(3, -2.0), upper=np.full(3, 2.0))
    assert verdict(q, robot=replace(ROBOT, limits=limits, joints=wide)) is CommandStatus.SINGULAR


def test_what_the_drawing_cannot_assemble_is_out_of_reach():
    """One arm folded inward: three elbows nearly collinear, on a circle too wide for rods."""
    wide = replace(ROBOT, joints=replace(ROBOT.joints, upper=np.full(3, np.pi)))
    assert verdict([3.0, 0.0, 0.0], robot=wide) is CommandStatus.OUT_OF_REACH


def test_a_correction_beyond_a_joints_limit_is_none():
    """The command is within the limit by 0.1 mrad, the corrected one is not."""
    wrong = {f"joint_zero_{leg}": -1e-3 for leg in (1, 2, 3)}
    q = drawing_joints(np.array([[0.0, 0.0, -0.8]]))
    joints = replace(ROBOT.joints, upper=q[0] + 1e-4)
    assert verdict(q, wrong) is CommandStatus.CORRECTED
    assert verdict(q, wrong, replace(ROBOT, joints=joints)) is CommandStatus.JOINT_LIMIT


def test_one_bad_command_does_not_touch_the_others():
    wrong, q = errors(np.random.default_rng(6)), drawing_joints(line(5))
    alone = JointCompensator(calibration(wrong)).compensate(q)
    mixed = np.insert(q, [0, 3], [[np.nan, 0, 0], [9.0, 0, 0]], axis=0)
    done = JointCompensator(calibration(wrong)).compensate(mixed)
    good = [1, 2, 3, 5, 6]
    np.testing.assert_array_equal(done.joint[good], alone.joint)
    assert [done.verdicts[k] for k in (0, 4)] == [
        CommandStatus.NOT_FINITE,
        CommandStatus.JOINT_LIMIT,
    ]
    assert np.isfinite(done.correction).all()


@pytest.mark.parametrize("method", METHODS)
def test_nothing_is_nan_and_nothing_beyond_the_bound_wherever_one_asks(method):
    rng = np.random.default_rng(7)
    wrong, q = errors(rng), rng.uniform(-3.2, 3.2, (300 if method == "newton" else 40, 3))
    done = JointCompensator(calibration(wrong), method).compensate(q)
    assert np.isfinite(done.joint).all()
    assert not np.isnan(done.model_error).any()
    assert np.abs(done.correction).max() <= ROBOT.limits.correction
    corrected = np.array([v is CommandStatus.CORRECTED for v in done.verdicts])
    assert (done.model_error[corrected] < 1e-6).all()
    assert (done.correction[~corrected] == 0).all()


def test_wrong_method_is_refused():
    with pytest.raises(InputError, match="no method 'tables'; choose from: apso, newton, table"):
        JointCompensator(calibration({}), "tables")


def test_tool_points_are_those_of_the_base_the_tracker_stands_before():
    """A known reflector 60 mm off the tool, seen by a rotated tracker, converted to the base."""
    rng = np.random.default_rng(8)
    wrong, q = errors(rng), workspace(20, rng)
    cell = Cell(SixRods(wrong), (0.06, -0.02, 0.03))
    made = calibration(wrong)
    frame = Frame(cell.turn.as_matrix(), np.array(cell.place))
    theta = made.chain.join(made.geometry, np.array(cell.offset), frame)
    tool = replace(made, theta=theta).tool_points(cell.reading(q), q)
    np.testing.assert_allclose(tool, cell.machine.point(q), atol=1e-12)


def identified(cell, q, rng):
    """A calibration as in a cell, from noisy readings of an unknown machine."""
    found = identify(cell.measure(np.repeat(q, 2, axis=0), rng), ROBOT)
    return Calibration(
        robot=ROBOT,
        chain=found.chain,
        theta=found.theta,
        region=found.region,
        joints_lower=found.region_joints[0],
        joints_upper=found.region_joints[1],
        noise_floor=found.noise.floor,
        source="made",
        seal="0" * 64,
    )


@pytest.mark.parametrize("seed", [9, 10])
def test_an_unknown_machine_is_better_after_its_calibration(seed):
    """Before: tens of micrometres at least in the best-fitting frame; after: noise.

    The remaining error is also evaluated without any frame of the package, by distances between
    points.
    """
    rng = np.random.default_rng(seed)
    cell = Cell(SixRods(errors(rng)), tuple(2e-3 * rng.standard_normal(3)))
    calibrated = identified(cell, make_plan("identify", ROBOT, count=50).joint[::2], rng)
    target = line(41)
    q = drawing_joints(target)
    done = JointCompensator(calibrated).compensate(q)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    seen = cell.reading(done.joint)  # the machine itself, without noise
    after = np.linalg.norm(calibrated.tool_points(seen, done.joint) - target, axis=1)
    uncorrected, bent = cell.reading(q), drawing_joints(SPREAD)
    frame = align(
        np.concatenate([target, SPREAD]), np.concatenate([uncorrected, cell.reading(bent)])
    )
    before = np.linalg.norm(frame.inverse().apply(uncorrected) - target, axis=1)
    assert before.mean() > 50e-6
    assert after.max() < 20e-6
    assert after.mean() < before.mean() / 5

    def stretched(points):
        between = [np.linalg.norm(p[:, None] - p, axis=2) for p in (points, target)]
        return np.abs(between[0] - between[1]).max()

    assert stretched(seen) < 25e-6
    assert stretched(seen) < stretched(uncorrected) / 3


def test_no_commands_no_corrections():
    done = JointCompensator(calibration({})).compensate(np.zeros((0, 3)))
    assert done.joint.shape == (0, 3)
    assert done.verdicts == ()


@pytest.mark.parametrize("shape", [(3,), (2, 2), (2, 4), (1, 2, 3)])
def test_commands_of_another_shape_are_refused(shape):
    compensator = JointCompensator(calibration({}))
    with pytest.raises(InputError, match=r"commands have shape .*; it has to be \(n, 3\)"):
        compensator.compensate(np.zeros(shape))
