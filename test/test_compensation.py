from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from delta_calibration.chain import Chain
from delta_calibration.compensation import (
    Apso,
    ApsoSettings,
    Compensator,
    IdentifiedMachine,
    Newton,
    NewtonSettings,
    backward_kernel,
)
from delta_calibration.compensation.apso import inertia, swarm_entropy, velocity
from delta_calibration.errors import InputError
from delta_calibration.mechanisms import Mechanism
from delta_calibration.robot import load_robot

Array = NDArray[np.float64]

ETA = np.deg2rad([0.0, 120.0, 240.0])
UNIT = np.stack([np.cos(ETA), np.sin(ETA), 0 * ETA], axis=1)


class ToyDelta:
    """The paper's Delta as three spheres, written without any code of the package."""

    def __init__(self, rng: np.random.Generator | None = None) -> None:
        """Take the nominal sizes, with realistic errors if there is an rng."""
        errors = np.zeros((6, 3)) if rng is None else rng.normal(size=(6, 3))
        self.base = (0.200 - 0.055) * UNIT + 2.5e-4 * errors[:3]
        self.arm = 0.320 + 1.5e-4 * errors[3]
        self.rod = 0.850 + 2e-4 * errors[4]
        self.zero = 8e-4 * errors[5]

    def elbows(self, q: Array) -> Array:
        a = (q + self.zero)[..., None]
        return self.base + self.arm[:, None] * (np.cos(a) * UNIT - np.sin(a) * [0, 0, 1])

    def point(self, q: Array) -> Array:
        """Lower of the two points at the rod lengths from the elbows; NaN if there is none."""
        e0, e1, e2 = np.moveaxis(self.elbows(q), -2, 0)
        a, b = e1 - e0, e2 - e0
        n = np.cross(a, b)
        nn = np.sum(n * n, axis=-1, keepdims=True)
        ka = 0.5 * (self.rod[0] ** 2 - self.rod[1] ** 2 + np.sum(a * a, axis=-1, keepdims=True))
        kb = 0.5 * (self.rod[0] ** 2 - self.rod[2] ** 2 + np.sum(b * b, axis=-1, keepdims=True))
        foot = (ka * np.cross(b, n) + kb * np.cross(n, a)) / nn
        with np.errstate(invalid="ignore"):
            rise = np.sqrt((self.rod[0] ** 2 - np.sum(foot**2, axis=-1, keepdims=True)) / nn)
        return e0 + foot - np.sign(n[..., 2:]) * rise * n

    def jacobian(self, q: Array) -> Array:
        rods = self.point(q)[..., None, :] - self.elbows(q)
        a = (q + self.zero)[..., None]
        turn = self.arm[:, None] * (-np.sin(a) * UNIT - np.cos(a) * [0, 0, 1])
        return np.linalg.solve(rods, np.sum(rods * turn, axis=-1)[..., None] * np.eye(3))

    def machine(self) -> IdentifiedMachine:
        """The package's Delta with the same dimensions, for Newton's method."""
        cos, sin, none = np.cos(ETA), np.sin(ETA), np.zeros(3)
        x, y, z = self.base.T  # of each leg, to be transformed to its own frame
        place = [cos * x + sin * y, cos * y - sin * x, z]
        legs = np.stack([*place, none, none, self.zero, self.arm + none, self.rod + none], axis=1)
        return of(load_robot("srbd").model("rotary_delta"), legs.ravel(), np.zeros(3))

    def inverse(self, p: Array) -> Array:
        """Inverse kinematics of the nominal machine, arms outward: A sin q + B cos q = C."""
        u, z = p @ UNIT.T, p[..., 2:]
        a, b = 2 * 0.320 * z, 2 * 0.320 * (0.145 - u)
        c = 0.850**2 - 0.145**2 - 0.320**2 - np.sum(p * p, axis=-1, keepdims=True) + 0.290 * u
        return np.arctan2(a, b) + np.arccos(c / np.hypot(a, b))


def machine(seed: int) -> ToyDelta:
    return ToyDelta(np.random.default_rng(seed))


