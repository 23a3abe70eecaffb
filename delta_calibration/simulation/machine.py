"""The actual machine of a simulation, in front of a tracker."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.data import Conditions, at_rest
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.mechanisms.possible import impossible
from delta_calibration.parameters import ParameterSet
from delta_calibration.robot import Robot
from delta_calibration.simulation.climate import AMBIENT, PARTS
from delta_calibration.simulation.hidden import Causes, hide

Array = NDArray[np.float64]

_DISTANCE = 3.0  # [m] of the tracker from the robot's base
_FARTHEST = 10.0  # [m] of a reflector from where it should be
_REFLECTOR = 1e-3  # [m] usual mounting error of the reflector; less if the file's prior is less


@dataclass(frozen=True)
class TrueMachine:
    """The actual machine in front of a tracker; its chain contains all effects that it has."""

    robot: Robot
    chain: Chain
    theta: Array  # (P,) the truth

    @property
    def tool(self) -> Array:
        """Tool centre point in the platform's frame, (3,) [m]."""
        return self.robot.tool_offset

    @property
    def warms(self) -> bool:
        """Whether any of its effects depends on the temperature of a part."""
        return any(effect.part for effect in self.chain.effects)

    def tool_points(self, at: Conditions) -> Array:
        """True tool points in the base, (n, 3) [m]; NaN out of reach.

        They include the effects of drives and structure under these conditions, but neither the
        effects of the measurement nor noise.
        """
        return self.chain.point(self.chain.pose(at, self.theta), self.tool)

    def reflector_points(self, at: Conditions) -> Array:
        """True reflector points in the tracker's frame, (n, 3) [m]; NaN out of reach.

        These are the readings of a perfect tracker, without effects of the base.
        """
        _, offset, frame = self.chain.split(self.theta)
        return frame.apply(self.chain.point(self.chain.pose(at, self.theta), offset))

    def readings(self, at: Conditions, rng: np.random.Generator) -> Array:
        """Tracker readings, (n, 3) [m], with noise along and across the beam.

        Raises:
            ReachError: joint angles at which the machine cannot be assembled.
        """
        seen = self.chain.see(at, self.theta, asked="nothing")
        self.chain.mechanism.require_reach(seen.x, at.joint, "joint command")
        true = seen.reading
        distance = np.linalg.norm(true, axis=1, keepdims=True)
        beam = true / distance
        along, across = self.robot.tracker.sigmas(distance)
        noise = rng.standard_normal(true.shape)
        radial = np.sum(noise * beam, axis=1, keepdims=True) * beam
        return np.asarray(true + along * radial + across * (noise - radial))

    def turns(self, at: Conditions, rng: np.random.Generator) -> Array | None:
        """Platform orientations read by the tracker, (n, 4) x y z w, with noise.

        None for a tracker that measures points, or whose rotation noise is unknown.
        """
        tracker = self.robot.tracker
        if tracker.measures != "pose" or tracker.turn is None:
            return None
        x = self.chain.pose(at, self.theta)
        beside = rotations.exp(tracker.turn * rng.standard_normal((len(at), 3)))
        turned = beside @ self.chain.rotation(at, self.theta, x)
        return rotations.to_quaternion(turned)

    def rest_error(self, rng: np.random.Generator) -> Array:
        """Draw the deviations of the joints from the command at rest after a move, (m,) [rad]."""
        return self.robot.joints.repeatability * rng.standard_normal(len(self.robot.joints.names))

    def encoders(self, command: Array, rng: np.random.Generator) -> Array:
        """Encoder readings at commands (n, m) [rad]: command and noise, as drives see no error."""
        return command + self.robot.joints.encoder * rng.standard_normal(command.shape)


def standing(joint: Array, payload: float = 0.0) -> Conditions:
    """Conditions of joints (n, m) [rad] at rest in a cell just switched on, all at 20 deg C.

    Neither direction nor travel of the last motion counts: backlash is in its middle.
    """
    n = len(joint)
    return replace(
        at_rest(joint),
        payload=np.full(n, payload),
        payload_centre=np.zeros((n, 3)),
        temperature_parts=PARTS,
        temperature=np.full((n, len(PARTS)), AMBIENT),
    )


def draw_machine(
    robot: Robot, seed: int, scatter: float = 1.0, hidden: Causes = ()
) -> TrueMachine:
    """Draw a machine with errors of `scatter` times the tolerances, a tracker about 3 m away.

    Args:
        robot: drawing and tolerances.
        seed: of all random numbers.
        scatter: 1 is a real machine, 0 one as drawn.
        hidden: causes to add, by name, each with its options: `value` (SI) or `strength` (in
            typical sizes), `location` (joint_1 ...), and settings of the effect.

    Raises:
        InputError: an unknown cause or option, a value that is not allowed, or a machine that
            cannot be built.
    """
    rng = np.random.default_rng(seed)
    mechanism = robot.detailed
    parameters = mechanism.parameters
    drawn = parameters.prior * _errors(parameters, rng)
    bearing, turn = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    tilt = 0.02 * rng.standard_normal(2)
    rotation = rotations.exp(np.array([*tilt, 0.0])) @ rotations.about_z(turn)
    beam = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    place = _DISTANCE * beam + 0.1 * rng.standard_normal(3)
    tracker = robot.tracker
    chain = Chain(mechanism, tracker.reflector_offset, tracker.reflector_offset_prior)
    off = scatter * min(_REFLECTOR, tracker.reflector_offset_prior)
    offset = tracker.reflector_offset + off * rng.standard_normal(3)
    theta = chain.join(parameters.nominal + scatter * drawn, offset, Frame(rotation, place))
    causes = hide(robot, chain, hidden, seed)
    theta[chain.layout.dimensions] += causes.shift
    _require_buildable(chain, theta)
    return TrueMachine(
        robot, chain.with_effects(causes.effects), np.concatenate([theta, causes.values])
    )


def _errors(parameters: ParameterSet, rng: np.random.Generator) -> Array:
    """Errors of the parts in standard deviations, (p,); 0 for those that are not drawn."""
    errors = np.zeros(len(parameters))
    drawn = np.array([parameter.drawn for parameter in parameters])
    errors[drawn] = rng.standard_normal(int(drawn.sum()))
    return errors


def _require_buildable(chain: Chain, theta: Array) -> None:
    """Refuse dimensions that no machine has, and a reflector far from where it should be."""
    geometry, offset, _ = chain.split(theta)
    if wrong := impossible(chain.mechanism, geometry):
        raise InputError(f"such a machine cannot be built: {wrong}")
    off = float(np.linalg.norm(offset - chain.offset))
    if off > _FARTHEST:
        raise InputError(
            f"effect smr_offset: the reflector is {off:g} m away; "
            f"at most {_FARTHEST:g} m is allowed"
        )
