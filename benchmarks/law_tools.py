"""Comparison of tools that generate code from a closure: a leg's law with its derivatives by each.

    python benchmarks/law_tools.py [--before FOLDER] [--runs 5] [--batch 10000] [--only NAME ...]

The law is the closure of the six-rod Delta: 6 equations, 6 pose coordinates, 3 joints, 66
dimensions. Each tool returns f, f_x, f_q and f_g of every sample as whole matrices; the dimensions
are the same for all samples. Tools that are not installed are skipped: sympy, symengine, jax,
symforce (which needs an environment of its own because it installs a symengine under the same
name). `--before` is a checkout of the version whose laws were written by hand in numpy; it also
adds the second table.

Every tool runs in its own processes, on one core, first with an empty cache and then with a full
one.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module, metadata, util
from inspect import getsource
from pathlib import Path
from textwrap import dedent, indent
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

for _library in ("OPENBLAS", "MKL", "OMP"):
    os.environ.setdefault(f"{_library}_NUM_THREADS", "1")

# The libraries read these variables when they are loaded, hence the import after them.
# ruff: noqa: E402
import numpy as np

Evaluate = Callable[..., Any]  # q (n, 3), x (n, 6), g (66,) -> f, f_x, f_q, f_g

SIZES = {"q": 1, "x": 6, "g": 22, "c": 2}  # of a leg's law, in the order of its workspace
INPUTS, BY, ROWS = 31, 29, 2  # derivatives with respect to all but c
BASICS = ("numpy", "scipy", "numba", "llvmlite")  # required by the package anyway
DRAWING = {
    "base_radius": 0.2,
    "platform_radius": 0.055,
    "arm": 0.32,
    "rod": 0.85,
    "half_width": 0.04,
}
SAMPLES = 16  # for the comparison of the tools
LARGE = 2000  # samples per batch in numpy; beyond this the temporaries no longer fit the cache
TIMED_S = 1.0  # [s] shortest total time for a time per sample


class Built(NamedTuple):
    """Result of a tool, and the time that it took."""

    evaluate: Evaluate
    generate: float | None = None  # [s]
    law: float | None = None  # [s] to generate and compile, without the loop over samples
    alone: Callable[[int], Any] | None = None  # evaluates the law this many times, without output


class Tool(NamedTuple):
    """A tool: the function that builds its code, its distribution, its run-time module."""

    build: Callable[[Path], Built]
    distribution: str
    module: str
    written: Callable[[], int]  # number of lines of the law to be written by hand


# --- input of all tools --------------------------------------------------------------------------


def samples(n: int) -> tuple[Any, Any, Any]:
    """Joints (n, 3), poses (n, 6) and dimensions (66,), different for all legs."""
    rng = np.random.default_rng(1)
    q = rng.uniform(0.0, 0.6, (n, 3))
    place = np.array([0.0, 0.0, -0.7]) + 0.1 * rng.normal(size=(n, 3))
    x = np.concatenate([place, 0.05 * rng.normal(size=(n, 3))], axis=1)
    leg = [0.2, 0, 0, 0.055, *7 * [0], 0, 0.04, 0.04, 0.04, 0.04, *6 * [0]]
    leg[9], leg[10] = 0.32, 0.85
    return q, x, np.tile(leg, 3) + 1e-3 * rng.normal(size=66)


def stands() -> Any:
    """Cosine and sine of the directions of the legs, (3, 2)."""
    angle = 2 * np.pi / 3 * np.arange(3)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def law_in(functions: Any) -> Evaluate:
    """The package's own law on another tool's arrays, by exchanging the functions it uses."""
    from delta_calibration.mechanisms.six_rod_delta import SixRodDelta
    from delta_calibration.model import symbols

    symbols._casadi = lambda: functions  # type: ignore[assignment]
    return SixRodDelta.equation


def vocabulary(xp: Any, functions: Any) -> SimpleNamespace:
    """The functions that symbols.py uses of CasADi, for arrays in the manner of numpy."""

    def skew(w: Any) -> Any:
        return xp.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]])

    return SimpleNamespace(
        vertcat=lambda *entries: xp.concatenate([xp.atleast_1d(xp.array(e)) for e in entries]),
        horzcat=lambda *columns: xp.stack([xp.array(c) for c in columns], axis=1),
        sin=functions.sin,
        cos=functions.cos,
        dot=lambda a, b: a @ b,
        cross=lambda a, b: skew(a) @ b,
        skew=skew,
        SX=SimpleNamespace(eye=xp.eye),
    )


# --- ours ----------------------------------------------------------------------------------------


def ours(folder: Path, staged: bool = True, each: bool = False) -> Built:
    """The package's own way; optionally without stages, or with dimensions per sample."""
    from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
    from delta_calibration.mechanisms.six_rod_delta import SixRodDelta
    from delta_calibration.model import kernels

    os.environ["XDG_CACHE_HOME"] = str(folder)
    model = SixRodDelta(DeltaDimensions(**DRAWING), DeltaTolerances(*8 * (1e-3,)))
    law = replace(model._closure, name="law_tools")  # not the law shipped with the package
    if not staged:
        law = replace(law, fixed=(), shared=())
    model.__dict__["_closure"] = law
    spent = 0.0
    if not any(folder.rglob("law_tools_*.py")):
        begin = time.perf_counter()
        law.source()
        spent = time.perf_counter() - begin
    begin = time.perf_counter()
    _ = law.compiled
    compiling = time.perf_counter() - begin
    c = model._compiled

    def alone(count: int) -> None:
        q, x, g = samples(SAMPLES)
        repeat(c.limbs, c.size, q, x, g, count)

    @import_module("numba").njit
    def repeat(limbs: Any, size: int, q: Any, x: Any, g: Any, count: int) -> None:
        own = kernels.room(limbs, size)
        kernels.set_geometry(limbs, g, own)
        for k in range(count):
            if each:
                kernels.set_geometry(limbs, g, own)
            kernels.place(limbs, q[k % len(q)], x[k % len(q)], kernels.FULL, own)

    def evaluate(q: Any, x: Any, g: Any) -> Any:
        dimensions = np.tile(g, (len(q), 1)) if each else g[None]
        return kernels.closures(c.limbs, c.size, q, x, dimensions, True)

    return Built(evaluate, spent, compiling, alone)


