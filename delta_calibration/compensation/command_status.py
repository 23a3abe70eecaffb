"""Results of a compensator: corrected commands and the status of each, also as numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class CommandStatus(Enum):
    """Outcome of a command; the value is the reason in words."""

    CORRECTED = "corrected"
    NOT_FINITE = "a joint angle is not a finite number"
    JOINT_LIMIT = "beyond a joint limit, before or after the correction"
    OUT_OF_REACH = "out of reach of the nominal robot"
    OUTSIDE_REGION = "outside the calibrated region"
    SINGULAR = "near a singularity"
    SLACK = "a cable would hang slack"
    OUTSIDE_TABLE = "outside the table of corrections"
    NOT_REACHED = "no correction within the bound reaches the target"
    MISSING_CONDITION = "a condition that the model needs is not known"


# Codes of command_kernel.py, and the status that each stands for.
PASSED, NOT_FINITE, JOINT_LIMIT, OUT_OF_REACH, OUTSIDE_REGION, SINGULAR, SLACK, NOT_REACHED = (
    range(8)
)
BY_CODE = (
    CommandStatus.CORRECTED,
    CommandStatus.NOT_FINITE,
    CommandStatus.JOINT_LIMIT,
    CommandStatus.OUT_OF_REACH,
    CommandStatus.OUTSIDE_REGION,
    CommandStatus.SINGULAR,
    CommandStatus.SLACK,
    CommandStatus.NOT_REACHED,
)
FOUND, JUDGED, VERIFIED = range(3)  # modes of `command_kernel.every`
SHARE, LEFT, TURN, COUNT = range(4)  # of `told`: share applied, error [m], [rad], evaluations


@dataclass(frozen=True)
class Compensated:
    """Corrected commands, with the outcome of each."""

    joint: Array  # (n, m) [rad] what to send: q + dq, or q where there is no correction
    correction: Array  # (n, m) [rad]
    # (n,) [m] distance to the target *by the model*; infinite without correction
    model_error: Array
    evaluations: NDArray[np.int64]  # (n,) of the model
    verdicts: tuple[CommandStatus, ...]  # (n,)
    missing: str = ""  # conditions that were not known, in words
    # (n,) share of the whole correction that is applied: 1 in the calibrated region, falling to 0
    # over a margin beyond it. None where corrections end at the edge instead
    share: Array | None = None
    # (n,) [rad] remaining rotation to the target *by the model*; None where the joints command
    # no rotation
    model_turn: Array | None = None

    def whole(self, row: int) -> bool:
        """Whether a command got its whole correction."""
        return self.verdicts[row] is CommandStatus.CORRECTED and not self.blended(row)

    def blended(self, row: int) -> bool:
        """Whether a command got only a part of its correction."""
        return self.share is not None and 0.0 < float(self.share[row]) < 1.0

    @classmethod
    def joined(cls, parts: Sequence[Compensated]) -> Compensated:
        """Concatenate the results of several calls."""
        return cls(
            joint=np.concatenate([part.joint for part in parts]),
            correction=np.concatenate([part.correction for part in parts]),
            model_error=np.concatenate([part.model_error for part in parts]),
            evaluations=np.concatenate([part.evaluations for part in parts]),
            verdicts=tuple(verdict for part in parts for verdict in part.verdicts),
            missing=next((part.missing for part in parts if part.missing), ""),
            share=_joined([part.share for part in parts]),
            model_turn=_joined([part.model_turn for part in parts]),
        )


def _joined(parts: Sequence[Array | None]) -> Array | None:
    there = [part for part in parts if part is not None]
    return np.concatenate(there) if len(there) == len(parts) else None
