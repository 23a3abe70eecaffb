"""Read the `printer.cfg` of a Delta printer under Klipper: geometry, probed and caliper data.

DELTA_CALIBRATE and DELTA_ANALYZE leave their measurements in the block that SAVE_CONFIG writes at
the end of the file: section `delta_calibrate`, `heightN` with `heightN_pos`, `manual_heightN`,
`distanceN` with `distanceN_pos1` and `distanceN_pos2`. Positions are steps of the three carriages
down from their endstops: they do not depend on the firmware's geometry parameters.
Source: Klipper's configuration reference, sections [printer] (delta kinematics), [stepper],
[delta_calibrate].
"""

from __future__ import annotations

from configparser import Error, RawConfigParser
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from delta_calibration.errors import InputError
from delta_calibration.files import MEGABYTE, read_bounded
from delta_calibration.texts import number_of

Array = NDArray[np.float64]

TOWERS = "abc"
_SAVED = "#*#"  # begins each line of the block that SAVE_CONFIG writes
_ANGLES = (210.0, 330.0, 90.0)  # [deg] where none are given
_STEPS = 200.0  # full steps per motor turn, if not given
_MOST = 999  # measurements of each kind at most
_INCLUDE = "include "
_MM = 1e-3


@dataclass(frozen=True)
class PrinterFile:
    """Geometry configured in the firmware, and the measurements.

    Joints are carriage positions in metres down from the endstops.
    """

    path: Path
    radius: float  # [m]
    angle: Array  # (3,) [rad] of the towers
    arm: Array  # (3,) [m]
    endstop: Array  # (3,) [m] height of the nozzle over the bed's centre at the endstop
    at_height: Array  # (n, 3) [m] joints at which the probe touched
    height: Array  # (n,) [m]
    one: Array  # (k, 3) [m] joints at one end of each distance
    other: Array  # (k, 3) [m] joints at the other end
    distance: Array  # (k,) [m]


def read_printer(path: Path) -> PrinterFile:
    """Read geometry and measurements from a printer.cfg.

    Raises:
        InputError: it cannot be read, is not of a Delta, or an entry is missing or no number;
            names section, entry, value and what is allowed.
    """
    entries = _Entries.of(path)
    kinematics = entries.text("printer", "kinematics")
    if kinematics != "delta":
        raise entries.refused("printer", "kinematics", kinematics, "delta")
    first = "stepper_a"
    arm = entries.number(first, "arm_length", above=0.0)
    endstop = entries.number(first, "position_endstop")
    steppers = [f"stepper_{tower}" for tower in TOWERS]
    step = np.array([_step(entries, stepper, first) for stepper in steppers])
    heights = [*_heights(entries, "manual_height"), *_heights(entries, "height")]
    distances = list(_distances(entries))
    if not heights and not distances:
        raise InputError(
            f"{path}: no measurements: run DELTA_CALIBRATE, and SAVE_CONFIG after it; "
            "[delta_calibrate] has no height0 and no distance0"
        )
    places = [
        np.array([p for p, _ in heights]),
        *(np.array([d[i] for d in distances]) for i in (0, 1)),
    ]
    at, one, other = (p.reshape(-1, len(TOWERS)) * step for p in places)
    return PrinterFile(
        path=path,
        radius=_MM * entries.number("printer", "delta_radius", above=0.0),
        angle=np.radians(
            [entries.number(s, "angle", a) for s, a in zip(steppers, _ANGLES, strict=True)]
        ),
        arm=_MM * np.array([entries.number(s, "arm_length", arm, above=0.0) for s in steppers]),
        endstop=_MM * np.array([entries.number(s, "position_endstop", endstop) for s in steppers]),
        at_height=at,
        height=_MM * np.array([h for _, h in heights]),
        one=one,
        other=other,
        distance=_MM * np.array([d[2] for d in distances]),
    )


def _step(entries: _Entries, stepper: str, first: str) -> float:
    """Travel of a carriage per microstep [m]."""

    def of(name: str, usual: float | None = None) -> float:
        section = stepper if entries.has(stepper, name) else first
        return entries.number(section, name, usual, above=0.0)

    turn = of("full_steps_per_rotation", _STEPS) * of("microsteps") * _ratio(entries, stepper)
    return _MM * of("rotation_distance") / turn


