"""Laws: symbolic outputs of one sample as functions of its inputs, and the generated code.

The inputs come in groups (joint angles, pose, dimensions, ...). The generated functions work on
one array, the workspace of a law:

    inputs, group by group | outputs f | df by each group that is asked for, row by row | the rest

where derivatives that are always zero are never written. They work in stages, so that nothing
is computed more often than it changes:

    setup    what depends on the `fixed` groups alone       once a geometry
    shared   what depends on the `shared` group alone       once a sample, the same for all limbs
    near     f and its derivatives by the groups `near`     each step of Newton's method
    full     those, and the derivatives by the groups `full`

A law of `lanes` is evaluated for many values of one group at once, in vector instructions. These
values lie behind the workspace, whose last number is their count: the inputs and then the outputs,
each for all lanes. Divisors are inverted once there.

Derivatives are CasADi's (forward mode, so that `setup` computes columns which do not change);
its instructions, one by one, become the lines of a numba function.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace
from hashlib import blake2s
from importlib import import_module
from typing import Any

from delta_calibration.errors import ConfigError
from delta_calibration.lazy import cached_property
from delta_calibration.model import library

STAGES = ("setup", "shared", "near", "full")


@dataclass(frozen=True)
class Law:
    """A law and how it is to be differentiated.

    Raises:
        ConfigError: on first use, if the law has to be generated and CasADi is not installed.
    """

    name: str  # of the generated file
    groups: tuple[tuple[str, int], ...]  # inputs: name and size
    outputs: int
    express: Callable[..., Any]  # symbols of the groups, in their order, -> column of outputs
    fixed: tuple[str, ...] = ()
    shared: tuple[str, ...] = ()
    near: tuple[str, ...] = ()
    full: tuple[str, ...] = ()
    lanes: str = ""  # group of which stage `full` takes many values at once; no derivatives then

    @cached_property
    def offsets(self) -> dict[str, int]:
        """Start of each group in the workspace, then of f ("f") and its derivatives ("f_x")."""
        size, place = dict(self.groups), 0
        found: dict[str, int] = {}
        for name, count in self.groups:
            found[name], place = place, place + count
        found["f"], place = place, place + self.outputs
        for name in self.by:
            found[f"f_{name}"], place = place, place + self.outputs * size[name]
        found["rest"] = place
        return found

    @property
    def by(self) -> tuple[str, ...]:
        """Groups by which f is differentiated."""
        return self.near + self.full

    @cached_property
    def compiled(self) -> CompiledLaw:
        """Its compiled functions, from the package's file, or generated now and cached."""
        module = library.module_of(self)
        return CompiledLaw(
            tuple(module.ADDRESSES[stage] for stage in STAGES), module.SHARED, module.SIZE
        )

    @property
    def layout(self) -> tuple[Any, ...]:
        """All that the generated file depends on besides `express`."""
        own = (self.lanes,) if self.lanes else ()
        return (self.groups, self.outputs, self.fixed, self.shared, self.near, self.full, *own)

    def source(self) -> str:
        """Return the text of the generated file."""
        body = "\n".join(_lines(self)) + "\n"
        return body.replace(_DIGEST, blake2s(body.encode(), digest_size=8).hexdigest())

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without addresses, which hold only in the process that compiled it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True)
class CompiledLaw:
    """Addresses of a law's stages, range of its shared results, size of its workspace."""

    addresses: tuple[int, ...]
    shared: tuple[int, int]
    size: int


# --- the generator -------------------------------------------------------------------------------

_WORD, _INPUT = re.compile(r"[a-z]\w*"), re.compile(r"i\d+")
_DIVISION = re.compile(r"(\w+) / (t\d+)")
_DIGEST = "digest of this file"
_ALIGNED = 8  # numbers in a cache line of the processor
_FUNCTIONS = (
    "acos",
    "asin",
    "atan",
    "atan2",
    "ceil",
    "cos",
    "cosh",
    "exp",
    "floor",
    "inf",
    "log",
    "nan",
    "sin",
    "sinh",
    "sqrt",
    "tan",
    "tanh",
)


