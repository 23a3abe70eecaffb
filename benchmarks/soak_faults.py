"""Faults around the node in a soak."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

LONGEST_RAMP_S = 1.0
NEAR = np.zeros(3)  # [rad] relative to the middle of the motion

Steps = Iterator[None]


class Faults:
    """Faults, one after another; each is a generator that takes a cell through it."""

    def __init__(self, calibrations: dict[str, Path], singular: np.ndarray, seed: int) -> None:
        self._files, self._singular = calibrations, singular
        self._rng = np.random.default_rng(seed)

    def round(self, cell: Any) -> Steps:
        """Apply all of them once."""
        each = (
            self.nan_burst,
            self.tracker_gone,
            self.clock_steps,
            self.late,
            self.marked,
            self.echo,
            self.beyond,
            self.singular,
            self.swapped,
            self.sensor_gone,
            self.useless,
            self.broken,
            self.switched,
            self.lifecycle,
            self.storm,
            self.held,
        )
        for fault in each:
            cell.outputs.during = fault.__name__
            yield from fault(cell)
            yield from cell.wait(0.3)

    def nan_burst(self, cell: Any) -> Steps:
        for value in (np.nan, np.inf):
            cell.spoil = value
            yield from cell.wait(0.05)
            cell.spoil = None
            yield from cell.wait(0.2)

    def tracker_gone(self, cell: Any) -> Steps:
        yield from cell.order("start_capture")
        cell.tracked = False
        yield from cell.wait(2.0)
        cell.tracked = True
        yield from cell.order("stop_capture")

    def clock_steps(self, cell: Any) -> Steps:
        for shift in (-3.0, 3.0):
            cell.shift = shift
            yield from cell.wait(0.3)
            cell.shift = 0.0
            yield from cell.wait(0.3)

    def late(self, cell: Any) -> Steps:
        cell.sending = False
        yield from cell.wait(0.3)
        for age in np.linspace(0.3, 0.0, 60):
            cell.command(-float(age))
        for age in np.linspace(2.0, 1.0, 30):
            cell.command(-float(age))
        cell.sending = True

    def marked(self, cell: Any) -> Steps:
        cell.mark = "compensated"
        yield from cell.wait(0.3)
        cell.mark = ""

    def echo(self, cell: Any) -> Steps:
        cell.echoing = True
        yield from cell.wait(0.3)
        cell.echoing = False

    def beyond(self, cell: Any) -> Steps:
        yield from cell.go(np.full(3, 1.9))
        yield from cell.go(NEAR)

    def singular(self, cell: Any) -> Steps:
        cell.amplitude = 0.0
        yield from cell.go(self._singular - cell.middle)
        yield from cell.go(NEAR)
        cell.amplitude = 1.0

    def swapped(self, cell: Any) -> Steps:
        for name in ("extended", "plain", "extended"):
            yield from cell.load(self._files[name])
            yield from cell.wait(0.5)

    def sensor_gone(self, cell: Any) -> Steps:
        yield from cell.set(temperature_timeout_s=1.0)
        cell.warm = False
        yield from cell.wait(2.0)
        cell.warm = True
        yield from cell.wait(0.5)
        yield from cell.load(self._files["plain"])

    def useless(self, cell: Any) -> Steps:
        yield from cell.load(self._files["useless"])
        yield from cell.wait(0.5)
        yield from cell.load(self._files["plain"])

    def broken(self, cell: Any) -> Steps:
        if (yield from cell.load(self._files["broken"])):
            cell.outputs.broken.append("a broken calibration was loaded")
        yield from cell.set(calibration=str(self._files["plain"]))

    def switched(self, cell: Any) -> Steps:
        for on in (False, True, False, True):
            yield from cell.order("enable", on)
            yield from cell.wait(float(self._rng.uniform(0.02, 0.3)))

    def lifecycle(self, cell: Any) -> Steps:
        from lifecycle_msgs.msg import Transition

        cell.holding = True  # once active again it starts at the position of the drives
        for name in ("DEACTIVATE", "CONFIGURE", "ACTIVATE"):  # the second one is invalid
            transition = getattr(Transition, f"TRANSITION_{name}")
            yield from cell.transit(transition)
            yield from cell.wait(0.1)
        yield from cell.wait(LONGEST_RAMP_S + 1.0)
        cell.holding = False
        yield from cell.order("enable", True)

    def storm(self, cell: Any) -> Steps:
        draw = self._rng.uniform
        for _ in range(30):
            yield from cell.set(
                ramp_s=float(draw(0.0, LONGEST_RAMP_S)),
                max_correction_rate=float(draw(0.3, 1.0)) * cell.rate,
                command_timeout_s=float(draw(0.3, 1.0)),
            )
            bad = {"ramp_s": np.nan, "max_correction_rate": -1.0, "on_failure": "stop"}
            for name, value in bad.items():
                if (yield from cell.set(**{name: value})):
                    cell.outputs.broken.append(f"{name} = {value} was taken")
        yield from cell.set(**cell.parameters())

    def held(self, cell: Any) -> Steps:
        cell.holding = True
        yield from cell.set(on_failure="hold")
        yield from self.nan_burst(cell)
        yield from self.beyond(cell)
        yield from cell.set(on_failure="pass_through")
        yield from cell.wait(LONGEST_RAMP_S + 1.0)
        cell.holding = False