# --- symbols printed as a function, one loop for all ---------------------------------------------

LOOP = """

@njit(cache=True, nogil=True)
def given(w, q, x, g, c, leg):
    w[0] = q
    for i in range(6):
        w[1 + i] = x[i]
    for i in range(22):
        w[7 + i] = g[22 * leg + i]
    w[29], w[30] = c


@njit(cache=True, nogil=True)
def alone(q, x, g, c, count):
    w, work, total = np.zeros(SIZE), np.zeros((SCRATCH, 1 + BY)), 0.0
    for k in range(count):
        row = k % len(q)
        for leg in range(3):
            given(w, q[row, leg], x[row], g, c[leg], leg)
            law(w, work)
            total += w[31]
    return total + w.sum()


@njit(cache=True, nogil=True)
def batch(q, x, g, c):
    n = len(q)
    w, work = np.zeros(SIZE), np.zeros((SCRATCH, 1 + BY))
    f, by_x = np.zeros((n, 6)), np.zeros((n, 6, 6))
    by_q, by_g = np.zeros((n, 6, 3)), np.zeros((n, 6, 66))
    for row in range(n):
        for leg in range(3):
            given(w, q[row, leg], x[row], g, c[leg], leg)
            law(w, work)
            for rod in range(2):
                at = 33 + rod * BY
                f[row, 2 * leg + rod] = w[31 + rod]
                by_q[row, 2 * leg + rod, leg] = w[at]
                for i in range(6):
                    by_x[row, 2 * leg + rod, i] = w[at + 1 + i]
                for i in range(22):
                    by_g[row, 2 * leg + rod, 22 * leg + i] = w[at + 7 + i]
    return f, by_x, by_q, by_g
"""
HEAD = """from math import cos, sin

import numpy as np
from numba import njit

BY, SIZE, SCRATCH = 29, 33 + 2 * 29, {scratch}

"""
JIT = '@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})'


def looped(folder: Path, source: Callable[[], str], scratch: int = 1) -> Built:
    """Write a function `law(w, work)` of a leg's workspace to a file once; put it in the loop."""
    path, spent = folder / "generated_law.py", 0.0
    if not path.exists():
        begin = time.perf_counter()
        path.write_text(HEAD.format(scratch=scratch) + source() + LOOP, encoding="utf-8")
        spent = time.perf_counter() - begin
    made, legs = module_of(path), stands()
    begin = time.perf_counter()
    made.law(np.zeros(made.SIZE), np.zeros((made.SCRATCH, 1 + BY)))
    compiling = time.perf_counter() - begin
    return Built(
        lambda q, x, g: made.batch(q, x, g, legs),
        spent,
        spent + compiling,
        lambda count: made.alone(*samples(SAMPLES), legs, count),
    )


