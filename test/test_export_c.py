"""Tests of machines exported as C, compiled here and compared with the package's compensation."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import loops_in_c
from delta_calibration.compensation import CommandStatus, JointCompensator
from delta_calibration.effects import catalogue, effect_named
from delta_calibration.effects.base import SENSOR
from delta_calibration.errors import ConfigError
from delta_calibration.estimation import chain_of
from delta_calibration.export import c_files, c_laws, c_loops
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from export_bench import (
    COMPILER,
    QUICK,
    STRICT,
    Compiled,
    commands,
    doubles,
    machine,
    moving,
    needs_compiler,
)

pytestmark = needs_compiler
MACHINES = [
    ("srbd", "rotary_delta"),
    ("srbd", "six_rod_delta"),
    ("linear_delta", None),
    ("cdpr8", None),
    ("five_axis", None),
    ("scara", None),
    ("ur10", None),
]
SAME = 1e-10  # of the joint unit
WARM = 20e-6  # [1/K]
MAPS = {
    "position": {"width": 0.4, "centres": [0.1, 0.2, 0.1, 0.5, 0.0, 0.4]},
    "joint angle": {"width": 0.3, "centres": [0.1, 0.2, 0.1, 0.5, 0.0, 0.4]},
    "direction": {},
    "payload": {"width": 0.4, "centres": [0.1, 0.2, 0.1, 0.5, 0.0, 0.4]},
    "temperature": {},
    "speed": {},
}


def with_effects(robot, model, causes=None, scale=0.5):
    """A machine with all effects for which a command can be corrected, or some of them."""
    mechanism = chain_of(robot, model).mechanism
    effects, values = [], []
    rng = np.random.default_rng(7)
    for effect in catalogue(robot, mechanism):
        if effect.lacking or (causes is not None and effect.cause not in causes):
            continue
        *_, effect = effect.forms()  # the one with most parameters
        value = scale * effect.parameters.prior * rng.uniform(0.3, 0.9, len(effect.parameters))
        effect = effect.refined(value)
        if hasattr(effect, SENSOR):
            effect = replace(effect, sensor=effect.part)
            value = np.full(len(effect.parameters), WARM)
        if machine(robot, model, [effect], [value]).live:
            effects.append(effect)
            values.append(value)
    return machine(robot, model, effects, values)


@pytest.fixture(scope="module", name="with_all")
def with_all_fixture(tmp_path_factory):
    """Machines with all effects, and their C code; each is compiled once."""

    @cache
    def made(name, model):
        calibration = with_effects(load_robot(name), model)
        return calibration, Compiled(calibration, tmp_path_factory.mktemp("all"))

    return made


def held_against(calibration, made, n, far=0, least=0.8):
    """Correct commands both ways and compare; return the verdicts.

    Far from any pose the steps of Newton's method go anywhere, and rounding decides whether they
    reach one: a few of the far commands may have other verdicts.
    """
    q = commands(calibration.robot, calibration.chain.mechanism, n, far)
    at = moving(q, made.parts, calibration.chain.mechanism.joint_size)
    expected = JointCompensator(calibration).compensate(q, at)
    out, verdicts = made.correct(q, at)
    same = np.array([a is b for a, b in zip(verdicts, expected.verdicts, strict=True)])
    assert same[far:].all()
    assert np.count_nonzero(~same) <= far // 200
    np.testing.assert_allclose(out[same], expected.joint[same], rtol=0, atol=SAME)
    corrected = [verdict is CommandStatus.CORRECTED for verdict in verdicts]
    assert np.mean(corrected) > least
    return verdicts


@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_c_answers_as_the_compensator_does(name, model, tmp_path):
    robot = load_robot(name)
    plan = commands(robot, robot.commanded, 40, 0)
    at_drawing = robot.commanded.forward(plan, robot.commanded.parameters.nominal)
    region = Region.of(robot.commanded.position(at_drawing))
    calibration = machine(robot, model, region=region)
    made = Compiled(calibration, tmp_path)
    verdicts = held_against(calibration, made, 3000, 600, least=0.2)
    assert {CommandStatus.CORRECTED, CommandStatus.OUTSIDE_REGION} < set(verdicts)
    assert len(set(verdicts)) >= 3


@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_effects_take_part(name, model, with_all):
    calibration, made = with_all(name, model)
    assert len(calibration.live) >= 5
    held_against(calibration, made, 1000, 50)


def test_a_drift_is_that_of_the_session_s_end(tmp_path):
    """Whatever the time of a command is: another session's clock says nothing about it."""
    robot = load_robot("srbd")
    mechanism = chain_of(robot, "rotary_delta").mechanism
    drift = effect_named("joint_zero_drift", robot, mechanism, {})
    plain = machine(robot, "rotary_delta", [drift], [np.array([1e-3, -5e-4, 2e-4])])
    ended = replace(plain, ended=5400.0)
    held_against(ended, Compiled(ended, tmp_path, options=QUICK), 100)
    q = commands(robot, mechanism, 20, 0)
    shift = (
        JointCompensator(ended).compensate(q).joint - JointCompensator(plain).compensate(q).joint
    )
    np.testing.assert_allclose(shift, np.tile([-1.5e-3, 7.5e-4, -3e-4], (20, 1)), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_each_effect_by_itself(name, model, tmp_path):
    """Not optimised, unlike those with all effects: these are about a hundred programs."""
    robot = load_robot(name)
    for effect in catalogue(robot, chain_of(robot, model).mechanism):
        calibration = with_effects(robot, model, [effect.cause], 1.0)
        if calibration.live:
            made = Compiled(calibration, tmp_path / effect.cause, options=QUICK)
            held_against(calibration, made, 300, 10)


@pytest.mark.parametrize("family", MAPS)
def test_smooth_maps_take_part(family, tmp_path):
    robot = load_robot("srbd")
    mechanism = chain_of(robot, "rotary_delta").mechanism
    shape = {"family": family, "joint_size": 1.0, **MAPS[family]}
    effect = effect_named("unexplained", robot, mechanism, shape)
    value = 1e-4 * np.random.default_rng(3).standard_normal(len(effect.parameters))
    calibration = machine(robot, "rotary_delta", [effect], [value])
    made = Compiled(calibration, tmp_path)
    held_against(calibration, made, 500)
    assert made.parts == (("first",) if family == "temperature" else ())


def test_unknown_conditions_are_told_where_they_are_needed(tmp_path):
    robot = load_robot("srbd")
    calibration = with_effects(robot, "rotary_delta", ["joint_compliance", "thermal_growth_arm"])
    made = Compiled(calibration, tmp_path)
    assert made.parts == ("arm",)
    q = commands(robot, calibration.chain.mechanism, 5, 0)
    known, compensator = moving(q, made.parts), JointCompensator(calibration)
    unknown = {
        "payload": replace(known, payload=np.full(5, np.nan)),
        "payload_centre": replace(known, payload_centre=np.full((5, 3), np.nan)),
        "temperature": replace(known, temperature=np.full((5, 1), np.nan)),
        "direction": replace(known, direction=np.zeros((5, 3))),
    }
    for name, at in unknown.items():
        out, verdicts = made.correct(q, at)
        expected = compensator.compensate(q, at)
        assert verdicts == list(expected.verdicts)
        needed = name != "direction"
        assert set(verdicts) == {
            CommandStatus.MISSING_CONDITION if needed else CommandStatus.CORRECTED
        }
        np.testing.assert_allclose(out, expected.joint, rtol=0, atol=SAME)
    assert set(made.correct(q)[1]) == {CommandStatus.MISSING_CONDITION}


def test_a_machine_can_have_two_gears(tmp_path):
    robot = load_robot("srbd")
    geared = effect_named("transmission_error", robot, robot.model(), {"cycles": 33.0})
    effects = geared, replace(geared, cycles=50.0)
    values = np.array([2e-4, 0, 0, 0, 0, 0]), np.array([0, 0, 0, 0, 0, 3e-4])
    calibration = machine(robot, "rotary_delta", effects, values)
    q = commands(robot, calibration.chain.mechanism, 20, 0)
    out, verdicts = Compiled(calibration, tmp_path).correct(q)
    assert set(verdicts) == {CommandStatus.CORRECTED}
    np.testing.assert_allclose(
        out, JointCompensator(calibration).compensate(q).joint, rtol=0, atol=SAME
    )
    plain = JointCompensator(machine(robot, "rotary_delta")).compensate(q).joint
    waves = np.stack([2e-4 * np.sin(33 * out[:, 0]), 0 * out[:, 1], 3e-4 * np.cos(50 * out[:, 2])])
    np.testing.assert_allclose(out + waves.T, plain, rtol=0, atol=1e-9)


def test_without_effects_nothing_has_to_be_known(tmp_path):
    calibration = machine(load_robot("srbd"), "rotary_delta")
    made = Compiled(calibration, tmp_path)
    q = commands(calibration.robot, calibration.chain.mechanism, 50, 0)
    out, verdicts = made.correct(q)
    assert set(verdicts) == {CommandStatus.CORRECTED}
    np.testing.assert_allclose(out, JointCompensator(calibration).compensate(q).joint, atol=SAME)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e308])
