"""What compensation needs of an identified robot."""

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
    """A robot's chain as identified, and the region it holds in."""

    robot: Robot
    chain: Chain
    theta: Array  # (P,)
    region: Region
    joints_lower: Array  # (m,) [rad] lowest measured
    joints_upper: Array  # (m,) [rad]
    noise_floor: float  # [m]
    source: str
    seal: str  # hash of the file's content
    # [m] error left: RMS 3-D distance at places that the fit had not seen; NaN where nobody says
    held_out: float = np.nan
    uncertainty: Uncertainty | None = None  # None: the file does not say
    measured: str = ""  # `Poses.digest` of what it was made from; empty: the file does not say

    @property
    def identified(self) -> Identified | None:
        """What uncertainties of positions come from; None where the file does not say."""
        if self.uncertainty is None:
            return None
        return Identified(self.chain, self.theta, self.uncertainty)

    @property
    def geometry(self) -> Array:
        """The mechanism's geometry, (p,)."""
        return self.chain.split(self.theta)[0]

    @property
    def live(self) -> tuple[tuple[Effect, Array], ...]:
        """Effects with their values that hold from session to session and move the tool."""
        values = self.chain.effect_values(self.theta)
        return tuple(
            (effect, value)
            for effect, value in zip(self.chain.effects, values, strict=True)
            if not effect.on_readings and not effect.bound_to_session
        )

    @property
    def left_out(self) -> tuple[str, ...]:
        """Causes that were found and cannot be compensated; `why_left_out` gives the reason."""
        effects = self.chain.effects
        return tuple(e.cause for e in effects if e.bound_to_session or e.stage is Stage.BASE)

    def why_left_out(self, cause: str) -> str:
        """Why a cause that was found is not compensated: the end of a sentence."""
        (effect,) = (e for e in self.chain.effects if e.cause == cause)
        if effect.bound_to_session:
            return "it depends on the time within its session"
        return "it moves the base, not the joints"

    @property
    def frame(self) -> Frame:
        """`T_tracker_base`."""
        return self.chain.split(self.theta)[2]

    def tool_points(self, readings: Array, q: Array) -> Array:
        """Where the tool is in the base, as the tracker sees it, (n, 3) [m].

        The reflector stands off the tool by the identified offset less the tool's, turned with the
        platform as the model has it at joints q, (n, m) [rad]. This base is the calibration's own:
        an unknown reflector offset and an unknown frame shift alike, and only their sum is
        measured.
        """
        _, offset, frame = self.chain.split(self.theta)
        x = self.chain.mechanism.forward(q, self.geometry)  # effects turn the platform by nothing
        standoff = self.chain.point(x, offset) - self.chain.point(x, self.robot.tool_offset)
        return frame.inverse().apply(readings) - standoff
