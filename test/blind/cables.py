"""Causes hidden in cables, pulleys and drums, in addition to those of any drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.drives import Drive, drives_of
from blind.measurement import timestamp_latency, tracker_drift, tracker_scale
from blind.shared import dimension, in_no_catalogue
from blind.winches import CDPR8
from blind.world import State, World

Array = NDArray[np.float64]

_STRETCH = 1 / 4e5  # [1/N] of steel cables
_WEIGHT = 0.6  # [N/m] of a steel cable of 4 mm
_PULLEY = 20e-3  # [m]
_DRUM = 1e-3
_LOST = 0.15  # share of the pretension
_LAYER = 30e-6  # [m^2/m]
_HOMED = 0.5e-3  # [m]
_RUN_OUT = 0.15e-3  # [m] of a drum's groove


def _lets_out(state: State, more: Array) -> None:
    """Add cable length, (n, 8) [m]."""
    state.changed = state.changed.plus("cable", more)


def _here_and_home(world: World) -> tuple[Array, Array, Array, Array]:
    """Cables as vectors and their tensions, in each sample and at home without payload."""
    build, stand, home = world.build, world.stand, CDPR8.home[None]
    here = CDPR8.away(np.append(stand.place, stand.gibbs, axis=1), build)
    at_home = CDPR8.tensions(home, build, np.zeros(1), CDPR8.centre)
    return here, world.pulls(CDPR8.nothing()), CDPR8.away(home, build), at_home


def cable_elasticity(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Cables stretch under their tension; the drum lets out the unstretched length."""
    give = strength * _STRETCH

    def act(world: World, state: State) -> None:
        _, pull, home, pull_home = _here_and_home(world)
        at_home, let_out = np.linalg.norm(home, axis=2), world.build.gain * world.command
        free = at_home / (1 + give * pull_home) + let_out
        _lets_out(state, free * (1 + give * pull) - at_home - let_out)

    return Cause("cable_elasticity", act, {"give": give})