def test_a_command_that_is_no_command_comes_back_as_it_is(value, tmp_path):
    calibration = machine(load_robot("srbd"), "rotary_delta")
    made = Compiled(calibration, tmp_path)
    q = np.array([[0.2, value, 0.1]])
    out, verdicts = made.correct(q)
    expected = CommandStatus.JOINT_LIMIT if np.isfinite(value) else CommandStatus.NOT_FINITE
    assert verdicts == [expected] == list(JointCompensator(calibration).compensate(q).verdicts)
    np.testing.assert_array_equal(out, q)


@pytest.mark.parametrize(("name", "model"), MACHINES)
def test_answers_depend_on_no_other_and_stay_in_their_room(name, model, with_all):
    calibration, made = with_all(name, model)
    q = commands(calibration.robot, calibration.chain.mechanism, 60, 20)
    at = moving(q, made.parts)
    expected, _ = made.correct(q, at)
    edge = np.full(made.room + 8, 12.5)
    made.library.correct_begin(doubles(edge))
    out = np.empty_like(q)
    for row in reversed(range(len(q))):
        given = ctypes.byref(made.given(at, row))
        made.library.correct_in(doubles(edge), doubles(q[row]), given, doubles(out[row]))
    np.testing.assert_array_equal(out, expected)
    assert set(edge[made.room :]) == {12.5}


