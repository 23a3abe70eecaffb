"""Detection of echoes: outputs to the drives that come back as commands without their mark."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.cell import echo_kernel
from delta_calibration.cell.echo_kernel import KEPT, LEAST, SAME, Outputs, outputs
from delta_calibration.cell.ramp import Stage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Output:
    """Output that was sent to the drives."""

    joint: Array  # (m,) [rad]
    stage: Stage  # of the correction in it
    astray: bool  # whether it is on the way back from a hold, so not at the place of a command

    def is_at(self, q: Array) -> bool:
        """Whether a command (m,) [rad] is this output."""
        return bool((np.abs(self.joint - q) <= SAME).all())

    @property
    def odd(self) -> bool:
        """Whether it differs from its command, so that it is recognised even without its mark."""
        return self.astray or bool(np.abs(self.stage.applied).max() > LEAST)


class Echo:
    """Store of the last outputs that were compensated or on the way back from a hold.

    A smooth motion's own command practically never agrees with one of them to `SAME` in every
    joint, so such a command is taken for an echo.

    Attributes:
        kept: the outputs in the form of the compiled functions; None before the first.
    """

    def __init__(self) -> None:
        self.kept: Outputs | None = None
        self._sent: list[tuple[Stage, bool] | None] = [None] * KEPT  # by row

    def sent(self, output: Output) -> None:
        """Remember an output."""
        if self.kept is None:
            self.kept = outputs(len(output.joint))
        row = echo_kernel.keep(self.kept, output.joint, output.odd)
        self._sent[row] = output.stage, output.astray

    def of(self, q: Array, marked: bool) -> Output | None:
        """Newest output equal to a command (m,) [rad]; None if there is none.

        A marked command may match any output, an unmarked one only an output that is `odd`.
        """
        if self.kept is None:
            return None
        row = echo_kernel.find(self.kept, q, marked)
        known = self._sent[row] if row >= 0 else None
        return None if known is None else Output(self.kept.joint[row].copy(), *known)

    def kept_already(self, stage: Stage) -> None:
        """Add the stage of the last output, which compiled code has already put into `kept`."""
        if self.kept is not None:
            self._sent[(int(self.kept.told[0]) - 1) % KEPT] = stage, False
