"""Continual calibration: the state carried over from the history, and its update by few poses."""

from __future__ import annotations

from dataclasses import replace
from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import Session, survey
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import Carried, chain_of, identify
from delta_calibration.history import Dated, History, Part, Step, Steps, Walk, prospect
from delta_calibration.history.walk import Kept, State
from delta_calibration.plans import Plan, make_plan
from delta_calibration.plans.optimal import drawn_theta, unmeasured
from delta_calibration.plans.renewal import renewal_plan
from delta_calibration.recording import write_session
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import days_later, draw_machine, simulate_session, visited

BEGAN = datetime(2026, 1, 1, tzinfo=timezone.utc)
SEED = 5
Causes = dict[str, dict[str, str]]


def kept(count: int) -> tuple[Kept, ...]:
    """Parameters of two classes, in turn."""
    return tuple(
        Kept(f"p{i}", "ab"[i % 2], f"joint_{i}", "m", 0.0, 1.0, 1.0, (f"p{i}",))
        for i in range(count)
    )


def walked(
    rng: np.random.Generator, sessions: int, speed: tuple[float, float], size: int = 6
) -> tuple[Walk, np.ndarray]:
    """Simulate the sessions of a drifting machine; return them and its final state."""
    x, parts = rng.standard_normal(size), []
    each = np.where(np.arange(size) % 2, speed[1], speed[0])
    for number in range(sessions):
        x = x + each * rng.standard_normal(size) * np.sqrt(7.0) * (number > 0)
        rows = 5.0 * rng.standard_normal((2 * size, size))
        seen = rows @ x + rng.standard_normal(2 * size)
        parts.append(Part(str(number), rows.T @ rows, rows.T @ seen))
    return Walk(kept(size), tuple(parts), np.full(sessions - 1, 7.0)), x


# The state space


def test_the_likelihood_goes_with_the_speeds_as_its_slope_says() -> None:
    walk, _ = walked(np.random.default_rng(0), 8, (0.005, 0.2))
    walk = replace(walk, speed=(("a", 0.05), ("b", 0.1)))
    _, slope = walk._score()
    for number in range(2):
        ends = []
        for sign in (-1, 1):
            own = [0.05, 0.1]
            own[number] *= np.exp(sign * 1e-4)
            ends.append(replace(walk, speed=(("a", own[0]), ("b", own[1])))._score()[0])
        assert np.isclose((ends[1] - ends[0]) / 2e-4, slope[number], rtol=1e-5)


def test_the_speed_of_each_class_is_learnt_and_the_last_state_with_its_error() -> None:
    off = []
    for seed in range(12):
        walk, x = walked(np.random.default_rng(seed), 30, (0.005, 0.2))
        learnt = walk.learnt()
        speed = dict(learnt.speed)
        assert speed["a"] < 0.03
        assert 0.14 < speed["b"] < 0.28
        state = learnt.later(0.0)
        off.append((state.value - x) @ np.linalg.solve(state.covariance, state.value - x))
    assert 0.7 < np.mean(off) / len(x) < 1.4


def test_only_what_clearly_drifts_is_told() -> None:
    walk, _ = walked(np.random.default_rng(0), 12, (0.0, 0.2))
    assert [name for name, _ in walk.learnt().clear()] == ["b"]
    told = History(("a", "b"), (), np.zeros(2), np.zeros(2), (("arm_length", 0.031),))
    assert told.sentences()[1].endswith("fraction of the tolerance: arm length by 3.1 %")


def test_smoothing_is_what_all_numbers_at_once_give() -> None:
    """Compared with one normal equation for the states of two sessions."""
    walk, _ = walked(np.random.default_rng(1), 2, (0.1, 0.1), 3)
    walk = replace(walk, speed=(("a", 0.1), ("b", 0.3)), steps=(Step((1,), 0),))
    q = np.diag(1.0 / walk.moved(0))
    first, last = (part.information for part in walk.parts)
    normal = np.block([[first + np.eye(3) + q, -q], [-q, last + q]])
    right = np.concatenate([part.right for part in walk.parts])
    both, covariance = np.linalg.solve(normal, right), np.linalg.inv(normal)
    for session, own in enumerate((slice(3), slice(3, 6))):
        state = walk.smoothed(session)
        assert np.allclose(state.value, both[own])
        assert np.allclose(state.covariance, covariance[own, own], atol=1e-10)
    turn = np.hstack([-np.eye(3), np.eye(3)])
    assert np.allclose(walk.change(0).value, turn @ both)
    assert np.allclose(walk.change(0).covariance, turn @ covariance @ turn.T, atol=1e-8)