def _ratio(entries: _Entries, stepper: str) -> float:
    """Motor turns per pulley turn, from `80:16` or several such ratios separated by commas."""
    if not entries.has(stepper, "gear_ratio"):
        return 1.0
    said, ratio = entries.text(stepper, "gear_ratio"), 1.0
    for pair in said.split(","):
        numbers = [number_of(n) for n in pair.split(":")]
        if len(numbers) != 2 or not all(n > 0 for n in numbers):
            raise entries.refused(stepper, "gear_ratio", said, "such as 80:16")
        ratio *= numbers[0] / numbers[1]
    return ratio


def _heights(entries: _Entries, name: str) -> list[tuple[list[float], float]]:
    """Carriage steps and height [mm] of each probed point."""
    section, found = "delta_calibrate", []
    for i in range(_MOST):
        if not entries.has(section, f"{name}{i}"):
            break
        steps = entries.steps(section, f"{name}{i}_pos")
        found.append((steps, entries.number(section, f"{name}{i}")))
    return found


def _distances(entries: _Entries) -> list[tuple[list[float], list[float], float]]:
    """Carriage steps at both ends, and length [mm], of each distance."""
    section, found = "delta_calibrate", []
    for i in range(_MOST):
        name = f"distance{i}"
        if not entries.has(section, name):
            break
        ends = [entries.steps(section, f"{name}_pos{end}") for end in (1, 2)]
        found.append((ends[0], ends[1], entries.number(section, name, above=0.0)))
    return found


@dataclass(frozen=True)
class _Entries:
    """Sections of the file; entries written by SAVE_CONFIG replace those typed by the user."""

    path: Path
    parser: RawConfigParser

    @classmethod
    def of(cls, path: Path) -> _Entries:
        raw = read_bounded(path, MEGABYTE, InputError)
        lines = raw.decode("utf-8", errors="replace").splitlines()
        typed = [line for line in lines if not line.startswith(_SAVED)]
        saved = [line[len(_SAVED) :].strip() for line in lines if line.startswith(_SAVED)]
        marks = ("#", ";")
        parser = RawConfigParser(
            strict=False, comment_prefixes=marks, inline_comment_prefixes=marks
        )
        try:
            parser.read_string("\n".join(typed), str(path))
            parser.read_string("\n".join(n for n in saved if not n.startswith("<")), str(path))
        except Error as error:
            raise InputError(f"{path}: no printer.cfg: {' '.join(str(error).split())}") from error
        return cls(path, parser)

    def has(self, section: str, name: str) -> bool:
        return self.parser.has_option(section, name)

    def text(self, section: str, name: str) -> str:
        if not self.has(section, name):
            sections = (s for s in self.parser.sections() if s.startswith(_INCLUDE))
            further = [s.removeprefix(_INCLUDE) for s in sections]
            hint = f"; it may be in {', '.join(further)}, which is not read" if further else ""
            raise InputError(f"{self.path}: [{section}] {name} is missing{hint}")
        return self.parser.get(section, name).strip()

    def number(
        self, section: str, name: str, usual: float | None = None, above: float = -np.inf
    ) -> float:
        """Entry that is a finite number greater than `above`; `usual` if there is no entry."""
        if usual is not None and not self.has(section, name):
            return usual
        said = self.text(section, name)
        value = number_of(said)
        if not (np.isfinite(value) and value > above):
            allowed = f"a number above {above:g}" if np.isfinite(above) else "a number"
            raise self.refused(section, name, said, allowed)
        return value

    def steps(self, section: str, name: str) -> list[float]:
        """Entry of three step counts, one per carriage."""
        said = self.text(section, name)
        values = [number_of(n) for n in said.split(",")]
        if len(values) != len(TOWERS) or not np.isfinite(values).all():
            raise self.refused(section, name, said, "three numbers separated by commas")
        return values

    def refused(self, section: str, name: str, said: str, allowed: str) -> InputError:
        return InputError(f"{self.path}: [{section}] {name}: {said!r} is not allowed; {allowed}")
