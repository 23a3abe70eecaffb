"""Statements of a certificate on machine, instrument and conditions, not from the session."""

from __future__ import annotations

from calendar import monthrange
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

from delta_calibration.documents import check_document, load_schema, read_document
from delta_calibration.errors import ConfigError

NOT_STATED = "not stated"
STATED = (
    "tracker along the beam, its certificate",
    "tracker across the beam, its certificate",
    "reflector",
    "temperature",
)
_UM = 1e-6


@dataclass(frozen=True)
class About:
    """Statements as given by the user; missing ones appear as `not stated` on the page.

    Standard uncertainties are those of the instrument's and the thermometer's certificates. They
    are common to all readings, so averaging does not reduce them.
    """

    given: Mapping[str, Any] = field(default_factory=dict)

    def text(self, *keys: str) -> str:
        """Text of an entry, or `not stated`."""
        value = self._value(*keys)
        return NOT_STATED if value is None else str(value)

    def number(self, *keys: str) -> float | None:
        """Number of an entry; None if it was not given."""
        value = self._value(*keys)
        return None if value is None else float(value)

    def _value(self, *keys: str) -> Any:
        value: Any = self.given
        for key in keys:
            value = value.get(key) if isinstance(value, Mapping) else None
        return value

    @property
    def tolerance(self) -> float | None:
        """Tolerance of the 3-D error [m]; None if it was not given."""
        given = self.number("tolerance_mm")
        return None if given is None else 1e-3 * given

    @property
    def tracker(self) -> tuple[float, float]:
        """Common standard uncertainty of all its readings, along and across the beam [m]."""
        along, across = (self.number("instrument", f"u_{way}_um") for way in ("along", "across"))
        return _UM * (along or 0.0), _UM * (across or 0.0)

    @property
    def reflector(self) -> float:
        """Standard uncertainty of the reflector's centre about each axis [m]."""
        return _UM * (self.number("instrument", "u_reflector_um") or 0.0)

    @property
    def growth(self) -> float:
        """Relative standard uncertainty of lengths due to temperature [m/m]."""
        coefficient = self.number("machine", "expansion_um_per_m_k")
        kelvin = self.number("ambient", "u_temperature_k")
        return _UM * (coefficient or 0.0) * (kelvin or 0.0)

    def expired(self, start: date | None) -> str:
        """Warning if the instrument's certificate had expired at the measurement; else empty.

        Args:
            start: date of the session, if it has one.
        """
        until, stated = self._value("instrument", "valid_until"), self._value("measured_on")
        measured = start if stated is None else _days(stated)[1]
        if until is None or measured is None or measured <= _days(until)[1]:
            return ""
        return f"the certificate of the instrument was valid until {until}; measured on {measured}"

    @property
    def silent(self) -> tuple[str, ...]:
        """Contributions missing in the budget, because an entry was not stated."""
        return tuple(name for name, missing, _ in self._asked() if missing)

    @property
    def gaps(self) -> tuple[str, ...]:
        """The missing contributions for display; those stated in part with the missing entries."""
        return tuple(
            f"{name} ({' and '.join(missing)} missing)" if len(missing) < count else name
            for name, missing, count in self._asked()
            if missing
        )

    def _asked(self) -> Iterator[tuple[str, tuple[str, ...], int]]:
        """Name, missing entries and number of required entries of each stated contribution."""
        asked = (
            (("instrument", "u_along_um"),),
            (("instrument", "u_across_um"),),
            (("instrument", "u_reflector_um"),),
            (("ambient", "u_temperature_k"), ("machine", "expansion_um_per_m_k")),
        )
        for name, entries in zip(STATED, asked, strict=True):
            missing = tuple(".".join(keys) for keys in entries if self.number(*keys) is None)
            yield name, missing, len(entries)


def read_about(path: Path | None, options: Mapping[str, Any]) -> About:
    """Read statements from a file and from options, which override the file.

    Args:
        path: YAML file; None if there is none.
        options: values by entry, as in {"machine.serial": "17"}; None if not given.

    Raises:
        ConfigError: no such file, or an entry unknown or out of range; names file, entry, value.
    """
    schema = load_schema("about")
    data = {} if path is None else read_document(path, lambda _: schema)
    for name, value in options.items():
        if value is not None:
            data = _with(data, name.split("."), value)
    source = "options of the certificate" if path is None else str(path)
    check_document(data, schema, source)
    about = About(data)
    for keys in (("measured_on",), ("instrument", "valid_until")):
        _require_days(about.text(*keys), ".".join(keys), source)
    return about


def _require_days(text: str, entry: str, source: str) -> None:
    """Refuse a date that does not exist in the calendar.

    Raises:
        ConfigError: the date does not exist.
    """
    try:
        _days(text) if text != NOT_STATED else None
    except ValueError as error:
        raise ConfigError(f"{source}: {entry}: {text!r} is not a date of the calendar") from error


def _days(text: str) -> tuple[date, date]:
    """First and last day of a date or a month.

    Raises:
        ValueError: there is no such day.
    """
    year, month, *day = map(int, text.split("-"))
    last = monthrange(year, month)[1]
    return date(year, month, *(day or [1])), date(year, month, *(day or [last]))


def _with(data: Mapping[str, Any], keys: list[str], value: Any) -> dict[str, Any]:
    first, *rest = keys
    return {**data, first: _with(data.get(first, {}), rest, value) if rest else value}
