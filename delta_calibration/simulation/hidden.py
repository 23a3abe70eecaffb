"""Hidden errors of a machine beyond its scatter: causes by name, each with options.

A size is `value`, in SI, or `strength`, in typical sizes (those that the fit expects). The seed
draws all that is not given: phases of harmonics and the direction in which a tracker drifts, and
with a strength also signs and each joint's share; always within what a machine can have.
"""

from __future__ import annotations

import zlib
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.effects import EFFECTS, Effect, catalogue, effect_named
from delta_calibration.effects.base import SENSOR, Setting
from delta_calibration.errors import InputError
from delta_calibration.parameters import Parameter
from delta_calibration.robot import Robot
from delta_calibration.simulation.climate import PARTS
from delta_calibration.simulation.dimensions import (
    dimension_causes,
    dimensions,
    rows_of,
    shift_of,
)
from delta_calibration.simulation.options import (
    LOCATION,
    STRENGTH,
    VALUE,
    Options,
    number,
    require_known,
    require_one_of,
    sizes,
)

Array = NDArray[np.float64]
Causes = Mapping[str, Options] | Iterable[tuple[str, Options]]

_SHARE = (0.7, 1.3)  # range of a joint's share of the typical size


@dataclass(frozen=True)
class Hidden:
    """Shifts of a machine's dimensions, and effects in it."""

    shift: Array  # (p + 3,) of the mechanism's geometry and the reflector's place [m, rad]
    effects: tuple[Effect, ...]
    values: Array  # (k,) of the effects' parameters


def hideable_causes(robot: Robot, chain: Chain) -> tuple[str, ...]:
    """Causes that can be hidden in a machine."""
    effects = (e.cause for e in catalogue(robot, chain.mechanism) if not e.lacking)
    return tuple(dict.fromkeys((*dimension_causes(chain), *effects)))


def hide(robot: Robot, chain: Chain, causes: Causes, seed: int) -> Hidden:
    """Return shifts and effects of these causes, for a machine that `chain` has without them.

    Raises:
        InputError: an unknown cause or option, or a value that is not allowed.
    """
    shift = np.zeros(len(dimensions(chain)))
    found: dict[tuple[object, ...], tuple[Effect, Array]] = {}
    for cause, options in causes.items() if isinstance(causes, Mapping) else causes:
        before = sum(other.cause == cause for other, _ in found.values())
        key = [seed, 2, zlib.crc32(cause.encode())]
        options = _placed(robot, options)
        if cause not in EFFECTS:
            _require_place(robot, chain, cause, options)
            shift = shift + shift_of(chain, cause, options, np.random.default_rng(key))
            continue
        effect = _shaped(cause, robot, chain, options)
        shape = cause, *effect.settings.items()
        again = [before] if before and shape not in found else []  # not a multiple of the first
        values = _values(effect, options, np.random.default_rng(key + again))
        if shape in found:
            values = values + found[shape][1]
        elif before and not effect.repeats:
            raise InputError(f"effect {cause} is given twice, with different settings")
        _require_possible(effect, values)
        found[shape] = effect, values
    each = [values for _, values in found.values()]
    return Hidden(
        shift,
        tuple(effect.refined(values) for effect, values in found.values()),
        np.concatenate([np.zeros(0), *each]),
    )


def _placed(robot: Robot, options: Options) -> Options:
    """Return the options, their location converted from the robot file's name of a joint."""
    if LOCATION not in options:
        return options
    return {**options, LOCATION: robot.place(options[LOCATION])}


def _require_place(robot: Robot, chain: Chain, cause: str, options: Options) -> None:
    location = options.get(LOCATION)
    if rows_of(chain, cause, location):
        return
    where = f" at {location}" if location else ""
    places = ", ".join(dict.fromkeys(p.location for p in dimensions(chain) if p.location))
    raise InputError(
        f"effect {cause}{robot.named(where)} cannot be hidden; "
        f"causes: {', '.join(hideable_causes(robot, chain))}; locations: {robot.named(places)}"
    )