def test_the_answer_may_take_the_place_of_the_command(tmp_path):
    calibration = machine(load_robot("srbd"), "rotary_delta")
    made = Compiled(calibration, tmp_path)
    q = commands(calibration.robot, calibration.chain.mechanism, 1, 0)
    expected, _ = made.correct(q)
    assert made.library.correct(doubles(q), None, doubles(q)) == 0
    np.testing.assert_array_equal(q, expected)


def test_two_machines_go_into_one_program(tmp_path):
    objects = []
    for prefix, model in (("left_", "rotary_delta"), ("right_", "six_rod_delta")):
        files = c_files(machine(load_robot("srbd"), model), f"{prefix}machine", prefix)
        (tmp_path / f"{prefix}machine.h").write_text(files.header)
        (tmp_path / f"{prefix}machine.c").write_text(files.source)
        objects.append(f"{prefix}machine.c")
    (tmp_path / "both.c").write_text(
        '#include "left_machine.h"\n#include "right_machine.h"\n'
        "int main(void) {\n"
        "    double q[LEFT_CORRECT_JOINTS] = {0.2, 0.1, 0.3}, a[3], b[RIGHT_CORRECT_JOINTS];\n"
        "    left_conditions at;\n"
        "    left_conditions_at_rest(&at);\n"
        "    return left_correct(q, &at, a) != LEFT_CORRECT_PASSED\n"
        "        || right_correct(q, 0, b) != RIGHT_CORRECT_PASSED || a[0] == b[0];\n"
        "}\n"
    )
    subprocess.run(
        [COMPILER, *STRICT, "both.c", *objects, "-o", "both", "-lm"], cwd=tmp_path, check=True
    )
    subprocess.run([str(tmp_path / "both")], check=True)


