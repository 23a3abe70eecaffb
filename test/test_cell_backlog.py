"""Tests of commands after the process was suspended: losses are counted, nothing stale is sent."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.cell.backlog import Backlog
from delta_calibration.cell.command_path import CommandPath
from test_cell_command_path import Q

MS = 1_000_000  # [ns]


def flowing(n: int = 50) -> tuple[Backlog[int], int]:
    """A backlog at 1 kHz, and the number of the last command."""
    backlog: Backlog[int] = Backlog()
    for k in range(n):
        assert backlog.take(k, k * MS, k * 1e-3) == (k,)
    return backlog, n - 1


def test_a_stop_loses_are_counted_and_only_the_newest_of_the_burst_goes_out() -> None:
    """After 1 s the queue holds 100 and 900 are lost; earlier, the rest was sent a second late."""
    backlog, last = flowing()
    sent = []
    now_s = last * 1e-3 + 1.0
    for k in range(last + 901, last + 1001):
        sent += backlog.take(k, k * MS, now_s)
        now_s += 2e-5
    after = [last + 1001, last + 1002]
    for k in after:
        sent += backlog.take(k, k * MS, k * 1e-3 + 0.002)
    assert sent == [last + 1000, *after]
    assert backlog.lost == 900
    assert backlog.superseded == 99


def test_the_last_of_a_burst_goes_out_though_nothing_follows() -> None:
    backlog, last = flowing()
    for k in (last + 400, last + 401):
        assert backlog.take(k, k * MS, last * 1e-3 + 0.5) == ()
    assert backlog.release() == (last + 401,)
    assert backlog.interrupted
    assert backlog.release() == ()


@pytest.mark.parametrize("pause_s", [0.2, 1.0, 60.0])
def test_a_pause_of_who_commands_is_no_loss(pause_s: float) -> None:
    backlog, last = flowing()
    begin_s = last * 1e-3 + pause_s
    sent = []
    for k in range(20):
        sent += backlog.take(k, round((begin_s + k * 1e-3) * 1e9), begin_s + k * 1e-3)
    assert sent == list(range(20))
    assert backlog.lost == backlog.superseded == 0
    assert not backlog.interrupted


def test_a_process_may_wake_slowly_after_a_pause_of_who_commands() -> None:
    """The first command is received a little later than usual, the next ones right after it."""
    backlog, last = flowing()
    begin_s, sent = last * 1e-3 + 6.0, []
    for k, comes_s in enumerate((0.0015, 0.0016, 0.0021, 0.0031, 0.0041)):
        stamp_s = begin_s + k * 1e-3
        sent += backlog.take(k, round(stamp_s * 1e9), begin_s + comes_s)
    assert sent == list(range(5))
    assert backlog.lost == backlog.superseded == 0


@pytest.mark.parametrize("period_s", [0.2, 2.0])
def test_a_slow_stream_does_not_wait(period_s: float) -> None:
    backlog: Backlog[int] = Backlog()
    for k in range(10):
        assert backlog.take(k, round(k * period_s * 1e9), k * period_s) == (k,)


def test_after_lost_time_the_output_goes_no_faster_than_the_joints_may() -> None:
    path = CommandPath(ramp_s=1.0, speed=2.0)
    path.send(Q, 0, 0.0)
    path.interrupt()
    way = np.array([path.send(Q + 0.1, k, 1.0 + k * 1e-3).joint for k in range(100)])
    np.testing.assert_allclose(way[0], Q)
    assert np.abs(np.diff(way, axis=0)).max() == pytest.approx(2e-3)
    np.testing.assert_allclose(way[60], Q + 0.1)


def test_on_a_busy_machine_what_is_late_has_waited_though_it_comes_slowly() -> None:
    """A second of commands, taken 0.8 ms apart: at most the last three periods' are sent."""
    backlog, last = flowing()
    sent: list[tuple[int, float]] = []
    now_s = last * 1e-3 + 1.0
    k = last
    while (k + 1) * 1e-3 <= now_s:
        k += 1
        sent += [(each, now_s) for each in backlog.take(k, k * MS, now_s)]
        now_s += 0.8e-3
    assert all(at_s - each * 1e-3 < 5e-3 for each, at_s in sent)
    assert backlog.superseded > 900