@dataclass
class _Line:
    """One instruction: its name, its right side, its operands and its earliest stage."""

    target: str
    text: str
    needs: tuple[str, ...]
    stage: int


def _lines(law: Law) -> Iterator[str]:
    lines, outputs = _instructions(law)
    lines = list(_inverted(lines)) if law.lanes else lines
    own = {line.target: line for line in lines}
    wanted = [_needed(own, outputs, names) for names in _asked(law)]
    kept = _kept_results(lines, wanted[1], outputs)
    place = {name: law.offsets["rest"] + i for i, name in enumerate(kept)}
    first = sum(own[name].stage == 0 for name in kept)
    size = law.offsets["rest"] + len(kept)
    if law.lanes:
        size = (size // _ALIGNED + 1) * _ALIGNED
    words = {word for line in lines for word in _WORD.findall(line.text)}
    words |= {word for ends in outputs.values() for _, end in ends for word in _WORD.findall(end)}
    yield '"""Generated from a law of a mechanism or an effect, by `make laws`: edits are lost."""'
    yield ""
    if taken := sorted(words & {*_FUNCTIONS}):
        yield f"from math import {', '.join(taken)}"
        yield ""
    yield "from delta_calibration.model.jit import idle, law"
    yield ""
    yield f"LAYOUT = {law.layout!r}"
    yield f"SIZE = {size}"
    yield f"SHARED = ({law.offsets['rest'] + first}, {size})"
    many = ""
    if law.lanes:
        count = dict(law.groups)[law.lanes]
        yield f"LANES = {(law.offsets[law.lanes], count, law.offsets['f'], law.outputs, size)}"
        many = ", LANES"
    yield ""
    bodies: dict[str, list[str]] = {}
    for stage, name in enumerate(STAGES):
        chosen = wanted[0] if name == "near" else wanted[1]
        bodies[name] = list(_body(lines, min(stage, 2), chosen, place, outputs, law, stage))
    if not law.near:  # no Newton steps are taken with it
        bodies["near"] = []
    for name, body in bodies.items():
        if body:
            yield ""
            yield f"def {name}(w):"
            yield from (f"    {text}" for text in body)
            yield ""
    yield ""
    yield "ADDRESSES = {"
    for name, body in bodies.items():
        more = many if name == "full" else ""
        yield f'    "{name}": ' + (f'law({name}, "{_DIGEST}"{more}),' if body else "idle(),")
    yield "}"
    if not law.near:
        yield 'ADDRESSES["near"] = ADDRESSES["full"]'


def _inverted(lines: list[_Line]) -> Iterator[_Line]:
    """Replace divisions by products with the inverse, computed once for each divisor."""
    last = max(int(line.target[1:]) for line in lines)
    known: dict[str, str] = {}
    for line in lines:
        division = _DIVISION.fullmatch(line.text)
        if division is None:
            yield line
            continue
        upper, lower = division.groups()
        if lower not in known:
            known[lower] = f"t{last + 1 + len(known)}"
            stage = next(own.stage for own in lines if own.target == lower)
            yield _Line(known[lower], f"1.0 / {lower}", (lower,), stage)
        needs = tuple(known[lower] if name == lower else name for name in line.needs)
        yield replace(line, text=f"{upper} * {known[lower]}", needs=needs)


def _asked(law: Law) -> tuple[tuple[str, ...], tuple[str, ...]]:
    near = ("f", *(f"f_{name}" for name in law.near))
    return near, (*near, *(f"f_{name}" for name in law.full))


def _needed(own: dict[str, _Line], outputs: dict[str, Any], names: tuple[str, ...]) -> set[str]:
    """All instructions that some outputs need."""
    todo = [target for name in names for _, target in outputs[name]]
    found: set[str] = set()
    while todo:
        name = todo.pop()
        if name in own and name not in found:
            found.add(name)
            todo.extend(own[name].needs)
    return found


def _kept_results(
    lines: list[_Line], wanted: set[str], outputs: dict[str, list[tuple[int, str]]]
) -> list[str]:
    """Results that a later stage or an output needs; those of the first stage come first."""
    own = {line.target: line for line in lines}
    used: set[str] = set()
    for line in lines:
        if line.target in wanted:
            used |= {n for n in line.needs if n in own and own[n].stage < line.stage}
    ends = {target for pairs in outputs.values() for _, target in pairs}
    used |= {target for target in ends if target in own and own[target].stage < 2}
    return sorted(used, key=lambda name: (own[name].stage, int(name[1:])))


def _body(
    lines: list[_Line],
    stage: int,
    wanted: set[str],
    place: dict[str, int],
    outputs: dict[str, list[tuple[int, str]]],
    law: Law,
    number: int,
) -> Iterator[str]:
    """Lines of one stage: load what it needs, compute, store what others need."""
    own = {line.target: line for line in lines}
    mine = [line for line in lines if line.stage == stage and line.target in wanted]
    stored = _asked(law)[0 if STAGES[number] == "near" else 1] if stage == 2 else ()
    ends = [(slot, target) for name in stored for slot, target in outputs[name]]
    inside = {line.target for line in mine}
    loads = dict.fromkeys(
        need
        for need in (*(n for line in mine for n in line.needs), *(t for _, t in ends))
        if need not in inside
    )
    for name in loads:
        if _INPUT.fullmatch(name):
            yield f"{name} = w[{name[1:]}]"
        elif name in own:
            yield f"{name} = w[{place[name]}]"
    for line in mine:
        yield f"{line.target} = {line.text}"
        if line.target in place and stage < 2:
            yield f"w[{place[line.target]}] = {line.target}"
    for slot, target in ends:
        yield f"w[{slot}] = {target}"


def _instructions(law: Law) -> tuple[list[_Line], dict[str, list[tuple[int, str]]]]:
    """The law and its derivatives as single instructions, and which of them fill which slots."""
    try:
        casadi: Any = import_module("casadi")
    except ImportError as error:
        raise ConfigError(
            f"law {law.name}: it is not one of the package's, and generating its code needs "
            "CasADi: pip install casadi"
        ) from error
    symbols = {name: casadi.SX.sym(name, size) for name, size in law.groups}
    f = casadi.SX(casadi.densify(casadi.vertcat(law.express(*symbols.values()))))
    if f.shape != (law.outputs, 1):
        raise ConfigError(f"law {law.name}: {f.shape[0]} outputs; {law.outputs} are to be given")
    parts = {"f": f}
    for name in law.by:
        count = symbols[name].shape[0]
        seeds = (casadi.DM.eye(count)[:, k] for k in range(count))
        columns = [casadi.jtimes(f, symbols[name], seed) for seed in seeds]
        parts[f"f_{name}"] = casadi.sparsify(casadi.horzcat(*columns))
    function = casadi.Function(law.name, list(symbols.values()), casadi.cse(list(parts.values())))
    return _walk(casadi, law, function, parts)


def _walk(
    casadi: Any, law: Law, function: Any, parts: dict[str, Any]
) -> tuple[list[_Line], dict[str, list[tuple[int, str]]]]:
    names, shapes = list(parts), [part.shape for part in parts.values()]
    fills = [function.sparsity_out(i) for i in range(len(names))]
    cells = [list(zip(*fill.get_triplet(), strict=True)) for fill in fills]
    stage_of = {
        name: 0 if name in law.fixed else 1 if name in law.shared else 2 for name, _ in law.groups
    }
    register: dict[int, str] = {}
    stage: dict[str, int] = {}
    lines: list[_Line] = []
    outputs: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    text = _texts(casadi)
    for k in range(function.n_instructions()):
        code = function.instruction_id(k)
        taken, given = function.instruction_input(k), function.instruction_output(k)
        if code == casadi.OP_INPUT:
            group = law.groups[taken[0]][0]
            name = f"i{law.offsets[group] + taken[1]}"
            register[given[0]], stage[name] = name, stage_of[group]
        elif code == casadi.OP_CONST:
            constant = repr(function.instruction_constant(k))
            register[given[0]] = f"({constant})" if constant.startswith("-") else constant
        elif code == casadi.OP_OUTPUT:
            row, column = cells[given[0]][given[1]]
            slot = law.offsets[names[given[0]]] + row * shapes[given[0]][1] + column
            outputs[names[given[0]]].append((slot, register[taken[0]]))
        else:
            needs = tuple(register[r] for r in taken)
            if code not in text:
                raise ConfigError(
                    f"law {law.name}: operation {code} of CasADi is not one of the vocabulary "
                    "(delta_calibration.model.symbols)"
                )
            name = f"t{k}"
            variables = tuple(n for n in needs if n in stage)
            stages = {stage[n] for n in variables}
            when = max(stages, default=0) if len(stages) < 2 else 2  # of a limb and shared: last
            lines.append(_Line(name, text[code].format(*needs), variables, when))
            register[given[0]], stage[name] = name, when
    return lines, outputs


def _texts(ca: Any) -> dict[int, str]:
    """Python text of each CasADi operation; a condition is 1.0 or 0.0 there."""
    plain = {
        ca.OP_ASSIGN: "{0}",
        ca.OP_ADD: "{0} + {1}",
        ca.OP_SUB: "{0} - {1}",
        ca.OP_MUL: "{0} * {1}",
        ca.OP_DIV: "{0} / {1}",
        ca.OP_NEG: "-({0})",
        ca.OP_SQ: "{0} * {0}",
        ca.OP_TWICE: "2.0 * {0}",
        ca.OP_INV: "1.0 / {0}",
        ca.OP_FABS: "abs({0})",
        ca.OP_FMIN: "min({0}, {1})",
        ca.OP_FMAX: "max({0}, {1})",
        ca.OP_LT: "1.0 if {0} < {1} else 0.0",
        ca.OP_LE: "1.0 if {0} <= {1} else 0.0",
        ca.OP_EQ: "1.0 if {0} == {1} else 0.0",
        ca.OP_NE: "1.0 if {0} != {1} else 0.0",
        ca.OP_NOT: "0.0 if {0} != 0.0 else 1.0",
        ca.OP_AND: "1.0 if {0} != 0.0 and {1} != 0.0 else 0.0",
        ca.OP_OR: "1.0 if {0} != 0.0 or {1} != 0.0 else 0.0",
        ca.OP_IF_ELSE_ZERO: "{1} if {0} != 0.0 else 0.0",
        ca.OP_SIGN: "(1.0 if {0} > 0.0 else 0.0) - (1.0 if {0} < 0.0 else 0.0)",
        ca.OP_POW: "{0} ** {1}",
        ca.OP_CONSTPOW: "{0} ** {1}",
    }
    functions = {
        ca.OP_SQRT: "sqrt",
        ca.OP_SIN: "sin",
        ca.OP_COS: "cos",
        ca.OP_ACOS: "acos",
        ca.OP_EXP: "exp",
        ca.OP_LOG: "log",
        ca.OP_TANH: "tanh",
        ca.OP_TAN: "tan",
        ca.OP_ASIN: "asin",
        ca.OP_ATAN: "atan",
        ca.OP_SINH: "sinh",
        ca.OP_COSH: "cosh",
        ca.OP_FLOOR: "floor",
        ca.OP_CEIL: "ceil",
    }
    calls = {code: f"{name}({{0}})" for code, name in functions.items()}
    return {**plain, **calls, ca.OP_ATAN2: "atan2({0}, {1})"}
