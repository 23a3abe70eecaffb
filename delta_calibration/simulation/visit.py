"""The same machine on another day: tracker set up again, reflector mounted again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeVar, cast

import numpy as np

from delta_calibration.data import Session
from delta_calibration.robot import Robot
from delta_calibration.simulation.machine import TrueMachine, draw_machine

Stream = TypeVar("Stream")

_DAY_NS = 86_400_000_000_000


def visited(
    machine: TrueMachine, robot: Robot, seed: int, visit: int, scatter: float = 1.0
) -> TrueMachine:
    """Return the machine with its tracker at another place and its reflector mounted again.

    Args:
        machine: the machine that is measured.
        robot: drawing and tolerances.
        seed: that the machine was drawn with.
        visit: number of the visit; 0 leaves all as it is.
        scatter: of the reflector's place, as in `draw_machine`.
    """
    if visit == 0:
        return machine
    other = draw_machine(robot, int(np.random.default_rng([seed, visit]).integers(2**31)), scatter)
    layout, theta = machine.chain.layout, machine.theta.copy()
    for part in (layout.offset, layout.frame):
        theta[part] = other.theta[part]
    return replace(machine, theta=theta)


def days_later(session: Session, days: int) -> Session:
    """Return the session with all its time stamps so many days later."""
    shift = days * _DAY_NS

    def later(stream: Stream) -> Stream:
        if stream is None:
            return stream
        stamped: Any = stream
        return cast(Stream, replace(stamped, stamp_ns=stamped.stamp_ns + shift))

    return replace(
        session,
        command=later(session.command),
        states=later(session.states),
        tracker=later(session.tracker),
        temperature=tuple(later(each) for each in session.temperature),
        payload=later(session.payload),
    )
