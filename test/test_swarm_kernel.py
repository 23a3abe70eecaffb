"""The compiled swarm has the same particles at the same places as the one of apso.py."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numba import njit

from delta_calibration.chain import Chain
from delta_calibration.compensation import (
    Apso,
    ApsoSettings,
    IdentifiedMachine,
    Newton,
    NewtonSettings,
    Swarm,
    swarm_kernel,
)
from delta_calibration.compensation.backward_kernel import scratch
from delta_calibration.errors import InputError
from delta_calibration.model import symbols
from delta_calibration.model.jit import call
from delta_calibration.model.kernels import FULL
from delta_calibration.robot import load_robot
from six_rods import SixRods, workspace

ROBOT = load_robot("srbd")
DELTAS = ("rotary_delta", "six_rod_delta")
TOOL = np.array([0.02, -0.03, -0.08])
BOUND = ROBOT.limits.correction
HUNDREDTH = ApsoSettings(bound_rad=BOUND, tolerance=1e-5)  # fast in numpy too


class Made:
    """A machine drawn within its tolerances, and its point by numpy."""

    def __init__(self, name, seed=0):
        self.mechanism = ROBOT.model(name)
        parameters, rng = self.mechanism.parameters, np.random.default_rng(seed)
        drawn = parameters.prior * rng.standard_normal(len(parameters))
        self.errors = dict(zip(parameters.names, drawn, strict=True))
        self.geometry = parameters.nominal + drawn
        self.chain = Chain(self.mechanism, np.zeros(3), 0.05)
        self.machine = IdentifiedMachine(
            self.chain, np.concatenate([self.geometry, np.zeros(9)]), TOOL
        )

    def point(self, q):
        rows = q.reshape(-1, 3)
        with np.errstate(invalid="ignore"):
            x = self.mechanism.forward(rows, self.geometry)
        return self.chain.point(x, TOOL).reshape(q.shape)


def tasks(n, seed=0):
    """Commands, and the points of the nominal machine for them."""
    q, drawing = workspace(n, np.random.default_rng(seed)), ROBOT.model("rotary_delta")
    return q, drawing.forward(q, drawing.parameters.nominal) + TOOL


def assert_same(found, expected):
    """Require equality of each particle except for rounding.

    If a target is out of reach, the swarm converges where the distance is smallest and flat:
    places 1e-9 rad apart are equally good, and rounding decides between them.
    """
    np.testing.assert_array_equal(found.converged, expected.converged)
    done = found.converged
    np.testing.assert_allclose(found.dq[done], expected.dq[done], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.dq, expected.dq, rtol=0, atol=1e-8)
    np.testing.assert_allclose(found.error, expected.error, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.evaluations, expected.evaluations)


@pytest.mark.parametrize(("name", "n"), [("rotary_delta", 100), ("six_rod_delta", 30)])
def test_it_is_the_swarm_of_numpy(name, n):
    made, (q, target) = Made(name), tasks(n)
    settings = ApsoSettings(bound_rad=BOUND, seed=3)
    found = Swarm(made.machine, settings).correct(q, target)
    assert_same(found, Apso(made.point, settings).correct(q, target))
    assert found.converged.all()
    assert len(np.unique(found.evaluations)) > 3  # they differ


@pytest.mark.parametrize(
    "change",
    [
        {"bound_rad": 1e-3},  # many corrections are larger
        {"bound_rad": symbols.LITTLE, "iterations": 40},
        {"bound_rad": 0.2},  # beyond the range of the series
        {"particles": 17},
        {"particles": 101},
        {"iterations": 1},
        {"iterations": 7},
        {"velocity_fraction": 0.5},
        {"cognitive": 1.4, "social": 2.3},
        {"seed": 12},
    ],
    ids=str,
)
def test_every_setting_means_the_same(change):
    settings = ApsoSettings(**{"bound_rad": BOUND, "tolerance": 1e-6, **change})
    made, (q, target) = Made("rotary_delta", 1), tasks(30, 1)
    expected = Apso(made.point, settings).correct(q, target)
    assert_same(Swarm(made.machine, settings).correct(q, target), expected)


@pytest.mark.parametrize(
    ("name", "bound"), [("rotary_delta", BOUND), ("rotary_delta", 0.2), ("six_rod_delta", BOUND)]
)
def test_what_is_out_of_reach_is_treated_alike(name, bound):
    """Part of the box has no pose, and some targets are out of reach."""
    made = Made(name, 2)
    settings = ApsoSettings(bound_rad=bound, tolerance=1e-3, iterations=60)
    rng = np.random.default_rng(2)
    q = rng.uniform(-np.pi, np.pi, (4000, 3))
    around = made.point(q + bound * rng.uniform(-1, 1, (40, 1, 3)))
    reached = np.isfinite(around).all(axis=2)
    some = np.flatnonzero(reached.any(axis=0) & ~reached.all(axis=0))[:40]
    q, target = q[some], around[reached.argmax(axis=0)[some], some]
    target[::5] = [0.0, 0.0, -3.0]
    q[7], target[8, 1] = np.nan, np.inf
    expected = Apso(made.point, settings).correct(q, target)
    found = Swarm(made.machine, settings).correct(q, target)
    if name == "rotary_delta":
        assert_same(found, expected)
    else:  # the local law ends where three spheres do, so the swarm goes another way
        np.testing.assert_array_equal(found.converged, expected.converged)
        far = np.linalg.norm(made.point(q + found.dq) - target, axis=1)
        done = found.converged
        np.testing.assert_allclose(found.error[done], far[done], rtol=0, atol=1e-9)
    assert len(q) == 40
    assert np.isinf(found.error).any()
    assert 5 < found.converged.sum() < 35


@pytest.mark.parametrize("name", DELTAS)
def test_a_target_has_one_answer_whatever_the_batch(name):
    n = 200
    solver, (q, target) = Swarm(Made(name).machine, HUNDREDTH), tasks(n)
    together = solver.correct(q, target)
    order = np.random.default_rng(0).integers(0, n, n)  # another order, some twice, some never
    shuffled = solver.correct(q[order], target[order])
    np.testing.assert_array_equal(shuffled.dq, together.dq[order])
    np.testing.assert_array_equal(shuffled.error, together.error[order])
    halves = [solver.correct(q[part], target[part]).dq for part in (slice(0, 7), slice(7, n))]
    np.testing.assert_array_equal(np.concatenate(halves), together.dq)
    for row in (0, n // 2, n - 1):
        alone = solver.correct(q[[row]], target[[row]])
        np.testing.assert_array_equal(alone.dq[0], together.dq[row])
    again = Swarm(Made(name).machine, HUNDREDTH).correct(q, target)
    np.testing.assert_array_equal(again.dq, together.dq)


def test_another_seed_is_another_search():
    made, (q, target) = Made("rotary_delta"), tasks(50)
    one, two = (
        Swarm(made.machine, ApsoSettings(bound_rad=BOUND, seed=seed)).correct(q, target)
        for seed in (0, 1)
    )
    assert np.all(np.any(one.dq != two.dq, axis=1))
    np.testing.assert_allclose(one.dq, two.dq, rtol=0, atol=2e-6)


def test_it_brings_a_machine_written_apart_to_its_targets():
    made, (q, target) = Made("six_rod_delta", 5), tasks(30, 5)
    apart = SixRods(made.errors)
    before = np.linalg.norm(apart.point(q, TOOL) - target, axis=1)
    settings = ApsoSettings(bound_rad=BOUND, tolerance=1e-6)
    found = Swarm(made.machine, settings).correct(q, target)
    after = np.linalg.norm(apart.point(q + found.dq, TOOL) - target, axis=1)
    assert before.min() > 1e-5
    assert after.max() <= 1e-6
    np.testing.assert_allclose(found.error, after, rtol=0, atol=1e-11)


def test_it_agrees_with_newton_to_the_tolerance():
    made, (q, target) = Made("rotary_delta", 6), tasks(500, 6)
    settings = ApsoSettings(bound_rad=BOUND)
    found = Swarm(made.machine, settings).correct(q, target)
    newton = Newton(made.machine, NewtonSettings(bound_rad=BOUND)).correct(q, target)
    steps = 1e-6 * np.eye(3)
    slope = [(made.point(q + step) - made.point(q - step)) / 2e-6 for step in steps]
    weakest = np.linalg.svd(np.stack(slope, axis=-1), compute_uv=False).min()
    np.testing.assert_allclose(found.dq, newton.dq, rtol=0, atol=1.05e-7 / weakest)


def test_series_of_a_little_turn_is_off_by_less_than_rounding():
    """Computed in extended precision, to see the truncation error and not the rounding."""
    d = np.linspace(-symbols.LITTLE, symbols.LITTLE, 2001, dtype=np.longdouble)
    assert np.finfo(d.dtype).eps < 1e-18
    cos, sin = symbols.little(d)
    np.testing.assert_array_less(np.abs(cos - np.cos(d)), 3e-17)
    np.testing.assert_array_less(np.abs(sin - np.sin(d)), 3e-17)


@pytest.mark.parametrize("count", [1, 5, 24])
@pytest.mark.parametrize("name", DELTAS)
def test_the_law_of_places_nearby_is_the_direct_problem(name, count):
    """All lanes at once, for any number of them."""
    made, rng = Made(name, 3), np.random.default_rng(count)
    law, compiled = made.mechanism._nearby, made.machine.compiled
    q, d = np.array([0.3, 0.8, -0.1]), rng.uniform(-symbols.LITTLE, symbols.LITTLE, (3, count))
    around, size = made.mechanism.around(symbols.LITTLE), law.compiled.size
    work = np.full(size + 4 * count, 7.0)
    work[size : size + 3 * count] = d.ravel()
    swarm_kernel._set_machine(around, compiled, count, work)
    target = np.array([0.1, -0.2, -0.6])
    assert set_command(made, around, q, target, work)
    _called(around.law[FULL], work)
    there = np.linalg.norm(made.point(q + d.T) - target, axis=1)
    np.testing.assert_allclose(np.sqrt(work[size + 3 * count :]), there, rtol=0, atol=1e-11)


@pytest.mark.parametrize("name", DELTAS)
def test_no_law_is_asked_about_a_command_at_which_nothing_stands(name):
    made, rng = Made(name, 3), np.random.default_rng(1)
    wild = rng.uniform(-np.pi, np.pi, (4000, 3))
    apart = wild[np.isnan(made.point(wild)).any(axis=1)][0]
    around = made.mechanism.around(symbols.LITTLE)
    work = np.zeros(made.mechanism._nearby.compiled.size + 4)
    assert not set_command(made, around, apart, np.zeros(3), work)


def set_command(made, around, q, target, work):
    machine, signals = made.machine.compiled, made.machine.resting(q[None]).rows[0]
    room = scratch(machine, len(signals))
    return swarm_kernel._set_command(machine, around, signals, target, work, room)


@njit
def _called(address, work):
    call(address, work)


def test_shapes_are_checked():
    with pytest.raises(InputError, match="target has shape"):
        Swarm(Made("rotary_delta").machine).correct(np.zeros((2, 3)), np.zeros((3, 3)))


def test_no_swarm_is_compiled_for_newton():
    script = (
        "import sys, numpy as np;"
        "from delta_calibration.chain import Chain;"
        "from delta_calibration.compensation import IdentifiedMachine, Newton;"
        "from delta_calibration.robot import load_robot;"
        "model = load_robot('srbd').model('rotary_delta');"
        "chain = Chain(model, np.zeros(3), 0.05);"
        "theta = np.concatenate([model.parameters.nominal, np.zeros(9)]);"
        "machine = IdentifiedMachine(chain, theta, np.zeros(3));"
        "q = np.zeros((1, 3));"
        "Newton(machine).correct(q, machine.point(q));"
        "assert 'delta_calibration.compensation.backward_kernel' in sys.modules;"
        "sys.exit('delta_calibration.compensation.swarm_kernel' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_a_change_of_another_file_is_seen(tmp_path: Path):
    """The stored code contains functions of other files, and must be renewed with them."""
    (tmp_path / "outer.py").write_text(
        "from inner import more\n"
        "from delta_calibration.model.jit import compiled\n"
        "@compiled('i8(i8)')\n"
        "def twice(x):\n"
        "    return 2 * more(x)\n"
    )

    def run(more: int) -> tuple[str, ...]:
        (tmp_path / "inner.py").write_text(
            "from delta_calibration.model.jit import compiled\n"
            "@compiled()\n"
            "def more(x):\n"
            f"    return x + {more}\n"
        )
        script = "import outer; print(outer.twice(0), sum(outer.twice.stats.cache_hits.values()))"
        environment = {
            **os.environ,
            "PYTHONPATH": f"{tmp_path}:{os.environ.get('PYTHONPATH', '')}",
            "PYTHONDONTWRITEBYTECODE": "1",
        }
        done = subprocess.run(
            [sys.executable, "-c", script],
            check=True,
            capture_output=True,
            text=True,
            env=environment,
        )
        return tuple(done.stdout.split())

    assert run(1) == ("2", "0")
    assert run(1) == ("2", "1")
    assert run(3) == ("6", "0")


def test_beside_modules_that_import_each_other_a_function_is_compiled(tmp_path: Path):
    """As in a benchmark, the sources on which the function depends import each other."""
    (tmp_path / "own.py").write_text(
        "from delta_calibration.mechanisms import Mechanism\n"
        "from delta_calibration.model.jit import compiled\n"
        "@compiled('i8(i8)')\n"
        "def twice(x):\n"
        "    return 2 * x\n"
        "print(twice(21))\n"
    )
    environment = {**os.environ, "PYTHONDONTWRITEBYTECODE": "1"}
    own = [sys.executable, str(tmp_path / "own.py")]
    done = subprocess.run(own, check=True, capture_output=True, text=True, env=environment)
    assert done.stdout.split() == ["42"]
