"""Symbolic laws: generated code compared with closures written by hand, and its storage."""

from __future__ import annotations

import ctypes
import importlib
import math
import os
import pickle
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from importlib.metadata import version

import numpy as np
import pytest

from cables import EIGHT_CABLES, FOUR_CABLES, TOLERANCES, ZEROS_FREE
from closures_by_hand import BY_HAND, placed, walked
from delta_calibration import laws
from delta_calibration.errors import ConfigError
from delta_calibration.mechanisms import MECHANISMS, CableRobot, RotaryDelta, SerialArm
from delta_calibration.mechanisms.serial_dimensions import ArmTolerances
from delta_calibration.model import generated, kernels, library, symbols
from delta_calibration.model.chain_constants import SIDES
from delta_calibration.model.law import STAGES, Law
from delta_calibration.robot import load_robot
from machines import MODELS, complex_step, differences

PACKAGE = {law.name: law for law in laws.every_law()}
GENERATED = "delta_calibration.model.generated"
needs_casadi = pytest.mark.skipif(
    importlib.util.find_spec("casadi") is None, reason="generates code (extra [laws])"
)


def arm_of(joints):
    """An arm whose links are like those of the UR10, some parallel, with random dimensions."""
    rng, plain = np.random.default_rng(joints), load_robot("ur10").dimensions
    links = tuple(
        replace(
            plain.links[0],
            twist=rng.uniform(-2, 2),
            length=rng.uniform(-0.5, 0.5),
            offset=rng.uniform(-0.5, 0.5),
            parallel=i % 3 == 2,
        )
        for i in range(joints)
    )
    drawing = replace(
        plain,
        links=links,
        home=rng.uniform(-1, 1, joints),
        tool=rng.uniform(-0.1, 0.1, 3),
        mount=rng.uniform(-2, 2, 3),
    )
    return SerialArm(drawing, ArmTolerances(1e-3, 1e-3, 1e-3, 1e-3, 1e-3))


MACHINES = {
    **MODELS,
    "point": CableRobot(FOUR_CABLES, TOLERANCES),
    "point, zeros free": CableRobot(FOUR_CABLES, ZEROS_FREE),
    "body, zeros free": CableRobot(EIGHT_CABLES, ZEROS_FREE),
    **{f"arm of {joints}": arm_of(joints) for joints in (4, 5, 7)},
}


@pytest.fixture(params=MACHINES)
def mechanism(request):
    return MACHINES[request.param]


def disturbed(mechanism, rng, n):
    """Geometry of n machines with errors of centimetres and of a tenth of a radian."""
    units = np.array([p.unit for p in mechanism.parameters])
    size = np.select([units == "m", units == "rad"], [0.02, 0.1], 1e-4)
    return mechanism.parameters.nominal + size * rng.standard_normal((n, len(units)))


def anywhere(mechanism, rng, n):
    """Random joints, poses (rotated by up to 3.7 rad) and geometry; the closures are not met."""
    q = mechanism.home + mechanism.joint_size * rng.uniform(-2, 2, (n, mechanism.joints))
    x = mechanism.home_pose + rng.uniform(-0.3, 0.3, (n, mechanism.pose_size))
    if mechanism.pose_size == 6:
        way = rng.standard_normal((n, 3))
        way *= rng.uniform(0.0, 3.7, (n, 1)) / np.linalg.norm(way, axis=1, keepdims=True)
        x[:, 3:] = way
    elif mechanism.name == "five_axis":
        x[:, 2:] = rng.uniform(-3, 3, (n, 2))
    return q, x, disturbed(mechanism, rng, n)


def test_every_mechanism_is_written_twice():
    assert {*BY_HAND} == {*MECHANISMS} == {m.name for m in MACHINES.values()}


