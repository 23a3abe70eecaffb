"""A large error of one dimension of one chain."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
from numpy.typing import NDArray

from blind.cause import Cause, Draw
from blind.machine import SIDES, Build, manufactured

Array = NDArray[np.float64]

# (build, leg, size) -> build
Wrong = Callable[[Build, int, float], Build]


def _at(build: Build, part: str, where: tuple[int, ...], size: float) -> Build:
    values = getattr(build, part).copy()
    values[where] += size
    return replace(build, **{part: values})


def _mismatched(build: Build, leg: int, size: float) -> Build:
    rod = build.rod.copy()
    rod[leg] += SIDES * size / 2
    return replace(build, rod=rod)


# Cause -> parameters it may affect, each with its typical size [rad], [m].
_ONE: dict[str, dict[str, tuple[float, Wrong]]] = {
    "joint_zero_offset": {"zero": (1e-3, lambda b, k, s: _at(b, "zero", (k,), s))},
    "arm_length": {"arm": (0.2e-3, lambda b, k, s: _at(b, "arm", (k,), s))},
    "forearm_length": {"rod": (0.2e-3, lambda b, k, s: _at(b, "rod", (k,), s))},
    "base_joint_position": {
        "radial": (0.3e-3, lambda b, k, s: _at(b, "hinge", (k, 0), s)),
        "tangential": (0.3e-3, lambda b, k, s: _at(b, "hinge", (k, 1), s)),
        "height": (0.3e-3, lambda b, k, s: _at(b, "hinge", (k, 2), s)),
    },
    "base_joint_tilt": {
        "about_radius": (1e-3, lambda b, k, s: _at(b, "tilt", (k, 0), s)),
        "about_height": (1e-3, lambda b, k, s: _at(b, "tilt", (k, 2), s)),
    },
    "parallelogram_mismatch": {"mismatch": (0.1e-3, _mismatched)},
}


def _draw(name: str) -> Draw:
    def draw(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
        leg = int(rng.choice(np.flatnonzero(legs)))
        part = str(rng.choice(list(_ONE[name])))
        typical, wrong = _ONE[name][part]
        size = float(strength * typical * rng.choice([-1.0, 1.0]))
        return Cause(
            name,
            values={f"{part}_{leg + 1}": size},
            location=f"joint_{leg + 1}",
            rebuild=lambda build: wrong(build, leg, size),
        )

    return draw


def _all_over(rng: np.random.Generator, strength: float, legs: Array) -> Cause:
    """Another machine's manufacturing errors in addition: many, none of them dominant."""
    more, exact = manufactured(rng, strength), manufactured(rng, 0.0)

    def rebuild(build: Build) -> Build:
        parts = [part.name for part in fields(Build)]
        return replace(
            build,
            **{p: getattr(build, p) + getattr(more, p) - getattr(exact, p) for p in parts},
        )

    return Cause("geometry", values={"scatter": strength}, rebuild=rebuild)


GEOMETRY: dict[str, Draw] = {name: _draw(name) for name in _ONE} | {"geometry": _all_over}