def test_a_session_as_expected_surprises_as_chance_does() -> None:
    rng, squares = np.random.default_rng(2), []
    for _ in range(200):
        rows = rng.standard_normal((4, 6))
        x = rng.standard_normal(6)
        seen = rows @ x + rng.standard_normal(4)
        square, degrees = State(np.zeros(6), np.eye(6)).surprise(
            Part("", rows.T @ rows, rows.T @ seen)
        )
        assert degrees == 4
        squares.append(square)
    assert 3.4 < np.mean(squares) < 4.6


def test_a_drift_is_no_row_of_steps_and_a_step_beside_it_is_seen() -> None:
    for seed in range(3):
        walk, _ = walked(np.random.default_rng(seed), 12, (0.05, 0.05))
        days = tuple(walk.days.tolist())
        found, _ = Steps(walk.kept, walk.parts, days=days).search()
        assert found == ()
        far = np.eye(6)[2] * 3.0
        parts = tuple(
            replace(p, right=p.right + p.information @ far * (k > 6))
            for k, p in enumerate(walk.parts)
        )
        (step,), _ = Steps(walk.kept, parts, days=days).search()
        assert (step.step.rows, step.step.gap) == ((2,), 6)


def test_a_step_of_few_sessions_is_not_taken_for_drift() -> None:
    walk, _ = walked(np.random.default_rng(3), 4, (0.0, 0.0))
    far = np.eye(6)[2] * 3.0
    parts = tuple(
        replace(p, right=p.right + p.information @ far * (k > 1)) for k, p in enumerate(walk.parts)
    )
    (step,), _ = Steps(walk.kept, parts, days=(7.0,) * 3).search()
    assert (step.step.rows, step.step.gap) == ((2,), 1)


# The machine


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("srbd")


def measured(robot: Robot, day: int, plan: Plan, causes: Causes) -> Session:
    """Simulate a session of one day, with tracker and reflector set up again."""
    machine = visited(draw_machine(robot, SEED, 1.0, causes), robot, SEED, day + 1)
    return days_later(simulate_session(machine, plan, 100 + day), day)


def dated(robot: Robot, day: int, plan: Plan, causes: Causes) -> Dated:
    recorded = measured(robot, day, plan, causes)
    seen = survey(recorded, robot.joints.names, robot.commanded.joint_size)
    return Dated(f"day_{day}", BEGAN + timedelta(days=day), seen)


@pytest.fixture(scope="module")
def whole(robot: Robot) -> Plan:
    return make_plan("identify", robot, count=30, seed=1)


@pytest.fixture(scope="module")
def old(robot: Robot, whole: Plan) -> list[Dated]:
    return [dated(robot, day, whole, {}) for day in range(4)]


@pytest.fixture(scope="module")
def few(robot: Robot, old: list[Dated]) -> Plan:
    return renewal_plan(robot, prospect(old, robot).carried, 12, seed=1).plan


def off(robot: Robot, carried: Carried | None, new: Dated, held: Dated) -> float:
    """RMS distance from poses of the same set-up that were not fitted [m]."""
    found = identify(new.survey.poses, robot, carried=carried)
    poses = held.survey.poses
    missed = poses.point - found.chain.predict(poses.conditions, found.theta)
    return float(np.sqrt(np.mean(np.sum(missed**2, axis=1))))


def test_few_poses_added_to_a_history_do_as_well_as_a_whole_plan(
    robot: Robot, whole: Plan, old: list[Dated], few: Plan
) -> None:
    """All errors include the noise of the held-out poses, 9 um."""
    held = dated(robot, 4, make_plan("identify", robot, count=60, seed=9), {})
    new = dated(robot, 4, few, {})
    now = prospect(old, robot, new)
    assert now.changes == ()
    assert now.odd == 1.0
    updated = off(robot, now.carried, new, held)
    assert updated < 1.2 * off(robot, None, dated(robot, 4, whole, {}), held)
    assert updated < off(robot, None, new, held)