def test_closure_and_its_derivatives_are_those_by_hand(mechanism):
    """Each sample has another geometry; rotations of the platform exceed half a turn."""
    q, x, g = anywhere(mechanism, np.random.default_rng(1), 12)
    by_hand = BY_HAND[mechanism.name]
    real = mechanism.name == "serial_arm"  # scipy's rotations take no complex numbers
    if real:  # the rotation vector of the residual jumps at half a turn
        near = np.linalg.norm(by_hand(mechanism, q, x, g)[:, 3:], axis=1) < 3.0
        q, x, g = q[near], x[near], g[near]
        assert len(q) > 6
    slope, exact = (differences, 2e-9) if real else (complex_step, 1e-12)
    f = by_hand(mechanism, q, x, g)
    np.testing.assert_allclose(mechanism.closure(q, x, g), f, rtol=1e-12, atol=1e-13)
    for found, expected in (
        (mechanism.closure_by_pose, slope(lambda v: by_hand(mechanism, q, v, g), x)),
        (mechanism.closure_by_joints, slope(lambda v: by_hand(mechanism, v, x, g), q)),
        (mechanism.closure_by_geometry, slope(lambda v: by_hand(mechanism, q, x, v), g)),
    ):
        size = np.abs(expected).max()
        np.testing.assert_allclose(found(q, x, g), expected, rtol=0, atol=exact * size)


def test_points_of_the_platform_are_those_by_hand(mechanism):
    """Position, orientation and derivatives, also beyond half a turn; one offset and many."""
    rng = np.random.default_rng(5)
    _, x, _ = anywhere(mechanism, rng, 12)
    offset = rng.uniform(-0.3, 0.3, (12, 3))
    np.testing.assert_allclose(
        mechanism.points(x, offset), placed(mechanism, x, offset), atol=1e-13
    )
    exact = complex_step(lambda v: placed(mechanism, v, offset), x)
    np.testing.assert_allclose(mechanism.point_by_pose(x, offset), exact, atol=1e-13)
    shared = np.broadcast_to(offset[0], offset.shape)
    np.testing.assert_array_equal(mechanism.points(x, offset[0]), mechanism.points(x, shared))
    origin = placed(mechanism, x, np.zeros((12, 3)))
    np.testing.assert_allclose(mechanism.position(x), origin, atol=1e-15)
    for k, axis in enumerate(np.eye(3)):
        turned = placed(mechanism, x, np.broadcast_to(axis, (12, 3))) - origin
        np.testing.assert_allclose(mechanism.rotation(x)[:, :, k], turned, atol=1e-13)


def test_small_turn_by_the_pose_is_that_of_the_rotation(mechanism):
    """[dphi]x = dR R^T, with the rotation by hand and its derivative by complex step."""
    _, x, _ = anywhere(mechanism, np.random.default_rng(6), 6)

    def rotation(v):
        columns = [placed(mechanism, v, np.broadcast_to(e, (6, 3))) for e in np.eye(3)]
        return np.stack(columns, axis=-1) - placed(mechanism, v, np.zeros((6, 3)))[..., None]

    change = np.einsum("nijk,nlj->nilk", complex_step(rotation, x), rotation(x))
    expected = np.stack([change[:, 2, 1], change[:, 0, 2], change[:, 1, 0]], axis=1)
    np.testing.assert_allclose(mechanism.turn_by_pose(x), expected, atol=1e-12)


def test_jacobians_are_those_of_the_implicit_function_theorem(mechanism):
    """Compared with numpy's pseudoinverse; also for six quantities that depend on the pose."""
    rng = np.random.default_rng(2)
    q, x, g = anywhere(mechanism, rng, 5)
    f_x, f_q, f_g = (
        by(q, x, g)
        for by in (
            mechanism.closure_by_pose,
            mechanism.closure_by_joints,
            mechanism.closure_by_geometry,
        )
    )
    back = -np.linalg.pinv(f_x)
    by_pose = rng.standard_normal((5, 6, mechanism.pose_size))
    wanted = by_pose @ back @ f_q, by_pose @ back @ f_g
    worst = np.linalg.cond(f_x).max() ** 2
    for found, expected in zip(mechanism.moved_by(q, x, g, by_pose), wanted, strict=True):
        size = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14 * worst * size)
    eye = np.tile(np.eye(mechanism.pose_size), (5, 1, 1))
    np.testing.assert_array_equal(
        mechanism.velocity_jacobian(q, x, g), mechanism.moved_by(q, x, g, eye)[0]
    )