def of(mechanism: Mechanism, geometry: Array, tool: Array) -> IdentifiedMachine:
    chain = Chain(mechanism, np.zeros(3), 1.0)
    return IdentifiedMachine(chain, np.concatenate([geometry, np.zeros(9)]), tool)


def task(name: str, model: str | None = None) -> tuple[IdentifiedMachine, Array, Array]:
    """A robot's machine within its tolerances; commands, and their nominal targets."""
    robot, rng = load_robot(name), np.random.default_rng(3)
    mechanism = robot.model(model)
    parameters, m = mechanism.parameters, mechanism.joints
    off = parameters.nominal + 0.5 * parameters.prior * rng.standard_normal(len(parameters))
    drawn = of(mechanism, parameters.nominal, robot.tool_offset)
    some = rng.uniform(-0.1, 0.1, (9, mechanism.task_size))
    x = mechanism.forward(mechanism.home[None], parameters.nominal)
    slopes = mechanism.velocity_jacobian(mechanism.home[None], x, parameters.nominal)[0]
    poses = x + some @ np.eye(mechanism.task_size, m) @ slopes.T * mechanism.joint_size
    q = mechanism.inverse(poses[:, : mechanism.task_size], parameters.nominal)
    assert np.isfinite(q).all()
    return of(mechanism, off, robot.tool_offset), q, drawn.point(q)


OTHERS = [("srbd", "six_rod_delta"), ("scara", None), ("ur10", None), ("cdpr8", None)]


def paper_line(n: int) -> Array:
    """The paper's line: x = -y, z = -711 mm, |x| <= 450 mm."""
    x = np.linspace(-0.45, 0.45, n)
    return np.stack([x, -x, np.full(n, -0.711)], axis=1)


LINE = paper_line(31)
COMMANDS = ToyDelta().inverse(LINE)
SOLVERS: dict[str, Callable[[ToyDelta], Compensator]] = {
    "apso": lambda toy: Apso(toy.point),
    "newton": lambda toy: Newton(toy.machine()),
}


def test_toy_is_the_papers_delta() -> None:
    nominal = ToyDelta()
    np.testing.assert_allclose(nominal.point(COMMANDS), LINE, atol=1e-12)
    assert np.rad2deg([COMMANDS.min(), COMMANDS.max()]) == pytest.approx([-24.2, 94.2], abs=0.1)
    h = 1e-6 * np.eye(3)
    slopes = [(nominal.point(COMMANDS + d) - nominal.point(COMMANDS - d)) / 2e-6 for d in h]
    np.testing.assert_allclose(nominal.jacobian(COMMANDS), np.stack(slopes, -1), atol=1e-7)


def test_toy_and_machine_are_one() -> None:
    toy = machine(1)
    made = toy.machine()
    np.testing.assert_allclose(made.point(COMMANDS), toy.point(COMMANDS), atol=1e-12)
    for none in (np.zeros((0, 3)), np.zeros((4, 0, 3))):
        assert made.point(none).shape == none.shape


@pytest.mark.parametrize("name", SOLVERS)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_papers_line_is_put_right(name: str, seed: int) -> None:
    toy = machine(seed)
    before = np.linalg.norm(toy.point(COMMANDS) - LINE, axis=1)
    assert before.mean() > 2e-4  # there is something to correct
    result = SOLVERS[name](toy).correct(COMMANDS, LINE)
    after = np.linalg.norm(toy.point(COMMANDS + result.dq) - LINE, axis=1)
    assert result.converged.all()
    assert after.max() <= 1e-7
    np.testing.assert_allclose(result.error, after, atol=1e-12)
    assert np.all(result.evaluations > 0)


def test_both_find_the_same_correction() -> None:
    toy = machine(4)
    swarm = SOLVERS["apso"](toy).correct(COMMANDS, LINE)
    newton = SOLVERS["newton"](toy).correct(COMMANDS, LINE)
    # 1e-7 m of tolerance over the smallest singular value of J
    weakest = np.linalg.svd(toy.jacobian(COMMANDS), compute_uv=False).min()
    np.testing.assert_allclose(swarm.dq, newton.dq, atol=1.05e-7 / weakest)
    assert newton.evaluations.max() < 0.05 * swarm.evaluations.min()