def test_what_changed_is_seen_by_few_poses_and_not_carried_over(
    robot: Robot, whole: Plan, old: list[Dated], few: Plan
) -> None:
    longer = {"arm_length": {"location": "joint_3", "value": "1.5e-4"}}
    held = dated(robot, 4, make_plan("identify", robot, count=60, seed=9), longer)
    new = dated(robot, 4, few, longer)
    now = prospect(old, robot, new)
    (change,) = now.changed_now("day_4")
    assert (change.what, change.location) == ("arm_length", "joint_3")
    assert abs(change.to - change.from_ - 1.5e-4) < 4 * change.std < 6e-5
    updated = off(robot, now.carried, new, held)
    assert updated < 1.2 * off(robot, None, dated(robot, 4, whole, longer), held)
    stale = prospect(old, robot).carried
    held_to = replace(stale, covariance=1e-6 * stale.covariance)
    assert off(robot, held_to, new, held) > 2 * updated


def test_a_session_before_all_others_has_no_history(robot: Robot, old: list[Dated]) -> None:
    with pytest.raises(DataError, match="no session in the history began before this one"):
        prospect(old[1:], robot, old[0])
    with pytest.raises(DataError, match="no session in the history; an update needs at least one"):
        prospect([], robot)


def test_a_prior_is_carried_into_the_unknowns(robot: Robot) -> None:
    """The standard deviations of dimensions without measurements are those of the prior."""
    chain = chain_of(robot)
    size = len(chain.mechanism.parameters)
    rng = np.random.default_rng(0)
    root = 1e-5 * rng.standard_normal((size, size))
    carried = Carried((), chain.mechanism.parameters.nominal + 1e-4, root @ root.T, np.zeros(0))
    problem = carried.applied(unmeasured(chain, drawn_theta(chain)))
    own = chain.layout.geometry
    assert np.allclose(problem.theta0[own], carried.mean)
    spread = problem.basis[own, own] @ problem.basis[own, own].T
    assert np.allclose(spread, carried.covariance)
    assert np.allclose(
        problem.theta(problem.unknowns(problem.theta0 + 1e-6)), problem.theta0 + 1e-6
    )


def test_an_update_of_too_few_places_is_refused(robot: Robot, old: list[Dated]) -> None:
    with pytest.raises(InputError, match="--count 4: an update needs 5 places or more"):
        renewal_plan(robot, prospect(old[:1], robot).carried, 4)


# The verbs


def test_a_plan_to_update_and_its_fit_go_by_the_store(
    robot: Robot, whole: Plan, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("sqlalchemy")
    store = ["--machine", "m", "--store", str(tmp_path / "h.sqlite")]
    for day in range(2):
        write_session(tmp_path / f"day_{day}", measured(robot, day, whole, {}), {})
    add = ["history", "add", *(str(tmp_path / f"day_{day}") for day in range(2))]
    assert run([*add, "--robot", "srbd", "--quick", *store]) == 0
    poses = tmp_path / "poses.csv"
    assert run(["plan", "--update", *store, "--count", "6", "--out", str(poses)]) == 0
    assert "6 poses of 1000, each from both sides, added to 2 sessions" in capsys.readouterr().out
    plan = make_plan(str(poses), robot)
    assert len(plan) == 12
    write_session(tmp_path / "new", measured(robot, 2, plan, {}), {})
    out = tmp_path / "calibration.yaml"
    assert run(["fit", str(tmp_path / "new"), *store, "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "carried over from 2 sessions (day_0 to day_1): geometry" in said
    assert "this session shows no change since then" in said
    assert run(["fit", str(tmp_path / "new"), "--robot", "srbd"]) == 1  # too few without history
    assert "6 different poses at rest, 12 or more are needed" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["plan", "--update", "--robot", "srbd"], "--update and --machine must be given together"),
        (["plan", "--identify"], "give --robot, or --machine of a history"),
        (["plan", "--identify", "--robot", "srbd", "--store", "h"], "give --machine as well"),
        (["plan", "--identify", "--update"], "give one of --name, --identify, --update"),
        (["plan", "--update", "--machine", "m"], "no history found"),
    ],
)
def test_what_cannot_be_updated_is_said(
    arguments: list[str],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    pytest.importorskip("sqlalchemy")
    monkeypatch.chdir(tmp_path)
    assert run([*arguments, "--out", str(tmp_path / "p.csv")]) == 2
    assert said in capsys.readouterr().err