def module_of(path: Path) -> ModuleType:
    spec = util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


def outputs(equation: Evaluate, entries: list[Any]) -> list[Any]:
    """The law's two outputs, then their derivatives row by row, for symbols that have `diff`."""
    q, x, g, c = entries[0], entries[1:7], entries[7:29], entries[29:]
    f = list(equation(q, *(np.array(part, dtype=object) for part in (x, g, c))))
    return f + [gap.diff(entry) for gap in f for entry in entries[:BY]]


def printed(found: tuple[Any, Any], text: Callable[[Any], str]) -> str:
    """Print common subexpressions and outputs as a function."""
    lines = [f"i{k} = w[{k}]" for k in range(INPUTS)]
    lines += [f"{name} = {text(value)}" for name, value in found[0]]
    lines += [f"w[{INPUTS + k}] = {text(value)}" for k, value in enumerate(found[1])]
    return f"{JIT}\ndef law(w, work):\n" + indent("\n".join(lines), "    ") + "\n"


def by_sympy() -> str:
    sympy = import_module("sympy")
    equation = law_in(vocabulary(np, elementwise(sympy)))
    every = outputs(equation, [sympy.Symbol(f"i{k}") for k in range(INPUTS)])
    pycode = import_module("sympy.printing.pycode").pycode
    return printed(sympy.cse(every), lambda e: pycode(e, fully_qualified_modules=False))


def by_symengine() -> str:
    symengine = import_module("symengine")
    equation = law_in(vocabulary(np, elementwise(symengine)))
    every = outputs(equation, [symengine.Symbol(f"i{k}") for k in range(INPUTS)])
    return printed(symengine.cse(every), str)


def by_symforce(folder: Path) -> Built:
    """The function generated by SymForce, unchanged, with its `numba.njit` and its checks."""

    def source() -> str:
        import_module("symforce")
        sf = import_module("symforce.symbolic")
        codegen, values = import_module("symforce.codegen"), import_module("symforce.values")
        equation = law_in(vocabulary(np, elementwise(sf)))
        w = sf.Matrix(INPUTS, 1).symbolic("w")
        every = sf.Matrix(outputs(equation, list(w.to_flat_list())))
        made = codegen.Codegen(
            values.Values(w=w),
            values.Values(f=every),
            name="leg",
            config=codegen.PythonConfig(use_numba=True),
        ).generate_function(str(folder / "symforce"))
        text = (made.function_dir / "leg.py").read_text(encoding="utf-8")
        text = text.replace("from __future__ import annotations", "")
        text = text.replace("@numba.njit", "@numba.njit(cache=True)")
        return text + f"\n\n{JIT}\ndef law(w, work):\n    w[31:] = leg(w[:31])\n"

    return looped(folder, source)


def elementwise(functions: Any) -> SimpleNamespace:
    """Sine and cosine of one expression."""
    return SimpleNamespace(sin=functions.sin, cos=functions.cos)


# --- CasADi's own virtual machine ---------------------------------------------------------------


def by_machine(folder: Path) -> Built:
    """The law's instructions, interpreted by CasADi and mapped over legs and samples."""
    casadi, path = import_module("casadi"), folder / "leg.casadi"
    if not path.exists():
        w = casadi.SX.sym("w", INPUTS)
        f = law_in(casadi)(w[0], w[1:7], w[7:29], w[29:])
        every = casadi.vertcat(f, casadi.vec(casadi.jacobian(f, w[:BY]).T))
        casadi.Function("leg", [w], casadi.cse([casadi.densify(every)])).save(str(path))
    leg, stand = casadi.Function.load(str(path)), stands()

    def evaluate(q: Any, x: Any, g: Any) -> Any:
        n = len(q)
        w = np.empty((n, 3, INPUTS))
        w[:, :, 0], w[:, :, 1:7], w[:, :, 7:29] = q, x[:, None], g.reshape(3, 22)
        w[:, :, 29:] = stand
        found = leg(w.reshape(3 * n, INPUTS).T).full().T.reshape(n, 3, ROWS * (1 + BY))
        by = found[:, :, ROWS:].reshape(n, 3, ROWS, BY)
        by_q, by_g = np.zeros((n, 3, ROWS, 3)), np.zeros((n, 3, ROWS, 3, 22))
        for k in range(3):
            by_q[:, k, :, k], by_g[:, k, :, k] = by[:, k, :, 0], by[:, k, :, 7:]
        f, by_x = found[:, :, :ROWS].reshape(n, 6), by[..., 1:7].reshape(n, 6, 6)
        return f, by_x, by_q.reshape(n, 6, 3), by_g.reshape(n, 6, 66)

    return Built(evaluate)