@pytest.mark.parametrize("name", SOLVERS)
def test_a_machine_without_error_needs_no_correction(name: str) -> None:
    result = SOLVERS[name](ToyDelta()).correct(COMMANDS, LINE)
    assert np.all(result.dq == 0.0)
    assert result.converged.all()


# Independence of the batch, reproducibility


@pytest.mark.parametrize("name", SOLVERS)
def test_answer_depends_on_neither_row_nor_neighbours(name: str) -> None:
    solver = SOLVERS[name](machine(5))
    q, target = COMMANDS[:9], LINE[:9]
    together = solver.correct(q, target)
    order = np.array([8, 0, 3, 3, 7, 1])
    shuffled = solver.correct(q[order], target[order])
    np.testing.assert_allclose(shuffled.dq, together.dq[order], rtol=0, atol=1e-12)
    np.testing.assert_array_equal(shuffled.evaluations, together.evaluations[order])
    alone = solver.correct(q[4:5], target[4:5])
    np.testing.assert_allclose(alone.dq[0], together.dq[4], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("name", "model"), OTHERS)
def test_newton_depends_on_neither_row_nor_neighbours_to_the_last_bit(
    name: str, model: str | None
) -> None:
    made, q, target = task(name, model)
    solver = Newton(made, NewtonSettings(bound_rad=load_robot(name).limits.correction))
    together = solver.correct(q, target)
    assert together.converged.all()
    assert np.abs(together.dq).max() > 1e-5
    order = np.array([8, 0, 3, 3, 7, 1])
    shuffled = solver.correct(q[order], target[order])
    alone = [solver.correct(q[[row]], target[[row]]).dq[0] for row in range(len(q))]
    np.testing.assert_array_equal(shuffled.dq, together.dq[order])
    np.testing.assert_array_equal(shuffled.error, together.error[order])
    np.testing.assert_array_equal(alone, together.dq)


def test_batches_larger_than_a_block() -> None:
    solver = Apso(machine(5).point, ApsoSettings(tolerance=1e-4))
    q, target = np.tile(COMMANDS, (20, 1)), np.tile(LINE, (20, 1))  # 620 rows
    result, once = solver.correct(q, target), solver.correct(COMMANDS, LINE)
    np.testing.assert_allclose(result.dq, np.tile(once.dq, (20, 1)), rtol=0, atol=1e-12)
    assert result.converged.all()


def test_same_seed_same_answer_other_seed_another() -> None:
    toy = machine(6)
    q, target = COMMANDS[::10], LINE[::10]
    first, again = (Apso(toy.point, ApsoSettings(seed=7)).correct(q, target) for _ in range(2))
    other = Apso(toy.point, ApsoSettings(seed=8)).correct(q, target)
    np.testing.assert_array_equal(first.dq, again.dq)
    assert np.all(np.any(first.dq != other.dq, axis=1))
    np.testing.assert_allclose(first.dq, other.dq, atol=2e-6)


# Bounds, and unreachable targets


@pytest.mark.parametrize("name", SOLVERS)
def test_bound_is_never_exceeded(name: str) -> None:
    toy, bound = machine(1), 5e-4  # several commands need more
    solver: Compensator = {
        "apso": Apso(toy.point, ApsoSettings(bound_rad=bound, iterations=60)),
        "newton": Newton(toy.machine(), NewtonSettings(bound_rad=bound)),
    }[name]
    needed = Newton(toy.machine()).correct(COMMANDS, LINE).dq
    result = solver.correct(COMMANDS, LINE)
    assert np.abs(result.dq).max() <= bound
    outside = np.abs(needed).max(axis=1) > 1.01 * bound
    assert outside.sum() >= 3
    assert not result.converged[outside].any()
    assert np.all(result.error[outside] > 1e-7)
    before = np.linalg.norm(toy.point(COMMANDS) - LINE, axis=1)
    assert np.all(result.error <= before)