def test_an_arm_ends_where_scipy_says():
    for joints in (4, 5, 7):
        arm = arm_of(joints)
        rng = np.random.default_rng(joints)
        q = rng.uniform(-3, 3, (6, joints))
        g = disturbed(arm, rng, 6)
        x = arm.forward(q, g)
        for row, pose in enumerate(x):
            place, turn = walked(arm, q[row], g[row])
            np.testing.assert_allclose(pose[:3], place, atol=1e-13)
            np.testing.assert_allclose(arm.rotation(x)[row], turn.as_matrix(), atol=1e-12)


# --- bad input


def test_one_bad_sample_is_nan_alone(mechanism):
    """NaN and infinity in joints, task, guess or geometry."""
    home = np.tile(mechanism.home, (3, 1))
    g = np.tile(mechanism.parameters.nominal, (3, 1))
    x = mechanism.forward(home, g)
    task = x[:, : mechanism.task_size].copy()
    assert np.isfinite(mechanism.inverse(task, g)).all()
    for bad in (np.nan, np.inf):
        spoilt = {name: at.copy() for name, at in (("q", home), ("g", g), ("task", task))}
        for at in spoilt.values():
            at[1, 0] = bad
        found = [
            mechanism.forward(spoilt["q"], g),
            mechanism.forward(home, spoilt["g"]),
            mechanism.forward(spoilt["q"], g, x),
            mechanism.inverse(spoilt["task"], g),
            mechanism.inverse(task, spoilt["g"]),
            mechanism.inverse(spoilt["task"], g, home),
        ]
        for each in found:
            assert np.isnan(each[1]).any()
            np.testing.assert_array_equal(np.isfinite(each).all(axis=1), [True, False, True])


def test_what_has_another_shape_is_refused(mechanism):
    """The compiled loops would read beyond the array."""
    q, x, g = anywhere(mechanism, np.random.default_rng(3), 3)
    guesses = []  # a solution in closed form ignores the guess
    if not mechanism.exact:
        guesses.append(lambda: mechanism.forward(q, g[0], x[1:]))
    if mechanism.damped or mechanism.reaching is None:
        guesses.append(lambda: mechanism.inverse(x[:, : mechanism.task_size], g, q[1:]))
    for call in (
        lambda: mechanism.closure(q[:, 1:], x, g),
        lambda: mechanism.closure(q, x[1:], g),
        lambda: mechanism.closure(q, x, g[:, 1:]),
        lambda: mechanism.closure(q, x, g[:2]),
        lambda: mechanism.closure(q, x, np.append(g[0], 0.0)),
        lambda: mechanism.forward(q, g[:2]),
        lambda: mechanism.inverse(x[:, : mechanism.task_size - 1], g),
        *guesses,
        lambda: mechanism.moved_by(q, x, g, np.zeros((3, SIDES + 1, mechanism.pose_size))),
        lambda: mechanism.moved_by(q, x, g, np.zeros((2, 3, mechanism.pose_size))),
    ):
        with pytest.raises((ValueError, IndexError)):
            call()


def test_memory_of_any_layout_gives_the_same_and_compiles_nothing(mechanism):
    q, x, g = anywhere(mechanism, np.random.default_rng(4), 3)
    expected = mechanism.closure(q, x, g)
    compiled_before = len(kernels.closures.signatures)
    still = [values.copy() for values in (q, x, g)]
    for values in still:
        values.flags.writeable = False
    np.testing.assert_array_equal(mechanism.closure(*still), expected)
    turned = [np.asfortranarray(values) for values in (q, x, g)]
    np.testing.assert_array_equal(mechanism.closure(*turned), expected)
    assert len(kernels.closures.signatures) == compiled_before