# --- JAX -----------------------------------------------------------------------------------------


def by_jax(folder: Path, forward: bool = True) -> Built:
    """The law mapped over legs and samples, with JAX's own cache of compiled code."""
    flags = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"
    os.environ["XLA_FLAGS"] = flags
    jax = import_module("jax")
    jax.config.update("jax_enable_x64", True)
    jax.config.update("jax_compilation_cache_dir", str(folder / "jax"))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    jnp = jax.numpy
    equation = law_in(vocabulary(jnp, jnp))

    def both(q: Any, x: Any, g: Any, c: Any) -> Any:
        f = equation(q, x, g, c)
        return f, f

    slopes = (jax.jacfwd if forward else jax.jacrev)(both, argnums=(0, 1, 2), has_aux=True)
    legs = jax.vmap(slopes, in_axes=(0, None, 0, 0))
    stand, own = jnp.array(stands()), jnp.eye(3)

    def whole(q: Any, x: Any, g: Any) -> Any:
        (by_q, by_x, by_g), f = legs(q, x, g.reshape(3, 22), stand)
        spread = jnp.einsum("lri,lm->lrmi", by_g, own)
        joints = jnp.einsum("lr,lm->lrm", by_q, own)
        return f.reshape(6), by_x.reshape(6, 6), joints.reshape(6, 3), spread.reshape(6, 66)

    mapped = jax.jit(jax.vmap(whole, in_axes=(0, 0, None)))
    return Built(lambda q, x, g: jax.block_until_ready(mapped(q, x, g)))


# --- dual numbers by hand ------------------------------------------------------------------------
# A number is a row of `t`: its value, then its 29 derivatives. `at[0]`, in the last row of the
# array, is the next free row. This part is written once:

DUALS = """
@njit(cache=True, inline="always")
def new(t):
    t[-1, 0] += 1
    return int(t[-1, 0]) - 1


@njit(cache=True)
def number(t, value):
    c = new(t)
    t[c] = 0.0
    t[c, 0] = value
    return c


@njit(cache=True)
def lin(t, p, a, q, b):
    c = new(t)
    for k in range(30):
        t[c, k] = p * t[a, k] + q * t[b, k]
    return c


@njit(cache=True)
def mul(t, a, b):
    c = new(t)
    u, v = t[a, 0], t[b, 0]
    t[c, 0] = u * v
    for k in range(1, 30):
        t[c, k] = u * t[b, k] + v * t[a, k]
    return c


@njit(cache=True)
def chain(t, a, value, slope):
    c = new(t)
    t[c, 0] = value
    for k in range(1, 30):
        t[c, k] = slope * t[a, k]
    return c


@njit(cache=True)
def dot(t, a, b):
    s = mul(t, a[0], b[0])
    for i in range(1, 3):
        s = lin(t, 1.0, s, 1.0, mul(t, a[i], b[i]))
    return s


@njit(cache=True)
def cross(t, a, b):
    return (
        lin(t, 1.0, mul(t, a[1], b[2]), -1.0, mul(t, a[2], b[1])),
        lin(t, 1.0, mul(t, a[2], b[0]), -1.0, mul(t, a[0], b[2])),
        lin(t, 1.0, mul(t, a[0], b[1]), -1.0, mul(t, a[1], b[0])),
    )


@njit(cache=True)
def add(t, a, q, b):
    return (lin(t, 1.0, a[0], q, b[0]), lin(t, 1.0, a[1], q, b[1]), lin(t, 1.0, a[2], q, b[2]))


@njit(cache=True)
def scale(t, s, a):
    return (mul(t, s, a[0]), mul(t, s, a[1]), mul(t, s, a[2]))


@njit(cache=True)
def factors(t, w):
    s = dot(t, w, w)
    z = t[s, 0]
    a, da, b, db = 0.0, 0.0, 0.0, 0.0
    term = 1.0
    for k in range(18):
        a += term
        b += term / (2 * k + 2)
        after = -term / ((2 * k + 2) * (2 * k + 3))
        da += (k + 1) * after
        db += (k + 1) * after / (2 * k + 4)
        term = after * z
    return chain(t, s, a, da), chain(t, s, b, db)


@njit(cache=True)
def turned(t, w, ab, v):
    one = cross(t, w, v)
    two = cross(t, w, one)
    return add(t, add(t, v, 1.0, scale(t, ab[0], one)), 1.0, scale(t, ab[1], two))


@njit(cache=True)
def stood(t, c, s, a):
    return lin(t, c, a[0], -s, a[1]), lin(t, s, a[0], c, a[1]), a[2]

"""
# This part is written for each mechanism:
DUAL_LAW = """
@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract"})
def law(w, t):
    t[-1, 0] = 0
    for i in range(29):
        t[number(t, w[i]), 1 + i] = 1.0
    c, s, zero = w[29], w[30], number(t, 0.0)
    hinge, line, crooked = (13, zero, 14), (23, zero, 24), (25, zero, 26)
    on_arm = 27, zero, 28
    turn, tilt = (4, 5, 6), factors(t, hinge)
    along = (zero, number(t, 1.0), zero)
    angle = lin(t, 1.0, 0, 1.0, 15)
    a = t[angle, 0]
    ahead, down = chain(t, angle, cos(a), -sin(a)), chain(t, angle, -sin(a), -cos(a))
    arm = ahead, zero, down
    arm = add(t, (7, 8, 9), 1.0, turned(t, hinge, tilt, scale(t, 16, arm)))
    middle = add(t, (1, 2, 3), -1.0, stood(t, c, s, arm))
    own = turned(t, on_arm, factors(t, on_arm), along)
    own = (
        lin(t, 1.0, mul(t, ahead, own[0]), -1.0, mul(t, down, own[2])),
        own[1],
        lin(t, 1.0, mul(t, ahead, own[2]), 1.0, mul(t, down, own[0])),
    )
    axis = turned(t, hinge, tilt, turned(t, line, factors(t, line), own))
    axis = stood(t, c, s, axis)
    across = stood(t, c, s, turned(t, crooked, factors(t, crooked), along))
    joint, by = stood(t, c, s, (10, 11, 12)), factors(t, turn)
    for rod in range(2):
        side = 2.0 * rod - 1.0
        ball = add(t, joint, side, scale(t, 21 + rod, across))
        gap = add(t, middle, 1.0, turned(t, turn, by, ball))
        gap = add(t, gap, -side, scale(t, 19 + rod, axis))
        length = lin(t, 1.0, 17, side / 2, 18)
        f = lin(t, 1.0, dot(t, gap, gap), -1.0, mul(t, length, length))
        w[31 + rod] = t[f, 0]
        for i in range(29):
            w[33 + 29 * rod + i] = t[f, 1 + i]
"""


