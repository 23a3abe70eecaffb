"""A cell without a robot: a machine that is not built as drawn, and the tracker that measures it.

The machine is the chain of measurement run forward with six rods and parameters drawn about the
drawing; the same chain that is fitted afterwards, with numbers nobody tells it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.errors import InputError, ReachError
from delta_calibration.geometry import Frame, rotations
from delta_calibration.plans import Leg, Plan, legs
from delta_calibration.robot import Robot
from delta_calibration.samples import (
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
    at_rest,
)

Array = NDArray[np.float64]

_DISTANCE = 3.0  # [m] of the tracker from the robot's base
_TRUTH = "six_rod_delta"
_AMBIENT = 20.0  # [deg C]
# stamps of simulated sessions start here, whatever the clock says
_EPOCH_NS = 1_700_000_000_000_000_000
_DEFAULT_STRENGTH = 3.0  # standard deviations of a hidden cause whose size is not given
# What of a cause's parameters a hidden one goes into: the same shift of a base joint and of its
# platform joint would do nothing, and a mismatch is of the rods, not of widths and tilts as well.
_HIDDEN_IN = {"base_joint_position": "base_", "parallelogram_mismatch": "rod_mismatch"}


@dataclass(frozen=True)
class Machine:
    """A machine as it really is, in front of a tracker."""

    robot: Robot
    chain: Chain
    theta: Array  # (P,) the truth

    @property
    def tool(self) -> Array:
        """Tool centre point in the platform's frame, (3,) [m]."""
        return self.robot.tool_offset

    def tool_points(self, q: Array) -> Array:
        """Where the tool truly is in the base at joint angles q, (n, 3) [m]; NaN out of reach."""
        x = self.chain.pose(at_rest(q), self.theta)
        return self.chain.point(x, self.tool)

    def readings(self, q: Array, rng: np.random.Generator) -> Array:
        """What the tracker says at joint angles q, (n, 3) [m], noise along and across its beam.

        Raises:
            ReachError: joint angles at which the machine cannot be assembled.
        """
        x = self.chain.pose(at_rest(q), self.theta)
        self.chain.mechanism.require_reach(x, q, "joint command", "rad")
        true = self.chain.reading(at_rest(q), x, self.theta)
        distance = np.linalg.norm(true, axis=1, keepdims=True)
        beam = true / distance
        along, across = self.robot.tracker.sigmas(distance)
        noise = rng.standard_normal(true.shape)
        radial = np.sum(noise * beam, axis=1, keepdims=True) * beam
        return np.asarray(true + along * radial + across * (noise - radial))

    def rest_error(self, rng: np.random.Generator) -> Array:
        """How far from the command the joints come to rest after a move, (m,) [rad]."""
        return self.robot.joints.repeatability * rng.standard_normal(len(self.robot.joints.names))

    def encoders(self, command: Array, rng: np.random.Generator) -> Array:
        """What encoders say at commands (n, m) [rad]: the command, as the drive sees no error."""
        return command + self.robot.joints.encoder * rng.standard_normal(command.shape)


def draw_machine(
    robot: Robot,
    seed: int,
    scatter: float = 1.0,
    hidden: Mapping[str, Mapping[str, str]] | None = None,
) -> Machine:
    """A machine whose parts deviate by `scatter` times their tolerances, a tracker about 3 m away.

    Args:
        robot: drawing and tolerances.
        seed: of everything that is drawn.
        scatter: 1 is a real machine, 0 one as drawn.
        hidden: causes to add, by name, with `location` (joint_1 ...) and `value` [m or rad].

    Raises:
        InputError: a cause or location that the machine does not have.
    """
    rng = np.random.default_rng(seed)
    mechanism = robot.model(_TRUTH)
    parameters = mechanism.parameters
    drawn = parameters.prior * rng.standard_normal(len(parameters))
    geometry = parameters.nominal + scatter * drawn
    for cause, options in (hidden or {}).items():
        geometry = _hide(robot, geometry, cause, options)
    bearing, turn = rng.uniform(0, 2 * np.pi), rng.uniform(0, 2 * np.pi)
    tilt = 0.02 * rng.standard_normal(2)
    rotation = rotations.exp(np.array([*tilt, 0.0])) @ rotations.about_z(turn)
    beam = np.array([np.cos(bearing), np.sin(bearing), 0.0])
    place = _DISTANCE * beam + 0.1 * rng.standard_normal(3)
    chain = Chain(mechanism, robot.tracker.reflector_offset, robot.tracker.reflector_offset_prior)
    offset = robot.tracker.reflector_offset + 1e-3 * scatter * rng.standard_normal(3)
    return Machine(robot, chain, chain.join(geometry, offset, Frame(rotation, place)))


