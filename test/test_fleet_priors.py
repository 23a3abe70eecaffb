"""Priors from a fleet: a known population is found, and odd machines are not pulled towards it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import Poses, collect
from delta_calibration.documents import read_document
from delta_calibration.errors import ConfigError, DataError
from delta_calibration.estimation import (
    Likelihood,
    Population,
    believe,
    chain_of,
    identify,
)
from delta_calibration.fleet.evidence import Fitted, likelihood_of_calibration
from delta_calibration.fleet.population import estimate, kinds_of
from delta_calibration.fleet.priors import read_priors, write_priors
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, simulate_session

Array = NDArray[np.float64]

SIZE, SEEN = 12, 9  # dimensions, and combinations of them that a machine's data determine


def machines(
    rng: np.random.Generator, count: int, mean: Array, spread: Array
) -> tuple[Likelihood, Array]:
    """Machines drawn by numpy: normal dimensions, measured through a matrix with noise."""
    dimensions = mean + spread * rng.standard_normal((count, SIZE))
    return seen(rng, dimensions), dimensions


def seen(rng: np.random.Generator, dimensions: Array) -> Likelihood:
    matrix = 20 * rng.standard_normal((len(dimensions), SEEN, SIZE))
    reading = (matrix @ dimensions[..., None])[..., 0]
    reading += rng.standard_normal(reading.shape)
    turned = np.swapaxes(matrix, 1, 2)
    return Likelihood(turned @ matrix, (turned @ reading[..., None])[..., 0])


def test_mean_and_spread_of_a_known_population_are_found() -> None:
    rng = np.random.default_rng(1)
    mean, spread = rng.uniform(-0.8, 0.8, SIZE), rng.uniform(0.1, 0.5, SIZE)
    data, _ = machines(rng, 80, mean, spread)
    found = estimate(data)
    z = (found.population.mean - mean) / found.mean_std
    assert np.abs(z).max() < 4
    assert 0.4 < np.sqrt(np.mean(z**2)) < 1.8
    ratio = found.population.spread / spread
    assert np.abs(np.log(ratio)).max() < np.log(1.7)
    assert found.population.odd.max() < 0.02


def test_odd_machines_do_not_widen_the_crowd_and_are_told() -> None:
    rng = np.random.default_rng(2)
    mean, spread = np.full(SIZE, 0.4), np.full(SIZE, 0.15)
    _, dimensions = machines(rng, 60, mean, spread)
    dimensions[0, 3] = 3.0
    dimensions[1, 7] = -2.5
    found = estimate(seen(rng, dimensions))
    odd = set(map(tuple, np.argwhere(found.belief.crowd < 0.5).tolist()))
    assert {(0, 3), (1, 7)} <= odd
    assert len(odd) <= 4
    assert found.population.spread.max() < 0.25


def test_parts_of_a_kind_share_their_spread() -> None:
    assert kinds_of(["arm_1", "arm_2", "joint_zero_1", "half_width_1a", "half_width_3b"]) == (
        "arm",
        "arm",
        "joint_zero",
        "half_width",
        "half_width",
    )
    rng = np.random.default_rng(3)
    data, _ = machines(rng, 10, np.zeros(SIZE), np.full(SIZE, 0.2))
    spread = estimate(data, ["a", "b"] * (SIZE // 2)).population.spread
    assert len(np.unique(spread)) == 2


def test_what_no_session_shows_keeps_the_tolerance() -> None:
    nothing = Likelihood(np.zeros((6, 3, 3)), np.zeros((6, 3)))
    found = estimate(nothing)
    np.testing.assert_allclose(found.population.mean, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.population.spread, 1.0)
    with pytest.raises(DataError, match="4 machines of this type; priors need at least 5"):
        estimate(Likelihood(nothing.information[:4], nothing.along[:4]))


@pytest.mark.parametrize(("value", "odd"), [(0.55, False), (4.0, True), (-4.0, True)])
def test_a_dimension_is_drawn_to_the_crowd_only_where_it_belongs(value: float, odd: bool) -> None:
    """Measured with an error of 0.2: one near the population is pulled, a far one is not."""
    crowd = Population(np.array([0.5]), np.array([0.05]), np.array([0.01]))
    data = Likelihood(np.array([[25.0]]), np.array([25.0 * value]))
    found = believe(data, crowd)
    assert (found.crowd[0] < 0.01) == odd
    if odd:  # as by the tolerance alone
        np.testing.assert_allclose(found.mean, 25 * value / 26, rtol=1e-3)
    else:
        assert abs(found.mean[0] - 0.5) < 0.01


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("linear_delta")


def poses_of(robot: Robot, seed: int) -> Poses:
    plan = make_plan("identify", robot, count=24, seed=1)
    session = simulate_session(draw_machine(robot, seed), plan, seed)
    return collect(session, robot.joints.names, robot.commanded.joint_size)


@pytest.fixture(scope="module")
def fleet(robot: Robot) -> list[Fitted]:
    found = []
    for seed in range(6):
        poses = poses_of(robot, seed)
        fit = identify(poses, robot)
        found.append(Fitted(f"m{seed}", (from_identification(fit, robot, poses),)))
    return found


def test_a_calibration_divided_by_its_prior_gives_itself_back(
    robot: Robot, fleet: list[Fitted]
) -> None:
    """The likelihood of a fit, multiplied by the tolerances again, is the fit."""
    calibration = fleet[0].calibrations[0]
    assert calibration.uncertainty is not None
    geometry = calibration.chain.layout.geometry
    parameters = chain_of(robot).mechanism.parameters
    data = likelihood_of_calibration(calibration)
    covariance = np.linalg.inv(data.information + np.eye(len(parameters)))
    off = parameters.prior * (covariance @ data.along)
    std = parameters.prior * np.sqrt(np.diag(covariance))
    own = np.sqrt(np.diag(calibration.uncertainty.covariance))[geometry]
    np.testing.assert_allclose(std, own, rtol=0.03)
    away = (parameters.nominal + off - calibration.theta[geometry]) / own
    assert np.abs(away).max() < 0.1


def test_a_file_of_priors_is_read_back_and_only_for_its_robot(
    robot: Robot, fleet: list[Fitted], tmp_path: Path
) -> None:
    file = tmp_path / "priors.yaml"
    only_updates = Fitted("a first one", ())
    document = write_priors(file, [only_updates, *fleet], robot)
    assert document["machines"] == 6
    population = read_priors(file, robot)
    expected = [(p["mean"] - p["nominal"]) / p["tolerance"] for p in document["parameters"]]
    np.testing.assert_allclose(population.mean, expected)
    assert (population.spread > 0).all()
    with pytest.raises(ConfigError, match="made for 'linear_delta'"):
        read_priors(file, load_robot("srbd"))
    with pytest.raises(DataError, match="4 machines of robot linear_delta with a fit of their"):
        write_priors(file, fleet[:4], robot)


def test_a_fit_by_priors_needs_fewer_places_and_says_so(
    robot: Robot, fleet: list[Fitted], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, session, out = tmp_path / "priors.yaml", tmp_path / "few", tmp_path / "c.yaml"
    write_priors(file, fleet, robot)
    plan = make_plan("identify", robot, count=8, seed=1)
    write_session(session, simulate_session(draw_machine(robot, 50), plan, 50), {})
    fit = ["fit", str(session), "--robot", "linear_delta", "--out", str(out)]
    assert run(fit) == 1
    assert "8 different poses at rest, 12 or more" in capsys.readouterr().err
    assert run([*fit, "--priors", str(file)]) == 0
    assert read_document(out, lambda _: {})["provenance"]["prior"] == "population"


def test_a_fit_by_priors_is_no_evidence_of_a_population(
    robot: Robot, fleet: list[Fitted], tmp_path: Path
) -> None:
    file = tmp_path / "priors.yaml"
    write_priors(file, fleet, robot)
    poses = poses_of(robot, 7)
    plain = identify(poses, robot)
    told = identify(poses, robot, population=read_priors(file, robot))
    save_calibration(tmp_path / "c.yaml", told, robot, poses)
    assert plain.effort.settings == {}
    assert told.effort.settings == {"prior": "population"}
    assert (told.std[told.chain.layout.geometry] <= 1.05 * plain.std[:10]).all()


@pytest.mark.parametrize(("odd", "most"), [(0.01, 1.2), (0.0, 2.0)])
def test_a_machine_unlike_any_other_is_not_explained_as_noise(
    robot: Robot, odd: float, most: float
) -> None:
    """With a much narrower population, even one that allows for no odd machines."""
    size = len(chain_of(robot).mechanism.parameters)
    tight = Population(np.full(size, 0.3), np.full(size, 0.05), np.full(size, odd))
    poses = poses_of(robot, 3)
    plain, told = identify(poses, robot), identify(poses, robot, population=tight)
    assert told.full.in_sample < most * plain.full.in_sample