# --- numpy by hand -------------------------------------------------------------------------------


def by_numpy(folder: Path) -> Built:
    """The four functions of the earlier version (its folder comes first on the path)."""
    del folder
    from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
    from delta_calibration.mechanisms.six_rod_delta import SixRodDelta

    model = SixRodDelta(DeltaDimensions(**DRAWING), DeltaTolerances(*8 * (1e-3,)))

    def evaluate(q: Any, x: Any, g: Any) -> Any:
        f, by_x = model.linearised(q, x, g)
        return f, by_x, model.closure_by_joints(q, x, g), model.closure_by_geometry(q, x, g)

    return Built(evaluate)


# --- lines to be written by hand -----------------------------------------------------------------


def lines_of(source: str) -> int:
    """Number of lines of code without blank lines, docstrings and comments."""
    tree = ast.parse(dedent(source))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and ast.get_docstring(node):
            node.body = node.body[1:] or [ast.Pass()]
    return len(ast.unparse(tree).replace("\n\n", "\n").splitlines())


def symbolic_lines() -> int:
    from delta_calibration.mechanisms.six_rod_delta import SixRodDelta

    return lines_of(getsource(SixRodDelta.equation))


def numpy_lines(folder: Path) -> int:
    """Lines of the four functions and of the functions in the same file that they call."""
    path = folder / "delta_calibration" / "mechanisms" / "six_rod_delta.py"
    tree = ast.parse(path.read_text(encoding="utf-8"))
    own = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
    kinds = ("closure", "closure_by_pose", "linearised", "closure_by_joints")
    todo, found = [*kinds, "closure_by_geometry"], set()
    while todo:
        name = todo.pop()
        if name in own and name not in found:
            found.add(name)
            todo += re.findall(r"\w+", ast.unparse(own[name]))
    return sum(lines_of(ast.unparse(own[name])) for name in found)


# --- the table -----------------------------------------------------------------------------------

