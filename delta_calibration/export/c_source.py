"""Print an identified machine as a C99 header and source: the compiled path of single commands.

The C code has the same laws as the package (c_laws.py), the same compiled loops that call them
(c_loops.py), and the records that these use (c_numbers.py). `templates/machine.c` has the public
functions.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from importlib import resources
from string import Template
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from delta_calibration import __version__
from delta_calibration.calibration import Calibration
from delta_calibration.compensation import JointCompensator, command_kernel
from delta_calibration.compensation.compensator import SingleCommand
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import Effect
from delta_calibration.effects.base import law_for
from delta_calibration.effects.signals import (
    ACCELERATION,
    CENTRE,
    DIRECTION,
    JOINT,
    PAYLOAD,
    RATE,
    TEMPERATURE,
    TIME,
    TRAVEL,
    Places,
)
from delta_calibration.errors import ConfigError
from delta_calibration.export import c_loops
from delta_calibration.export.c_laws import law_in_c
from delta_calibration.export.c_numbers import constant, placed
from delta_calibration.model import kernels, stand
from delta_calibration.model.law import Law

FIRST = "first"  # name for the part whose temperature a session recorded first

_COMMANDED = 4  # number of scalar results of a command
_PUBLIC = (
    "correct",
    "correct_begin",
    "correct_in",
    "conditions",
    "conditions_at_rest",
)
_MACROS = (
    "JOINTS",
    "TEMPERATURES",
    "ROOM",
    "PASSED",
    "NOT_FINITE",
    "JOINT_LIMIT",
    "OUT_OF_REACH",
    "OUTSIDE_REGION",
    "SINGULAR",
    "SLACK",
    "NOT_REACHED",
    "MISSING_CONDITION",
)


@dataclass(frozen=True)
class CFiles:
    """A C header and source, and the parts whose temperatures are in its conditions, in order."""

    header: str
    source: str
    parts: tuple[str, ...]


class _Given(NamedTuple):
    """Indices of conditions in a row of signals, and which are needed: `Given` of machine.c."""

    size_drawn: int
    size_own: int
    joint: int
    rate: int
    acceleration: int
    direction: int
    travel: int
    payload: int
    centre: int
    time: int
    temperature: int
    temperatures: int
    needs_payload: bool
    needs_centre: bool
    needs_temperature: NDArray[np.int64]  # indices among the temperatures
    moment: float  # [s] end of the session: the time of effects by its clock


def c_files(calibration: Calibration, stem: str, prefix: str = "") -> CFiles:
    """Print the machine of a calibration as C.

    Args:
        calibration: calibration to print.
        stem: file name without suffix; the source includes the header by it.
        prefix: text before every public name, so that one program can contain two machines.

    Raises:
        ConfigError: an effect needs what the robot file does not state, or a law has to be
            generated first, and CasADi is not installed.
    """
    effects = tuple(effect for effect, _ in calibration.live)
    for effect in effects:
        if effect.lacking:
            raise ConfigError(f"effect {effect.cause}: {effect.lacking}")
    parts = parts_of(effects)
    single = JointCompensator(calibration).single_command(parts)
    loaded = tuple(single.own.compiled.stages.loaded.tolist())
    names, laws = _laws(calibration, effects, single.own.places, loaded)
    given = _given(calibration, effects, single.drawn.places, single.own.places)
    numbers = [
        constant("MachineRecord", "drawn", single.drawn.compiled, names),
        constant("MachineRecord", "own", single.own.compiled, names),
        constant("Guards", "guards", single.guards, names),
        constant("Search", "search", single.search, names),
        constant("Given", "given", given, names),
    ]
    lines, size = placed("(*scratch)", single.room)
    aimed = single.own.aim.size
    room = size + given.size_own + aimed + _joints(calibration) + _COMMANDED
    header = _header(calibration, effects, parts, stem, prefix, room)
    front = [f'#include "{stem}.h"', *_renamed(prefix), ""]
    body = _template("machine.c")
    for mark, text in {
        "TYPES": f"{c_loops.TYPES}\n{_structures(single)}",
        "MACHINE": "\n".join([laws, *numbers]),
        "CHAIN": f"#define CONSTANTS_AT {kernels.C}\n#define TARGET {aimed}\n\n{_chain(single)}",
        "PLACES": "\n".join([*lines, f"    return next + {size};"]),
    }.items():
        body = body.replace(f"/* @{mark}@ */\n", f"{text}\n")
    return CFiles(header, "\n".join([_banner(header), *front, body]), parts)


def _structures(single: SingleCommand) -> str:
    """C structures of the records that the chain uses."""
    known = single.own.compiled, single.guards, single.search
    kinds = [*map(c_loops.kind_of, known), c_loops.kind_of(single.room, scratch=True)]
    return c_loops.structures(kinds)


def _chain(single: SingleCommand) -> str:
    """Print the compiled loops from commands to corrections, and the set-up of a machine, as C.

    In C, a law has its derivatives by the joints only at the stage with all derivatives.
    """
    of_machine = c_loops.kind_of(single.own.compiled)
    kinds = (
        of_machine,
        of_machine,
        c_loops.kind_of(single.guards),
        c_loops.kind_of(single.search),
        c_loops.NUMBERS,
        c_loops.NUMBERS,
        c_loops.REAL,
        c_loops.NUMBERS,
        c_loops.INT,
        *3 * (c_loops.ROWS,),
        c_loops.kind_of(single.room, scratch=True),
    )
    program = c_loops.Program({"BESIDE": kernels.FULL})
    program.add(command_kernel.commanded, kinds)
    of_state = c_loops.kind_of(single.room.own.state, scratch=True)
    program.add(stand.take_dimensions, (of_machine.fields["body"], c_loops.NUMBERS, of_state))
    return program.text


def parts_of(effects: Collection[Effect]) -> tuple[str, ...]:
    """Parts whose temperatures the effects use, in order.

    A smooth map over temperature uses that of the part that its session recorded first.
    """
    sensors = [part for effect in effects for part in effect.sensors]
    maps = [FIRST] if any(TEMPERATURE in effect.takes for effect in effects) else []
    return tuple(dict.fromkeys([*maps, *sensors]))


def _laws(
    calibration: Calibration,
    effects: Collection[Effect],
    places: Places,
    loaded: tuple[int, ...],
) -> tuple[dict[int, str], str]:
    """Names, by address, and text of the C functions of all laws that a command uses."""
    names: dict[int, str] = {}
    texts = []
    for law in dict.fromkeys(_every_law(calibration, effects, places)):
        own, text = law_in_c(law, ("x", "q"), loaded)
        texts += [text] if own.keys() - names.keys() else []
        names |= own
    return names, "\n".join(texts)


def _every_law(
    calibration: Calibration, effects: Collection[Effect], places: Places
) -> Iterator[Law]:
    """Yield the laws of the commanded machine, of the identified one, and of its effects."""
    for mechanism in (calibration.robot.commanded, calibration.chain.mechanism):
        yield from mechanism.laws_forward
    for effect in effects:
        term = next(effect.terms(places), None)
        if term is not None:
            yield law_for(effect, term)


def _given(
    calibration: Calibration, effects: Collection[Effect], drawn: Places, own: Places
) -> _Given:
    parts = own.parts
    warm = [i for i, part in enumerate(parts) if _needs(calibration, effects, parts, part)]
    return _Given(
        size_drawn=drawn.size,
        size_own=own.size,
        joint=own.begin(JOINT),
        rate=own.begin(RATE),
        acceleration=own.begin(ACCELERATION),
        direction=own.begin(DIRECTION),
        travel=own.begin(TRAVEL),
        payload=own.begin(PAYLOAD),
        centre=own.begin(CENTRE),
        time=own.begin(TIME),
        temperature=own.begin(TEMPERATURE),
        temperatures=len(parts),
        needs_payload=_needs(calibration, effects, parts, PAYLOAD),
        needs_centre=_needs(calibration, effects, parts, CENTRE),
        needs_temperature=np.array(warm, dtype=np.int64),
        moment=calibration.ended or 0.0,
    )


def _needs(
    calibration: Calibration, effects: Collection[Effect], parts: tuple[str, ...], what: str
) -> bool:
    """Whether an effect cannot be evaluated if this condition alone is unknown."""
    at = _all_known(calibration.robot.commanded.home[None], parts)
    if what == PAYLOAD:
        at = replace(at, payload=np.full(1, np.nan))
    elif what == CENTRE:
        at = replace(at, payload_centre=np.full((1, 3), np.nan))
    else:
        known = [np.nan if part == what else 20.0 for part in parts]
        at = replace(at, temperature=np.array([known]))
    return any(effect.missing(at) for effect in effects)


def _all_known(q: NDArray[np.float64], parts: tuple[str, ...]) -> Conditions:
    return replace(
        at_rest(q),
        direction=np.ones_like(q),
        payload=np.zeros(1),
        payload_centre=np.zeros((1, 3)),
        temperature_parts=parts,
        temperature=np.full((1, len(parts)), 20.0),
    )


def _joints(calibration: Calibration) -> int:
    return len(calibration.robot.joints.names)


def _header(
    calibration: Calibration,
    effects: Collection[Effect],
    parts: tuple[str, ...],
    stem: str,
    prefix: str,
    room: int,
) -> str:
    robot, macro = calibration.robot, prefix.upper()
    celsius = "".join(f" {i}: {part}" for i, part in enumerate(parts))
    limits = zip(robot.joints.names, robot.joints.lower, robot.joints.upper, strict=True)
    return Template(_template("machine.h")).substitute(
        file=_plain(f"{stem}.h"),
        robot=robot.name,
        version=__version__,
        robot_hash=robot.hash,
        calibration_hash=calibration.seal,
        session=_plain(calibration.source),
        mechanism=calibration.chain.mechanism.name,
        commanded=robot.commanded.name,
        effects=", ".join(dict.fromkeys(effect.cause for effect in effects)) or "none",
        left_out=", ".join(calibration.left_out) or "nothing",
        joints="\n".join(
            f" *   {i}  {_plain(name)}, {low:.6g} to {high:.6g}"
            for i, (name, low, high) in enumerate(limits)
        ),
        unit=robot.joints.unit,
        count=_joints(calibration),
        temperatures=len(parts),
        temperature=f"    double temperature[{len(parts)}];  /* [deg C] of{_plain(celsius)} */\n"
        if parts
        else "",
        room=room,
        guard=f"{macro}CORRECT_H",
        macro=macro,
        prefix=prefix,
    )


def _plain(text: str) -> str:
    """Remove from a text what would end a line or a comment in C."""
    line = "".join(c if c.isprintable() else " " for c in text)
    return line.replace("*/", "* /").replace("/*", "/ *").replace("??", "? ?")


def _banner(header: str) -> str:
    """The opening comment of the header, with the name of the source."""
    return header[: header.index("*/") + 2].replace(".h:", ".c:", 1)


def _renamed(prefix: str) -> list[str]:
    """Macros that rename the public names of machine.c to those of the header."""
    if not prefix:
        return []
    macros = [f"CORRECT_{name}" for name in _MACROS]
    lines = [f"#define {name} {prefix}{name}" for name in _PUBLIC]
    return lines + [f"#define {name} {prefix.upper()}{name}" for name in macros]


def _template(name: str) -> str:
    folder = resources.files("delta_calibration").joinpath("export", "templates")
    return folder.joinpath(name).read_text("utf-8")