def pretension_loss(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """The drives lose pretension: tensions change, and the cables stretch less."""
    share, constant = strength * _LOST, rng.uniform(1200.0, 4000.0)

    def act(world: World, state: State) -> None:
        x = np.append(world.stand.place, world.stand.gibbs, axis=1)
        left = CDPR8.pretension * (1 + share * np.expm1(-world.time / constant))
        now, before = (
            CDPR8.tensions(x, world.build, world.payload, CDPR8.centre, kept)
            for kept in (np.tile(left[:, None], 8), None)
        )
        free = np.linalg.norm(CDPR8.away(x, world.build), axis=2) / (1 + _STRETCH * before)
        _lets_out(state, _STRETCH * (now - before) * free)

    strain = share * CDPR8.pretension * _STRETCH
    return Cause("pretension_loss", act, {"strain": strain, "constant": constant})


def _arc(away: Array, pull: Array, weight: float) -> Array:
    """Length of a cable that hangs as a parabola between its ends, by a separate quadrature."""
    level = np.hypot(away[..., 0], away[..., 1])
    chord = np.linalg.norm(away, axis=-1)
    bend = weight * chord**2 / (pull * level)  # difference of the slope from end to end
    nodes, shares = np.polynomial.legendre.leggauss(8)
    total = np.zeros_like(chord)
    for node, share in zip(nodes, shares, strict=True):
        slope = away[..., 2] / level + bend * node / 2
        total = total + share / 2 * level * np.sqrt(1 + slope**2)
    return total


def cable_sag(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Cables sag under their own weight: their arcs are longer than their chords."""
    weight = np.sqrt(strength) * _WEIGHT

    def act(world: World, state: State) -> None:
        here, pull, home, pull_home = _here_and_home(world)
        more = _arc(here, pull, weight) - np.linalg.norm(here, axis=2)
        less = _arc(home, pull_home, weight) - np.linalg.norm(home, axis=2)
        _lets_out(state, less - more)

    return Cause("cable_sag", act, {"weight_squared": weight**2})


def over_pulley(away: Array, radius: float, rising: Array) -> Array:
    """Cable from the swivel axis round the groove and straight to the platform joint [m].

    In the pulley's plane the cable leaves tangentially: there the line from the groove is at right
    angles to the radius. A cable that comes from above is the mirror image of one that rises.
    """
    level = np.hypot(away[..., 0], away[..., 1]) - radius
    above = np.where(rising, away[..., 2], -away[..., 2])
    far = np.hypot(level, above)
    free = np.sqrt(far**2 - radius**2)
    towards = np.arctan2(above, level)  # angle of the joint seen from the pulley's centre
    leaves = towards + np.arccos(radius / far)
    return radius * (np.pi - leaves) + free


def off_pulley(away: Array, radius: float, rising: Array) -> Array:
    """Unit vectors along the straight part of the same cables, from groove to platform joint.

    By the right triangle of groove, centre and joint: its length and the radius give the angle.
    """
    across = np.hypot(away[..., 0], away[..., 1])
    sign = np.where(rising, 1.0, -1.0)
    level, above = across - radius, sign * away[..., 2]
    up = np.arctan2(above, level) - np.arcsin(radius / np.hypot(level, above))
    outward = np.cos(up) / across
    return np.stack([outward * away[..., 0], outward * away[..., 1], sign * np.sin(up)], axis=-1)


def pulley_radius(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Cables run over swivelling pulleys that the controller models as points.

    To the pulleys above the platform, and to those below it, they come from either side.
    """
    radius = strength * _PULLEY
    high, low = (rng.random(2) < 0.5).tolist()

    def act(world: World, state: State) -> None:
        here, _, home, _ = _here_and_home(world)
        rising = np.where(home[..., 2] > 0, low, high)
        more = over_pulley(here, radius, rising) - np.linalg.norm(here, axis=2)
        less = over_pulley(home, radius, rising) - np.linalg.norm(home, axis=2)
        _lets_out(state, less - more)
        straight = here / np.linalg.norm(here, axis=2, keepdims=True)
        turned = off_pulley(here, radius, rising) - straight
        state.changed = state.changed.plus("direction", turned)

    return Cause("pulley_radius", act, {"radius": radius, "rise": (high, low)})


def drum_build_up(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Cable lies over cable: the squared radius decreases in proportion to the cable let out."""
    layer = strength * _LAYER

    def act(world: World, state: State) -> None:
        radius = CDPR8.gain * CDPR8.gear
        drum = world.command / CDPR8.gear
        # d(r^2) = -layer d(out), d(out) = r d(drum): r decreases linearly with the angle.
        out = radius * drum - layer * drum**2 / 4
        _lets_out(state, out - radius * drum)

    return Cause("drum_build_up", act, {"build_up": layer})


def drum_eccentricity(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A drum turns about a point beside the middle of its groove.

    The point where the cable comes off moves along the cable as the groove's middle does.
    """
    out, start = strength * _RUN_OUT, rng.uniform(-np.pi, np.pi)
    drum = int(rng.choice(np.flatnonzero(legs)))

    def act(world: World, state: State) -> None:
        turn = world.command[:, drum] / CDPR8.gear[drum]
        more = np.zeros_like(world.command)
        more[:, drum] = out * (np.sin(start + turn) - np.sin(start))
        _lets_out(state, more)

    values = {f"sine_{drum + 1}": out * np.cos(start), f"cosine_{drum + 1}": out * np.sin(start)}
    return Cause("drum_eccentricity", act, values, location=f"cable_{drum + 1}")


def counter_zero_offset(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Winches were homed with their cables a little longer or shorter than at home."""
    size = rng.uniform(0.3, 1.0, CDPR8.gain.shape) * rng.choice([-1.0, 1.0], CDPR8.gain.shape)
    off = np.where(legs, strength * _HOMED * size, 0.0)

    def act(world: World, state: State) -> None:
        _lets_out(state, np.tile(off, (len(world.command), 1)))

    return Cause("counter_zero_offset", act)


def winch_causes() -> tuple[dict[str, Draw], dict[str, Draw]]:
    """Causes that can be hidden in a cable robot by name, and kinds that are in no catalogue."""
    geared = ("backlash", "stick_slip", "joint_lag", "encoder_eccentricity", "joint_zero_drift")
    drives = drives_of(Drive(CDPR8.size), *geared)

    def wrong(name: str, part: str, typical: float) -> Draw:
        where = {i + 1: [(part, (i, axis)) for axis in range(3)] for i in range(8)}
        return dimension(name, "cable", typical, where)

    drums = {i + 1: [("gain", (i,))] for i in range(8)}
    return {
        "timestamp_latency": timestamp_latency,
        "tracker_drift": tracker_drift,
        "tracker_scale": tracker_scale,
        **drives,
        "cable_elasticity": cable_elasticity,
        "cable_sag": cable_sag,
        "pulley_radius": pulley_radius,
        "drum_build_up": drum_build_up,
        "drum_eccentricity": drum_eccentricity,
        "counter_zero_offset": counter_zero_offset,
        "pretension_loss": pretension_loss,
        "base_joint_position": wrong("base_joint_position", "anchor", 10e-3),
        "platform_joint_position": wrong("platform_joint_position", "joint", 3e-3),
        "drum_scale": dimension("drum_scale", "cable", _DRUM * float(CDPR8.gain[0]), drums),
    }, in_no_catalogue(CDPR8)