def test_threads_do_not_disturb_each_other():
    """Eight threads use new objects of one law for the first time at the same time."""
    model = load_robot("srbd").model("six_rod_delta")
    q, x, g = anywhere(model, np.random.default_rng(5), 200)
    expected = model.identification_jacobian(q, x, g)
    for _ in range(5):
        fresh = load_robot("srbd").model("six_rod_delta")
        with ThreadPoolExecutor(8) as pool:
            found = list(pool.map(lambda _, m=fresh: m.identification_jacobian(q, x, g), range(8)))
        assert all(np.array_equal(each, expected) for each in found)


def test_a_mechanism_that_was_used_goes_to_another_process():
    """Addresses of machine code are not pickled; they are not valid in another process."""
    model = load_robot("srbd").model("six_rod_delta")
    before = model.forward(np.zeros((1, 3)), model.parameters.nominal)
    script = (
        "import pickle, sys, numpy as np; m = pickle.load(sys.stdin.buffer);"
        "print(m.forward(np.zeros((1, 3)), m.parameters.nominal).tolist())"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], input=pickle.dumps(model), check=True, capture_output=True
    )
    np.testing.assert_array_equal(np.array(eval(done.stdout)), before)
    closure = model.laws[0]
    assert closure.compiled.addresses
    assert "compiled" not in vars(pickle.loads(pickle.dumps(closure)))


# --- generated files


@needs_casadi
def test_generated_files_are_those_of_the_laws():
    """If not, run `make laws`. With another version of CasADi only the results have to agree."""
    folder = laws.folder()
    assert {path.stem for path in folder.glob("*.py")} == {"__init__", *PACKAGE}
    alike = said_alike if version("casadi") == generated.CASADI else computed_alike
    files = {name: (folder / f"{name}.py").read_text(encoding="utf-8") for name in PACKAGE}
    stale = [name for name, law in PACKAGE.items() if not alike(law, files[name], law.source())]
    assert stale == [], "run `make laws`"


def said_alike(law, one, other):
    del law
    return one == other


def computed_alike(law, *texts):
    rng, count = np.random.default_rng(0), sum(size for _, size in law.groups)
    start = np.zeros(50000)
    start[:count] = rng.uniform(-1.0, 1.0, count)
    found = [start.copy() for _ in texts]
    for text, workspace in zip(texts, found, strict=True):
        if str(law.layout) not in text:
            return False
        run_text(text, workspace)
    outputs = slice(count, law.offsets["rest"])
    return np.allclose(found[0][outputs], found[1][outputs], rtol=1e-9, atol=1e-9, equal_nan=True)


def test_a_law_that_was_edited_is_noticed_in_either_way():
    law = PACKAGE["rotary_delta"]
    text = (laws.folder() / "rotary_delta.py").read_text(encoding="utf-8")
    edited = text.replace(" + ", " - ", 1)
    for alike in (said_alike, computed_alike):
        assert alike(law, text, text)
        assert not alike(law, text, edited)
        assert not alike(law, text, text.replace("('c', 2)", "('c', 3)"))


@needs_casadi
def test_generated_files_are_the_same_in_every_process(tmp_path):
    """Names and their order do not depend on the hash seed of Python."""
    names = ("six_rod_delta", "serial_arm_3_opening", "cable_robot_body")
    script = (
        "import sys; from pathlib import Path; from delta_calibration import laws\n"
        f"some = [law for law in laws.every_law() if law.name in {names}]\n"
        "print(len(laws.write(some, Path(sys.argv[1]))))"
    )
    for seed, changed in (("1", "4"), ("2", "0")):
        done = subprocess.run(
            [sys.executable, "-c", script, tmp_path],
            check=True,
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed},
        )
        assert done.stdout.strip() == changed


@needs_casadi
def test_writing_says_what_changed_and_removes_what_is_no_law(tmp_path):
    one, other = PACKAGE["linear_delta"], PACKAGE["five_axis"]
    own, gone, init = (tmp_path / f"{name}.py" for name in (one.name, "gone", "__init__"))
    assert laws.write([one], tmp_path) == (own, init)
    assert laws.write([one], tmp_path) == ()
    gone.write_text("")
    own.write_text("edited")
    assert laws.write([one, other], tmp_path) == (own, tmp_path / "five_axis.py", gone)
    assert sorted(tmp_path.iterdir()) == [init, tmp_path / "five_axis.py", own]
    assert own.read_text(encoding="utf-8") == one.source()


