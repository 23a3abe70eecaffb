"""Simulated session: a machine runs a plan, and all streams of a cell are recorded."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from delta_calibration.data import (
    SIMULATED_NS,
    Conditions,
    JointStream,
    PayloadStream,
    Session,
    TemperatureStream,
    TrackerStream,
    motion_of,
)
from delta_calibration.errors import ReachError
from delta_calibration.plans import Leg, Plan, legs
from delta_calibration.simulation.climate import PARTS, Climate
from delta_calibration.simulation.machine import TrueMachine

Array = NDArray[np.float64]
Stamps = NDArray[np.int64]

RICH_PERIOD = 38.0  # [s] from stop to stop of the plan `rich`: two hours for its usual count
_PAYLOAD_CENTRE = np.array([0.0, 0.0, -0.03])  # [m] in the platform's frame
_THERMOMETERS = 60.0  # [s] between temperature readings
_FINE = 20.0  # [1/s] least rate at which the motion is computed, for slower samples too


def simulate_session(
    machine: TrueMachine,
    plan: Plan,
    seed: int,
    rate: float = 20.0,
    period: float = 0.0,
    source: str = "simulated",
    follow: Callable[[Iterator[Leg]], Iterable[Leg]] = iter,
    warming: bool = False,
) -> Session:
    """Run a plan on the machine and record all streams of a cell.

    The state of the motion (which way each joint went last and how far, speeds, time, payload,
    temperatures) is carried through the whole session.

    Args:
        machine: the machine that is measured.
        plan: the motion.
        seed: of the noise.
        rate: of readings and joint states [1/s]; commands, which show the reversals, come at
            20 a second at least.
        period: least time from stop to stop [s]; the waiting is not recorded.
        source: the session's name.
        follow: wraps the iteration over the legs; for a progress bar.
        warming: whether the cell was switched on when the session began, and warms up. It always
            does if an effect of the machine depends on temperature; else it is at 20 deg C.

    Raises:
        ReachError: the plan leads where the machine cannot go.
    """
    rng = np.random.default_rng([seed, 1])
    climate = Climate(warming or machine.warms)
    ways, at, command = _motion(plan, machine, rate, period, climate)
    encoders, points = [], []
    turns: list[Array] = []
    end, rested = 0, None
    for way in follow(iter(ways)):
        begin, end = end, end + len(way.time)
        here = at.take(slice(begin, end))
        rest = machine.rest_error(rng)
        error = np.where(way.started[:, None], rest, rest if rested is None else rested)
        actual, rested = replace(here, joint=way.joint + error), rest
        encoders.append(machine.encoders(way.joint, rng))
        points.append(_readings(machine, actual, rng, plan))
        turned = machine.turns(actual, rng)
        if turned is not None:
            turns.append(turned)
    stamp_ns = _stamps(at.time)
    names = machine.robot.joints.names
    return Session(
        source=source,
        command=command,
        states=JointStream(stamp_ns, names, np.concatenate(encoders)),
        tracker=TrackerStream(
            stamp_ns, np.concatenate(points), np.concatenate(turns) if turns else None
        ),
        temperature=_temperatures(climate, float(at.time[-1])),
        payload=_payloads(at),
    )


def _motion(
    plan: Plan, machine: TrueMachine, rate: float, period: float, climate: Climate
) -> tuple[Sequence[Leg], Conditions, JointStream]:
    """The legs of a plan at `rate`, the conditions of all their samples, and the commands."""
    each = max(1, int(np.ceil(_FINE / rate)))
    fine = list(legs(plan, machine.robot, rate * each))
    ways = [_thinned(leg, each) for leg in fine]
    begin = np.cumsum([0.0, *(max(float(way.time[-1]) + 1 / rate, period) for way in ways)])
    time = np.concatenate([b + leg.time for b, leg in zip(begin[:-1], fine, strict=True)])
    joint = np.concatenate([leg.joint for leg in fine])
    motion = motion_of(time, joint, machine.robot.commanded.joint_size)
    payload = np.concatenate([np.full(len(way.time), way.payload) for way in ways])
    kept = np.concatenate([np.arange(len(leg.time)) % each == 0 for leg in fine])
    n = len(payload)
    # moves begin and end softly: a difference from joints at rest to a neighbour is no speed
    moving = np.concatenate([way.moving for way in ways])[:, None]
    conditions = Conditions(
        joint=np.concatenate([way.joint for way in ways]),
        time=time[kept],
        velocity=motion.velocity[kept] * moving,
        acceleration=motion.acceleration[kept] * moving,
        direction=motion.direction[kept],
        travel=motion.travel[kept],
        payload=payload,
        payload_centre=np.tile(_PAYLOAD_CENTRE, (n, 1)),
        temperature_parts=PARTS,
        temperature=climate.celsius(time[kept]),
        reading=np.full((n, 3), np.nan),
        reading_velocity=np.zeros((n, 3)),
        reading_acceleration=np.zeros((n, 3)),
    )
    return ways, conditions, JointStream(_stamps(time), machine.robot.joints.names, joint)


def _thinned(leg: Leg, each: int) -> Leg:
    """Keep every `each`-th sample of a leg."""
    return Leg(leg.time[::each], leg.joint[::each], leg.resting[::each], leg.payload)


def _readings(machine: TrueMachine, at: Conditions, rng: np.random.Generator, plan: Plan) -> Array:
    try:
        return machine.readings(at, rng)
    except ReachError as error:
        raise ReachError(f"plan {plan.name!r}: {error}") from error


def _stamps(time: Array) -> Stamps:
    return SIMULATED_NS + np.round(time * 1e9).astype(np.int64)


def _payloads(at: Conditions) -> PayloadStream:
    """One message at the first sample after each change of payload."""
    change = np.flatnonzero(np.diff(at.payload, prepend=np.nan) != 0)
    return PayloadStream(_stamps(at.time[change]), at.payload[change], at.payload_centre[change])


def _temperatures(climate: Climate, duration: float) -> tuple[TemperatureStream, ...]:
    time = np.arange(0.0, duration + _THERMOMETERS, _THERMOMETERS)
    celsius = climate.celsius(time)
    return tuple(
        TemperatureStream(part, _stamps(time), celsius[:, k]) for k, part in enumerate(PARTS)
    )
