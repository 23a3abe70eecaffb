"""Checks of the node's outputs in a soak."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

STOP_S = 0.1  # [s] without an output after which the next may start at the position of the drives
RETURN_S = 2.0  # [s] duration of the return from there to the commands


@dataclass(frozen=True)
class Told:
    """A command as it was sent."""

    when: float  # steady [s]
    joint: np.ndarray
    held: bool  # whether the node may be holding, or returning


class Outputs:
    """Checks each output against the commands; keeps violations in words."""

    def __init__(self, bound: float, rate: float, speed: float) -> None:
        self.bound, self._step = bound, rate + speed
        self.count, self.fastest, self.largest = 0, 0.0, 0.0
        self.broken: list[str] = []
        self.during = ""  # the fault that is being applied
        self.told: dict[int, Told] = {}
        self._last: tuple[Told, np.ndarray] | None = None
        self._came, self._returning = (
            np.inf,
            -np.inf,
        )  # last output; end of a possible return

    def forget(self) -> None:
        """The node has restarted: do not compare the next output with the last."""
        self._last = None

    def take(self, stamp: int, out: np.ndarray, now: float) -> None:
        """Check an output."""
        self.count += 1
        if now - self._came > STOP_S:
            self._returning = now + RETURN_S
        self._came = now
        told = self.told.get(stamp)
        if told is None:
            return self._break(f"an output with a stamp that no command had: {stamp}")
        if not np.isfinite(out).all():
            return self._break(f"an output that is not finite: {out.tolist()}")
        finite = np.isfinite(told.joint).all()
        if finite and not told.held and now > self._returning:
            self.largest = max(self.largest, float(np.abs(out - told.joint).max()))
            if self.largest > self.bound * (1 + 1e-9):
                self._break(f"a correction of {self.largest:.5f} rad")
        if self._last is not None:
            before, last = self._last
            # The node received the later one after the first was sent, and the earlier one before
            # now.
            allowed = self._step * (now - before.when) + 1e-9
            if finite and np.isfinite(before.joint).all():
                allowed = allowed + np.abs(told.joint - before.joint)
                share = float((np.abs(out - last) / allowed).max())
                self.fastest = max(self.fastest, share)
                if share > 1.0:
                    self._break(f"a step of {np.abs(out - last).max():.5f} rad, {share:.2f} of it")
        if finite:
            self._last = told, out
        return None

    def _break(self, text: str) -> None:
        if len(self.broken) < 10:
            self.broken.append(f"{text}, during '{self.during}'")