def run_by_python(law, workspace):
    """Run the generated file as Python, with numpy's functions instead of LLVM's."""
    text = (laws.folder() / f"{law.name}.py").read_text(encoding="utf-8")
    return run_text(text, workspace)


def run_text(text, workspace):
    names = {
        "law": lambda function, *how: function,
        "idle": lambda: lambda workspace: None,
        "sqrt": np.sqrt,
        "sin": np.sin,
        "cos": np.cos,
        "acos": np.arccos,
        "atan2": np.arctan2,
        "floor": np.floor,
        "exp": np.exp,
        "log": np.log,
        "tanh": np.tanh,
        "tan": np.tan,
        "asin": np.arcsin,
        "atan": np.arctan,
        "sinh": np.sinh,
        "cosh": np.cosh,
        "ceil": np.ceil,
        "inf": np.inf,
        "nan": np.nan,
    }
    lines = (line for line in text.splitlines() if not line.startswith("from "))
    exec("\n".join(lines), names)
    with np.errstate(all="ignore"):
        for stage in STAGES:
            names["ADDRESSES"][stage](workspace)
    return names["SIZE"]


def run_compiled(law, workspace):
    kind = ctypes.CFUNCTYPE(None, ctypes.POINTER(ctypes.c_double))
    place = workspace.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
    for address in law.compiled.addresses:
        kind(address)(place)


@pytest.mark.parametrize("name", sorted(PACKAGE))
def test_machine_code_does_what_the_generated_file_says(name):
    law, rng = PACKAGE[name], np.random.default_rng(6)
    for _ in range(3):
        start = np.zeros(law.compiled.size)
        count = sum(size for _, size in law.groups)
        start[:count] = rng.uniform(-1.0, 1.0, count)
        here, there = start.copy(), start.copy()
        assert run_by_python(law, here) == law.compiled.size
        if law.lanes:
            there = one_of_three_lanes(law, there)
        else:
            run_compiled(law, there)
        np.testing.assert_allclose(there, here, rtol=1e-9, atol=1e-9)


def one_of_three_lanes(law, start):
    """Workspace of the second of three lanes; the other lanes have other inputs."""
    size, (first, last) = law.compiled.size, own_slots(law, law.lanes)
    begin, end = own_slots(law, "f")
    lanes = start[first:last, None] + [0.3, 0.0, -0.2]
    start[-1] = lanes.shape[1]
    whole = np.concatenate([start, lanes.ravel(), np.full(3 * (end - begin), 7.0)])
    run_compiled(law, whole)
    found = whole[size + lanes.size :].reshape(-1, 3)
    assert np.ptp(found, axis=1).all()
    whole[begin:end], whole[size - 1] = found[:, 1], 0.0
    return whole[:size]


def own_slots(law, name):
    first = law.offsets[name]
    return first, first + {**dict(law.groups), "f": law.outputs}[name]


def test_near_and_full_agree():
    """Newton's steps use the same values as the Jacobians."""
    model = load_robot("srbd").model("six_rod_delta")
    q, x, g = anywhere(model, np.random.default_rng(7), 4)
    near, full = (model._closed(q, x, g, derivatives=some) for some in (False, True))
    np.testing.assert_array_equal(near[0], full[0])
    np.testing.assert_array_equal(near[1], full[1])


# --- laws of users

