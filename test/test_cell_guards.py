"""Tests of each guard of the command path: rate, age, echo, hold and return, edge."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.cell import command_path
from delta_calibration.cell.command_path import HOLD, PASS_THROUGH, CommandPath
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.errors import InputError
from delta_calibration.robot import load_robot
from six_rods import drawing_joints
from test_cell_command_path import DQ, Fixed, Q, compensating, outside
from test_compensator import ROBOT, calibration, errors

STEP_S = 0.01  # [s]


def test_a_correction_beyond_its_rate_is_held_to_it_and_counted() -> None:
    path = CommandPath(ramp_s=0.0, rate=0.5)
    path.load(Fixed())
    path.enable(True)
    path.send(Q, 0, 0.0)
    path.load(Fixed(-DQ))
    sent = [path.send(Q, k, k * STEP_S).joint - Q for k in range(1, 12)]
    steps = np.abs(np.diff([DQ, *sent], axis=0))
    assert steps.max() == pytest.approx(0.5 * STEP_S)
    np.testing.assert_allclose(sent[-1], -DQ)
    assert path.counts[command_path.LIMITED] == 7  # 40 mrad in steps of 5, the last one free


@pytest.mark.parametrize("already", [False, True])
def test_a_stale_command_is_dropped_or_the_last_one_held(already: bool) -> None:
    passing, holding = compensating(), compensating(HOLD)
    for path in (passing, holding):
        path.set_options(path.on_failure, 0.0, timeout_s=0.1)
        fresh = path.send(Q, 0, 0.0, age_s=0.1)
        np.testing.assert_allclose(fresh.joint, Q + DQ)
        np.testing.assert_allclose(path.send(Q, 1, 0.0, age_s=-0.1).joint, Q + DQ)
    assert passing.send(Q + 0.1, 2, 0.1, already, age_s=0.11) is None
    np.testing.assert_array_equal(
        holding.send(Q + 0.1, 2, 0.1, already, age_s=0.11).joint, fresh.joint
    )
    assert passing.counts[command_path.STALE] == holding.counts[command_path.STALE] == 1
    assert passing.trouble == command_path.STALE
    passing.set_options(PASS_THROUGH, 0.0)  # no timeout
    assert passing.send(Q, 3, 0.2, age_s=1e9) is not None
    with pytest.raises(InputError, match="command_timeout_s is -1"):
        CommandPath(timeout_s=-1.0)


def test_what_was_sent_is_not_corrected_again_though_its_mark_is_lost() -> None:
    path = compensating()
    out = path.send(Q, 0, 0.0)
    for k in range(1, 20):  # a loop: the output is the next input
        out = path.send(out.joint.copy(), k, k * STEP_S)
        np.testing.assert_array_equal(out.joint, Q + DQ)
        assert out.compensated
        assert path.trouble == command_path.ECHO
        np.testing.assert_allclose(path.nominal(out.joint), Q, atol=1e-15)
    assert path.counts[command_path.ECHO] == 19
    np.testing.assert_allclose(path.send(Q, 20, 0.3).joint, Q + DQ)  # out of the loop again


def test_a_motion_is_not_taken_for_an_echo() -> None:
    path = compensating()
    way = np.linspace(0.0, 1.0, 4001)[:, None] * 1.7 * DQ  # exactly along the correction
    for k, step in enumerate(way):
        np.testing.assert_allclose(path.send(Q + step, k, k * 1e-3).joint, Q + step + DQ)
    assert path.counts[command_path.ECHO] == 0


@pytest.mark.parametrize("marked", [False, True])
def test_an_output_that_comes_back_ends_no_ramp(marked: bool) -> None:
    path = compensating(ramp_s=1.0)
    for k in range(41):
        out = path.send(Q, k, k * STEP_S)
    for k in range(41, 60):  # a loop for a while
        out = path.send(out.joint.copy(), k, k * STEP_S, already=marked)
        np.testing.assert_allclose(out.joint - Q, 0.4 * DQ, atol=1e-15)
    for k, share in ((60, 0.4), (90, 0.7), (120, 1.0), (121, 1.0)):  # from there on
        if k == 60:
            path.send(out.joint.copy(), k, k * STEP_S, already=marked)
        np.testing.assert_allclose(path.send(Q, k, k * STEP_S).joint - Q, share * DQ, atol=1e-15)


def test_an_output_that_comes_back_in_a_hold_or_after_it_is_sent_as_it_is() -> None:
    path = compensating(HOLD, ramp_s=1.0)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    held = path.send(outside(), 1, 0.0).joint
    np.testing.assert_array_equal(path.send(held.copy(), 2, 0.0, already=True).joint, held)
    away = Q + 0.4
    np.testing.assert_allclose(path.send(away, 3, 0.0).joint, held)  # no jump to the command
    half = path.send(away, 4, 0.5).joint
    np.testing.assert_allclose(half, (held + away + DQ) / 2)
    for now_s in (0.5, 0.6):  # and not the remaining way once more
        np.testing.assert_array_equal(path.send(half.copy(), 5, now_s).joint, half)


@pytest.mark.parametrize("on_failure", [PASS_THROUGH, HOLD])
def test_no_correction_brings_a_joint_beyond_its_limit(on_failure: str) -> None:
    """If a correction is sent because the joint limit is near, it stays for a while."""
    limits = Q - 1.0, Q + np.array([0.1, 1.0, 1.0])
    path = CommandPath(on_failure, ramp_s=1.0, limits=limits)
    path.load(Fixed(np.full(3, 0.01)))
    path.enable(True)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    path.enable(False)
    for k, s in enumerate(np.linspace(0.0, 0.3, 32)):  # at the limit before the ramp is complete
        q = Q + 0.1 * s / 0.3
        out = path.send(q, k, s).joint
        assert (out <= limits[1]).all()
        np.testing.assert_allclose(path.nominal(out), q)
    assert path.counts[command_path.LIMIT] > 0


@pytest.mark.parametrize("enabled", [False, True])
@pytest.mark.parametrize("already", [False, True])
def test_a_command_beyond_a_joint_limit_is_refused_or_brought_to_it(enabled, already) -> None:
    """Compensated here, elsewhere or not at all."""
    lower, upper = Q - 1.0, Q + 1.0
    path = CommandPath(ramp_s=0.0, limits=(lower, upper))
    path.load(Fixed())
    path.enable(enabled)
    assert path.send(np.array([0.1, 1e308, 0.3]), 0, 0.0, already) is None
    assert path.send(np.array([0.1, -1.0, 0.3]), 1, 0.0, already) is None
    assert path.counts[command_path.BEYOND] == 2
    assert path.trouble == command_path.BEYOND
    assert path.send(upper + 5e-10, 2, 0.0, already) is not None  # a limit in degrees, rounded
    path.set_options(PASS_THROUGH, 0.0, beyond_limits="clamp")
    sent = path.send(np.array([0.1, 1e308, 0.3]), 3, 0.0, already)
    assert sent is not None
    assert (sent.joint >= lower).all()
    assert (sent.joint <= upper).all()
    assert path.counts[command_path.CLAMPED] == 1


def test_with_hold_the_last_good_output_stands_in_for_one_beyond_a_limit() -> None:
    path = CommandPath(HOLD, ramp_s=0.0, limits=(Q - 1.0, Q + 1.0))
    np.testing.assert_array_equal(path.send(Q, 0, 0.0).joint, Q)
    np.testing.assert_array_equal(path.send(Q + 2.0, 1, 0.1).joint, Q)


def test_a_ramp_is_bounded_a_step_where_commands_are_far_apart() -> None:
    """Commands are two seconds apart; earlier, the whole correction came in one step."""
    path = CommandPath(ramp_s=1.0, at_once_s=0.1)
    path.load(Fixed())
    path.send(Q, 0, 0.0)
    path.enable(True)
    out = np.array([path.send(Q, k, 2.0 * k).joint for k in range(1, 15)])
    assert np.abs(np.diff(out, axis=0)).max() <= 0.1001 * np.abs(DQ).max()
    np.testing.assert_allclose(out[-1], Q + DQ)


def test_a_correction_is_held_to_its_rate_where_commands_are_far_apart() -> None:
    path = CommandPath(ramp_s=0.0, rate=0.02, at_once_s=0.1)
    path.load(Fixed())
    path.enable(True)
    path.send(Q, 0, 0.0)
    path.compensator.dq = DQ + 0.01
    path.load(path.compensator)
    out = np.array([path.send(Q, k, 5.0 * k).joint for k in range(1, 9)])
    assert np.abs(np.diff(out, axis=0)).max() <= 0.1001 * 0.02
    np.testing.assert_allclose(out[-1], Q + DQ + 0.01)


def test_a_command_marked_by_another_does_not_complete_a_ramp() -> None:
    path = CommandPath(ramp_s=1.0, rate=0.1)
    path.load(Fixed())
    path.send(Q, 0, 0.0)
    path.enable(True)
    path.send(Q, 1, 0.01)
    before = path.send(Q, 2, 0.02).joint
    path.send(Q + 0.3, 3, 0.03, already=True)
    after = path.send(Q, 4, 0.04).joint
    assert np.abs(after - before).max() <= 0.03 * np.abs(DQ).max()


@pytest.mark.parametrize("foreign", [Q + 1e-3, Q + 0.3])
def test_a_marked_command_of_another_is_told_as_none_of_ours(foreign: np.ndarray) -> None:
    path = compensating(ramp_s=0.0)
    before = path.send(Q, 0, 0.0).joint - Q
    sent = path.send(foreign, 1, 0.01, already=True)
    np.testing.assert_array_equal(sent.joint, foreign)
    np.testing.assert_array_equal(path.nominal(foreign), foreign)
    assert path.applied == 0.0
    np.testing.assert_allclose(path.send(Q, 2, 0.02).joint - Q, before)


def test_a_marked_command_of_another_is_no_way_round_the_rate() -> None:
    """In full or on its ramp: the next correction is rate limited from our own last one."""
    path = CommandPath(ramp_s=0.0, rate=0.02)
    path.load(Fixed())
    path.send(Q, 0, 0.0)
    path.enable(True)
    before = path.send(Q, 1, 0.1).joint - Q
    path.send(Q + 0.1, 2, 0.11, already=True)
    after = path.send(Q, 3, 0.12).joint - Q
    assert np.abs(after - before).max() <= 0.02 * 0.02 * 1.001


def test_the_way_back_from_a_hold_is_bounded_a_step() -> None:
    """With commands seconds apart each output makes 0.1 s of the return, not all of it at once."""
    path = CommandPath(HOLD, ramp_s=1.0, at_once_s=0.1)
    held = path.send(Q, 0, 0.0).joint
    path.refuse("no command")
    away = Q + 0.3
    path.send(away, 1, 5.0)
    way = np.array([path.send(away, k, 5.0 + 2.0 * k).joint for k in range(1, 12)])
    steps = np.abs(np.diff(np.vstack([held, way]), axis=0)).max(axis=1)
    assert steps.max() == pytest.approx(0.03)
    np.testing.assert_allclose(way[-1], away)


@pytest.mark.parametrize(
    ("age_s", "why"), [(-1000.0, command_path.AHEAD), (np.nan, command_path.AGELESS)]
)
def test_a_command_of_an_age_that_cannot_be_is_not_sent(age_s: float, why: str) -> None:
    """Earlier, stamps 1000 s ahead, and any without simulated time, passed the timeout."""
    path = compensating()
    path.set_options(PASS_THROUGH, 0.0, timeout_s=0.1)
    assert path.send(Q, 0, 0.0, age_s=age_s) is None
    assert path.trouble == why
    assert path.counts[why] == 1
    path.set_options(PASS_THROUGH, 0.0)  # there is no check without a timeout
    assert path.send(Q, 0, 0.0, age_s=age_s) is not None


def test_after_a_hold_the_output_goes_back_to_the_commands_without_a_jump() -> None:
    path = compensating(HOLD, ramp_s=1.0)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    held = path.send(outside(), 1, 0.1).joint
    away = Q + np.array([0.4, -0.3, 0.2])  # position at which the commands returned
    sent = [path.send(away, 2 + k, 0.2 + k * STEP_S) for k in range(120)]
    way = np.array([s.joint for s in sent])
    np.testing.assert_allclose(way[0], held, atol=1e-12)
    np.testing.assert_allclose(way[50], (held + away + DQ) / 2, atol=1e-12)
    np.testing.assert_allclose(way[-1], away + DQ)
    assert np.abs(np.diff(way, axis=0)).max() == pytest.approx(0.4 * STEP_S, rel=1e-6)
    np.testing.assert_allclose(path.nominal(way[-1]), away)


def test_the_way_back_from_a_hold_is_no_faster_than_the_joints_are() -> None:
    path = CommandPath(HOLD, 0.0, speed=2.0)
    path.send(Q, 0, 0.0)
    path.refuse("no names")
    sent = np.array([path.send(Q + 1.0, k, k * STEP_S).joint for k in range(1, 60)])
    assert np.abs(np.diff([Q, *sent], axis=0)).max() == pytest.approx(2.0 * STEP_S)
    np.testing.assert_allclose(sent[-1], Q + 1.0)


def test_a_change_of_policy_while_held_is_no_jump() -> None:
    path = compensating(HOLD, ramp_s=1.0)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    held = path.send(outside(), 1, 0.1).joint
    path.set_options(PASS_THROUGH, 1.0)
    np.testing.assert_allclose(path.send(outside(), 2, 0.2).joint, held, atol=1e-12)
    np.testing.assert_allclose(path.send(outside(), 3, 2.0).joint, outside())


def test_activated_again_the_correction_that_the_drives_have_goes_out_on_a_ramp() -> None:
    path = compensating(ramp_s=1.0)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    path.reset()
    assert not path.enabled
    for now_s, share in ((7.0, 1.0), (7.5, 0.5), (8.0, 0.0)):
        np.testing.assert_allclose(path.send(Q, 1, now_s).joint - Q, share * DQ, atol=1e-15)


def test_activated_again_after_a_hold_it_starts_where_the_drives_stand() -> None:
    """Earlier, the first output after a hold and a new activation was the command: 56 mrad off."""
    path = compensating(HOLD, ramp_s=1.0)
    path.send(Q, 0, -5.0)
    path.send(Q, 0, 0.0)
    held = path.send(outside(), 1, 0.0).joint
    path.reset()
    away = Q + 0.056
    assert path.send(away, 2, 9.0) is None  # the position of the drives is unknown
    assert path.trouble == command_path.WAITING
    path.stand(held, 8.0)
    assert path.send(away, 3, 9.01) is None  # and has not been received recently
    path.reset()  # which keeps the hold
    assert path.send(away, 3, 9.01) is None
    path.stand(held, 9.02)
    way = np.array([path.send(away, k, 9.02 + k * STEP_S).joint for k in range(150)])
    np.testing.assert_allclose(way[0], held, atol=1e-12)
    assert np.abs(np.diff(way, axis=0)).max() < 1e-3
    np.testing.assert_allclose(way[-1], away)
    assert path.counts[command_path.WAITING] == 3


def test_the_first_output_starts_where_the_drives_stand() -> None:
    path = CommandPath(ramp_s=0.0, speed=1.0)
    path.stand(Q - 0.1, 0.0)
    way = np.array([path.send(Q, k, k * STEP_S).joint for k in range(20)])
    np.testing.assert_allclose(way[0], Q - 0.1, atol=1e-12)
    assert np.abs(np.diff(way, axis=0)).max() == pytest.approx(1.0 * STEP_S)
    np.testing.assert_allclose(way[-1], Q)
    path.stand(Q - 0.2, 0.21)  # from then on, the commands lead
    np.testing.assert_allclose(path.send(Q, 21, 0.21).joint, Q)


# The edge of the region

CENTRE = np.array([0.0, 0.0, -0.711])
MARGIN = ROBOT.limits.region_margin


def across(n: int = 401) -> np.ndarray:
    """Tool points from well inside a region of 0.25 m to well beyond its margin, and back."""
    radius = 0.25 + MARGIN * np.linspace(-0.5, 1.5, n)
    way = np.concatenate([radius, radius[::-1]])
    return CENTRE + np.stack([way, 0 * way, 0 * way], axis=1)


def test_a_correction_is_blended_out_by_place_over_the_margin() -> None:
    made = calibration(errors(np.random.default_rng(1)), reach=0.25)
    points = across()
    q = drawing_joints(points)
    done = JointCompensator(made).compensate(q)
    whole = JointCompensator(calibration(errors(np.random.default_rng(1)))).compensate(q)
    beyond = made.region.outside(points)
    share = np.clip(1.0 - beyond / MARGIN, 0.0, 1.0)
    np.testing.assert_allclose(done.correction, share[:, None] * whole.correction, atol=1e-9)
    # Continuous in position: a step of a thousandth of the margin changes a thousandth of it.
    largest = np.abs(whole.correction).max()
    assert largest > 1e-4
    steps = np.abs(np.diff(done.correction, axis=0)).max()
    assert steps < 1.1 * largest * np.abs(np.diff(share)).max() + 1e-6
    inside, out = beyond <= 0, beyond > MARGIN + 1e-9
    assert {v for v, b in zip(done.verdicts, out, strict=True) if b} == {
        CommandStatus.OUTSIDE_REGION
    }
    assert {v for v, b in zip(done.verdicts, out, strict=True) if not b} == {
        CommandStatus.CORRECTED
    }
    blended = (share > 1e-6) & (share < 1 - 1e-6)
    clear = blended | (share == 0) | (beyond < -1e-6)
    found = np.array([done.blended(k) for k in range(len(q))])
    np.testing.assert_array_equal(found[clear], blended[clear])
    # The remaining error is reported: none inside, all of it at the end of the margin.
    assert done.model_error[inside].max() < 1e-6
    left = np.linalg.norm(
        JointCompensator(made).point(done.joint[blended]) - points[blended], axis=1
    )
    np.testing.assert_allclose(done.model_error[blended], left, rtol=0.02, atol=1e-7)


@pytest.mark.parametrize("on_failure", [PASS_THROUGH, HOLD])
def test_across_the_edge_the_output_has_no_step(on_failure: str) -> None:
    made = calibration(errors(np.random.default_rng(1)), reach=0.25)
    path = CommandPath(on_failure, ramp_s=1.0)
    path.load(JointCompensator(made))
    path.enable(True)
    q = drawing_joints(across())
    path.send(q[0], 0, -9.0)
    sent = np.array([path.send(c, k, k * 1e-3).joint for k, c in enumerate(q)])
    moved, followed = np.abs(np.diff(q, axis=0)).max(), np.abs(np.diff(sent, axis=0)).max()
    assert followed < 1.5 * moved
    beyond = made.region.outside(across()) > MARGIN + 1e-9
    assert path.counts[CommandStatus.OUTSIDE_REGION.value] == beyond.sum()
    assert path.counts[command_path.BLENDED] > 100
    if on_failure == PASS_THROUGH:
        # The same position has the same correction on the way out and in: no ramp over time.
        n = len(q) // 2
        np.testing.assert_allclose(sent[:n] - q[:n], (sent[n:] - q[n:])[::-1], atol=1e-9)
        np.testing.assert_array_equal(sent[beyond], q[beyond])
    else:
        assert len(np.unique(sent[beyond], axis=0)) == 1  # it stays at its last position


def test_without_a_margin_corrections_end_at_the_region() -> None:
    sharp = replace(ROBOT, limits=replace(ROBOT.limits, region_margin=0.0))
    made = calibration(errors(np.random.default_rng(1)), sharp, reach=0.25)
    q = drawing_joints(across(5))
    done = JointCompensator(made).compensate(q)
    inside = made.region.outside(across(5)) <= 1e-9
    assert [v is CommandStatus.CORRECTED for v in done.verdicts] == inside.tolist()
    assert done.share is None  # none is partial


def test_without_a_margin_a_correction_ends_and_begins_over_the_ramp() -> None:
    sharp = replace(ROBOT, limits=replace(ROBOT.limits, region_margin=0.0))
    path = CommandPath(ramp_s=1.0)
    path.load(JointCompensator(calibration(errors(np.random.default_rng(1)), sharp, reach=0.25)))
    path.enable(True)
    q = drawing_joints(across(4001))  # 0.1 mm per millisecond
    path.send(q[0], 0, -9.0)
    added = np.array([path.send(c, k, k * 1e-3).joint - c for k, c in enumerate(q)])
    largest = np.abs(added).max()
    assert largest > 1e-4
    assert np.abs(np.diff(added, axis=0)).max() < 2.0 * largest * 1e-3


def test_each_guard_of_a_real_calibration_is_counted_on_the_path() -> None:
    """Bound, singularity, joint limit, reach: the path counts what the compensator refuses."""
    limits = replace(load_robot("srbd").limits, correction=1e-4)
    robot = replace(ROBOT, limits=limits)
    path = CommandPath(ramp_s=0.0)
    path.load(JointCompensator(calibration({"joint_zero_1": 1e-3}, robot)))
    path.enable(True)
    np.testing.assert_array_equal(path.send(Q, 0, 0.0).joint, Q)
    assert path.counts[CommandStatus.NOT_REACHED.value] == 1
    strict = replace(ROBOT, limits=replace(ROBOT.limits, condition=1.01))
    path.load(JointCompensator(calibration({}, strict)))
    q = drawing_joints(np.array([[0.3, 0.0, -0.711]]))[0]
    np.testing.assert_array_equal(path.send(q, 0, 0.0).joint, q)
    assert path.counts[CommandStatus.SINGULAR.value] == 1
    far = ROBOT.joints.upper + 0.1
    np.testing.assert_array_equal(path.send(far, 0, 0.0).joint, far)
    assert path.counts[CommandStatus.JOINT_LIMIT.value] == 1


@pytest.mark.parametrize("method", ["newton", "apso"])
def test_a_command_alone_is_judged_and_corrected_as_among_others(method: str) -> None:
    made = calibration(errors(np.random.default_rng(3)), reach=0.4)
    compensator = JointCompensator(made, method)
    rng = np.random.default_rng(4)
    q = np.concatenate([rng.uniform(-0.6, 1.8, (150, 3)), [[np.nan, 0, 0], [0.1, 0.2, 0.15]]])
    together = compensator.compensate(q)
    alone = [compensator.compensate(row[None]) for row in q]
    assert tuple(a.verdicts[0] for a in alone) == together.verdicts
    assert {CommandStatus.CORRECTED, CommandStatus.OUTSIDE_REGION} < set(together.verdicts)
    for name, atol in (("correction", 1e-15), ("model_error", 1e-15), ("share", 1e-12)):
        each = [getattr(a, name)[0] for a in alone]
        np.testing.assert_allclose(each, getattr(together, name), atol=atol)
