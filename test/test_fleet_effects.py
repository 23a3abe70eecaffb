"""Priors of effects: an effect of most machines of a fleet is expected in the next one."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import Survey, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.documents import read_document
from delta_calibration.effects import Effect, effect_named
from delta_calibration.estimation import Likelihood, Population, identify
from delta_calibration.fleet.evidence import Fitted, alike
from delta_calibration.fleet.population import Looked, estimate
from delta_calibration.fleet.priors import read_priors, write_priors
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.simulation.machine import TrueMachine

Array = NDArray[np.float64]

MACHINES = 40


def test_the_crowd_is_of_machines_that_have_the_effect() -> None:
    """Of 40 machines 34 have the first parameter, about 1; six have the second."""
    rng = np.random.default_rng(4)
    there = np.zeros((MACHINES, 2), dtype=bool)
    there[:34, 0] = there[30:36, 1] = True
    values = np.column_stack([np.zeros(MACHINES), 1 + 0.1 * rng.standard_normal((MACHINES, 2))])
    known = np.column_stack([np.ones(MACHINES, dtype=bool), there])
    information = 1e4 * np.eye(3) * known[:, None, :]
    data = Likelihood(information, 1e4 * np.where(known, values, 0.0))
    found = estimate(data, None, Looked(np.ones(MACHINES, dtype=bool), there)).population
    np.testing.assert_allclose(found.mean, [0.0, 1.0, 0.0], atol=0.05)
    assert 0.05 < found.spread[1] < 0.2
    np.testing.assert_allclose(found.odd[1:], [7 / 42, 7 / 42], atol=0.05)
    assert found.spread[2] < 0.05  # most have none of it


def test_frequent_causes_are_likelier_and_chance_raises_as_many_alarms() -> None:
    causes = ["a", "b", "c"]
    population = Population(
        np.zeros(1), np.ones(1), np.full(1, 0.05), found=(("a", 0.8), ("b", 0.1), ("c", 0.1))
    )
    weights = dict(population.weights(causes))
    assert weights["a"] == pytest.approx(2.4)
    assert sum(weights.values()) == pytest.approx(len(causes))
    assert population.weights([*causes, "new"]) == ()  # the fleet has no information on it


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("linear_delta")


def machine(robot: Robot, seed: int, strength: float = 1.0) -> TrueMachine:
    hidden = {"backlash": {"strength": f"{strength}"}} if strength else {}
    return draw_machine(robot, seed, 0.3, hidden)


def seen(robot: Robot, drawn: TrueMachine, places: int, seed: int) -> Survey:
    session = simulate_session(drawn, make_plan("identify", robot, count=places, seed=1), seed)
    return survey(session, robot.joints.names, robot.commanded.joint_size)


@pytest.fixture(scope="module")
def fleet(robot: Robot) -> list[Fitted]:
    """Five machines with backlash, and one without."""
    found = []
    for seed in range(6):
        session = seen(robot, machine(robot, seed, float(seed < 5)), 24, seed)
        calibration = from_identification(
            diagnose(session, robot).identification, robot, session.poses
        )
        found.append(Fitted(f"m{seed}", (calibration,), calibration))
    return found


@pytest.fixture(scope="module")
def priors(robot: Robot, fleet: list[Fitted], tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("priors") / "priors.yaml"
    write_priors(file, fleet, robot)
    return file


def error(population: Population | None, robot: Robot, drawn: TrueMachine, places: int) -> float:
    """RMS error of a fit at places that it does not contain, from both sides [m]."""
    fit = identify(seen(robot, drawn, places, 60).poses, robot, population=population)
    plan = make_plan("identify", robot, count=40, seed=9)
    session = simulate_session(drawn, plan, 61)
    at = survey(session, robot.joints.names, robot.commanded.joint_size).poses.conditions
    off = fit.chain.predict(at, fit.theta) - drawn.reflector_points(at)
    return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))


def test_the_file_tells_in_how_many_machines_a_cause_is(priors: Path, robot: Robot) -> None:
    document = read_document(priors, lambda _: {})
    (play,) = (each for each in document["causes"] if each["cause"] == "backlash")
    assert (play["found_in"], play["of"]) == (5, 6)
    (effect,) = document["effects"]
    gap = effect["parameters"][0]
    typical = effect_named("backlash", robot, robot.model(), {}).parameters.prior[0]
    assert 0.7 < gap["mean"] / typical < 1.3
    assert gap["spread"] < 0.5 * typical
    population = read_priors(priors, robot)
    assert [e.cause for e in population.effects] == ["backlash"]
    np.testing.assert_allclose(population.mean[-3] * gap["tolerance"], gap["mean"])


def test_a_fit_of_few_places_has_the_effects_of_the_fleet(priors: Path, robot: Robot) -> None:
    """From half the places better than with tolerances, and than with the dimensions alone."""
    population, drawn = read_priors(priors, robot), machine(robot, 50)
    dimensions = replace(
        population,
        mean=population.mean[:-3],
        spread=population.spread[:-3],
        odd=population.odd[:-3],
        effects=(),
    )
    whole = error(population, robot, drawn, 6)
    assert whole < 0.5 * error(None, robot, drawn, 12)
    assert whole < 0.5 * error(dimensions, robot, drawn, 6)


@pytest.mark.parametrize("strength", [0.0, 3.0])
def test_an_odd_machine_is_not_given_the_play_of_the_others(
    strength: float, priors: Path, robot: Robot
) -> None:
    """With the narrowest possible prior; without odd machines in the model it would be."""
    found, drawn = read_priors(priors, robot), machine(robot, 51, strength)
    tight = replace(found, spread=np.append(found.spread[:-3], np.full(3, 1e-4)))
    poses = seen(robot, drawn, 8, 62).poses
    typical = found.effects[0].parameters.prior
    true = drawn.chain.effect_values(drawn.theta)[0] / typical if strength else np.zeros(3)

    def off(population: Population) -> float:
        fit = identify(poses, robot, population=population)
        (gap,) = fit.chain.effect_values(fit.theta)
        return float(np.abs(gap / typical - true).max())

    assert off(tight) < 0.2
    if not strength:
        assert off(replace(tight, odd=np.zeros(len(tight.odd)))) > 0.3


def test_a_diagnosis_by_priors_says_so_and_is_no_evidence(
    priors: Path, robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, out = tmp_path / "session", tmp_path / "c.yaml"
    plan = make_plan("identify", robot, count=12, seed=1)
    write_session(folder, simulate_session(machine(robot, 52), plan, 63), {})
    told = ["diagnose", str(folder), "--robot", "linear_delta", "--priors", str(priors)]
    assert run([*told, "--out", str(out)]) == 0
    assert "backlash" in capsys.readouterr().out
    assert read_document(out, lambda _: {})["provenance"]["prior"] == "population"


def test_a_diagnosis_tells_the_drawing_before_and_the_fleet_behind(
    priors: Path, robot: Robot, tmp_path: Path
) -> None:
    """Values reported for the nominal machine do not depend on the fleet's priors."""
    session = seen(robot, machine(robot, 53), 14, 64)
    plain = diagnose(session, robot)
    told = diagnose(session, robot, population=read_priors(priors, robot))
    before, again = plain.verdict.baseline, told.verdict.baseline
    assert again.held_out_rms_mm == pytest.approx(before.held_out_rms_mm, rel=0.02)
    assert told.verdict.extended.held_out_rms_mm < 1.1 * plain.verdict.extended.held_out_rms_mm
    save_calibration(tmp_path / "c.yaml", told.identification, robot, session.poses)


def test_growths_are_of_one_kind_only_if_the_same_parts_follow_the_same_sensor(
    robot: Robot,
) -> None:
    def growth(**shape: float | str) -> Effect:
        return effect_named("thermal_growth_arm", robot, robot.model(), shape)

    by_clock = growth(time_constant=1500.0)
    others = (
        growth(time_constant=900.0),
        growth(time_constant=1500.0, alike=0.0),
        growth(sensor="arm"),
        growth(sensor="base"),
    )
    assert alike(by_clock) == alike(growth(time_constant=1502.0))
    assert len({alike(effect) for effect in (by_clock, *others)}) == 5