TOOLS = {
    "CasADi to numba (ours)": Tool(ours, "casadi", "casadi", symbolic_lines),
    "the same, dimensions differ by sample": Tool(
        lambda folder: ours(folder, each=True), "casadi", "casadi", symbolic_lines
    ),
    "CasADi to numba, no stages": Tool(
        lambda folder: ours(folder, staged=False), "casadi", "casadi", symbolic_lines
    ),
    "CasADi's virtual machine": Tool(by_machine, "casadi", "casadi", symbolic_lines),
    "SymPy, cse, to numba": Tool(
        lambda folder: looped(folder, by_sympy), "sympy", "sympy", symbolic_lines
    ),
    "symengine, cse, to numba": Tool(
        lambda folder: looped(folder, by_symengine), "symengine", "symengine", symbolic_lines
    ),
    "SymForce to numba": Tool(by_symforce, "symforce", "sym", symbolic_lines),
    "JAX, jacfwd": Tool(by_jax, "jax", "jax", symbolic_lines),
    "JAX, jacrev": Tool(lambda folder: by_jax(folder, False), "jax", "jax", symbolic_lines),
    "numba, dual numbers by hand": Tool(
        lambda folder: looped(folder, lambda: DUALS + DUAL_LAW, 1000),
        "numba",
        "numba",
        lambda: lines_of(DUAL_LAW),
    ),
    "numpy by hand (before)": Tool(by_numpy, "numpy", "numpy", lambda: 0),
}
BEFORE = "numpy by hand (before)"
IMPORTED = {"SymForce to numba": "symforce.symbolic"}  # module to generate with, if another