def _shaped(cause: str, robot: Robot, chain: Chain, options: Options) -> Effect:
    """Return the effect with the settings among the options, or with its usual settings."""
    plain = effect_named(cause, robot, chain.mechanism, {})
    if plain.lacking:
        raise InputError(f"effect {cause}: {plain.lacking}")
    # A setting that is an array cannot be an option: it goes with the values.
    own = {key: usual for key, usual in plain.settings.items() if not isinstance(usual, tuple)}
    require_one_of(cause, options, plain.one_of)
    given = {key: _setting(plain, key, own[key], options) for key in own if key in options}
    effect = effect_named(cause, robot, chain.mechanism, {**_usual_unless(plain, given), **given})
    places = [LOCATION] if any(p.location for p in effect.parameters) else []
    require_known(cause, options, (*places, VALUE, STRENGTH, *own))
    return effect


def _usual_unless(plain: Effect, given: Collection[str]) -> dict[str, Setting]:
    """Usual settings, except those that exclude a given one (`one_of`)."""
    either = plain.one_of if any(key in plain.one_of for key in given) else ()
    return {k: v for k, v in plain.usual(PARTS).items() if k not in either}


def _setting(effect: Effect, key: str, usual: Setting, options: Options) -> Setting:
    """Convert an option to a setting of the type of its usual value.

    Raises:
        InputError: not a number, a number out of range, or a sensor that the cell does not have.
    """
    cause, text = effect.cause, options[key]
    if isinstance(usual, str):
        if key == SENSOR and text not in PARTS:
            raise InputError(f"effect {cause}: no {key} {text!r}; allowed: {', '.join(PARTS)}")
        return text
    value = number(cause, key, options, "")
    low, high = effect.limits.get(key, (0.0, np.inf))
    least_of_all = low if low == -high else 0.0  # one to either side; else below 0 stands for none
    if value < least_of_all or (value == 0 and low > 0):
        least = "more than 0" if low > 0 else f"{least_of_all:g} or more"
        raise InputError(f"effect {cause}: {key} {text} is not allowed; {least}")
    return value


def _values(effect: Effect, options: Options, rng: np.random.Generator) -> Array:
    """Draw the values of the effect's parameters, (k,)."""
    parameters = effect.parameters
    unit = effect.told_unit(parameters.items[0])
    size = sizes(effect.cause, options, parameters.prior, 1.0, unit)
    # All is drawn, needed or not, so that a location or a value does not change the rest.
    share, sign = rng.uniform(*_SHARE, len(size)), rng.choice([-1.0, 1.0], len(size))
    _, vector = np.unique([_vector(p) for p in parameters], return_inverse=True)
    size = size * _ways(vector, rng.standard_normal(len(size)))
    if VALUE not in options:
        own = np.array([p.location is not None for p in parameters])
        signed = np.array([_signed(effect, p) for p in parameters])
        size = size * np.where(own, share[vector], 1.0) * np.where(signed, sign, 1.0)
    location = options.get(LOCATION)
    here = np.array([location in (None, p.location) for p in parameters])
    if not here.any():
        places = ", ".join(dict.fromkeys(p.location for p in parameters if p.location))
        text = f"no location {location!r}; allowed: {places}"
        raise InputError(f"effect {effect.cause}: {effect.robot.named(text)}")
    return np.where(here, size, 0.0)


def _vector(parameter: Parameter) -> str:
    """Name of the vector (harmonic, shift) that a parameter is part of, else its own name."""
    stem, _, end = parameter.name.rpartition("_")
    if stem.endswith("sine"):
        return f"{stem.removesuffix('cosine').removesuffix('sine')}harmonic_{end}"
    return stem if end in ("x", "y", "z") else parameter.name


def _ways(vector: NDArray[np.intp], drawn: Array) -> Array:
    """Components of unit vectors in random directions, 1 for a vector of one component, (k,).

    Args:
        vector: number of the vector that each of k parameters is a part of, (k,).
        drawn: from the normal distribution, (k,).
    """
    length = np.sqrt(np.bincount(vector, drawn**2))[vector]
    return np.where(np.bincount(vector)[vector] > 1, drawn / length, 1.0)


def _signed(effect: Effect, parameter: Parameter) -> bool:
    """Whether a parameter may also be negative."""
    return parameter.lower < 0 and effect.either_sign


def _require_possible(effect: Effect, values: Array) -> None:
    for p, value in zip(effect.parameters, values.tolist(), strict=True):
        if not p.lower <= value <= p.upper:
            told = effect.told_unit(p)
            unit = "" if told == "1" else f" {told}"
            raise InputError(
                f"effect {effect.cause}: {p.name} = {value:g}{unit} is not possible; "
                f"allowed: {p.lower:g} to {p.upper:g}"
            )
