"""The identified robot, as compensation uses it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import Effect, Stage
from delta_calibration.effects.time_course import HOUR
from delta_calibration.geometry import Frame
from delta_calibration.lazy import cached_property
from delta_calibration.region import Region
from delta_calibration.robot import Robot
from delta_calibration.uncertainty import Identified, Uncertainty

Array = NDArray[np.float64]

_MOVED = {Stage.BASE: "base", Stage.REFLECTOR: "reflector or the tool"}


def _lasted(seconds: float) -> str:
    """Text of a duration, in hours, or in minutes below an hour."""
    return f"{seconds / HOUR:.2g} h" if seconds >= HOUR else f"{seconds / 60:.2g} min"


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
    # [s] last pose, on the clock of effects that are bound to the session; None: not in the file
    ended: float | None = None

    @property
    def identified(self) -> Identified | None:
        """Chain, theta and covariance, for position uncertainties; None if not in the file."""
        if self.uncertainty is None:
            return None
        return Identified(self.chain, self.theta, self.uncertainty, self.ended)

    @cached_property
    def later(self) -> Calibration:
        """The same as another session meets the machine: see `Identified.later`.

        Without the covariance of its values nothing is left out.
        """
        if self.identified is None:
            return self
        left = self.identified.later
        return replace(self, chain=left.chain, theta=left.theta, uncertainty=left.uncertainty)

    @property
    def geometry(self) -> Array:
        """The mechanism's geometry, (p,)."""
        return self.chain.split(self.theta)[0]

    @property
    def live(self) -> tuple[tuple[Effect, Array], ...]:
        """Effects that are compensated, with their values: those of drives and structure.

        They act before the pose. Effects by the clock are those at the session's end: a joint that
        slipped stays where it is, and a machine that warmed up is warm. Cycles are left out.
        """
        values = self.chain.effect_values(self.theta)
        return tuple(
            (effect, value)
            for effect, value in zip(self.chain.effects, values, strict=True)
            if not effect.on_readings and effect.outlasts(self.ended)
        )

    @property
    def live_causes(self) -> tuple[str, ...]:
        """Causes that are compensated, each once."""
        return tuple(dict.fromkeys(effect.cause for effect, _ in self.live))

    @property
    def left_out(self) -> tuple[str, ...]:
        """Causes that were identified but are not compensated; see `why_left_out`."""
        return tuple(dict.fromkeys(effect.cause for effect in self._left_out))

    @property
    def _left_out(self) -> tuple[Effect, ...]:
        """Effects of the machine that are not compensated."""
        effects = (e for e in self.chain.effects if e.stage is not Stage.MEASUREMENT)
        return tuple(e for e in effects if e.on_readings or not e.outlasts(self.ended))

    def why_left_out(self, cause: str) -> str:
        """Reason why an identified cause is not compensated, as the end of a sentence."""
        effect = next(e for e in self._left_out if e.cause == cause)
        if effect.on_readings:
            return f"it moves the {_MOVED[effect.stage]}, not the joints"
        if effect.lasting:
            return (
                "it goes by the clock of a session, and the file does not say when that ended: "
                "fit again"
            )
        return (
            "it goes up and down by the clock, after the session as well; it is in neither the "
            "commands nor u95"
        )

    @property
    def as_it_ended(self) -> str:
        """Sentence on effects by the clock in the commands; empty if there are none."""
        causes = dict.fromkeys(e.cause for e, _ in self.live if e.bound_to_session)
        if not causes or self.ended is None:
            return ""
        return (
            f"{', '.join(causes)}: compensated as at the end of the session, "
            f"{_lasted(self.ended)} after its start; what changed since is in neither the "
            "commands nor u95"
        )

    @property
    def frame(self) -> Frame:
        """Identified pose of the base in the tracker's frame, `T_tracker_base`."""
        return self.chain.split(self.theta)[2]

    def tool_points(self, readings: Array, q: Array, at: Conditions | None = None) -> Array:
        """Tool points in the base frame, computed from tracker readings, (n, 3) [m].

        The vector from the tool to the reflector is the identified reflector offset less the tool
        offset, rotated with the platform as the model predicts. The base frame is the
        calibration's own: an error of the reflector offset and one of the frame shift the readings
        alike, so only their sum can be identified.

        Args:
            readings: of the tracker, (n, 3) [m].
            q: joints, (n, m) [rad or m].
            at: conditions of the readings; at rest if not given. An effect that needs a condition
                which is not known turns nothing.
        """
        _, offset, frame = self.chain.split(self.theta)
        x = self._stand(at_rest(q) if at is None else replace(at, joint=q))
        standoff = self.chain.point(x, offset) - self.chain.point(x, self.robot.tool_offset)
        return frame.inverse().apply(readings) - standoff

    def _stand(self, at: Conditions) -> Array:
        """Poses of the machine, with those effects whose conditions are known, (n, k)."""
        known = [(effect, value) for effect, value in self.live if not effect.missing(at)]
        chain = self.chain.held(self.ended).with_effects(tuple(effect for effect, _ in known))
        base = self.theta[self.chain.layout.base]
        return chain.pose(at, np.concatenate([base, *(value for _, value in known)]))
