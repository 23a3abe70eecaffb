"""A correction table keeps its bound between the nodes, and refuses commands where it cannot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from delta_calibration.calibration import Calibration
from delta_calibration.chain import Chain
from delta_calibration.compensation import CommandStatus, JointCompensator, TableSettings
from delta_calibration.compensation.base import Correction
from delta_calibration.compensation.table import BEND, Stamp, Table, nodes_between
from delta_calibration.compensation.table_build import Task, build
from delta_calibration.data import Conditions, at_rest
from delta_calibration.effects import effect_named
from delta_calibration.errors import DataError, InputError
from delta_calibration.geometry import Frame
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from six_rods import SixRods, drawing_joints

ROBOT = load_robot("srbd")
WIDE = 0.45 * np.sqrt(2)  # [m] radius of a disc that contains the line of the paper
STAMP = Stamp("0" * 64, "1" * 64, "toy", (0.0, 0.0, 0.0))


def errors(seed: int, robot=ROBOT) -> dict[str, float]:
    parameters = robot.model("six_rod_delta").parameters
    drawn = parameters.prior * np.random.default_rng(seed).standard_normal(len(parameters))
    return dict(zip(parameters.names, drawn, strict=True))


def body(radius: float, low: float = -0.711, high: float = -0.711) -> Region:
    turn = np.linspace(0, 2 * np.pi, 90, endpoint=False)
    rim = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * turn], axis=1)
    return Region.of(np.concatenate([rim + np.array([0, 0, z]) for z in {low, high}]))


def calibration(
    wrong: dict[str, float], region: Region, effects: dict[str, tuple[dict, float]] | None = None
) -> Calibration:
    """A calibration equal to the true machine, over a region."""
    mechanism = ROBOT.model("six_rod_delta")
    made = tuple(
        effect_named(cause, ROBOT, mechanism, shape)
        for cause, (shape, _) in (effects or {}).items()
    )
    chain = Chain(mechanism, np.zeros(3), 0.05, made)
    theta = chain.join(mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    theta[: len(mechanism.parameters)] += [wrong.get(n, 0.0) for n in mechanism.parameters.names]
    values = [
        size * np.ones(len(e.parameters))
        for e, (_, size) in zip(made, (effects or {}).values(), strict=True)
    ]
    theta[chain.layout.effects] = np.concatenate([np.zeros(0), *values])
    lower, upper = ROBOT.joints.lower, ROBOT.joints.upper
    return Calibration(ROBOT, chain, theta, region, lower, upper, 1e-5, "made", "0" * 64)


def places(n: int, radius: float, low: float, high: float, seed: int) -> np.ndarray:
    """Points in a cylinder, a third of them on its rim."""
    rng = np.random.default_rng(seed)
    r = radius * np.sqrt(np.where(np.arange(n) < n // 3, 1.0, rng.random(n)))
    turn = rng.uniform(0, 2 * np.pi, n)
    return np.stack([r * np.cos(turn), r * np.sin(turn), rng.uniform(low, high, n)], axis=1)


@pytest.fixture(scope="module")
def small() -> JointCompensator:
    """Table of a machine over a small region."""
    return JointCompensator(calibration(errors(1), body(0.2, -0.75, -0.7)), "table")


# The bound


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_fifteen_nodes_keep_the_papers_disc_within_a_micrometre(seed: int) -> None:
    """Checked with an independent six-rod model."""
    wrong = errors(seed)
    compensator = JointCompensator(calibration(wrong, body(WIDE)), "table")
    assert compensator.table.nodes == 15
    target = places(6000, WIDE, -0.711, -0.711, seed)
    done = compensator.compensate(drawing_joints(target))
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    whole = done.share == 1.0  # corrections fade out beyond the faces of the region
    assert whole.mean() > 0.6  # a third is on the rim, outside the polygon of the region
    after = np.linalg.norm(SixRods(wrong).point(done.joint) - target, axis=1)[whole]
    assert 1e-9 < after.max() < 0.5e-6
    assert after.max() <= compensator.table.worst  # which was found at other places
    np.testing.assert_allclose(done.model_error[whole], after, atol=1e-10)
    assert set(done.evaluations) == {1}
    exact = JointCompensator(compensator.calibration).compensate(drawing_joints(target))
    np.testing.assert_allclose(done.joint, exact.joint, atol=1e-6)


def test_a_grid_that_is_too_wide_is_refined_until_the_bound_holds() -> None:
    bound = 2e-7
    wrong, asked = errors(4), TableSettings(bound=bound, nodes=6)
    made = calibration(wrong, body(0.4, -0.8, -0.65))
    compensator = JointCompensator(made, "table", table=asked)
    assert compensator.table.nodes > 6
    assert compensator.table.worst <= 0.8 * bound
    target = places(4000, 0.4, -0.8, -0.65, 4)
    q = drawing_joints(target)
    room = ROBOT.limits.correction  # distance to the joint limits, also for the corrected command
    inside = ((q > ROBOT.joints.lower + room) & (q < ROBOT.joints.upper - room)).all(axis=1)
    done = compensator.compensate(q[inside])
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    whole = done.share == 1.0
    assert whole.mean() > 0.6
    missed = SixRods(wrong).point(done.joint) - target[inside]
    after = np.linalg.norm(missed, axis=1)[whole]
    assert after.max() <= bound


def test_a_bound_that_cannot_be_held_is_no_table() -> None:
    asked = TableSettings(bound=1e-8, nodes=5, most=7)
    with pytest.raises(DataError, match=r"with 7 nodes an axis it is .* um off .* 0.008 um is"):
        JointCompensator(calibration(errors(1), body(0.5)), "table", table=asked)


def test_a_swarm_finds_the_same_table(small: JointCompensator) -> None:
    made = replace(small.calibration, region=body(0.05))
    newton, swarm = (
        JointCompensator(made, "table", table=TableSettings(by, nodes=5))
        for by in ("newton", "apso")
    )
    assert swarm.table.solver == "apso"
    gap = np.abs(swarm.table.corrections - newton.table.corrections).max()
    assert 0 < gap < 1e-6  # the tolerance of the swarm over the smallest gain


# What is checked, with a simple machine: p* = 0.3 q, p = 0.3 (q - e(q0)), so dq = e


def toy(e, asked, answers=lambda q: np.full(len(q), True)) -> Task:
    class Exact:
        def correct(self, q, target):
            there, dq = answers(q), np.repeat(e(q[:, :1]), 3, axis=1)
            error = np.where(there, 0.0, np.inf)
            return Correction(dq, error, np.ones(len(q), dtype=np.int64), there)

    def point(q):
        start = q.copy()
        for _ in range(50):  # q = start + e(start)
            start = q - np.repeat(e(start[:, :1]), 3, axis=1)
        return 0.3 * start

    return Task(STAMP, Exact(), lambda q: 0.3 * q, point, lambda q: _ball(q, 1.0), 0.02, asked)


def _ball(q: np.ndarray, radius: float) -> np.ndarray:
    return np.linalg.norm(q, axis=1) <= radius


def inside(n: int) -> np.ndarray:
    q = np.random.default_rng(8).uniform(-1, 1, (3 * n, 3))
    return q[_ball(q, 1.0)][:n]


@pytest.mark.parametrize("only", ["middles", "places"])
def test_what_no_node_has_seen_is_found_between_them(only: str) -> None:
    """A bump of 3 um in the middle of a cell, too narrow for the nodes to see.

    It is found at the middles of the cells alone or, where a guard refuses these, at the other
    places.
    """
    asked = np.concatenate([inside(1500), np.eye(3), -np.eye(3)])
    steps = np.linspace(-1, 1, 15)
    axis = nodes_between(-1.02 * np.ones(3), 1.02 * np.ones(3), steps, BEND)[:, 0]

    def bump(x: np.ndarray) -> np.ndarray:
        return 1e-5 * np.exp(-(((x - axis[9]) / 0.05) ** 2))

    assert bump(axis[::2]).max() * 0.3 < 0.02e-6  # with 8 nodes per axis
    task = toy(bump, asked)
    if only == "middles":
        task = replace(task, asked=asked[np.abs(asked[:, 0] - axis[9]) > 0.2])
    else:
        task = replace(task, admitted=lambda q: np.isin(q[:, 2], asked[:, 2]))
    table = build(task, TableSettings(nodes=8))
    assert table.nodes > 12
    q = inside(1200)
    np.testing.assert_allclose(table.at(q), bump(q[:, [0, 0, 0]]), atol=3.4e-6)
    blind = replace(task, asked=task.asked[-6:], admitted=lambda q: np.abs(q).max(axis=1) > 0.99)
    assert build(blind, TableSettings(nodes=8)).nodes == 8


def test_nodes_beyond_the_region_may_be_without_an_answer() -> None:
    task = toy(lambda x: 5e-3 + 1e-4 * np.sin(x), inside(500), lambda q: _ball(q, 1.15))
    table = build(task, TableSettings())
    q = 0.9 * inside(700)
    assert np.isfinite(table.corrections).all()
    assert table.nodes == 15  # substitute values make no refinement necessary
    np.testing.assert_allclose(table.at(q), 5e-3 + 1e-4 * np.sin(q[:, [0, 0, 0]]), atol=3e-6)
    nothing = replace(task, solver=toy(np.sin, task.asked, lambda q: q[:, 0] > 9).solver)
    with pytest.raises(DataError, match="newton finds no correction at any of its nodes"):
        build(nothing, TableSettings())
    with pytest.raises(DataError, match="the region has no command"):
        build(replace(task, asked=np.empty((0, 3))), TableSettings())


def test_the_work_is_handed_out_in_blocks_for_a_bar() -> None:
    seen = []

    def follow(blocks: range):
        seen.append([len(blocks), 0])
        for block in blocks:
            yield block
            seen[-1][1] += 1

    build(toy(lambda x: 1e-3 * x, inside(100)), TableSettings(nodes=12), follow)
    assert seen == [[2, 2], [2, 2]]  # 12^3 nodes; 11^3 middles and 100 places


# The lookup


def table_of(values: np.ndarray, lower=(-0.5, -0.4, 0.1), upper=(1.5, 1.2, 1.0)) -> Table:
    return Table(np.array(lower), np.array(upper), values, STAMP, "newton", 1e-6, 0.0, 1)


def straight(table: Table, q: np.ndarray) -> np.ndarray:
    """x (1 + b x^2) / (1 + b) of commands; nodes are equally spaced in this."""
    x = (q - (table.lower + table.upper) / 2) / ((table.upper - table.lower) / 2)
    return x * (1 + BEND * x**2) / (1 + BEND)


def commands(table: Table, n: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).uniform(table.lower, table.upper, (n, 3))


@pytest.mark.parametrize("k", [5, 6, 15])
def test_lookup_is_scipys_tensor_spline(k: int) -> None:
    values = np.random.default_rng(k).standard_normal((k, k, k, 3))
    table, axis = table_of(values), np.linspace(-1, 1, k)
    q = commands(table, 500, k)
    cardinal = make_interp_spline(axis, np.eye(k), k=3)  # 1 at one node; not-a-knot, as here
    weights = [cardinal(s) for s in straight(table, q).T]
    expected = np.einsum("ni,nj,nk,ijkm->nm", *weights, values)
    np.testing.assert_allclose(table.at(q), expected, atol=1e-11)


def test_cubics_are_met_exactly_and_the_nodes_too() -> None:
    rng = np.random.default_rng(2)
    factors = rng.standard_normal((4, 4, 4, 3))

    def cubic(s: np.ndarray) -> np.ndarray:
        powers = s[..., None] ** np.arange(4)
        return np.einsum("ni,nj,nk,ijkm->nm", powers[:, 0], powers[:, 1], powers[:, 2], factors)

    k = 7
    steps = np.linspace(-1, 1, k)
    grid = np.stack(np.meshgrid(steps, steps, steps, indexing="ij"), axis=-1).reshape(-1, 3)
    table = table_of(cubic(grid).reshape(k, k, k, 3))
    q = commands(table, 400, 3)
    np.testing.assert_allclose(table.at(q), cubic(straight(table, q)), atol=1e-11)
    axes = nodes_between(table.lower, table.upper, steps, BEND)
    nodes = np.stack(np.meshgrid(*axes.T, indexing="ij"), axis=-1).reshape(-1, 3)
    np.testing.assert_allclose(straight(table, nodes), grid, atol=1e-13)
    within = np.clip(nodes, table.lower, table.upper)  # except for rounding at the ends
    np.testing.assert_allclose(table.at(within).reshape(k, k, k, 3), table.corrections, atol=1e-11)
    quartic = table_of((grid**4).reshape(k, k, k, 3))
    assert np.abs(quartic.at(q) - straight(table, q) ** 4).max() > 1e-4


def test_outside_there_is_nothing_and_neighbours_do_not_mind() -> None:
    table = table_of(np.random.default_rng(1).standard_normal((6, 6, 6, 3)))
    q = commands(table, 40, 5)
    alone = table.at(q)
    for joint in range(3):
        for far in (np.nan, np.inf, -np.inf, table.lower[joint] - 1e-9, table.upper[joint] + 1e-9):
            mixed = q.copy()
            mixed[7, joint] = far
            found = table.at(mixed)
            assert np.isnan(found[7]).all()
            np.testing.assert_array_equal(np.delete(found, 7, 0), np.delete(alone, 7, 0))
            assert table.covers(mixed).sum() == 39
    assert np.isfinite(table.at(np.stack([table.lower, table.upper]))).all()
    assert table.at(q[:0]).shape == (0, 3)
    np.testing.assert_array_equal(table.at(np.asfortranarray(q)), alone)


# Guards


def test_beyond_the_table_a_guard_says_so(small: JointCompensator) -> None:
    """The region is wider than when the table was made, although its name is the same."""
    wide = replace(small.calibration, region=body(0.5, -0.8, -0.65))
    compensator = JointCompensator(wide, "table", table=small.table)
    q = drawing_joints(np.array([[0.0, 0.0, -0.72], [0.45, 0.0, -0.72], [0.1, 0.1, -0.71]]))
    done = compensator.compensate(q)
    beyond = CommandStatus.OUTSIDE_TABLE
    assert done.verdicts == (CommandStatus.CORRECTED, beyond, CommandStatus.CORRECTED)
    assert beyond.value == "outside the table of corrections"
    np.testing.assert_array_equal(done.joint[1], q[1])
    assert np.isinf(done.model_error[1])


def test_the_region_lies_within_its_table(small: JointCompensator) -> None:
    target = places(3000, 0.21, -0.76, -0.69, 9)
    done = small.compensate(drawing_joints(target))
    region, margin = small.calibration.region, ROBOT.limits.region_margin
    there = region.outside(target) <= margin
    assert 500 < there.sum() < 3000
    assert {done.verdicts[row] for row in np.flatnonzero(there)} == {CommandStatus.CORRECTED}
    assert {done.verdicts[row] for row in np.flatnonzero(~there)} == {CommandStatus.OUTSIDE_REGION}


def test_a_table_that_is_wrong_corrects_nothing(small: JointCompensator) -> None:
    """Every correction from the table is tested with the model; here all are off by 10 urad."""
    wrong = replace(small.table, corrections=small.table.corrections + 1e-5)
    compensator = JointCompensator(small.calibration, "table", table=wrong)
    done = compensator.compensate(drawing_joints(np.array([[0.0, 0.05, -0.72]])))
    assert done.verdicts == (CommandStatus.NOT_REACHED,)
    assert (done.correction == 0).all()


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (
            {"seal": "a" * 64},
            "made for calibration 000000000000, but the current one is aaaaaaaaaaaa",
        ),
        (
            {"robot": replace(ROBOT, hash="b" * 64)},
            "made for robot .*, but the current one is bbbbbbbbbbbb",
        ),
        (
            {"robot": replace(ROBOT, tool_offset=np.array([0.0, 0.0, -0.1]))},
            r"made for tool \[m\] \(0.0, 0.0, 0.0\), but the current one is \(0.0, 0.0, -0.1\)",
        ),
    ],
)
def test_a_table_for_something_else_is_refused(small, change, said) -> None:
    with pytest.raises(
        InputError, match=f"the table is outdated: it was {said}; compute it again"
    ):
        JointCompensator(replace(small.calibration, **change), "table", table=small.table)


def test_a_table_of_another_model_is_refused(small: JointCompensator) -> None:
    chain = Chain(ROBOT.model("rotary_delta"), np.zeros(3), 0.05)
    theta = chain.join(chain.mechanism.parameters.nominal, np.zeros(3), Frame.identity())
    other = replace(small.calibration, chain=chain, theta=theta)
    with pytest.raises(
        InputError, match="made for model six_rod_delta, but the current one is rotary_delta"
    ):
        JointCompensator(other, "table", table=small.table)


def test_a_table_without_its_method_is_refused(small: JointCompensator) -> None:
    with pytest.raises(InputError, match="a table is for method 'table', not 'newton'"):
        JointCompensator(small.calibration, "newton", table=small.table)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"bound": 0.0}, "bound is 0.0"),
        ({"bound": np.nan}, "bound is nan"),
        ({"bound": 2e-6}, "bound is 2 um; at most 1 allowed"),
        ({"nodes": 4}, "nodes is 4; it has to be a whole number, at least 5"),
        ({"nodes": 20, "most": 19}, "most is 19; it has to be a whole number, at least 20"),
        ({"solver": "table"}, "no solver 'table' for a table; choose from: apso, newton"),
    ],
)
def test_settings_that_make_no_table_are_refused(settings, said) -> None:
    with pytest.raises(InputError, match=said):
        TableSettings(**settings)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"corrections": np.zeros((5, 5, 5, 2))}, r"shape \(5, 5, 5, 2\); it has to be"),
        ({"corrections": np.zeros((4, 4, 4, 3))}, "k at least 5"),
        ({"corrections": np.zeros((6, 6, 7, 3))}, "it has to be"),
        ({"corrections": np.full((5, 5, 5, 3), np.nan)}, "not finite"),
        ({"lower": np.array([0.0, 2.0, 0.0])}, "no grid of three joints"),
        ({"upper": np.array([1.0, np.nan, 1.0])}, "no grid of three joints"),
    ],
)
def test_values_that_are_no_table_are_refused(change, said) -> None:
    with pytest.raises(InputError, match=said):
        replace(table_of(np.zeros((5, 5, 5, 3))), **change)


# Effects


def conditions(q: np.ndarray, seed: int) -> Conditions:
    rng, n = np.random.default_rng(seed), len(q)
    return replace(
        at_rest(q),
        velocity=rng.uniform(-0.5, 0.5, q.shape),
        direction=rng.choice([-1.0, 1.0], q.shape),
        payload=rng.uniform(0.0, 3.0, n),
        payload_centre=np.zeros((n, 3)),
        temperature_parts=("arm",),
        temperature=rng.uniform(15.0, 35.0, (n, 1)),
    )


DRIVE = {
    "backlash": ({}, 3e-4),
    "joint_compliance": ({}, 4e-5),
    "joint_lag": ({}, 5e-3),
    "transmission_error": ({"cycles": 66.0}, 1e-4),
}
STRUCTURE = {
    "thermal_growth_arm": ({"sensor": "arm"}, 23e-6),
    "forearm_compliance": ({}, 6e-7),
}


@pytest.mark.parametrize("cause", DRIVE)
def test_drives_are_undone_around_the_table(cause: str) -> None:
    made = calibration(errors(2), body(0.2, -0.75, -0.7), {cause: DRIVE[cause]})
    q = drawing_joints(places(12, 0.17, -0.74, -0.71, 1))  # well inside the region
    table = JointCompensator(made, "table")
    assert table.table is not None
    assert table.needs_conditions
    shifts = []
    for seed in (1, 2):  # the same commands under other conditions
        at = conditions(q, seed)
        done = table.compensate(q, at)
        exact = JointCompensator(made).compensate(q, at)
        assert done.verdicts == exact.verdicts == (CommandStatus.CORRECTED,) * len(q)
        np.testing.assert_allclose(done.joint, exact.joint, atol=3e-6)
        reached = made.chain.predict(replace(at, joint=done.joint), made.theta)
        assert np.linalg.norm(reached - SixRods().point(q), axis=1).max() < 1e-6
        shifts.append(done.correction)
    if cause != "transmission_error":  # it depends on the angle only
        assert np.abs(shifts[0] - shifts[1]).max() > 1e-5
    bare = table.table.at(q)
    assert np.abs(shifts[0] - bare).max() > 1e-5


@pytest.mark.parametrize("cause", STRUCTURE)
def test_dimensions_that_change_are_followed_exactly_and_it_is_said(cause: str) -> None:
    effects = {"backlash": DRIVE["backlash"], cause: STRUCTURE[cause]}
    made = calibration(errors(2), body(0.2, -0.75, -0.7), effects)
    q = drawing_joints(places(8, 0.2, -0.75, -0.7, 1))
    compensator = JointCompensator(made, "table")
    assert compensator.table is None
    assert compensator.way == f"newton (no table, because the dimensions change with {cause})"
    at = conditions(q, 1)
    done = compensator.compensate(q, at)
    exact = JointCompensator(made, "newton").compensate(q, at)
    assert set(done.verdicts) == {CommandStatus.CORRECTED}
    np.testing.assert_array_equal(done.joint, exact.joint)


def test_at_other_dimensions_a_table_corrects_nothing(small: JointCompensator) -> None:
    """The table must not be used for arms 0.1 mm longer than those that it was made for."""
    grown = small.calibration.theta.copy()
    names = list(ROBOT.model("six_rod_delta").parameters.names)
    grown[[names.index(f"arm_{leg}") for leg in (1, 2, 3)]] += 1e-4
    made = replace(small.calibration, theta=grown)  # with the old hash
    q = drawing_joints(np.array([[0.0, 0.05, -0.72]]))
    done = JointCompensator(made, "table", table=small.table).compensate(q)
    assert done.verdicts == (CommandStatus.NOT_REACHED,)
    assert (done.correction == 0).all()
    here, there = (JointCompensator(c).compensate(q) for c in (small.calibration, made))
    assert set(here.verdicts + there.verdicts) == {CommandStatus.CORRECTED}
    assert np.abs(here.correction - there.correction).max() > 1e-5


def test_what_it_is_made_of_is_told(small: JointCompensator) -> None:
    table = small.table
    assert small.way.startswith(f"table ({table.nodes} nodes an axis by newton, at most ")
    assert f"at {table.checked} places between them, bound 1 um" in small.way
    assert JointCompensator(small.calibration, "newton").way == "newton"
