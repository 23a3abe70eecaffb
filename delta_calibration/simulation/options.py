"""Options of a hidden cause, as text: `NAME:key=value,key=value`."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.texts import number_of

Array = NDArray[np.float64]
Options = Mapping[str, str]

_MOST = 1e9  # largest allowed setting of an effect, in SI units
VALUE, STRENGTH, LOCATION = "value", "strength", "location"


def effect_options(text: str) -> tuple[str, dict[str, str]]:
    """Split `NAME:k=v,k=v` into a name and its options.

    Raises:
        InputError: text of another form.
    """
    name, _, rest = text.partition(":")
    options: dict[str, str] = {}
    for part in filter(None, rest.split(",")):
        key, equals, value = part.partition("=")
        if not equals or not key or not value:
            raise InputError(f"effect {text}: {part!r} is not of the form key=value")
        if key in options:
            raise InputError(f"effect {text}: {key} is given twice")
        options[key] = value
    return name, options


def require_known(cause: str, options: Options, allowed: Collection[str]) -> None:
    """Refuse options that a cause does not have.

    Raises:
        InputError: names them and what is allowed.
    """
    unknown = sorted(set(options) - set(allowed))
    if unknown:
        raise InputError(
            f"effect {cause}: unknown option {', '.join(unknown)}; allowed: {', '.join(allowed)}"
        )


def require_one_of(cause: str, options: Options, either: Collection[str]) -> None:
    """Refuse options that say the same thing twice.

    Raises:
        InputError: names those that were given.
    """
    given = [key for key in options if key in either]
    if len(given) > 1:
        raise InputError(f"effect {cause}: only one of {', '.join(given)} can be given")


def number(cause: str, key: str, options: Options, unit: str) -> float:
    """Return an option as a number.

    Raises:
        InputError: not a finite number, or larger than any setting can be.
    """
    value, said = number_of(options[key]), f" (SI: {unit})" if unit else ""
    if np.isnan(value):
        raise InputError(f"effect {cause}: {key} {options[key]!r} is not a finite number{said}")
    if abs(value) > _MOST:
        raise InputError(
            f"effect {cause}: {key} {options[key]} is not allowed; "
            f"allowed: {-_MOST:g} to {_MOST:g}{said}"
        )
    return value


def sizes(cause: str, options: Options, typical: Array, usual: float, unit: str) -> Array:
    """Sizes of k parameters with these typical sizes, (k,).

    With `value` the first parameter has that value, the others in proportion to their typical
    sizes; with `strength` each has so many times its typical size, `usual` times by default.

    Raises:
        InputError: not a finite number, or both given.
    """
    require_one_of(cause, options, (VALUE, STRENGTH))
    if VALUE in options:
        return np.asarray(number(cause, VALUE, options, unit) * (typical / typical[0]))
    times = number(cause, STRENGTH, options, "") if STRENGTH in options else usual
    return np.asarray(times * typical)
