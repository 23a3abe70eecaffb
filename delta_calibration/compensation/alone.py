"""One command at a time, as a stream brings them: guards and correction in one compiled call."""

from __future__ import annotations

from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from delta_calibration.calibration import Calibration
from delta_calibration.compensation.base import REACHED
from delta_calibration.compensation.compiled import CompiledGeometry, CompiledNewton

Array = NDArray[np.float64]


class Alone:
    """Guards and, by Newton's method, corrections of single commands for a calibrated Delta.

    Args:
        calibration: the region, and the robot with its limits.
        nominal: the drawing that is commanded, its tool with it.
        solver: whatever finds the corrections; Newton's method on a compiled geometry becomes
            part of the compiled call.
        on_face: how near a point on a face of the region is to it [m].
    """

    def __init__(
        self, calibration: Calibration, nominal: CompiledGeometry, solver: object, on_face: float
    ) -> None:
        limits, joints = calibration.robot.limits, calibration.robot.joints
        self._kernel = _kernel()
        self._guards = (
            nominal.arrays[0],
            np.ascontiguousarray(calibration.region.planes),
            np.array([joints.lower, joints.upper], dtype=np.float64),
            nominal.arrays[2],
            (
                float(limits.condition),
                nominal.typical,
                float(limits.region_margin),
                on_face,
                float(limits.correction),
                REACHED,
            ),
        )
        self._machine: tuple[Any, ...] = ()
        if isinstance(solver, CompiledNewton):
            self._machine = (*solver.geometry.arrays, solver.settings.numbers)

    @property
    def corrects(self) -> bool:
        """Whether `correct` has a way to the correction."""
        return bool(self._machine)

    def judge(self, q: Array) -> tuple[int, Array]:
        """First guard that a command (3,) [rad] fails, and numbers: see command_kernel.py."""
        out = np.empty(self._kernel.OUT)
        return self._kernel.judge(*self._guards, q, out), out

    def correct(self, q: Array) -> tuple[int, Array]:
        """What became of a command (3,) [rad], and numbers: see command_kernel.py."""
        out = np.empty(self._kernel.OUT)
        return self._kernel.correct(*self._guards, *self._machine, q, out), out


def _kernel() -> Any:
    """The compiled functions."""
    return import_module("delta_calibration.compensation.command_kernel")
