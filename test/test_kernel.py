"""The compiled geometry is that of the mechanisms, and corrects as their Newton's method does."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import (
    Compensated,
    JointCompensator,
    Newton,
    NewtonSettings,
    Verdict,
)
from delta_calibration.compensation import compiled as compiled_module
from delta_calibration.compensation.compiled import (
    CompiledDrawing,
    CompiledGeometry,
    CompiledNewton,
)
from delta_calibration.errors import InputError
from delta_calibration.geometry import Frame
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from six_rods import SixRods, workspace

ROBOT = load_robot("srbd")
DELTAS = ("rotary_delta", "six_rod_delta")
TOOL = np.array([0.02, -0.03, -0.08])


class Machine:
    """A machine `scale` times as far from its drawing as one expects; its tool by numpy."""

    def __init__(self, name, seed=0, scale=1.0):
        self.mechanism = ROBOT.model(name)
        rng, parameters = np.random.default_rng(seed), self.mechanism.parameters
        drawn = scale * parameters.prior * rng.standard_normal(len(parameters))
        self.errors = dict(zip(parameters.names, drawn, strict=True))
        self.geometry = parameters.nominal + drawn
        self.chain = Chain(self.mechanism, np.zeros(3), 0.05)
        self.compiled = CompiledGeometry(self.mechanism, self.geometry, TOOL)

    def point(self, q):
        return self.chain.point(self.mechanism.forward(q, self.geometry), TOOL)

    def jacobian(self, q):
        x = self.mechanism.forward(q, self.geometry)
        slope = self.mechanism.velocity_jacobian(q, x, self.geometry)
        return self.chain.point_by_pose(x, TOOL) @ slope

    def calibration(self, robot=ROBOT):
        """The truth itself as the calibration, over a cylinder."""
        turn = np.linspace(0, 2 * np.pi, 40)
        rim = [[0.6 * np.cos(a), 0.6 * np.sin(a), z] for a in turn for z in (-0.9, -0.55)]
        return Calibration(
            robot=robot,
            chain=self.chain,
            theta=self.chain.join(self.geometry, np.zeros(3), Frame.identity()),
            region=Region.of(np.array(rim)),
            joints_lower=robot.joints.lower,
            joints_upper=robot.joints.upper,
            noise_floor=1e-5,
            source="made",
            seal="0" * 64,
        )


def commands(n, seed=0):
    return workspace(n, np.random.default_rng(seed))


@pytest.fixture(scope="module", params=DELTAS)
def machine(request):
    return Machine(request.param)


@pytest.mark.parametrize("name", DELTAS)
@pytest.mark.parametrize("seed", range(5))
def test_points_and_jacobians_are_the_mechanisms(name, seed):
    machine, q = Machine(name, seed, scale=5.0), commands(300, seed)
    x = machine.mechanism.forward(q, machine.geometry)
    np.testing.assert_allclose(machine.compiled.pose(q), x, rtol=0, atol=1e-12)
    np.testing.assert_allclose(machine.compiled.point(q), machine.point(q), rtol=0, atol=1e-12)
    found = machine.compiled.jacobian(q)
    np.testing.assert_allclose(found, machine.jacobian(q), rtol=0, atol=1e-12)


def test_points_are_those_of_a_machine_written_apart():
    machine, q = Machine("six_rod_delta", 7, scale=3.0), commands(200, 7)
    apart = SixRods(machine.errors).point(q, TOOL)
    np.testing.assert_allclose(machine.compiled.point(q), apart, rtol=0, atol=1e-12)


def test_jacobian_is_the_slope_of_the_point(machine):
    q, h = commands(50), 1e-6
    steps = h * np.eye(3)
    slopes = [
        (machine.compiled.point(q + step) - machine.compiled.point(q - step)) / (2 * h)
        for step in steps
    ]
    found = machine.compiled.jacobian(q)
    np.testing.assert_allclose(found, np.stack(slopes, axis=-1), rtol=0, atol=1e-8)


def test_any_number_of_rows_in_any_layout(machine):
    q = commands(60)
    whole = machine.compiled.point(q)
    fixed = q.copy()
    fixed.flags.writeable = False
    for same in (fixed, np.asfortranarray(q), np.repeat(q, 2, axis=0)[::2]):
        np.testing.assert_array_equal(machine.compiled.point(same), whole)
    np.testing.assert_array_equal(machine.compiled.point(q[7:8]), whole[7:8])
    np.testing.assert_array_equal(machine.compiled.point(q[7]), whole[7])
    blocks = q.reshape(5, 12, 3)
    np.testing.assert_array_equal(machine.compiled.point(blocks), whole.reshape(5, 12, 3))
    assert machine.compiled.jacobian(blocks).shape == (5, 12, 3, 3)
    assert machine.compiled.point(q[:0]).shape == (0, 3)
    np.testing.assert_array_equal(q, commands(60))  # the caller's own is left alone


def test_rows_without_a_pose_are_nan_and_leave_the_others_alone(machine):
    q = np.random.default_rng(1).uniform(-np.pi, np.pi, (400, 3))
    q[5], q[6, 1], q[7, 2] = np.nan, np.inf, -np.inf
    with np.errstate(invalid="ignore"):
        there = np.isfinite(machine.point(q)).all(axis=1)
    assert 10 < np.sum(~there) < 390
    for found in (machine.compiled.point(q), machine.compiled.jacobian(q).reshape(-1, 9)):
        np.testing.assert_array_equal(np.isnan(found).all(axis=1), ~there)
        np.testing.assert_array_equal(np.isfinite(found).all(axis=1), there)
    assert np.isnan(machine.compiled.pose(q)[~there]).all()
    assert np.isinf(machine.compiled.condition(q[~there])).all()
    np.testing.assert_allclose(
        machine.compiled.point(q)[there], machine.point(q[there]), rtol=0, atol=1e-9
    )


def test_condition_is_the_mechanisms(machine):
    q = np.concatenate([commands(100), np.random.default_rng(2).uniform(-1.5, 2.2, (100, 3))])
    x = machine.mechanism.forward(q, machine.geometry)
    expected = machine.mechanism.condition(q, x, machine.geometry)
    assert np.nanmax(expected[np.isfinite(expected)]) > 5  # not only the middle
    np.testing.assert_allclose(machine.compiled.condition(q), expected, rtol=1e-8)


def test_another_geometry_of_the_same_machine_is_that_machine(machine):
    q, other = commands(50), Machine(machine.mechanism.name, seed=9, scale=3.0)
    before = machine.compiled.point(q)
    found = machine.compiled.at(other.geometry)
    for name in ("pose", "point", "jacobian", "condition"):
        np.testing.assert_array_equal(getattr(found, name)(q), getattr(other.compiled, name)(q))
    np.testing.assert_array_equal(machine.compiled.point(q), before)


@pytest.mark.parametrize("scale", [0.0, 1.0])
def test_a_compiled_drawing_is_the_mechanism_at_any_geometry(scale):
    plain, quick = Machine("rotary_delta", 3, scale), CompiledDrawing(
        ROBOT.dimensions, ROBOT.tolerances
    )  # fmt: skip
    q, g = commands(50), plain.geometry
    q[7] = np.nan
    with np.errstate(invalid="ignore"):
        x = plain.mechanism.forward(q, g)
        found = quick.forward(q, g)
    np.testing.assert_allclose(found, x, rtol=0, atol=1e-12)
    slope = plain.mechanism.velocity_jacobian(q, x, g)
    np.testing.assert_allclose(quick.velocity_jacobian(q, found, g), slope, rtol=0, atol=1e-12)


SETTINGS = {
    "as it is": NewtonSettings(),
    "a bound in the way": NewtonSettings(bound_rad=2e-3),
    "one step": NewtonSettings(iterations=1),
    "no halving": NewtonSettings(halvings=0, bound_rad=0.5),
    "nearly all singular": NewtonSettings(condition_limit=1.5),
}


@pytest.mark.parametrize("settings", SETTINGS.values(), ids=SETTINGS)
def test_newton_gives_the_same_corrections(machine, settings):
    q = commands(1000)
    target = machine.point(q + np.random.default_rng(3).normal(0.0, 2e-3, q.shape))
    target[::50] += [0.3, 0.0, 0.5]  # some far off
    target[3], q[4, 0], target[5] = np.nan, np.inf, [9.0, 0.0, 0.0]
    expected = Newton(machine.point, machine.jacobian, settings).correct(q, target)
    found = CompiledNewton(machine.compiled, settings).correct(q, target)
    np.testing.assert_array_equal(found.converged, expected.converged)
    np.testing.assert_allclose(found.dq, expected.dq, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.error, expected.error, rtol=0, atol=1e-12)
    done = expected.converged
    np.testing.assert_array_equal(found.evaluations[done], expected.evaluations[done])
    assert 0 < found.evaluations.max() <= 1 + settings.iterations * (settings.halvings + 2)
    assert np.abs(found.dq).max() <= settings.bound_rad
    for row in (0, 50, 3):
        alone = CompiledNewton(machine.compiled, settings).correct(q[[row]], target[[row]])
        np.testing.assert_array_equal(alone.dq[0], found.dq[row])


def test_newton_refuses_what_does_not_belong_together(machine):
    with pytest.raises(InputError, match="target has shape"):
        CompiledNewton(machine.compiled).correct(np.zeros((2, 3)), np.zeros((3, 3)))


@pytest.mark.parametrize(("method", "n"), [("newton", 1000), ("newton", 1), ("apso", 20)])
def test_same_answers_compiled_or_not(machine, method, n):
    robot = replace(ROBOT, tool_offset=TOOL)
    rng = np.random.default_rng(5)
    q = commands(n, seed=6)
    if n > 1:  # every guard
        q[::7] = rng.uniform(-1.0, 2.2, q[::7].shape)
        q[3], q[4] = np.nan, [-1.5, 3.0, 3.0]
    plain = JointCompensator(machine.calibration(robot), method)
    fast = JointCompensator(machine.calibration(robot), method, compiled=True)
    assert fast.compiled
    assert not plain.compiled
    fast.warm_up()
    expected, found = plain.compensate(q), fast.compensate(q)
    assert found.verdicts == expected.verdicts
    assert Verdict.CORRECTED in found.verdicts
    np.testing.assert_allclose(found.joint, expected.joint, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.model_error, expected.model_error, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found.evaluations, expected.evaluations)
    np.testing.assert_allclose(fast.targets(q), plain.targets(q), rtol=0, atol=1e-12)
    np.testing.assert_allclose(fast.jacobian(q), plain.jacobian(q), rtol=1e-9, atol=1e-12)


def test_one_command_meets_every_guard_and_correction_that_numpy_has_for_many(machine):
    limits = replace(ROBOT.limits, correction=2e-3, condition=4.0, region_margin=0.1)
    joints = replace(ROBOT.joints, lower=np.full(3, -1.6), upper=np.full(3, 2.6))
    robot = replace(ROBOT, tool_offset=TOOL, limits=limits, joints=joints)
    rng = np.random.default_rng(8)
    wide, middle = rng.uniform(-1.8, 2.8, (150, 3)), rng.uniform(-0.5, 1.6, (150, 3))
    q = np.concatenate([commands(150, seed=9), wide, middle])
    q[3], q[4], q[5] = [np.nan, 0.1, 0.2], [0.1, np.inf, 0.2], np.nan
    plain = JointCompensator(machine.calibration(robot)).compensate(q)
    fast = JointCompensator(machine.calibration(robot), compiled=True)
    alone = Compensated.joined([fast.compensate(row[None]) for row in q])
    assert alone.verdicts == plain.verdicts
    elsewhere = {Verdict.OUTSIDE_TABLE, Verdict.MISSING_CONDITION, Verdict.SLACK}
    assert set(alone.verdicts) == set(Verdict) - elsewhere
    assert any(v is Verdict.CORRECTED and plain.blended(k) for k, v in enumerate(plain.verdicts))
    for name in ("joint", "correction", "model_error", "share"):
        np.testing.assert_allclose(
            getattr(alone, name), getattr(plain, name), rtol=0, atol=1e-12, err_msg=name
        )
    # a search along the bound comes to its end by rounding, sooner or later
    found = plain.model_error < 1e-9
    assert found.sum() > 100
    np.testing.assert_array_equal(alone.evaluations[found], plain.evaluations[found])


def test_without_numba_numpy_does_the_work_and_it_says_so(machine, monkeypatch):
    def absent():
        raise ImportError("no numba")

    monkeypatch.setattr(compiled_module, "_kernel", absent)
    compensator = JointCompensator(machine.calibration(), compiled=True)
    assert not compensator.compiled
    assert compensator.compensate(commands(1)).verdicts == (Verdict.CORRECTED,)


def test_every_delta_has_a_compiled_form_and_nothing_else_pretends_to():
    class Other(MECHANISMS["rotary_delta"]):
        """Another closure, perhaps."""

    assert all(compiled_module.available(ROBOT.model(name)) for name in DELTAS)
    other = Other(ROBOT.dimensions, ROBOT.tolerances)
    assert not compiled_module.available(other)
    with pytest.raises(InputError, match="no compiled form"):
        CompiledGeometry(other, other.parameters.nominal, TOOL)


def test_numba_waits_until_it_is_asked_for():
    script = (
        "import sys, delta_calibration.compensation, delta_calibration.cli.fit;"
        "sys.exit('numba' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", script], check=False).returncode == 0


def test_compiles_where_nothing_can_be_kept(tmp_path: Path):
    """One small function: what matters is that numba finds no folder to write to."""
    (tmp_path / "small.py").write_text(
        "from delta_calibration.compensation.jit import compiled\n"
        "@compiled('i8(i8)')\n"
        "def double(x):\n"
        "    return 2 * x\n"
    )
    script = (
        "from numba.core import caching;"
        "caching.CacheImpl._locator_classes = [];"
        "import small; print(small.double(21), small.double.stats.cache_path)"
    )
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, "-c", script],
        check=True, capture_output=True, text=True, env=environment,
    )  # fmt: skip
    assert done.stdout.split() == ["42", "None"]
