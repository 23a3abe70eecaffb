"""Tests of the command path to the drives: what is sent, what is never sent, no jumps."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.cell import command_path
from delta_calibration.cell.command_path import HOLD, PASS_THROUGH, CommandPath
from delta_calibration.compensation import CommandStatus, Compensated
from delta_calibration.data import Conditions, at_rest
from delta_calibration.errors import DataError, InputError

Q = np.array([0.1, 0.2, 0.3])
DQ = np.array([0.01, -0.02, 0.005])
EDGE = 1.0  # [rad] of the first joint: there is no correction beyond it


class Fixed:
    """Corrects by the same amount everywhere inside the region."""

    def __init__(self, dq: np.ndarray = DQ) -> None:
        self.dq = dq
        self.calls = 0

    def compensate(self, q: np.ndarray, at: object = None) -> Compensated:
        self.calls += 1
        inside = q[:, 0] <= EDGE
        dq = np.where(inside[:, None], self.dq, 0.0)
        verdicts = tuple(
            CommandStatus.CORRECTED if i else CommandStatus.OUTSIDE_REGION for i in inside
        )
        return Compensated(q + dq, dq, 0.0 * q[:, 0], np.ones(len(q), dtype=np.int64), verdicts)


def compensating(on_failure: str = PASS_THROUGH, ramp_s: float = 0.0) -> CommandPath:
    """A path with its correction fully active; the steady clock is at 0."""
    path = CommandPath(on_failure, ramp_s)
    path.load(Fixed())
    path.enable(True)
    return path


def outside() -> np.ndarray:
    return np.array([EDGE + 0.5, 0.2, 0.3])


def test_without_compensation_a_command_goes_out_as_it_came_and_unmarked() -> None:
    sent = CommandPath().send(Q, 1, 0.0)
    np.testing.assert_array_equal(sent.joint, Q)
    assert not sent.compensated


def test_nothing_can_be_enabled_without_a_calibration() -> None:
    path = CommandPath()
    with pytest.raises(DataError, match="no calibration"):
        path.enable(True)
    assert not path.enabled


def test_with_compensation_the_correction_is_added_and_taken_off_the_states() -> None:
    path = compensating()
    sent = path.send(Q, 1, 0.0)
    np.testing.assert_allclose(sent.joint, Q + DQ)
    assert sent.compensated
    np.testing.assert_allclose(path.nominal(sent.joint), Q, atol=1e-15)
    assert path.counts == {CommandStatus.CORRECTED.value: 1}


def test_enabling_and_disabling_ramp_without_a_jump() -> None:
    path = CommandPath(ramp_s=1.0)
    path.load(Fixed())
    path.send(Q, 0, 9.0)
    sent = []
    for k in range(300):  # 3 s at 100 Hz: on at the begin, off in the middle of the first ramp
        if k == 0:
            path.enable(True)
        if k == 50:
            path.enable(False)
        if k == 200:
            path.enable(True)
        sent.append(path.send(Q, k, 10.0 + k * 0.01).joint - Q)
    steps = np.abs(np.diff([np.zeros(3), *sent], axis=0))
    assert np.all(steps <= np.abs(DQ) * 0.01 * 1.001)  # a hundredth of the correction each
    np.testing.assert_allclose(sent[49], 0.49 * DQ, rtol=1e-9)
    np.testing.assert_allclose(sent[160], np.zeros(3), atol=1e-15)  # the ramp down is complete
    np.testing.assert_allclose(sent[299], 0.99 * DQ, rtol=1e-9)


def test_another_calibration_is_ramped_in_from_the_one_before() -> None:
    path = compensating(ramp_s=1.0)
    path.send(Q, 0, 0.0)
    path.send(Q, 1, 5.0)
    path.load(Fixed(-DQ))
    assert path.enabled
    for now_s, share in ((6.0, 1.0), (6.25, 0.5), (6.5, 0.0), (7.0, -1.0), (9.0, -1.0)):
        np.testing.assert_allclose(path.send(Q, 2, now_s).joint - Q, share * DQ, atol=1e-15)


def test_leaving_the_region_ramps_out_what_was_applied() -> None:
    path = compensating(ramp_s=1.0)
    path.send(Q, 0, 0.0)
    path.send(Q, 1, 5.0)
    for now_s, share in ((6.0, 1.0), (6.5, 0.5), (7.0, 0.0)):
        sent = path.send(outside(), 2, now_s)
        np.testing.assert_allclose(sent.joint - outside(), share * DQ, atol=1e-15)
        assert sent.compensated
    assert path.trouble == CommandStatus.OUTSIDE_REGION.value


def test_hold_sends_the_last_good_command_and_nothing_before_there_is_one() -> None:
    path = compensating(HOLD)
    assert path.send(outside(), 0, 0.0) is None
    good = path.send(Q, 1, 0.0)
    held = path.send(outside(), 2, 0.0)
    np.testing.assert_array_equal(held.joint, good.joint)
    np.testing.assert_allclose(path.nominal(held.joint), Q)  # upstream sees the actual position
    assert path.counts[CommandStatus.OUTSIDE_REGION.value] == 2
    assert path.counts[command_path.DROPPED] == 1
    assert path.counts[command_path.HELD] == 1


def test_hold_passes_commands_through_while_compensation_is_off() -> None:
    sent = CommandPath(HOLD).send(outside(), 0, 0.0)
    np.testing.assert_array_equal(sent.joint, outside())


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("on", [True, False])
@pytest.mark.parametrize("already", [True, False])
def test_what_is_not_finite_never_goes_out(bad: float, on: bool, already: bool) -> None:
    q = np.array([0.1, bad, 0.3])
    passing, holding = compensating(), compensating(HOLD)
    for path in (passing, holding):
        path.enable(on)
        path.send(Q, 0, 0.0)
    assert passing.send(q, 1, 0.0, already) is None
    assert np.isfinite(holding.send(q, 1, 0.0, already).joint).all()
    assert passing.counts[CommandStatus.NOT_FINITE.value] == 1
    assert passing.trouble == CommandStatus.NOT_FINITE.value


def test_a_malformed_command_is_dropped_or_held() -> None:
    assert compensating().refuse("no names") is None
    path = compensating(HOLD)
    good = path.send(Q, 0, 0.0)
    assert path.refuse("no names") is good
    assert path.trouble == "no names"
    assert path.counts[command_path.REFUSED] == 1


def test_what_is_compensated_already_is_not_compensated_again() -> None:
    path = compensating()
    sent = path.send(Q, 0, 0.0, already=True)
    np.testing.assert_array_equal(sent.joint, Q)
    assert sent.compensated
    np.testing.assert_array_equal(path.nominal(Q), Q)
    assert path.counts == {command_path.ALREADY: 1}
    assert path.trouble is not None


def test_time_going_backwards_is_counted_and_the_command_still_sent() -> None:
    path = compensating()
    path.send(Q, 100, 0.0)
    assert path.trouble is None
    np.testing.assert_allclose(path.send(Q, 99, 0.0).joint, Q + DQ)
    assert path.counts[command_path.BACKWARD] == 1
    assert path.trouble == command_path.BACKWARD
    path.send(Q, 99, 0.0)  # a repeated stamp is no step back
    assert path.counts[command_path.BACKWARD] == 1


def test_a_dwell_is_solved_once() -> None:
    path = CommandPath(ramp_s=0.0)
    corrects = Fixed()
    path.load(corrects)
    path.enable(True)
    for k in range(50):
        np.testing.assert_allclose(path.send(Q.copy(), k, float(k)).joint, Q + DQ)
    assert corrects.calls == 1
    assert path.counts[CommandStatus.CORRECTED.value] == 50
    path.send(Q + 1e-9, 50, 50.0)
    assert corrects.calls == 2


def test_another_calibration_forgets_the_answers_of_the_one_before() -> None:
    path = compensating()
    path.send(Q, 0, 0.0)
    path.load(Fixed(2 * DQ))
    np.testing.assert_allclose(path.send(Q, 1, 1.0).joint, Q + 2 * DQ)


def test_after_a_reset_nothing_is_compensated_or_held() -> None:
    path = compensating(HOLD)
    path.send(Q, 5, 0.0)
    path.reset()
    assert not path.enabled
    assert path.loaded
    assert path.refuse("no names") is None
    path.send(Q, 1, 0.0)
    assert path.counts[command_path.BACKWARD] == 0


class Sided:
    """Corrects by half a gap on the side of approach; without a side a condition is missing."""

    def __init__(self) -> None:
        self.calls = 0

    def compensate(self, q: np.ndarray, at: Conditions | None = None) -> Compensated:
        self.calls += 1
        assert at is not None
        known = bool((at.direction != 0).all())
        dq = GAP / 2 * at.direction if known else np.zeros((1, 3))
        verdict = CommandStatus.CORRECTED if known else CommandStatus.MISSING_CONDITION
        missing = "" if known else "which way it went is not known"
        return Compensated(
            q + dq, dq, np.zeros(1), np.ones(1, dtype=np.int64), (verdict,), missing
        )


GAP = 1e-3  # [rad]


def going(direction: float) -> Conditions:
    return replace(at_rest(Q[None]), direction=np.full((1, 3), direction))


def test_a_step_of_the_correction_is_spread_at_the_rate_that_is_allowed() -> None:
    path = CommandPath(ramp_s=0.0, rate=0.02)  # 1 mrad takes 50 ms
    path.load(Sided())
    path.enable(True)
    begin = path.send(Q, 0, 10.0, at=going(1.0)).joint - Q
    np.testing.assert_allclose(begin, GAP / 2)
    sent = [
        path.send(Q, k, 10.0 + k * 0.01, at=going(-1.0)).joint - Q for k in range(1, 9)
    ]  # 100 Hz
    expected = np.maximum(GAP / 2 - 2e-4 * np.arange(1, 9), -GAP / 2)
    np.testing.assert_allclose(np.array(sent), expected[:, None] * np.ones(3), atol=1e-15)
    path.set_options(PASS_THROUGH, 0.0)
    np.testing.assert_allclose(path.send(Q, 9, 10.09, at=going(1.0)).joint - Q, GAP / 2)


def test_the_same_command_under_other_conditions_is_solved_anew_and_a_dwell_once() -> None:
    path = CommandPath(ramp_s=0.0)
    path.load(Sided())
    path.enable(True)
    for k, direction in enumerate((1.0, 1.0, -1.0, -1.0, -1.0, 1.0)):
        at = replace(going(direction), time=np.array([float(k)]))
        sent = path.send(Q, k, float(k), at=at)
        np.testing.assert_allclose(sent.joint - Q, direction * GAP / 2)
    assert path.compensator.calls == 3


@pytest.mark.parametrize("on_failure", [PASS_THROUGH, HOLD])
def test_a_condition_that_is_missing_is_named_and_the_policy_followed(on_failure: str) -> None:
    path = CommandPath(on_failure, 0.0)
    path.load(Sided())
    path.enable(True)
    good = path.send(Q, 0, 0.0, at=going(1.0))
    sent = path.send(Q + 0.1, 1, 1.0, at=going(0.0))
    np.testing.assert_array_equal(sent.joint, good.joint if on_failure == HOLD else Q + 0.1)
    assert path.trouble == (
        f"{CommandStatus.MISSING_CONDITION.value}: which way it went is not known"
    )
    assert path.counts[CommandStatus.MISSING_CONDITION.value] == 1


@pytest.mark.parametrize(
    "options", [("stop", 1.0), (HOLD, -1.0), (HOLD, np.nan), (HOLD, 1.0, 0.0), (HOLD, 1.0, np.nan)]
)
def test_options_that_are_none_are_refused(options: tuple[str, float]) -> None:
    with pytest.raises(InputError):
        CommandPath(*options)
