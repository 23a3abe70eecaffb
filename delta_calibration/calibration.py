"""The identified robot, as compensation uses it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.effects import Effect, Stage
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.uncertainty import Identified, Uncertainty

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Calibration:
    """Identified parameters of a robot's chain, and the region where they are valid."""

    robot: Robot
    chain: Chain
    theta: Array  # (P,)
    region: Region
    joints_lower: Array  # (m,) [rad or m] lowest measured
    joints_upper: Array  # (m,) [rad or m] highest measured
    noise_floor: float  # [m]
    source: str
    seal: str  # hash of the file's content
    # [m] error left: RMS 3-D distance at places that the fit had not seen; NaN if not known
    held_out: float = np.nan
    uncertainty: Uncertainty | None = None  # None: not in the file
    measured: str = ""  # `Poses.digest` of the poses that were fitted; empty: not in the file

    @property
    def identified(self) -> Identified | None:
        """Chain, theta and covariance, for position uncertainties; None if not in the file."""
        if self.uncertainty is None:
            return None
        return Identified(self.chain, self.theta, self.uncertainty)

    @property
    def geometry(self) -> Array:
        """The mechanism's geometry, (p,)."""
        return self.chain.split(self.theta)[0]

    @property
    def live(self) -> tuple[tuple[Effect, Array], ...]:
        """Effects that are compensated, with their values: those of drives and structure.

        They act before the pose and do not depend on the time within one session.
        """
        values = self.chain.effect_values(self.theta)
        return tuple(
            (effect, value)
            for effect, value in zip(self.chain.effects, values, strict=True)
            if not effect.on_readings and not effect.bound_to_session
        )

    @property
    def live_causes(self) -> tuple[str, ...]:
        """Causes that are compensated, each once."""
        return tuple(dict.fromkeys(effect.cause for effect, _ in self.live))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Causes that were identified but cannot be compensated; see `why_left_out`."""
        effects = self.chain.effects
        each = (e.cause for e in effects if e.bound_to_session or e.stage is Stage.BASE)
        return tuple(dict.fromkeys(each))

    def why_left_out(self, cause: str) -> str:
        """Reason why an identified cause is not compensated, as the end of a sentence."""
        effect = next(e for e in self.chain.effects if e.cause == cause)
        if effect.bound_to_session:
            return (
                "it depends on the time since the start of a session; what it has changed since "
                "is in neither the commands nor u95: measure again"
            )
        return "it moves the base, not the joints"

    @property
    def frame(self) -> Frame:
        """Identified pose of the base in the tracker's frame, `T_tracker_base`."""
        return self.chain.split(self.theta)[2]

    def tool_points(self, readings: Array, q: Array) -> Array:
        """Tool points in the base frame, computed from tracker readings, (n, 3) [m].

        The vector from the tool to the reflector is the identified reflector offset less the tool
        offset, rotated with the platform as the model predicts at joints q, (n, m) [rad or m]. The
        base frame is the calibration's own: an error of the reflector offset and one of the frame
        shift the readings alike, so only their sum can be identified.
        """
        _, offset, frame = self.chain.split(self.theta)
        x = self.chain.mechanism.forward(q, self.geometry)  # rotation by effects is neglected
        standoff = self.chain.point(x, offset) - self.chain.point(x, self.robot.tool_offset)
        return frame.inverse().apply(readings) - standoff