VOCABULARY = {
    "sin": (lambda v: symbols.sin(v[0]), lambda a, b: np.sin(a)),
    "cos": (lambda v: symbols.cos(v[0]), lambda a, b: np.cos(a)),
    "acos": (lambda v: symbols.acos(v[0] / 3), lambda a, b: np.arccos(a / 3)),
    "atan2": (lambda v: symbols.atan2(v[0], v[1]), np.arctan2),
    "sqrt": (lambda v: symbols.sqrt(v[0] + 3), lambda a, b: np.sqrt(a + 3)),
    "exp": (lambda v: symbols.exp(v[0]), lambda a, b: np.exp(a)),
    "tanh": (lambda v: symbols.tanh(v[0]), lambda a, b: np.tanh(a)),
    "sign": (lambda v: symbols.sign(v[0]), lambda a, b: np.sign(a)),
    "minimum": (lambda v: symbols.minimum(v[0], v[1]), np.minimum),
    "maximum": (lambda v: symbols.maximum(v[0], v[1]), np.maximum),
    "floor": (lambda v: symbols.floor(v[0]), lambda a, b: np.floor(a)),
    "where": (
        lambda v: symbols.where(v[0] < v[1], 2 * v[0], -v[1]),
        lambda a, b: np.where(a < b, 2 * a, -b),
    ),
    "both": (
        lambda v: symbols.where(symbols._casadi().logic_and(v[0] <= 1, v[1] != 0), 1.0, 0.0),
        lambda a, b: np.where((a <= 1) & (b != 0), 1.0, 0.0),
    ),
    "either": (
        lambda v: symbols.where(symbols._casadi().logic_or(v[0] == 0, v[1] < 0), 1.0, 0.0),
        lambda a, b: np.where((a == 0) | (b < 0), 1.0, 0.0),
    ),
    "power": (lambda v: (v[0] + 3) ** v[1], lambda a, b: (a + 3) ** b),
    "root": (lambda v: (v[0] + 3) ** 1.5, lambda a, b: (a + 3) ** 1.5),
    "whole power": (lambda v: v[0] ** 3, lambda a, b: a**3),
    "of a negative number": (
        lambda v: (-2.0) ** (2 * symbols.sign(v[1])),
        lambda a, b: (-2.0) ** (2 * np.sign(b)),
    ),
    "inverse": (lambda v: 1 / (v[0] - 0.3), lambda a, b: 1 / (a - 0.3)),
    "absolute": (lambda v: symbols.absolute(v[0]) - 2 * v[1], lambda a, b: np.abs(a) - 2 * b),
    "least of infinite": (
        lambda v: symbols.minimum(v[0], math.inf),
        lambda a, b: np.minimum(a, np.inf),
    ),
    "wrapped": (
        lambda v: symbols.wrapped(4 * v[0]),
        lambda a, b: np.pi - np.mod(np.pi - 4 * a, 2 * np.pi),
    ),
    "constant": (lambda v: symbols.column(0.25), lambda a, b: 0.25 + 0 * a),
}


