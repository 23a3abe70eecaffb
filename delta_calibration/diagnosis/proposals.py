"""Proposals of further measurements, from the cheapest to the most expensive.

Each proposal is a sentence for people and the samples that it would add to a session: some of its
poses again or under other conditions, poses elsewhere, or paths.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from delta_calibration.data import Conditions
from delta_calibration.diagnosis.predicted_information import Samples
from delta_calibration.diagnosis.shared_path_error import AT_REST
from delta_calibration.effects.unexplained import spread_out
from delta_calibration.geometry.halton import halton
from delta_calibration.mechanisms import Mechanism

Array = NDArray[np.float64]

_TEN = 10
_STOP = 40.0  # [s] between stops
_HOUR = 3600.0  # [s]
_SHORT = 0.01  # [rad of a Delta] travel of the joints from their last reversal to a stop
_PAYLOAD = 2.0  # [kg]
_WARMING = 10.0  # [K]
_COOLING = 1200.0  # [s] time constant
_REGULAR = 10.0  # largest condition number of a pose worth measuring
_RADII = (0.2, 0.1, 0.05)  # [m] of the circles
_ROUND = (10.0, 5.0, 2.5)  # [s] a turn
_ON_CIRCLE = 24
_SWEEP_STEP, _SWEEP_SPEED = 0.04, 0.03  # [rad], [rad/s] of a Delta
_DRAWN = 256


@dataclass(frozen=True)
class Experiment:
    """A proposed measurement: a sentence for people, and the samples that it adds."""

    sentence: str
    samples: Samples


@dataclass(frozen=True)
class Session:
    """The data of a session that proposals are based on."""

    at: Conditions  # of the stops
    end: float  # [s]
    mechanism: Mechanism
    lower: Array  # (m,) [rad] of the joints
    upper: Array  # (m,) [rad]

    def ten(self, count: int = _TEN) -> Conditions:
        """`count` stops of the session, spread out and repeated one by one after its end."""
        places = spread_out(self.at.joint, count)
        rows = cdist(places, self.at.joint).argmin(axis=1)
        return self.later(self.at.take(rows), _STOP)

    def later(self, at: Conditions, begin: float) -> Conditions:
        """The stops at rest, the first `begin` [s] after the session's end."""
        still = np.zeros_like(at.joint)
        return replace(
            at,
            time=self.end + begin + _STOP * np.arange(len(at), dtype=float),
            temperature=np.repeat(self.at.temperature[-1:], len(at), axis=0),
            velocity=still,
            acceleration=still,
            travel=np.full(at.joint.shape, _SHORT * self.mechanism.joint_size),
        )

    def elsewhere(self, joint: Array) -> Conditions:
        """Stops at other joint angles (n, m), under the conditions of the session's last one."""
        last = self.at.take(np.full(len(joint), len(self.at) - 1))
        return self.later(replace(last, joint=joint), _STOP)

    def usable(self, joint: Array) -> NDArray[np.bool_]:
        """Mask of joint angles within limits at which the nominal machine is well conditioned."""
        nominal = self.mechanism.parameters.nominal
        within = ((joint >= self.lower) & (joint <= self.upper)).all(axis=1)
        x = self.mechanism.forward(joint, nominal)
        good = np.asarray(within & np.isfinite(x).all(axis=1))
        good[good] = self.mechanism.condition(joint[good], x[good], nominal) < _REGULAR
        return good


def proposals(session: Session) -> Iterator[Experiment]:
    """All proposals that are possible on this machine, the cheapest first."""
    for propose in _PROPOSALS:
        proposed = propose(session)
        if proposed is not None and len(proposed.samples.path):
            yield proposed


def _stops(sentence: str, at: Conditions) -> Experiment:
    return Experiment(sentence, Samples(at, np.full(len(at), AT_REST)))


def _again(session: Session) -> Experiment:
    return _stops("repeat ten of the poses", session.ten())


def _other_side(session: Session) -> Experiment:
    at = session.ten()
    side = np.where(at.direction == 0, -1.0, -at.direction)
    return _stops("approach ten of the poses from the other side", replace(at, direction=side))


def _payload(session: Session) -> Experiment:
    at = session.ten()
    known = np.unique(session.at.payload)
    mass = float(known.max()) + _PAYLOAD
    a_second = "a second payload" if len(known) == 1 else "a payload"
    return _stops(
        f"repeat ten of the poses with {a_second} of {mass:g} kg",
        replace(at, payload=np.full(len(at), mass)),
    )


