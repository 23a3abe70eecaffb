"""Monitoring of a calibrated machine: no false alarm in a simulated year; a change is detected."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import from_identification
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.health import Level
from delta_calibration.cell.vigil import WINDOWS, Vigil
from delta_calibration.cell.watchman import EVERY_S, SILENT_S, Watchman
from delta_calibration.data import Poses, Session, collect
from delta_calibration.effects import effect_named
from delta_calibration.errors import InputError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import Robot, load_robot
from delta_calibration.simulation import TrueMachine, draw_machine, simulate_session, visited

SEED = 4
DAY_NS = 86_400_000_000_000
REST = 12e-6  # [rad] from the robot file
ALIKE = 0.9  # correlation of a joint's rest error between visits to a place
COUNT = 20  # readings averaged at a stop


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("srbd")


@pytest.fixture(scope="module")
def machine(robot: Robot) -> TrueMachine:
    return draw_machine(robot, SEED)


@pytest.fixture(scope="module")
def calibration(robot: Robot, machine: TrueMachine) -> Calibration:
    plan = make_plan("identify", robot, count=40, seed=SEED)
    poses = collect(simulate_session(machine, plan, SEED), robot.joints.names)
    return from_identification(identify(poses, robot), robot, poses)


@pytest.fixture(scope="module")
def program(robot: Robot, machine: TrueMachine) -> Poses:
    """Twelve places that the machine visits every day."""
    plan = make_plan("identify", robot, count=12, both_sides=False, seed=SEED + 1)
    return collect(simulate_session(machine, plan, SEED + 1), robot.joints.names)


def repeated(program: Poses, visits: int) -> Poses:
    """The program run `visits` times."""
    index = np.tile(np.arange(len(program)), visits)
    rows = ("joint", "command", "point", "count", "scatter", "direction", "travel")
    more = ("payload", "payload_centre", "temperature", "place", "repeat")
    taken = {name: getattr(program, name)[index] for name in rows + more}
    return replace(program, time=10.0 * np.arange(len(index)), **taken)


def days(
    machine: TrueMachine, robot: Robot, program: Poses, seed: int, count: int, visits: int = 2
) -> Iterator[Poses]:
    """Yield the readings of each day, with tracker and reflector set up again.

    The rest errors of a place are correlated from visit to visit and from day to day.
    """
    rng = np.random.default_rng(seed)
    whole, n = repeated(program, visits), len(program)
    rest = REST * rng.standard_normal(program.joint.shape)
    for day in range(count):
        here = visited(machine, robot, SEED, 1 + day)
        errors = []
        for _ in range(visits):
            rest = ALIKE * rest + np.sqrt(1 - ALIKE**2) * REST * rng.standard_normal(rest.shape)
            errors.append(rest)
        at = replace(whole.conditions, joint=whole.joint + np.concatenate(errors))
        ideal = here.chain.predict(at, here.theta)
        _, across = robot.tracker.sigmas(np.linalg.norm(ideal, axis=1))
        noise = across[:, None] / np.sqrt(COUNT) * rng.standard_normal((visits * n, 3))
        yield replace(
            whole,
            start_ns=whole.start_ns + day * DAY_NS,
            point=ideal + noise,
            count=np.full(visits * n, COUNT),
        )


def changed(machine: TrueMachine, name: str, by: float) -> TrueMachine:
    theta = machine.theta.copy()
    theta[machine.chain.parameters.names.index(name)] += by
    return replace(machine, theta=theta)


def test_a_year_without_a_change_keeps_the_stated_rate(
    machine: TrueMachine, robot: Robot, calibration: Calibration, program: Poses
) -> None:
    """Every third day of a year, at a rate of one alarm a month: twelve would be allowed."""
    vigil, alarms = Vigil(calibration, 1.0), 0
    for number, poses in enumerate(days(machine, robot, program, 1, 122, visits=1)):
        vigil.set_up()
        poses = replace(poses, start_ns=program.start_ns + 3 * number * DAY_NS)
        if vigil.take(poses).changed:
            alarms, vigil = alarms + 1, Vigil(calibration, 1.0)
    assert alarms <= 2
    assert WINDOWS[-1] < 31


def test_a_change_is_seen_within_days_and_stays(
    machine: TrueMachine, robot: Robot, calibration: Calibration, program: Poses
) -> None:
    vigil = Vigil(calibration, 0.1)
    for poses in days(machine, robot, program, 2, 6):
        vigil.set_up()
        assert not vigil.take(poses).changed
    longer = changed(machine, "arm_2", 8e-5)
    seen = 0
    for poses in days(longer, robot, program, 3, 12):
        later = replace(poses, start_ns=poses.start_ns + 6 * DAY_NS)
        vigil.set_up()
        seen += 1
        if vigil.take(later).changed:
            break
    assert vigil.suspicion.changed
    assert vigil.suspicion.location in (None, "joint_2")
    assert seen < 12
    for poses in days(machine, robot, program, 4, 1):  # an alarm is not withdrawn
        assert vigil.take(poses).changed


def test_a_tracker_that_is_moved_without_a_word_is_no_change(
    machine: TrueMachine, robot: Robot, calibration: Calibration, program: Poses
) -> None:
    vigil = Vigil(calibration, 0.1)
    for number, poses in enumerate(days(machine, robot, program, 5, 8)):
        if number % 2 == 0:  # on every second day the new set-up is not announced
            vigil.set_up()
        assert not vigil.take(poses).changed


def test_one_bad_reading_is_no_change(
    machine: TrueMachine, robot: Robot, calibration: Calibration, program: Poses
) -> None:
    vigil = Vigil(calibration, 0.1)
    for number, poses in enumerate(days(machine, robot, program, 6, 6)):
        point = poses.point.copy()
        if number in (2, 4):
            point[number] += 3e-4
        vigil.set_up()
        assert not vigil.take(replace(poses, point=point)).changed


def test_a_held_reading_is_not_looked_at(
    machine: TrueMachine, robot: Robot, calibration: Calibration, program: Poses
) -> None:
    vigil = Vigil(calibration, 0.1)
    for poses in days(machine, robot, program, 7, 3):
        point = poses.point.copy()
        point[4:] = point[3]
        assert not vigil.take(replace(poses, point=point)).changed
    assert vigil.held == 3 * (len(poses) - 4)


def test_a_calibration_that_wants_a_load_waits_until_it_is_known(
    robot: Robot, calibration: Calibration, program: Poses
) -> None:
    """Without the payload there is no prediction, and no alarm."""
    effect = effect_named("joint_compliance", robot, calibration.chain.mechanism, {})
    chain = calibration.chain.with_effects((effect,))
    size = chain.layout.size
    assert calibration.uncertainty is not None
    covariance = 1e-14 * np.eye(size)
    inner = calibration.chain.layout.size
    covariance[:inner, :inner] = calibration.uncertainty.covariance
    wanting = replace(
        calibration,
        chain=chain,
        theta=np.concatenate([calibration.theta, np.full(size - inner, 1e-5)]),
        uncertainty=replace(calibration.uncertainty, covariance=covariance),
    )
    vigil = Vigil(wanting, 0.1)
    nowhere = replace(program, payload=np.full(len(program), np.nan))
    assert not vigil.take(nowhere).changed
    assert (vigil.stops, vigil.unknown) == (0, len(program))
    warm = replace(
        program,
        payload=np.zeros(len(program)),
        payload_centre=np.zeros((len(program), 3)),
        temperature_parts=("arm",),
        temperature=np.full((len(program), 1), 25.0),
    )
    vigil.take(replace(warm, temperature_parts=(), temperature=np.zeros((len(program), 0))))
    vigil.take(warm)  # a sensor that appears later
    assert vigil.stops == 2 * len(program)
    assert np.isfinite(vigil.suspicion.odds)


def test_a_cycle_by_the_clock_of_the_calibration_is_no_change(
    robot: Robot, calibration: Calibration, program: Poses
) -> None:
    """Held at the end of its session, at its crest, it was expected to stay there."""
    settings = {"period": 3600.0, "phase": 0.0}
    effect = effect_named("joint_zero_drift", robot, calibration.chain.mechanism, settings)
    chain, inner = calibration.chain.with_effects((effect,)), calibration.chain.layout.size
    assert calibration.uncertainty is not None
    covariance = 1e-12 * np.eye(chain.layout.size)
    covariance[:inner, :inner] = calibration.uncertainty.covariance
    cycle = replace(
        calibration,
        chain=chain,
        theta=np.concatenate([calibration.theta, [3e-4, 2e-4, 1e-4]]),
        uncertainty=replace(calibration.uncertainty, covariance=covariance),
        ended=900.0,
    )
    plain, watched = Vigil(calibration, 0.1), Vigil(cycle, 0.1)
    assert watched.take(program).odds == pytest.approx(plain.take(program).odds, abs=1e-6)


def test_what_cannot_be_watched_is_refused(calibration: Calibration) -> None:
    with pytest.raises(InputError, match="does not contain its uncertainty; fit again"):
        Vigil(replace(calibration, uncertainty=None), 0.1)
    with pytest.raises(InputError, match="false alarms: 11 per month is not allowed; 0 to 10"):
        Vigil(calibration, 11.0)


# Streams


def feed(watchman: Watchman, session: Session, now_s: float) -> None:
    """Send the messages of a session as a node receives them."""
    for k in range(len(session.states.stamp_ns)):
        stamp = int(session.states.stamp_ns[k])
        watchman.add_tracker(stamp, session.tracker.position[k], None, now_s)
        watchman.capture.add_command(stamp, session.command.position[k])
        watchman.capture.add_states(stamp, session.states.position[k])


def look(watchman: Watchman, now_s: float) -> None:
    watchman.look(now_s)
    while watchman._work is not None:
        time.sleep(0.01)
        watchman.look(now_s)


def test_streams_are_judged_a_batch_at_a_time(
    machine: TrueMachine, robot: Robot, calibration: Calibration
) -> None:
    watchman = Watchman(robot.joints.names, 1.0, 0.1, 100_000)
    plan = make_plan("identify", robot, count=8, seed=3, dwell=0.4)
    sound = simulate_session(machine, plan, 8)
    feed(watchman, sound, 0.0)
    assert watchman.capture.held == 0  # nothing is calibrated
    watchman.watch(calibration)
    feed(watchman, sound, 0.0)
    look(watchman, EVERY_S - 1)
    assert watchman.values["watch stops examined"] == 0
    look(watchman, EVERY_S)
    assert watchman.values["watch stops examined"] == len(plan)
    assert watchman.trouble == ""
    assert watchman.values["watch"] == "as calibrated"
    bent = visited(changed(machine, "arm_2", 3e-4), robot, SEED, 9)
    for number in range(4):
        now_s = 2 * EVERY_S + SILENT_S + number * EVERY_S
        feed(watchman, simulate_session(bent, plan, 9 + number), now_s)
        look(watchman, now_s + EVERY_S)
    assert "no longer what was calibrated" in watchman.trouble
    watchman.watch(calibration)
    assert watchman.trouble == ""


def test_a_watch_that_fails_does_not_take_the_cell_with_it(
    machine: TrueMachine, robot: Robot, calibration: Calibration, monkeypatch: pytest.MonkeyPatch
) -> None:
    watchman = Watchman(robot.joints.names, 1.0, 0.1, 100_000)
    watchman.watch(calibration)

    def fails(self: Vigil, poses: Poses) -> None:
        raise ValueError("odd")

    monkeypatch.setattr(Vigil, "take", fails)
    plan = make_plan("identify", robot, count=3, seed=3, dwell=0.4)
    feed(watchman, simulate_session(machine, plan, 8), 0.0)
    look(watchman, EVERY_S)
    assert watchman.trouble == "not watched: ValueError('odd')"


def test_what_a_watch_says_comes_first_in_the_health_of_a_cell(calibration: Calibration) -> None:
    desk = CalibrationSession(Settings("srbd", false_alarms=0.1))
    assert desk.health(0.0, 1.0).values["watch"] == "off"
    desk.watchman.watch(replace(calibration, uncertainty=None))
    health = desk.health(0.0, 1.0)
    assert health.level is Level.WARN
    assert "not watched" in health.message