@needs_casadi
@pytest.mark.parametrize("name", VOCABULARY)
def test_the_vocabulary_means_what_it_says(name, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    express, expected = VOCABULARY[name]
    law = Law(f"word_{name.replace(' ', '_')}", (("v", 2),), 1, express)
    for a, b in ((0.7, -1.3), (-1.9, 0.4), (0.0, 0.0), (1.0, 1.0), (2.5, -0.0)):
        wanted = expected(a, b)
        workspace = np.zeros(law.compiled.size)
        workspace[:2] = a, b
        run_compiled(law, workspace)
        assert workspace[law.offsets["f"]] == pytest.approx(float(wanted), abs=1e-15)


@needs_casadi
def test_large_turns_of_the_vocabulary_are_scipys():
    from scipy.spatial.transform import Rotation

    rng = np.random.default_rng(8)
    group = (("w", 3), ("v", 3))

    def turned(w, v):
        both = symbols.quaternion_product(symbols.quaternion(w), symbols.quaternion(v))
        return symbols.column(symbols.rotation(w) @ v, symbols.rotation_vector(both))

    law = Law("turned", group, 6, turned)
    text = law.source()
    for size in (0.0, 1e-13, 1e-6, 0.4, 2.0, math.pi - 1e-6, math.pi, 4.0):
        w = rng.standard_normal(3)
        w *= size / np.linalg.norm(w)
        v = 0.3 * rng.standard_normal(3)
        workspace = np.zeros(4000)
        workspace[:6] = [*w, *v]
        run_text(text, workspace)
        found = workspace[law.offsets["f"] :][:6]
        np.testing.assert_allclose(found[:3], Rotation.from_rotvec(w).apply(v), atol=1e-14)
        both = Rotation.from_rotvec(w) * Rotation.from_rotvec(v)
        np.testing.assert_allclose(
            Rotation.from_rotvec(found[3:]).as_matrix(), both.as_matrix(), atol=1e-13
        )
        assert np.linalg.norm(found[3:]) <= math.pi + 1e-12


OWN = '''
import numpy as np
import lengths
from delta_calibration.mechanisms import Mechanism
from delta_calibration.model.symbols import square
from delta_calibration.parameters import Parameter, ParameterSet


class Own(Mechanism):
    """A point on three rods."""

    name = "own"
    joints = pose_size = task_size = 3

    def __init__(self):
        self.parameters = ParameterSet(
            tuple(Parameter(f"a_{i}", "m", float(i % 4 == 0), 1e-3) for i in range(9))
        )

    home_pose = np.array([0.0, 0.0, -1.0])
    home = np.full(3, 1.2)

    @staticmethod
    def equation(q, x, g, c):
        import_of_numpy = np
        from delta_calibration.model.symbols import column
        return column(*(lengths.gap(square(x - g[3 * i : 3 * i + 3]), q[i]) for i in range(3)))


own = Own()
print(own.forward(np.full((1, 3), 1.2), own.parameters.nominal).round(12).tolist())
'''
LENGTHS = "def gap(square, q):\n    return square - (q + {more}) ** 2\n"
WITHOUT_CASADI = "import sys; sys.modules['casadi'] = None\n"


@pytest.fixture
def user(tmp_path, monkeypatch):
    """A user's program with a mechanism in two files, and a folder for its laws."""
    (tmp_path / "own.py").write_text(OWN)
    (tmp_path / "lengths.py").write_text(LENGTHS.format(more=0.0))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path


def run_user(before="", check=True):
    return subprocess.run(
        [sys.executable, "-c", f"{before}import own"], capture_output=True, text=True, check=check
    )


def kept(folder):
    return sorted(path.name for path in (folder / "cache/delta_calibration/laws").glob("own_*.py"))


@needs_casadi
def test_a_law_of_a_user_is_generated_once(user):
    first = run_user().stdout
    (name,) = kept(user)
    path = user / "cache/delta_calibration/laws" / name
    written = path.stat()
    assert run_user(WITHOUT_CASADI).stdout == first  # so it was loaded
    assert path.stat().st_mtime_ns == written.st_mtime_ns
    (user / "lengths.py").write_text(LENGTHS.format(more=0.1))
    assert run_user().stdout != first  # a change of a called function counts as well
    assert len(kept(user)) == 2


@needs_casadi
def test_two_processes_may_generate_at_once(user):
    def start(_):
        return run_user().stdout

    with ThreadPoolExecutor(4) as pool:
        printed = set(pool.map(start, range(4)))
    assert len(printed) == 1
    folder = user / "cache/delta_calibration/laws"
    assert [path for path in folder.iterdir() if path.is_file()] == [folder / kept(user)[0]]


def test_without_casadi_a_user_is_told_what_to_install(user):
    done = run_user(WITHOUT_CASADI, check=False)
    assert done.returncode != 0
    assert "law own: it is not one of the package's" in done.stderr
    assert "pip install casadi" in done.stderr


def test_laws_of_the_package_need_no_casadi():
    script = (
        "import sys; sys.modules['casadi'] = None\n"
        "from delta_calibration import laws; print(laws.prepare(laws.every_law()))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], check=True, capture_output=True, text=True
    )
    assert done.stdout.strip() == str(len(PACKAGE))


def test_missing_casadi_is_an_error_of_configuration(monkeypatch):
    monkeypatch.setitem(sys.modules, "casadi", None)
    law = Law("no_such", (("x", 1),), 1, lambda x: x)
    with pytest.raises(ConfigError, match=r"law no_such: .* needs CasADi: pip install casadi"):
        law.source()


@needs_casadi
def test_where_nothing_can_be_kept_laws_are_still_generated(user, monkeypatch):
    """The folder cannot be made because a file has its name."""
    expected = run_user().stdout
    (user / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(user / "file"))
    assert run_user().stdout == expected
    monkeypatch.delenv("XDG_CACHE_HOME")
    before = "from pathlib import Path\ndef no(): raise RuntimeError('no home')\nPath.home = no\n"
    assert run_user(before).stdout == expected


@needs_casadi
def test_a_subclass_of_the_same_name_has_its_own_law(tmp_path, monkeypatch):
    """A subclass with another closure, or with limbs of another size, keeps the name."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    robot = load_robot("srbd")

    class Doubled(RotaryDelta):
        @staticmethod
        def equation(q, x, g, c):
            return 2 * RotaryDelta.equation(q, x, g, c)

    class Longer(RotaryDelta):
        @property
        def limbs(self):
            return tuple(replace(limb, constants=(*limb.constants, 1.0)) for limb in super().limbs)

    plain = robot.model("rotary_delta")
    q, x, g = anywhere(plain, np.random.default_rng(9), 3)
    f = plain.closure(q, x, g)
    doubled, longer = (kind(robot.dimensions, robot.tolerances) for kind in (Doubled, Longer))
    np.testing.assert_allclose(doubled.closure(q, x, g), 2 * f, rtol=1e-14)
    np.testing.assert_array_equal(longer.closure(q, x, g), f)
    names = [path.stem.rpartition("_")[0] for path in library.cache_folder().glob("*.py")]
    assert names.count("rotary_delta") == 2


@needs_casadi
@pytest.mark.parametrize(
    ("express", "said"),
    [
        (lambda x: symbols.column(x, x), "law wrong: 2 outputs; 1 are to be given"),
        (lambda x: symbols._casadi().erf(x), "law wrong: operation .* not one of the vocabulary"),
    ],
)
def test_a_law_that_cannot_be_generated_is_refused(express, said):
    with pytest.raises(ConfigError, match=said):
        Law("wrong", (("x", 1),), 1, express).source()


# --- installation


def machine_code(said):
    """Files of machine code that a process has loaded or saved."""
    return {*re.findall(r"\[cache\] data (?:loaded from|saved to) '([^']+)'", said)}


@pytest.mark.slow
@pytest.mark.timeout(1200)  # compiles everything if it is the first test to run
def test_after_installing_nothing_is_left_to_compile(tmp_path):
    """`make install` compiles last; a later fit of a session needs no further machine code.

    Files are compared by name, so the result does not depend on whether they existed before.
    """
    # two processes write: with buffers, the end of one's would tear a line of the other
    own = {**os.environ, "NUMBA_DEBUG_CACHE": "1", "PYTHONUNBUFFERED": "1"}

    def run(*arguments):
        return subprocess.run(
            [sys.executable, "-m", *arguments],
            check=True,
            capture_output=True,
            text=True,
            env=own,
            cwd=tmp_path,
        ).stdout

    warmed = run("delta_calibration.cli.warm")
    # text and end of line are written apart, so a line may hold two texts, or none
    lines = [line for line in warmed.splitlines() if line and not line.startswith("[cache]")]
    assert len(lines) == 1
    assert lines[0].startswith(f"compiled: {len(PACKAGE)} laws")
    main = "delta_calibration.cli.main"
    plan = ("--plan", "identify", "--count", "30", "--seed", "1", "--out", "session")
    simulated = run(main, "simulate", "--robot", "srbd", *plan)
    fitted = run(main, "fit", "session", "--robot", "srbd", "--out", "calibration.yaml")
    assert "data saved" not in simulated + fitted
    (tmp_path / "targets.csv").write_text("x_mm,y_mm,z_mm\n0,0,-750\n")
    files = ("targets.csv", "--calibration", "calibration.yaml", "--out", "commands.csv")
    corrected = run(main, "compensate", *files, "--robot", "srbd")  # by the usual method, a swarm
    assert "data saved" not in corrected
    assert machine_code(corrected) <= machine_code(warmed)
    assert machine_code(fitted)
    assert machine_code(simulated + fitted) <= machine_code(warmed)
    # needed by the first command in a cell
    assert any("usual_kernel.follow" in file for file in machine_code(warmed))
