"""What the effects on a cable robot share: lengths let out otherwise than k theta says.

    |a - P - R b| = l_0 + k theta + dl        dl = change(at) - change(home)

Whatever changes the length between anchor and platform acts as the angle dl / k behind the
encoder, so all of these are of the chain's first stage. What it does at home went into the
counter's zero. Loads and lengths are those of the nominal machine: deviations of a thousandth
change an effect by a thousandth.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from delta_calibration.effects.base import Array, Effect, Stage
from delta_calibration.effects.loads import pose_of, weight
from delta_calibration.mechanisms import CableRobot
from delta_calibration.samples import Conditions, at_rest


@dataclass(frozen=True)
class CableEffect(Effect):
    """Base of the effects on cables."""

    stage: ClassVar[Stage] = Stage.DRIVE

    @property
    def suits(self) -> bool:
        """Whether the mechanism has cables."""
        return isinstance(self.mechanism, CableRobot)

    @property
    def cables(self) -> CableRobot:
        """The mechanism, which is a cable robot."""
        assert isinstance(self.mechanism, CableRobot)
        return self.mechanism

    def as_angle(self, length: Array) -> Array:
        """Motor angle that lets out as much, (n, m) [m] -> (n, m) [rad]."""
        return np.asarray(length / self.cables.dimensions.gain)

    def poses(self, at: Conditions) -> Array:
        """Of the nominal machine, (n, k)."""
        return pose_of(self.mechanism, at)

    def lengths(self, at: Conditions) -> Array:
        """Of the nominal machine's cables, (n, m) [m]."""
        return self.cables.lengths(self.poses(at), self.mechanism.parameters.nominal)

    def tensions(self, at: Conditions) -> Array:
        """Pull of each cable under platform and payload, (n, m) [N]."""
        x = self.poses(at)
        load = weight(self.robot, self.mechanism, at, x)
        return self.cables.tensions(x, self.mechanism.parameters.nominal, load)

    def at_home(self) -> Conditions:
        """Where and under what the counters were set to zero: at home, no payload."""
        at = at_rest(np.zeros((1, self.mechanism.joints)))
        return replace(at, payload=np.zeros(1), payload_centre=np.zeros((1, 3)))