def child(name: str, folder: Path, batch: int, timed: bool) -> None:
    """Run one tool in this process; print its results as JSON."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    start, tool = float(os.environ["LAW_TOOLS_START"]), TOOLS[name]
    q, x, g = samples(SAMPLES)
    begin = time.perf_counter()
    built = tool.build(folder)
    loaded = time.perf_counter() - begin
    begin = time.perf_counter()
    first = [np.asarray(part) for part in built.evaluate(q, x, g)]
    figures: dict[str, Any] = {
        "generate": built.generate,
        "law": built.law,
        "made": loaded + time.perf_counter() - begin,  # [s] with imports, loops and first call
        "start": time.time() - start,
        "loaded": tool.module in sys.modules,
    }
    np.savez(folder / "found.npz", *first)
    if timed:
        many = samples(LARGE if name == BEFORE else batch)
        figures["batch"] = timed_call(built.evaluate, many) / len(many[0])
        figures["alone"] = built.alone and timed_count(built.alone)
        figures["single"] = timed_call(built.evaluate, samples(1))
        figures["lines"] = 0 if name == BEFORE else tool.written()
    print(json.dumps(figures))


def timed_call(evaluate: Evaluate, given: tuple[Any, Any, Any]) -> float:
    """Shortest time of a call [s]."""
    evaluate(*given)
    count, best, end = 1, np.inf, time.perf_counter() + TIMED_S
    while time.perf_counter() < end:
        begin = time.perf_counter()
        for _ in range(count):
            evaluate(*given)
        spent = time.perf_counter() - begin
        best = min(best, spent / count)
        if spent < 1e-3:
            count *= 2
    return best


def timed_count(alone: Callable[[int], Any], count: int = 20_000) -> float:
    """Shortest time of one evaluation of the law for the whole machine [s]."""
    alone(1)
    best = np.inf
    for _ in range(20):
        begin = time.perf_counter()
        alone(count)
        best = min(best, (time.perf_counter() - begin) / count)
    return best


def process(code: list[str], folder: Path, path: Path, limit: float | None = None) -> str:
    """Output of a new process, with its caches in a folder and this package first on the path."""
    where = {"PYTHONPATH": str(path), "NUMBA_CACHE_DIR": str(folder / "numba")}
    environment = {**os.environ, **where, "XDG_CACHE_HOME": str(folder)}
    environment["LAW_TOOLS_START"] = repr(time.time())
    run = subprocess.run(
        [sys.executable, *code],
        env=environment,
        text=True,
        capture_output=True,
        check=False,
        timeout=limit,
    )
    if run.returncode:
        raise SystemExit(run.stderr)
    return run.stderr if "importtime" in code else run.stdout


def trial(name: str, path: Path, runs: int, batch: int, keep: Path) -> dict[str, Any]:
    """Run a tool with an empty cache, then with a full one; the smallest of each value counts."""
    made: list[dict[str, Any]] = []
    again: list[dict[str, Any]] = []
    for run in range(2):
        with tempfile.TemporaryDirectory() as place:
            code = [__file__, "--child", name, "--folder", place, "--batch", str(batch)]
            made.append(json.loads(process(code, Path(place), path)))
            for _ in range(runs if run else 0):
                text = process([*code, "--timed"], Path(place), path)
                again.append(json.loads(text))
            shutil.copy(Path(place) / "found.npz", keep)
    return {
        **{key: least(again, key) for key in again[0]},
        **{key: least(made, key) for key in ("generate", "law", "made")},
        "needed": again[0]["loaded"],
        **import_of(IMPORTED.get(name, TOOLS[name].module), runs),
    }


def least(entries: list[dict[str, Any]], key: str) -> Any:
    return min((entry[key] for entry in entries if entry[key] is not None), default=None)


def written(value: float | None, scale: float, digits: int) -> str:
    return "" if value is None else f"{scale * value:.{digits}f}"


def import_of(module: str, runs: int) -> dict[str, float]:
    """Time to import a tool in addition to numpy, in new processes [s]."""
    code = f"import numpy, time; b = time.perf_counter(); import {module}; "
    code += "print(time.perf_counter() - b)"
    text = [process(["-c", code], Path(tempfile.gettempdir()), Path()) for _ in range(runs)]
    return {"import": min(map(float, text))}


def installed(distribution: str) -> float:
    """Bytes that a distribution and its requirements add to what the package needs anyway."""
    todo, found = [distribution], set()
    while todo:
        name = re.split(r"[^\w.-]", todo.pop().strip())[0].lower().replace("_", "-")
        if name in found or (name in BASICS):
            continue
        try:
            wanted = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        found.add(name)
        todo += [entry for entry in wanted if "extra ==" not in entry]
    files = [Path(f.locate()) for name in found for f in metadata.files(name) or ()]
    return float(sum(f.stat().st_size for f in files if f.exists() and f.suffix != ".pyc"))


def present(tool: Tool) -> bool:
    """Whether it is installed under its own name."""
    try:
        metadata.distribution(tool.distribution)
    except metadata.PackageNotFoundError:
        return False
    return True


def rows(before: Path | None, runs: int, batch: int, only: list[str]) -> Iterator[str]:
    """Yield the table, a row per tool."""
    here = Path(__file__).parents[1]
    yield (
        "| | a sample of a batch [us] | law alone [us] | one call [us] | generate [s] "
        "| and compile the law [s] | and the loop, first call [s] | new process, cache full [s] "
        "| import [s] | loaded at run time | adds [MB] | lines of the law | differs by |"
    )
    yield "|---|" + "---:|" * 8 + "---|" + "---:|" * 3
    with tempfile.TemporaryDirectory() as place:
        reference = Path(place) / "ours.npz"
        for name, tool in TOOLS.items():
            path = before if name == BEFORE else here
            if only and name not in only and name != next(iter(TOOLS)):
                continue
            if path is None or not present(tool):
                print(f"{name}: skipped, {tool.distribution} not there", file=sys.stderr)
                continue
            keep = reference if not reference.exists() else Path(place) / "other.npz"
            found = trial(name, path, runs, batch, keep)
            a, b = np.load(reference), np.load(keep)
            off = max(float(abs(a[key] - b[key]).max()) for key in a)
            assert off < 1e-12, f"{name}: differs from ours by {off}"
            size = installed(tool.distribution) / 1e6
            lines = numpy_lines(path) if name == BEFORE else found["lines"]
            yield (
                f"| {name} | {written(found['batch'], 1e6, 2)} "
                f"| {written(found['alone'], 1e6, 2)} | {written(found['single'], 1e6, 1)} "
                f"| {written(found['generate'], 1, 2)} | {written(found['law'], 1, 1)} "
                f"| {written(found['made'], 1, 1)} "
                f"| {written(found['start'], 1, 2)} | {written(found['import'], 1, 2)} "
                f"| {'yes' if found['needed'] else 'no'} | {size:.0f} | {lines} | {off:.0e} |"
            )


def arm(tool: str, chained: bool) -> None:
    """Print the time to generate a six-axis arm's closure with all derivatives [s]."""
    from delta_calibration.mechanisms.serial_arm import SerialArm
    from delta_calibration.model.law import Law

    sizes = (("q", 6), ("x", 6), ("g", 39), ("c", 0))
    if tool == "casadi":
        law = Law("arm", sizes, 6, SerialArm.equation, ("g", "c"), ("x",), ("x", "q"), ("g",))
        import_module("casadi")
        begin = time.perf_counter()
        law.source()
        print(time.perf_counter() - begin)
        return
    tools = import_module(tool)
    functions = vocabulary(np, tools)
    functions.sqrt, functions.atan2 = tools.sqrt, tools.atan2
    functions.if_else = lambda test, yes, no: tools.Piecewise((yes, test), (no, True))
    law_in(functions)
    entries = np.array([tools.Symbol(f"i{k}") for k in range(51)], dtype=object)
    begin = time.perf_counter()
    f = SerialArm.equation(entries[:6], entries[6:12], entries[12:], None)
    if chained:
        chain_rule(tools, list(f), entries)
    else:
        tools.cse([*f, *(row.diff(entry) for row in f for entry in entries)])
    print(time.perf_counter() - begin)