def hideable_causes(robot: Robot) -> tuple[str, ...]:
    """Causes that `draw_machine` can hide."""
    return tuple(dict.fromkeys(p.cause for p in robot.model(_TRUTH).parameters))


def simulate_session(
    machine: Machine,
    plan: Plan,
    seed: int,
    rate: float = 20.0,
    period: float = 0.0,
    source: str = "simulated",
    follow: Callable[[Iterator[Leg]], Iterable[Leg]] = iter,
) -> Session:
    """Take the machine through a plan and record what a cell records.

    Args:
        machine: what is measured.
        plan: where to.
        seed: of the noise.
        rate: of all streams [1/s].
        period: at least this long from stop to stop [s]; what is waited is not recorded.
        source: the session's name.
        follow: is handed the legs and hands them on; for a progress bar.

    Raises:
        ReachError: the plan leads where the machine cannot go.
    """
    rng = np.random.default_rng([seed, 1])
    stamps, commands, encoders, points = [], [], [], []
    payloads: list[tuple[float, float]] = []
    clock = 0.0
    for leg in follow(legs(plan, machine.robot, rate)):
        if not payloads or payloads[-1][1] != leg.payload:
            payloads.append((clock, leg.payload))
        actual = leg.joint + machine.rest_error(rng)
        stamps.append(clock + leg.time)
        commands.append(leg.joint)
        encoders.append(machine.encoders(leg.joint, rng))
        points.append(_readings(machine, actual, rng, plan))
        clock += max(_duration(leg, rate), period)
    time = np.concatenate(stamps)
    stamp_ns = _EPOCH_NS + np.round(time * 1e9).astype(np.int64)
    names = machine.robot.joints.names
    return Session(
        source=source,
        command=JointStream(stamp_ns, names, np.concatenate(commands)),
        states=JointStream(stamp_ns, names, np.concatenate(encoders)),
        tracker=TrackerStream(stamp_ns, np.concatenate(points), None),
        temperature=_temperatures(time[-1]),
        payload=_payload_stream(payloads),
    )


def _readings(machine: Machine, actual: Array, rng: np.random.Generator, plan: Plan) -> Array:
    try:
        return machine.readings(actual, rng)
    except ReachError as error:
        raise ReachError(f"plan {plan.name!r}: {error}") from error


def _duration(leg: Leg, rate: float) -> float:
    return float(leg.time[-1]) + 1 / rate


def _payload_stream(payloads: list[tuple[float, float]]) -> PayloadStream:
    when = np.array([t for t, _ in payloads])
    mass = np.array([m for _, m in payloads])
    centre = np.tile([0.0, 0.0, -0.03], (len(mass), 1))
    return PayloadStream(_EPOCH_NS + np.round(when * 1e9).astype(np.int64), mass, centre)


def _temperatures(duration: float) -> tuple[TemperatureStream, ...]:
    stamp = _EPOCH_NS + np.round(np.arange(0.0, duration + 60.0, 60.0) * 1e9).astype(np.int64)
    steady = np.full(len(stamp), _AMBIENT)
    return tuple(TemperatureStream(part, stamp, steady) for part in ("arm", "base"))


def _hide(robot: Robot, geometry: Array, cause: str, options: Mapping[str, str]) -> Array:
    parameters = robot.model(_TRUTH).parameters
    unknown = sorted(set(options) - {"location", "value"})
    if unknown:
        raise InputError(
            f"effect {cause}: unknown option {', '.join(unknown)}; allowed: location, value"
        )
    location = options.get("location")
    part = _HIDDEN_IN.get(cause, "")
    rows = [
        row
        for row, p in enumerate(parameters)
        if p.cause == cause and location in (None, p.location) and p.name.startswith(part)
    ]
    if not rows:
        where = f" at {location}" if location else ""
        places = ", ".join(dict.fromkeys(p.location for p in parameters if p.location))
        raise InputError(
            f"effect {cause}{where} cannot be hidden; "
            f"causes: {', '.join(hideable_causes(robot))}; locations: {places}"
        )
    moved = geometry.copy()
    moved[rows] += _value(cause, options, parameters.prior[rows])
    return moved


def _value(cause: str, options: Mapping[str, str], prior: Array) -> Array:
    if "value" not in options:
        return _DEFAULT_STRENGTH * prior
    try:
        value = float(options["value"])
    except ValueError:
        value = np.nan
    if not np.isfinite(value):
        raise InputError(
            f"effect {cause}: value {options['value']!r} is not a finite number (SI: m or rad)"
        )
    return np.full_like(prior, value)