@pytest.mark.parametrize(("name", "model"), OTHERS)
def test_no_machine_goes_beyond_the_bound(name: str, model: str | None) -> None:
    """Nor if the joints follow from the pose."""
    made, q, target = task(name, model)
    most = load_robot(name).limits.correction
    needed = np.abs(Newton(made, NewtonSettings(bound_rad=most)).correct(q, target).dq).max(axis=1)
    assert 0.0 < needed.min() < needed.max() < most
    bound = float(np.median(needed))
    result = Newton(made, NewtonSettings(bound_rad=bound)).correct(q, target)
    assert np.abs(result.dq).max() <= bound
    np.testing.assert_array_equal(result.converged, needed <= bound)
    assert 0 < result.converged.sum() < len(q)
    far = Newton(made).correct(q, target + 100.0)  # [m]
    assert np.abs(far.dq).max() <= NewtonSettings().bound_rad
    assert not far.converged.any()


def test_swarm_finds_the_best_place_inside_the_bound() -> None:
    # A machine p = 0.3 q with a bound of 1 mrad on each joint and the target (0.6, 0.15, 0) mm:
    # the best is dq = (1, 0.5, 0) mrad, 0.3 mm short along x.
    solver = Apso(lambda q: 0.3 * q, ApsoSettings(bound_rad=1e-3))
    result = solver.correct(np.zeros((1, 3)), np.array([[6e-4, 1.5e-4, 0.0]]))
    np.testing.assert_allclose(result.dq, [[1e-3, 5e-4, 0.0]], atol=1e-6)
    assert result.error[0] == pytest.approx(3e-4, rel=1e-4)
    assert not result.converged[0]


@pytest.mark.parametrize("name", SOLVERS)
def test_rows_that_are_not_finite_are_left_alone(name: str) -> None:
    toy = machine(2)
    q, target = COMMANDS[:4].copy(), LINE[:4].copy()
    target[1, 2], q[2, 0] = np.nan, np.inf
    result = SOLVERS[name](toy).correct(q, target)
    assert result.converged.tolist() == [True, False, False, True]
    assert np.all(result.dq[1:3] == 0.0)
    assert np.all(np.isinf(result.error[1:3]))
    assert np.all(result.evaluations[1:3] == 0)
    clean = SOLVERS[name](toy).correct(COMMANDS[:4], LINE[:4])
    np.testing.assert_allclose(result.dq[[0, 3]], clean.dq[[0, 3]], rtol=0, atol=1e-12)
    nothing = SOLVERS[name](toy).correct(q[1:3], target[1:3])
    assert np.all(nothing.dq == 0.0)
    assert not nothing.converged.any()


@pytest.mark.parametrize("name", SOLVERS)
def test_no_commands_no_corrections(name: str) -> None:
    result = SOLVERS[name](machine(2)).correct(np.zeros((0, 3)), np.zeros((0, 3)))
    assert result.dq.shape == (0, 3)
    assert result.error.shape == (0,)


@pytest.mark.parametrize("name", SOLVERS)
def test_target_beyond_the_reach(name: str) -> None:
    toy = machine(2)
    q = np.vstack([COMMANDS[:1], COMMANDS[5:6]])
    target = np.array([[0.0, 0.0, -3.0], LINE[5]])
    result = SOLVERS[name](toy).correct(q, target)
    assert result.converged.tolist() == [False, True]
    assert np.all(np.isfinite(result.dq))
    assert 1.0 < result.error[0] < np.linalg.norm(toy.point(q[0]) - target[0])


@pytest.mark.parametrize("row", [3, 15, 27])
def test_particles_out_of_reach_do_no_harm(row: int) -> None:
    """Nearly half of the box is out of reach; the solution lies 0.1 mrad inside the edge."""
    toy, q = machine(3), COMMANDS[row : row + 1]

    def point(joints: Array) -> Array:
        beyond = joints[..., :1] > q[0, 0] + 2e-3
        return np.where(beyond, np.nan, toy.point(joints))

    dq = np.array([[1.9e-3, -1e-3, 5e-4]])
    result = Apso(point).correct(q, toy.point(q + dq))
    assert result.converged[0]
    np.testing.assert_allclose(result.dq, dq, atol=1e-6)


