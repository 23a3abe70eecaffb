"""Commands that come back: what was sent to the drives is commanded again, its mark lost."""

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
    """What was sent to the drives."""

    joint: Array  # (m,) [rad]
    stage: Stage  # of the correction in it
    astray: bool  # on its way back from a hold: no command's own place

    def is_at(self, q: Array) -> bool:
        """Whether a command (m,) [rad] is this output."""
        return bool((np.abs(self.joint - q) <= SAME).all())

    @property
    def odd(self) -> bool:
        """Whether it is no command as any other, without its mark as well."""
        return self.astray or bool(np.abs(self.stage.applied).max() > LEAST)


class Echo:
    """The last outputs that are more than their commands.

    A command of the motion's own meets one of them to `SAME` in every joint by an accident that
    a smooth motion does not have.

    Attributes:
        kept: the outputs, as the compiled functions take them; None before the first.
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
        """The newest output that a command (m,) [rad] is; None if it is none.

        A marked one may have no correction in it yet, one that has lost its mark has.
        """
        if self.kept is None:
            return None
        row = echo_kernel.find(self.kept, q, marked)
        known = self._sent[row] if row >= 0 else None
        return None if known is None else Output(self.kept.joint[row].copy(), *known)

    def kept_already(self, stage: Stage) -> None:
        """Of the last output, which compiled code has put into `kept`: what is not kept there."""
        if self.kept is not None:
            self._sent[(int(self.kept.told[0]) - 1) % KEPT] = stage, False