@pytest.mark.skipif(shutil.which("c++") is None, reason="no C++ compiler (c++) here")
def test_the_header_is_one_of_cpp_as_well(tmp_path):
    files = c_files(machine(load_robot("srbd"), "rotary_delta"), "machine")
    (tmp_path / "machine.h").write_text(files.header)
    (tmp_path / "use.cpp").write_text('#include "machine.h"\nint n = CORRECT_JOINTS;\n')
    strict = ["-std=c++17", "-Wall", "-Wextra", "-Werror", "-pedantic", "-c", "use.cpp"]
    subprocess.run(["c++", *strict], cwd=tmp_path, check=True)


def test_the_header_says_what_it_is_made_of():
    calibration = with_effects(load_robot("ur10"), None, ["thermal_growth_link", "backlash"])
    files = c_files(replace(calibration, source="a/*b*/ #error\nno??/"), "arm")
    for text in (
        calibration.robot.hash,
        calibration.seal,
        "serial_arm",
        "backlash, thermal_growth_link",
        "joint_3",
        "of 0: ",
        "#define CORRECT_TEMPERATURES 1",
    ):
        assert text in files.header
    assert "a/ *b* / #error no? ?/" in files.header
    assert '#include "arm.h"' in files.source
    assert "malloc" not in files.source


def test_a_law_with_an_unknown_operation_is_refused(tmp_path):
    file = tmp_path / "odd.py"
    file.write_text("def full(w):\n    t1 = [w[0]]\n    w[1] = t1\n")
    lines = c_laws._functions(str(file))["full"]
    with pytest.raises(ConfigError, match="List"):
        c_laws._function("odd_full", lines)


# --- loops


KINDS = c_loops.Kind("Rows", 2), c_loops.ROWS, c_loops.NUMBERS


@pytest.mark.parametrize("positive", [-1.0, 1.0])
def test_loops_do_in_c_what_they_do_here(positive, tmp_path):
    program = c_loops.Program({})
    made = program.add(loops_in_c.everything, KINDS)
    call = f"{made.name}((Rows){{rows, 3, 4}}, (Rows){{out, 3, 1}}, (Numbers){{settings, 2, 1}})"
    take = "double *rows, double *out, const double *settings"
    text = f"double everything({take}) {{ return {call}; }}"
    source = "\n".join(["#include <math.h>", c_loops.TYPES, program.text, text])
    (tmp_path / "loops.c").write_text(source, encoding="utf-8")
    command = [COMPILER, *STRICT, "-shared", "-fPIC", "-o", "loops.so", "loops.c", "-lm"]
    command.insert(1, "-Wno-unused-function")
    subprocess.run(command, cwd=tmp_path, check=True)
    library = ctypes.CDLL(str(tmp_path / "loops.so"))
    library.everything.restype = ctypes.c_double
    rows = np.random.default_rng(1).uniform(-2, 2, (3, 4))
    settings, out, there = np.array([1.5, positive]), np.zeros(3), np.zeros(3)
    before = rows.copy()
    said = library.everything(doubles(rows), doubles(there), doubles(settings))
    np.testing.assert_array_equal(rows, before)
    assert said == loops_in_c.everything.py_func(rows, out, settings)
    np.testing.assert_allclose(there, out, rtol=1e-15)


@pytest.mark.parametrize(
    "function", [loops_in_c.remaining, loops_in_c.undecided, loops_in_c.listing]
)
def test_a_loop_that_has_no_c_is_refused_by_name(function):
    name = function.py_func.__name__
    with pytest.raises(ConfigError, match=rf"loops_in_c\.{name}.*(has no C|several kinds)"):
        c_loops.Program({}).add(function, (c_loops.ROWS,))


def test_an_effect_that_lacks_masses_is_not_exported():
    robot = load_robot("linear_delta")
    spring = effect_named("joint_compliance", robot, robot.model(), {})
    calibration = machine(robot, None, [spring], [np.full(3, 1e-6)])
    with pytest.raises(ConfigError, match="joint_compliance: the robot file states no masses"):
        c_files(calibration, "machine")
