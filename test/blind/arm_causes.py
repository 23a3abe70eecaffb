"""Causes hidden in arms: compliant gears and tools, thermal growth, causes of any drive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from blind.arm import Arm
from blind.cause import Cause, Draw, of_legs
from blind.drives import Drive, drives_of, encoder_interpolation, uneven
from blind.measurement import timestamp_latency, tracker_drift, tracker_scale
from blind.shared import dimension, in_no_catalogue
from blind.weight import GRAVITY
from blind.world import State, World

Array = NDArray[np.float64]

_EXPANSION = 23e-6  # [1/K] aluminium
_GIVE = 1 / 2.5e4  # [rad/(N m)]
_SCREWS = 1e7  # [N/m] of all screws that hold a tool


def _reducers(name: str) -> Draw:
    def draw(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        """Each reducer is a spring, loaded by weight and by inertia."""
        give = strength * _GIVE * uneven(rng, legs)

        def act(world: World, state: State) -> None:
            state.joint -= give * world.moments(state.changed)

        return Cause(name, act, of_legs("give", give))

    return draw


def thermal_growth_link(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """All links and the tool grow as they warm."""
    expansion = strength * _EXPANSION

    def act(world: World, state: State) -> None:
        warm = world.warming.of("link", world.time)
        longer = warm[:, None, None] * expansion * world.build.link
        state.changed = state.changed.plus("link", longer)

    return Cause("thermal_growth_link", act, {"expansion": expansion})


def flange_compliance(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """A tool on six springs, its screws, loaded by weight and inertia of the payload.

    The springs lie on a circle behind the tool. The displacement of the tool strains them, and
    their forces must balance the payload.
    """
    behind, ring = rng.uniform(0.1, 0.25), rng.uniform(0.05, 0.075)  # [m]
    one = _SCREWS / 6 / strength  # [N/m]
    angle = np.pi / 3 * np.arange(6)
    screws = np.stack([ring * np.cos(angle), ring * np.sin(angle), np.full(6, -behind)], axis=1)

    def act(world: World, state: State) -> None:
        stand, kind = world.stand, world.kind
        forces = np.zeros((len(world.time), 3))
        forces[:, 2] = -GRAVITY * world.payload
        forces += world.payload_pushes()
        out = screws @ np.swapaxes(stand.turn, 1, 2)  # (n, 6, 3) from the tool's position
        lever = np.broadcast_to(kind.centre @ np.swapaxes(stand.turn, 1, 2), forces.shape)
        strain = np.zeros((len(forces), 6, 3, 6))  # of each spring by motions of the tool
        for way, unit in enumerate(np.eye(3)):
            strain[..., way] = unit
            strain[..., 3 + way] = np.cross(unit, out)
        each = strain.reshape(len(forces), 18, 6)
        stiff = one * np.swapaxes(each, 1, 2) @ each
        load = np.concatenate([forces, np.cross(lever, forces)], axis=1)
        gives = np.linalg.solve(stiff, load[..., None])[..., 0]
        bare = stand.turn @ kind.mounted.T  # rotation of the last link from zero
        shift = np.zeros((len(forces), len(kind.links), 3))
        shift[:, -1] = (np.swapaxes(bare, 1, 2) @ gives[:, :3, None])[..., 0]
        state.changed = state.changed.plus("link", shift).plus("tool", gives[:, 3:])

    known = {"shift": strength / _SCREWS, "turn": 2 * strength / _SCREWS / ring**2}
    return Cause("flange_compliance", act, known | {"behind": behind})


def arm_causes(kind: Arm) -> tuple[dict[str, Draw], dict[str, Draw]]:
    """Causes that can be hidden in an arm by name, and kinds that are in no catalogue."""
    m = len(kind.joints)
    long = [int(np.argmax(np.abs(link))) for link in kind.links]
    # An error before a joint's line is reported at that joint; the last ones belong to the tool
    # too.
    lengths = {i + 1: [("link", (i, long[i]))] for i in kind.lengths}
    zeros = {i + 1: [("zero", (i,))] for i in range(1, max(2, m - 1))}
    return {
        "timestamp_latency": timestamp_latency,
        "tracker_drift": tracker_drift,
        "tracker_scale": tracker_scale,
        **drives_of(
            Drive(gears=kind.gears),
            "backlash",
            "stick_slip",
            "joint_lag",
            "encoder_eccentricity",
            "transmission_error",
            "joint_scale",
            "joint_zero_drift",
        ),
        "reducer_compliance" if m == 2 else "gravity_sag": _reducers(
            "reducer_compliance" if m == 2 else "gravity_sag"
        ),
        "thermal_growth_link": thermal_growth_link,
        "flange_compliance": flange_compliance,
        "encoder_interpolation": encoder_interpolation,
        "joint_zero_offset": dimension("joint_zero_offset", "joint", 1e-3, zeros),
        "link_length": dimension("link_length", "joint", 0.5e-3, lengths),
    }, in_no_catalogue(kind)