@pytest.mark.parametrize("name", SOLVERS)
def test_nothing_in_reach(name: str) -> None:
    """Rods of 0.1 m: the spheres about the elbows do not intersect."""
    toy = ToyDelta()
    toy.rod = np.full(3, 0.1)
    solver: Compensator = {
        "apso": Apso(toy.point, ApsoSettings(iterations=5)),
        "newton": Newton(toy.machine()),
    }[name]
    result = solver.correct(COMMANDS[:2], LINE[:2])
    assert result.evaluations.tolist() == {"apso": [6 * 24] * 2, "newton": [1, 1]}[name]
    assert np.all(result.dq == 0.0)
    assert np.all(np.isinf(result.error))
    assert not result.converged.any()


# Newton without a solution


SCARA = load_robot("scara")
ARM = of(SCARA.commanded, SCARA.commanded.parameters.nominal, SCARA.tool_offset)  # 0.5 m twice


@pytest.mark.parametrize("elbow", [0.0, 1e-12])
def test_newton_stops_at_a_singular_jacobian(elbow: float) -> None:
    """A stretched arm hardly moves along itself; Newton must not run to the bound in vain."""
    q = np.array([[0.3, elbow]] * 2)
    place = ARM.point(q)
    result = Newton(ARM).correct(q, place * [[1.001], [0.999]])
    assert not result.converged.any()
    assert np.all(result.dq == 0.0)
    np.testing.assert_allclose(result.error, 1e-3)


@pytest.mark.parametrize("last", [0.0, np.nan])
def test_there_is_no_step_by_slopes_that_are_singular_or_not_finite(last: float) -> None:
    for slope in (np.diag([0.3, 0.3, last]), np.diag([0.3, 0.3, last])[:, 1:]):
        gap, step = np.array([1e-3, 0.0, 1e-3]), np.zeros(3)
        step_of = backward_kernel._least_squares.py_func
        assert not step_of(slope, gap, np.zeros(3), np.zeros((4, 5)), step)
        assert np.all(step == 0.0)


def test_newton_halves_a_step_that_overshoots() -> None:
    """An elbow at 0.02 rad, a target at 0.2: by the derivative it would open by a radian."""
    q, target = np.array([[0.3, 0.02]]), ARM.point(np.array([[0.3, 0.2]]))
    settings = NewtonSettings(bound_rad=2.0, iterations=30)
    result = Newton(ARM, settings).correct(q, target)
    assert result.converged[0]
    np.testing.assert_allclose(result.dq, [[0.0, 0.18]], atol=1e-7)
    result = Newton(ARM, replace(settings, halvings=0)).correct(q, target)
    assert not result.converged[0]
    assert np.all(result.dq == 0.0)


def test_newton_begins_where_it_is_told() -> None:
    toy = machine(4)
    done = Newton(toy.machine()).correct(COMMANDS, LINE)
    again = Newton(toy.machine()).correct(COMMANDS, LINE, start=done.dq)
    assert np.all(again.evaluations == 1)
    np.testing.assert_array_equal(again.dq, done.dq)
    settings = NewtonSettings(bound_rad=0.5 * float(np.abs(done.dq).max(axis=1).min()))
    beyond = Newton(toy.machine(), settings).correct(COMMANDS, LINE, start=done.dq)
    assert np.all(beyond.dq == 0.0)
    assert np.all(np.isinf(beyond.error))


