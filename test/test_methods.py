"""All fitting methods on all robots solve the same problem with the same result and errors."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from delta_calibration.calibration_file import (
    from_identification,
    load_calibration,
    save_calibration,
)
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.documents import read_document
from delta_calibration.errors import DataError, InputError, SingularityError
from delta_calibration.estimation import chain_of, identify, prepare, solution_at, solve
from delta_calibration.papers import (
    METHODS,
    Box,
    LinearResidual,
    box_of,
    error_model,
    in_turn,
    method_named,
)
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import known_robots, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

SWARMS = ("stepwise_qpso", "qpso", "apso", "pso")
CONVERGE = ("least_squares", "alternating", "stepwise_qpso")  # these reach the minimum


def small(name):
    """A method with a small budget."""
    return method_named(name, 12, 8) if name in SWARMS else method_named(name)


@cache
def session(name, seed=3, count=24):
    robot = load_robot(name)
    plan = make_plan("identify", robot, count=count, seed=seed)
    return simulate_session(draw_machine(robot, seed), plan, seed)


@cache
def measured(name):
    robot = load_robot(name)
    return robot, collect(session(name), robot.joints.names)


@cache
def problem_of(name):
    robot, poses = measured(name)
    return prepare(poses, robot, chain_of(robot))[2]


@cache
def least(name):
    return solve(problem_of(name))


@cache
def found(name, method):
    robot, poses = measured(name)
    return identify(poses, robot, method=small(method))


def rng():
    return np.random.default_rng(0)


@pytest.mark.parametrize("name", known_robots())
@pytest.mark.parametrize("method", CONVERGE[1:])
def test_what_converges_comes_to_the_least_of_least_squares(name, method):
    """By the cost of the problem; `alternating` is slower where only priors determine unknowns."""
    fit = method_named(method).fit(problem_of(name), rng(), lambda _: None)
    lag = {"alternating": 20.0, "stepwise_qpso": 0.5}[method]
    assert fit.solution.cost < least(name).cost + lag
    missed, best = fit.solution.residual, least(name).residual
    assert np.sqrt(np.mean((missed - best) ** 2)) < 0.3  # in units of the noise


@pytest.mark.parametrize("name", known_robots())
@pytest.mark.parametrize("method", ["qpso", "apso", "pso"])
def test_a_plain_swarm_lowers_the_cost_and_stays_in_its_box(name, method):
    problem = problem_of(name)
    fit = method_named(method, 80, 200).fit(problem, rng(), lambda _: None)
    assert np.abs(box_of(problem).scaled(fit.solution.z)).max() <= 1
    drawn = box_of(problem).half_width * rng().uniform(-1, 1, (15, len(fit.solution.z)))
    by_chance = np.median([squares(solution_at(problem, z)) for z in drawn])
    assert squares(fit.solution) < 0.1 * by_chance


def squares(solution):
    """Sum of squares of residuals and priors, with the stated noise and without robust loss."""
    priors = solution.z[solution.problem.has_prior]
    return np.sum(solution.residual**2) + np.sum(priors**2)


@pytest.mark.parametrize("name", known_robots())
def test_the_error_model_is_the_problem_near_its_least(name):
    """The square of its norm is the sum of squares, to second order in the distance."""
    problem, best = problem_of(name), least(name)
    line = error_model(problem, best.z, 1.0)
    way = 1e-3 * rng().standard_normal(len(best.z))
    near = squares(solution_at(problem, best.z + way))
    assert line(best.z[None])[0] ** 2 == pytest.approx(squares(best), rel=1e-9)
    assert line((best.z + way)[None])[0] ** 2 == pytest.approx(near, rel=1e-2)
    assert near > squares(best) + 1


@pytest.mark.parametrize("name", known_robots())
def test_the_box_holds_the_machine(name):
    assert np.abs(box_of(problem_of(name)).scaled(least(name).z)).max() < 1


@pytest.mark.parametrize("name", ["linear_delta", "scara"])
@pytest.mark.parametrize("method", METHODS)
def test_every_method_makes_a_calibration_that_loads(name, method, tmp_path):
    robot, poses = measured(name)
    fit, path = found(name, method), tmp_path / "calibration.yaml"
    save_calibration(path, fit, robot, poses)
    read = load_calibration(path, robot)
    np.testing.assert_array_equal(read.theta, fit.theta)
    assert read.seal == from_identification(fit, robot, poses).seal
    said = read_document(path, lambda _: {})["provenance"]
    assert said["method"] == method
    assert said["evaluations"] == fit.effort.evaluations > 0
    assert ("particles" in said) == (method in SWARMS)
    assert (fit.std > 0).all()
    assert np.isfinite(fit.covariance).all()
    plain = found(name, "least_squares")
    assert fit.observability.rank == plain.observability.rank
    unset = [[r.parameter for r in f.observability.redundancies] for f in (fit, plain)]
    assert unset[0] == unset[1] != []
    assert fit.frame_only == plain.frame_only


def test_swarms_are_seeded():
    robot, poses = measured("scara")
    one, same, other = (
        identify(poses, robot, seed=seed, method=small("qpso")).theta for seed in (1, 1, 2)
    )
    np.testing.assert_array_equal(one, same)
    assert np.abs(one - other).max() > 0


@pytest.mark.parametrize("order", ["singular", "settled"])
def test_evaluations_are_counted_and_told_while_they_are_made(order):
    problem, told = problem_of("scara"), []
    method = method_named("stepwise_qpso", 12, 8, order)
    fit = method.fit(problem, rng(), told.append)
    assert set(told) == {12}
    assert sum(told) == fit.evaluations <= method.most(len(problem.theta0))
    if order == "singular":
        assert fit.evaluations == method.most(len(problem.theta0)) == 4 * 23 * 12 * 8


def test_a_knocked_reflector_does_no_harm_in_turn_or_by_a_swarm():
    robot, poses = measured("scara")
    point = poses.point.copy()
    point[5] += [0.02, 0.0, 0.01]
    knocked = prepare(replace(poses, point=point), robot, chain_of(robot))[2]
    for method in CONVERGE:
        fit = method_named(method).fit(knocked, rng(), lambda _: None)
        assert fit.solution.weight[5] == 0
        assert np.abs(fit.solution.theta - least("scara").theta)[:14].max() < 1e-3


# Sessions that determine no solution, by each method


@pytest.mark.parametrize("method", METHODS)
def test_too_few_poses(method):
    robot, poses = measured("linear_delta")
    few = poses.take(np.flatnonzero(poses.place < 9))
    with pytest.raises(DataError, match=r"9 different poses at rest, 12 or more are needed"):
        identify(few, robot, method=small(method))


@pytest.mark.parametrize("method", METHODS)
def test_poses_on_a_line(method):
    robot, poses = measured("linear_delta")
    point = poses.point.copy()
    point[:, :2] = 1.0
    with pytest.raises(DataError, match="points that do not lie on one line"):
        identify(replace(poses, point=point), robot, method=small(method))


@pytest.mark.parametrize("method", METHODS)
def test_a_singular_pose(method):
    """With three level arms no joint determines the height of the platform."""
    robot, poses = measured("linear_delta")
    flat = replace(robot.dimensions, arm=robot.dimensions.radius * (1 + 1e-10))
    with pytest.raises(SingularityError, match=r"pose 1 is singular: .* under 1 m is allowed"):
        identify(
            replace(poses, joint=np.full_like(poses.joint, 0.1)),
            replace(robot, dimensions=flat),
            method=small(method),
        )


@pytest.mark.parametrize("method", METHODS)
def test_cables_that_contradict_each_other(method):
    """Eight cables for six degrees of freedom: no pose fits if one motor has lost its zero."""
    robot, poses = measured("cdpr8")
    joint = poses.joint.copy()
    joint[:, 0] += 60.0
    with pytest.raises(DataError, match=r"another robot|out of the robot's reach"):
        identify(replace(poses, joint=joint), robot, method=small(method))


def test_in_turn_says_where_it_does_not_come_to_rest():
    """Two unknowns with nearly the same effect."""
    line = LinearResidual(np.array([[1.0, 0.999], [0.0, 0.01]]), np.array([1.0, 1.0]), 0.0)
    first = np.array([True, False])
    with pytest.raises(DataError, match=r"still move by .* after 20 rounds; under 1e-05"):
        in_turn(line, first, np.zeros(2), 20)
    rest = in_turn(line, first, np.zeros(2), 400_000, 1e-12)
    np.testing.assert_allclose(rest.best, np.linalg.solve(line.factor, line.target), rtol=1e-5)


def test_a_machine_that_cannot_be_assembled_is_no_result():
    problem = problem_of("linear_delta")
    row = problem.chain.parameters.row("arm_1")
    z = -300.0 * (np.arange(len(problem.theta0)) == row)
    with pytest.raises(
        DataError, match=r"cannot be reached by the machine found by the search: .* m;"
    ):
        solution_at(problem, z)


# Names and options


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("gauss",), "method: 'gauss' is not allowed; least_squares, alternating, stepwise_qpso"),
        (("least_squares", 80), "particles: 80 is not allowed with method least_squares; with st"),
        (("alternating", None, 9), "iterations: 9 is not allowed with method alternating; with "),
        (("qpso", None, None, "settled"), "order: settled is not allowed with method qpso; with "),
        (("stepwise_qpso", None, None, "up"), "order: 'up' is not allowed; singular, settled"),
        (("pso", 0), "particles is 0; it has to be a whole number, at least 2"),
    ],
)
def test_what_no_method_takes_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        method_named(*arguments)


def test_the_papers_budget_is_the_default():
    swarm = method_named("qpso").swarm
    assert (swarm.particles, swarm.iterations) == (80, 300)
    assert isinstance(box_of(problem_of("scara")), Box)


@pytest.mark.parametrize("method", ["alternating", "pso"])
def test_the_verb_fits_by_a_method(method, tmp_path, capsys):
    folder, out = tmp_path / "session", tmp_path / "calibration.yaml"
    write_session(folder, session("scara"))
    budget = ["--particles", "12", "--iterations", "8"] if method in SWARMS else []
    arguments = ["fit", str(folder), "--robot", "scara", "--method", method, *budget]
    assert run([*arguments, "--seed", "4", "--out", str(out)]) == 0
    tried = read_document(out, lambda _: {})["provenance"]["evaluations"]
    assert f"method {method}: {tried} evaluations" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--method", "simplex"], "'least_squares', 'alternating', 'stepwise_qpso', 'qpso', "),
        (["--particles", "20"], "particles: 20 is not allowed with method least_squares"),
        (["--method", "pso", "--particles", "1"], "1 is not in the range x>=2"),
    ],
)
def test_the_verb_refuses_what_no_method_takes(arguments, message, tmp_path, capsys):
    assert run(["fit", str(tmp_path), "--robot", "scara", *arguments]) == 2
    assert message in capsys.readouterr().err
