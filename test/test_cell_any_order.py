"""Tests of the command path with random events: finite, within bounds and limits, no jumps."""

from __future__ import annotations

import numpy as np
import pytest

from delta_calibration.cell import command_path
from delta_calibration.cell.command_path import ON_FAILURE, CommandPath, Sent
from delta_calibration.compensation import CommandStatus, Compensated

LARGEST = 0.01  # [rad] of any correction here
LIMIT = 1.2  # [rad] of each joint, in both directions
SINGULAR = 0.9  # [rad] of the first joint
RAMP_S, SPEED, FASTEST = 0.3, 2.0, 1.0  # [s], [rad/s] back from a hold, [rad/s] of the motion
COUNT = 1500  # commands per run


class Smooth:
    """Corrects as a function of the position, by at most `size` [rad]; has two of the guards."""

    def __init__(self, size: float) -> None:
        self.size = size

    def compensate(self, q: np.ndarray, at: object = None) -> Compensated:
        dq, verdict = self.size * np.sin(q + 0.3), CommandStatus.CORRECTED
        if np.abs(q + dq).max() > LIMIT:
            verdict = CommandStatus.JOINT_LIMIT
        if q[0, 0] > SINGULAR:
            verdict = CommandStatus.SINGULAR
        dq = dq if verdict is CommandStatus.CORRECTED else 0.0 * dq
        return Compensated(q + dq, dq, 0.0 * q[:, 0], np.ones(1, dtype=np.int64), (verdict,))


class Motion:
    """A path with random disturbances of its commands by upstream nodes, operators and faults."""

    def __init__(self, seed: int) -> None:
        self.rng = np.random.default_rng(seed)
        self.rate = 0.04 if seed % 2 else np.inf  # [rad/s]
        policy = ON_FAILURE[seed // 2 % 2]
        limits = np.full(3, -LIMIT), np.full(3, LIMIT)
        self.path = CommandPath(policy, RAMP_S, self.rate, 0.1, SPEED, limits=limits)
        self.path.load(Smooth(LARGEST))
        self.now, self.meant, self.speed = 0.0, self.rng.uniform(-1, 1, 3), np.zeros(3)
        # time and position meant, position sent, whether it was returning from a hold
        self.out: list[tuple[float, np.ndarray, np.ndarray, bool]] = []
        self.last: tuple[float, float, np.ndarray, np.ndarray] | None = None  # now, and these

    def move(self) -> None:
        """Advance the motion within the joint limits."""
        step = self.rng.choice([0.001, 0.002, 0.005, 0.02])
        self.now += step
        self.speed = np.clip(self.speed + self.rng.normal(0.0, 0.2, 3), -FASTEST, FASTEST)
        beyond = np.abs(self.meant + self.speed * step) > LIMIT
        self.speed[beyond] *= -1.0
        self.meant = np.clip(self.meant + self.speed * step, -LIMIT, LIMIT)

    astray = False  # whether the last command was in a return from a hold

    def event(self) -> tuple[Sent | None, float, np.ndarray]:
        """Apply a random event and a command; return output, and time and position meant."""
        rng, path = self.rng, self.path
        events = ["on", "on", "off", "load", "policy", "echo", "marked echo", "nan", "late", "bad"]
        event = str(rng.choice(events)) if rng.random() < 0.3 else "none"
        self.astray = False
        command, age_s, when, meant = self.meant.copy(), 0.0, self.now, self.meant
        if event in ("on", "off"):
            path.enable(event == "on")
        elif event == "load":
            path.load(Smooth(rng.choice([1.0, -1.0, 0.4]) * LARGEST))
        elif event == "policy":
            path.set_options(str(rng.choice(ON_FAILURE)), RAMP_S, self.rate, 0.1)
        elif event.endswith("echo") and self.out:
            last = self.out[-4:]
            when, meant, command, self.astray = last[int(rng.integers(len(last)))]
        elif event == "nan":
            command[rng.integers(3)] = np.nan
        elif event == "late":
            age_s = 0.2
        elif event == "bad":
            return path.refuse("no names"), when, meant
        stamp = int(self.now * 1e9)
        marked = event == "marked echo" and bool(self.out)
        return path.send(command, stamp, self.now, marked, None, age_s), when, meant


@pytest.mark.parametrize("seed", range(12))
def test_no_order_of_events_makes_the_output_jump(seed: int) -> None:
    motion = Motion(seed)
    path = motion.path
    # A ramp between corrections of either sign, and the change of a correction along the motion.
    slope = min(2.0 * LARGEST / RAMP_S, motion.rate)
    for _ in range(COUNT):
        motion.move()
        on_its_way, astray = path._back is not None or path._holding, motion.astray
        sent, when, meant = motion.event()
        if sent is None:
            continue
        out = sent.joint
        assert np.isfinite(out).all()
        assert np.abs(out).max() <= LIMIT + 1e-12
        way_back = path._back is not None or path._holding
        if not way_back and not motion.astray:
            assert np.abs(out - meant).max() <= LARGEST + 1e-12
        if motion.last is not None:
            then, before, meant_before, last = motion.last
            # An echoed command is of an earlier time; the correction has changed since.
            time = abs(when - before) + motion.now - then
            allowed = (1.0 + LARGEST) * np.abs(meant - meant_before) + slope * time
            allowed += SPEED * time * (on_its_way or way_back or motion.astray or astray)
            assert (np.abs(out - last) <= 1.01 * allowed + 1e-9).all()
        motion.last = motion.now, when, meant, out
        if sent.compensated and not path._holding:
            entry = when, meant, out, way_back or motion.astray
            motion.out = [*motion.out[-9:], entry]
    told = path.counts
    assert {command_path.ECHO, command_path.ALREADY, command_path.STALE} <= set(told)
    assert {
        command_path.REFUSED,
        CommandStatus.NOT_FINITE.value,
        CommandStatus.CORRECTED.value,
    } <= set(told)
    assert told[command_path.HELD] > 10 or told[command_path.DROPPED] > 10