def test_with_more_joints_than_it_needs_a_step_is_the_shortest() -> None:
    # p = (q1 + q2, q3, q4): the shortest step for 2 mm along x is 1 mrad in each of the two.
    weights = np.array([[1.0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    target, step = np.array([2e-3, 0.0, 0.0]), np.zeros(4)
    step_of = backward_kernel._least_squares.py_func
    assert step_of(weights, np.zeros(3), target, np.zeros((5, 6)), step)
    np.testing.assert_allclose(step, [-1e-3, -1e-3, 0, 0], atol=1e-12)


@pytest.mark.parametrize("row", [5, 10, 15, 20, 25])
def test_swarm_crosses_a_jump(row: int) -> None:
    """A joint that jumps over a gap, as at a reversal with backlash: no command reaches inside it.

    The target lies three quarters through the gap of joint 1. With joint 1 held at the upper edge,
    the smallest distance follows from J: with r the first row of its inverse the other two joints
    are optimal, and gap / 4 / |r| remains.
    """
    toy, q, gap = machine(7), COMMANDS[row : row + 1], np.array([2e-3, 0, 0])

    def played(joints: Array) -> Array:
        return joints + gap * (joints[..., :1] > q[0, 0] + 1e-3)

    meant = q + [1e-3, 5e-4, -5e-4] + 0.75 * gap
    target = toy.point(meant)
    r = np.linalg.inv(toy.jacobian(meant[0]))[0]
    best = 0.25 * gap[0] / np.linalg.norm(r)

    swarm = Apso(lambda x: toy.point(played(x))).correct(q, target)
    assert swarm.error[0] == pytest.approx(best, rel=0.01)
    assert swarm.dq[0, 0] == pytest.approx(1e-3, abs=1e-5)
    assert not swarm.converged[0]


# The swarm's equations, calculated by hand


def diagonal_places(fractions: list[float], bound: float) -> Array:
    """Particles on the main diagonal of a 3-D box, at fractions of it; (3, 1, m)."""
    return np.broadcast_to((2 * np.array(fractions) - 1) * bound, (3, 1, len(fractions)))


def test_entropy_of_a_swarm_in_one_place_and_its_inertia() -> None:
    entropy = swarm_entropy(diagonal_places([0.3] * 16, 0.02), 0.02)
    np.testing.assert_allclose(entropy, [0.0], atol=1e-15)
    np.testing.assert_allclose(inertia(entropy), [1 / 2.5], atol=1e-15)


def test_entropy_of_an_even_swarm_and_its_inertia() -> None:
    evenly = [(i + 0.5) / 16 for i in range(16)]
    entropy = swarm_entropy(diagonal_places(evenly, 0.02), 0.02)
    np.testing.assert_allclose(entropy, [1.0], atol=1e-12)
    # e^-2.6 = 0.0742736; 1 / (1 + 0.1114104) = 0.8997577
    np.testing.assert_allclose(inertia(entropy), [0.8997577], atol=1e-7)


def test_entropy_of_four_by_hand() -> None:
    # Bins of four: 2, 1, 1, 0. E = (1/2 ln 2 + 2 * 1/4 ln 4) / ln 4 = 1/4 + 1/2 = 3/4
    # w = 1 / (1 + 1.5 e^-1.95) = 1 / (1 + 1.5 * 0.1422741) = 1 / 1.2134112 = 0.8241230
    entropy = swarm_entropy(diagonal_places([0.1, 0.2, 0.4, 0.6], 1.0), 1.0)
    np.testing.assert_allclose(entropy, [0.75], atol=1e-12)
    np.testing.assert_allclose(inertia(entropy), [0.8241230], atol=1e-7)


def test_entropy_is_along_the_diagonal_of_the_box_and_of_each_swarm_alone() -> None:
    # (b, -b, 0) projects onto the middle like the centre: bin 2 of 4 for all, E = 0. Corners of
    # the diagonal are in the first and the last bin: E = ln 2 / ln 4 = 1/2.
    across = np.array([[1.0, -1.0, 0.0, 1.0], [-1, 1, 0, 0], [0, 0, 0, -1]])
    corners = np.array([[1.0, -1.0, 1.0, -1.0]] * 3)
    entropy = swarm_entropy(np.stack([across, corners], axis=1), 1.0)
    np.testing.assert_allclose(entropy, [0.0, 0.5], atol=1e-12)


def test_velocity_by_hand() -> None:
    # w v + c1 r1 (p - x) + c2 r2 (g - x) = 0.5 * 2 + 1.5 * 0.25 * (3 - 1) + 2 * 0.5 * (5 - 1)
    #   = 1 + 0.75 + 4 = 5.75 mrad; the bound is 0.05 * 2 * 0.1 rad = 10 mrad
    s = ApsoSettings(bound_rad=0.1, velocity_fraction=0.05, cognitive=1.5, social=2.0)
    own, leader = np.array([[[0.25 * 2e-3]]]), np.array([[[0.5 * 4e-3]]])
    v = velocity(np.array([[[2e-3]]]), own, leader, np.array([0.5]), s)
    np.testing.assert_allclose(v, [[[5.75e-3]]], atol=1e-15)
    v = velocity(np.array([[[-20e-3]]]), 0 * own, 0 * leader, np.array([0.9]), s)
    np.testing.assert_allclose(v, [[[-10e-3]]], atol=1e-15)


def test_search_contracts_until_its_target_is_reached() -> None:
    """By the points that it asks for: done targets drop out, the others are asked more closely."""
    toy, asked = machine(8), list[Array]()

    def point(q: Array) -> Array:
        asked.append(q)  # (targets, particles, 3)
        return toy.point(q)

    result = Apso(point).correct(COMMANDS[:6], LINE[:6])
    going = [len(q) for q in asked]
    assert going[0] == 6 > going[-1]
    assert going == sorted(going, reverse=True)
    assert result.evaluations.sum() == ApsoSettings().particles * sum(going)
    assert np.ptp(asked[-1], axis=1).max() < 0.1 * np.ptp(asked[0], axis=1).min()


# Settings and shapes


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"bound_rad": 0.0}, "bound_rad is 0.0"),
        ({"bound_rad": float("nan")}, "bound_rad is nan"),
        ({"tolerance": -1e-7}, "tolerance is -1e-07"),
        ({"particles": 15}, "particles is 15; it has to be a whole number, at least 16"),
        ({"particles": 20.5}, "particles is 20.5"),
        ({"iterations": 0}, "iterations is 0"),
        ({"seed": -1}, "seed is -1"),
        ({"velocity_fraction": 0.0}, "velocity_fraction is 0.0"),
        ({"velocity_fraction": 1.5}, "velocity_fraction is 1.5; at most 1"),
        ({"cognitive": -1.0}, "cognitive is -1.0"),
        ({"social": float("inf")}, "social is inf"),
    ],
)
def test_apso_settings_are_checked(change: dict[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ApsoSettings(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    "change",
    [
        {"bound_rad": -1.0},
        {"tolerance": 0.0},
        {"iterations": 0},
        {"halvings": -1},
        {"tolerance": float("nan")},
        {"iterations": 2.5},
    ],
)
def test_newton_settings_are_checked(change: dict[str, float]) -> None:
    with pytest.raises(InputError, match=next(iter(change))):
        NewtonSettings(**change)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", SOLVERS)
def test_shapes_are_checked(name: str) -> None:
    solver = SOLVERS[name](ToyDelta())
    with pytest.raises(InputError, match=r"q has shape \(3,\)"):
        solver.correct(COMMANDS[0], LINE[:1])
    with pytest.raises(InputError, match=r"target has shape \(2, 3\); it has to be \(3, 3\)"):
        solver.correct(COMMANDS[:3], LINE[:2])


@pytest.mark.parametrize(("name", "size"), [("srbd", 3), ("scara", 2), ("ur10", 12)])
def test_a_target_has_the_coordinates_that_the_machine_aims_at(name: str, size: int) -> None:
    made, q, target = task(name)
    assert target.shape == (9, size)
    with pytest.raises(InputError, match=rf"shape \(9, {size - 1}\); it has to be \(9, {size}\)"):
        Newton(made).correct(q, target[:, 1:])


def test_arguments_are_not_changed() -> None:
    toy = machine(1)
    for solver in (SOLVERS["apso"](toy), SOLVERS["newton"](toy)):
        q, target = COMMANDS[:3].copy(), LINE[:3].copy()
        solver.correct(q, target)
        np.testing.assert_array_equal(q, COMMANDS[:3])
        np.testing.assert_array_equal(target, LINE[:3])
    newton, start = SOLVERS["newton"](toy), np.full((3, 3), 1e-4)
    signals = newton.machine.resting(q)
    rows = signals.rows.copy()
    newton.correct(q, target, signals, start)
    np.testing.assert_array_equal(start, 1e-4)
    np.testing.assert_array_equal(signals.rows, rows)
