"""Interpolation error of an encoder: it divides its signal periods unevenly.

    dq = a sin(N q) + b cos(N q) + c sin(2 N q) + d cos(2 N q)        N: periods per turn

Offsets of the sine and cosine signals cause the first pair of terms; unequal amplitudes and a
phase other than 90 degrees cause the second (Heydemann, Applied Optics 20 (1981) 3382). N is
stated in the robot file, `joints.encoder_lines`, and is not searched: a search over all the N of
encoders would find something in any noise, and up to some hundred periods per turn
`transmission_error`, which has the same effect there, already searches. The effect is not tried
where it could not be seen: where its bound is less than the repeatability of the joints, or a
period is less than twice the travel over which readings in motion are averaged (data/poses.py).
An encoder on a motor behind a gear is such a case. Averaging attenuates longer periods too, by an
amount that depends on the spacing of the readings; stated intervals include the largest loss.

Leaves out slower errors: an eccentric disc is `encoder_eccentricity`.

Sizes: about 1 % of the signal period for exposed linear encoders (catalogue Exposed Linear
Encoders, HEIDENHAIN, "position error within one signal period"); more for magnetic ones and for
those that are out of adjustment.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from delta_calibration.data.poses import BLOCK
from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.harmonic import HarmonicEffect
from delta_calibration.effects.remedy import ADJUST, Remedy
from delta_calibration.effects.signals import RATE, Signals
from delta_calibration.parameters import ParameterSet

_USUAL, _MOST = 0.01, 0.05  # expected amplitude and its bound, as shares of a period
_ORDERS = 2


@dataclass(frozen=True)
class EncoderInterpolation(HarmonicEffect):
    """Sub-divisional error of each joint's encoder, once and twice per signal period."""

    cause: ClassVar[str] = "encoder_interpolation"
    remedy: ClassVar[Remedy] = Remedy(
        ADJUST,
        "encoder",
        "readjust the reading head of the encoder and its signals, or compensate",
        "turn the joint over two periods of its encoder in sixteen steps: the error repeats",
    )
    called: ClassVar[str] = "interpolation error of the encoder"

    @property
    def suits(self) -> bool:
        """Whether the robot file states the periods, and they are long enough to be detected."""
        return self.robot.joints.encoder_lines > 0 and self._period >= self._shortest

    @property
    def unsuited(self) -> str:
        """Reason: no periods are stated, or they are too short to be detected."""
        sliding = self.mechanism.joint_unit == "m"
        stated = f"joints.{'encoder_periods_per_m' if sliding else 'encoder_lines'}"
        if self.robot.joints.encoder_lines <= 0:
            return f"the robot file does not state {stated}"
        most = f"at most {(1.0 if sliding else 2 * np.pi) / self._shortest:.4g} can be resolved"
        return f"{stated}: the periods are too short to be resolved; {most}"

    @property
    def parameters(self) -> ParameterSet:
        """Amplitudes a, b, c, d of each joint [rad or m]; sizes are shares of a period."""
        period = self._period / self.mechanism.joint_size
        return self.waves(_USUAL * period, _MOST * period, _ORDERS)

    @property
    def orders(self) -> tuple[float, ...]:
        """Orders of the waves: once and twice per period of the encoder's lines."""
        lines = self.robot.joints.encoder_lines
        return tuple((order + 1) * lines for order in range(_ORDERS))

    def doubt(self) -> Effect | None:
        """Part of the error that averaging removes from readings in motion."""
        return _Averaged(self.robot, self.mechanism, self)

    @property
    def _period(self) -> float:
        """Signal period, in the joints' unit."""
        return 2 * np.pi / self.robot.joints.encoder_lines

    @property
    def _shortest(self) -> float:
        """Shortest period that can be detected, in the joints' unit."""
        averaged = 2 * BLOCK * self.mechanism.joint_size
        return max(averaged, self.robot.joints.repeatability / _MOST)


@dataclass(frozen=True)
class _Averaged(Effect):
    """Largest part of each wave that averaging over a block of travel removes."""

    cause: ClassVar[str] = "encoder_averaged"
    kind: ClassVar[str] = "drive"
    stage: ClassVar[Stage] = Stage.DRIVE

    error: EncoderInterpolation

    @property
    def parameters(self) -> ParameterSet:
        """Parameters of the interpolation error."""
        return self.error.parameters

    def columns_of(
        self, signals: Signals, values: Array | None = None, by_stage: Array | None = None
    ) -> Array:
        """See `Effect.columns_of`; the fastest joint travels a block, others in proportion."""
        full, rate = self.error.columns_of(signals), np.abs(signals.of(RATE))
        most = rate.max(axis=1, keepdims=True)
        share = np.divide(rate, most, out=np.zeros_like(rate), where=most > 0)
        travel = BLOCK * self.mechanism.joint_size * share  # (n, m)
        order = 1 + np.arange(len(self.parameters)) // (2 * self.mechanism.joints)
        periods = travel[:, :, None] * order * self.robot.joints.encoder_lines / (2 * np.pi)
        lost = full * (1 - np.sinc(periods))
        return np.asarray(lost if by_stage is None else by_stage @ lost)