def chain_rule(tools: Any, f: list[Any], entries: Any) -> tuple[list[Any], list[Any]]:
    """Lines (name, value) of f and its derivatives: subexpressions first, then the values."""
    parts, last = tools.cse(f)
    known: dict[Any, dict[int, Any]] = {entry: {k: 1} for k, entry in enumerate(entries)}

    def slopes(value: Any) -> dict[int, Any]:
        found: dict[int, Any] = {}
        if value.is_Relational:
            return found
        for symbol in value.free_symbols & known.keys():
            by = value.diff(symbol)
            for k, slope in known[symbol].items():
                found[k] = found.get(k, 0) + by * slope
        return found

    lines = []
    for name, value in parts:
        lines.append((name, value))
        own = slopes(value)
        known[name] = {k: tools.Symbol(f"{name}_{k}") for k in own}
        lines += [(known[name][k], slope) for k, slope in own.items()]
    return lines, [(value, slopes(value)) for value in last]


def larger(limit: float = 120.0) -> Iterator[str]:
    """Yield the same table for a larger law."""
    yield "| closure of a six-axis arm, its derivatives by 51 numbers | generate [s] |"
    yield "|---|---:|"
    here = Path(__file__).parents[1]
    for name in ("casadi", "sympy", "symengine", "symengine,chain rule"):
        if not util.find_spec(name.split(",")[0]):
            continue
        try:
            text = process(["-W", "ignore", __file__, "--arm", name], Path(), here, limit)
        except subprocess.TimeoutExpired:
            yield f"| {name} | stopped after {limit:.0f} |"
        else:
            yield f"| {name} | {float(text):.2f} |"


FIRST = """
import time
begin = time.perf_counter()
from delta_calibration.mechanisms.delta_leg import DeltaDimensions, DeltaTolerances
from delta_calibration.mechanisms.rotary_delta import RotaryDelta
import numpy as np
loaded = time.perf_counter()
model = RotaryDelta(DeltaDimensions(**{drawing}), DeltaTolerances(*8 * (1e-3,)))
model.forward(np.array([[0.1, 0.2, 0.3]]), model.parameters.nominal)
print(loaded - begin, time.perf_counter() - loaded)
"""


def starts(before: Path | None, runs: int) -> Iterator[str]:
    """Yield the times until a process has its first pose, with full caches."""
    yield "| | import of the mechanisms [s] | first forward [s] |"
    yield "|---|---:|---:|"
    code, here = ["-c", FIRST.format(drawing=DRAWING)], Path(__file__).parents[1]
    with tempfile.TemporaryDirectory() as place:
        for name, path in (("before", before), ("now", here)):
            if path is not None:
                text = [process(code, Path(place), path) for _ in range(runs + 1)][1:]
                best = np.array([list(map(float, each.split())) for each in text]).min(axis=0)
                yield f"| {name} | {best[0]:.2f} | {best[1]:.4f} |"
        code = ["-X", "importtime", "-c", "import delta_calibration.model.kernels"]
        last = [process(code, Path(place), here).splitlines()[-1] for _ in range(runs)]
    total = min(int(line.split("|")[1]) for line in last)
    yield f"\n`import delta_calibration.model.kernels`: {total / 1e6:.2f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--before", type=Path, help="checkout of the version in numpy")
    parser.add_argument(
        "--runs", type=int, default=5, help="number of new processes; the fastest counts"
    )
    parser.add_argument("--batch", type=int, default=10_000, help="number of samples")
    parser.add_argument("--only", nargs="*", default=[], help="rows to measure besides the first")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    parser.add_argument("--arm", help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("--timed", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.child:
        child(given.child, given.folder, given.batch, given.timed)
        return
    if given.arm:
        arm(given.arm.split(",")[0], "," in given.arm)
        return
    for row in rows(given.before, given.runs, given.batch, given.only):
        print(row, flush=True)
    print()
    for row in larger():
        print(row, flush=True)
    print()
    for row in starts(given.before, given.runs):
        print(row, flush=True)


if __name__ == "__main__":
    main()