def _farther(session: Session) -> Experiment | None:
    """New poses, each the farthest from those measured and those already chosen."""
    share = halton(_DRAWN, len(session.lower))
    box = session.lower + share * (session.upper - session.lower)
    box = box[session.usable(box)]
    if not len(box):
        return None
    nominal = session.mechanism.parameters.nominal
    place, measured = (
        session.mechanism.position(session.mechanism.forward(q, nominal))
        for q in (box, session.at.joint)
    )
    distance = cdist(place, measured).min(axis=1)
    chosen: list[int] = []
    for _ in range(min(_TEN + 2, len(box))):
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(place - place[chosen[-1]], axis=1))
    return _stops("measure poses farther out in the workspace", session.elsewhere(box[chosen]))


def _circles(session: Session) -> Experiment | None:
    """The largest circle within reach, at three speeds and in both directions."""
    mechanism, nominal = session.mechanism, session.mechanism.parameters.nominal
    middle = mechanism.forward(session.at.joint, nominal)[:, : mechanism.task_size].mean(axis=0)
    turn = np.linspace(0, 2 * np.pi, _ON_CIRCLE, endpoint=False)
    for radius in _RADII:
        task = np.tile(middle, (_ON_CIRCLE, 1))
        task[:, :2] += radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
        joint = mechanism.inverse(task, nominal)
        if session.usable(joint).all():
            ways = [(q, t / _ON_CIRCLE) for t in _ROUND for q in (joint, joint[::-1])]
            return Experiment(
                f"record circles of {1e3 * radius:.0f} mm at three speeds, both ways round",
                _moving(session, ways, closed=True),
            )
    return None


def _sweeps(session: Session) -> Experiment | None:
    """Each joint back and forth over its usable range, with the others at their median."""
    mechanism = session.mechanism
    if mechanism.joints != mechanism.task_size:  # none can be moved alone
        return None
    middle = np.median(session.at.joint, axis=0)
    step = _SWEEP_STEP * mechanism.joint_size
    ways = []
    for j in range(len(middle)):
        reach = np.arange(session.lower[j], session.upper[j], step)
        joint = np.tile(middle, (len(reach), 1))
        joint[:, j] = reach
        stuck = np.flatnonzero(~session.usable(joint))
        below, above = stuck[reach[stuck] < middle[j]], stuck[reach[stuck] >= middle[j]]
        there = joint[(below[-1] + 1 if below.size else 0) : (above[0] if above.size else None)]
        if len(there) > 2:
            ways += [(q, _SWEEP_STEP / _SWEEP_SPEED) for q in (there, there[::-1])]
    if not ways:
        return None
    return Experiment(
        "record a slow sweep of each joint over its range", _moving(session, ways, closed=False)
    )


def _moving(session: Session, ways: list[tuple[Array, float]], closed: bool) -> Samples:
    """Samples on paths, each given by its joint angles and time step [s]."""
    parts = [_motion(joint, step, closed) for joint, step in ways]
    joint = np.concatenate([joint for joint, _ in ways])
    velocity, acceleration = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    at = session.elsewhere(joint)
    at = replace(
        at,
        velocity=velocity,
        acceleration=acceleration,
        direction=np.where(velocity == 0, at.direction, np.sign(velocity)),
        travel=np.full(joint.shape, np.inf),
        time=np.full(len(joint), session.end + _STOP),
    )
    return Samples(at, np.repeat(np.arange(len(ways)), [len(joint) for joint, _ in ways]))


def _motion(joint: Array, step: float, closed: bool) -> tuple[Array, Array]:
    """Joint speeds and accelerations at even time steps along a path, (n, m) each."""
    if closed:
        after, before = np.roll(joint, -1, axis=0), np.roll(joint, 1, axis=0)
        return (after - before) / (2 * step), (after - 2 * joint + before) / step**2
    return np.gradient(joint, step, axis=0), np.zeros_like(joint)


def _warm(session: Session) -> Experiment:
    at = session.later(session.ten(), _HOUR)
    return _stops(
        "repeat ten of the poses after the machine has warmed by 10 K",
        replace(at, temperature=at.temperature + _WARMING),
    )


def _cooling(session: Session) -> Experiment:
    """Five poses every ten minutes while cooling, from at least 10 K above the session's begin."""
    rounds, reference = 6, session.ten(5)
    row = np.tile(np.arange(len(reference)), rounds)
    since = np.repeat(_HOUR / rounds * np.arange(rounds), len(reference))
    at = session.later(reference.take(row), 0.0)
    cold = session.at.temperature[0]
    warm = np.maximum(session.at.temperature[-1], cold + _WARMING)
    return _stops(
        "repeat five reference poses every ten minutes through an hour of cooling",
        replace(
            at,
            time=session.end + _STOP + since,
            temperature=cold + (warm - cold) * np.exp(-since / _COOLING)[:, None],
        ),
    )


_PROPOSALS: tuple[Callable[[Session], Experiment | None], ...] = (
    _again,
    _other_side,
    _payload,
    _farther,
    _circles,
    _sweeps,
    _warm,
    _cooling,
)
