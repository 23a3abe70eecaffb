"""Tests of whole targets on the simulated Delta, and of when a machine counts as standing."""

from __future__ import annotations

import csv
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.cell.positioning import (
    Outcome,
    Positioning,
    TrackerFrame,
    frame_joints,
    write_outcomes,
)
from delta_calibration.cell.stop_detector import StopDetector
from delta_calibration.compensation.grid_search import Stop
from delta_calibration.errors import DataError, InputError, ReachError
from delta_calibration.geometry import Frame
from delta_calibration.robot import load_robot
from delta_calibration.ros.simulated_machine import SimulatedMachine
from delta_calibration.simulation import draw_machine
from positioning import drive, lattice, targets, truth

ROBOT = load_robot("srbd")
NAMES = ROBOT.joints.names
TOLD = np.array([0.1, 0.2, 0.3])
PLACE = np.array([1.0, 2.0, 2.0])  # [m] 3 m from the tracker
ALONG = np.array([1.0, 0.0, 0.0])


# --- targets


@pytest.mark.parametrize("seed", [1, 2])
def test_it_beats_the_uncalibrated_machine_without_a_model_of_it(seed: int) -> None:
    run = drive(ROBOT, seed, lattice(ROBOT), points=4, repeats=2, frame_stops=12)
    assert run.before.mean() > 250e-6
    assert run.after.max() < 100e-6
    assert run.after.mean() < 0.2 * run.before.mean()
    assert run.moves.max() < 25
    # The remaining error in the machine's own base is that of the frame.
    np.testing.assert_allclose(run.truly_after, run.frame_error, atol=100e-6)


def test_corrections_are_those_of_the_true_machine_within_their_uncertainty() -> None:
    """Compared with the six-rod machine's inverse kinematics, which the search does not know."""
    machine, wanted = draw_machine(ROBOT, 3), targets(3, 3)
    calibration = truth(machine)
    simulated = SimulatedMachine(machine, np.random.default_rng(1), 0.0)
    work = Positioning(ROBOT, wanted, lattice(ROBOT), 2, 10, calibration)
    now = 0.0
    while not work.done:
        now += 1.0
        simulated.command(work.step, now)
        work.tell(np.mean([simulated.measure(now).position for _ in range(10)], axis=0))
    assert work.frame is None
    mechanism = machine.chain.mechanism
    joint = mechanism.inverse(wanted, calibration.geometry)
    score = np.array(
        [(o.joint - exact) / o.std for o, exact in zip(work.outcomes, joint, strict=True)]
    )
    assert np.abs(score).max() < 4.0
    assert 0.4 < np.sqrt(np.mean(score**2)) < 1.8
    assert min(o.before for o in work.outcomes) > 150e-6
    assert max(o.after for o in work.outcomes) < 100e-6


def test_what_it_does_is_told() -> None:
    work = Positioning(ROBOT, targets(1, 2), lattice(ROBOT), 2, 10, 4)
    assert work.doing == "tracker frame, stop 1 of 4"
    model = ROBOT.model("rotary_delta")
    for _ in range(4):
        work.tell(model.forward(work.step[None], model.parameters.nominal)[0])
    first = work.step
    with pytest.raises(DataError, match=r"target 1 of 2, search 1 of 2, move 1: reading .nan"):
        work.tell(np.full(3, np.nan))
    np.testing.assert_array_equal(work.step, first)  # waits for another reading
    assert not work.done


def test_a_tracker_that_lays_no_frame_ends_it() -> None:
    work = Positioning(ROBOT, targets(1, 2), lattice(ROBOT), 2, 10, 4)
    for _ in range(3):
        work.tell(PLACE)
    with pytest.raises(DataError, match="a frame needs points that do not lie on one line"):
        work.tell(PLACE)
    assert not work.done


@pytest.mark.parametrize(
    ("repeats", "readings", "stops", "said"),
    [(1, 10, 24, "repeats is 1"), (2, 0, 24, "readings is 0"), (2, 10, 3, "frame_stops is 3")],
)
def test_too_little_is_refused(repeats: int, readings: int, stops: int, said: str) -> None:
    with pytest.raises(InputError, match=said):
        Positioning(ROBOT, targets(1, 1), lattice(ROBOT), repeats, readings, stops)


def test_a_target_out_of_reach_is_refused() -> None:
    with pytest.raises(ReachError, match="point 1"):
        Positioning(ROBOT, np.array([[3.0, 0.0, -0.7]]), lattice(ROBOT), 2, 10, 24)


@pytest.mark.parametrize("count", [4, 5, 7, 12, 13, 24, 40])
def test_stops_of_a_frame_lie_all_around_at_two_heights(count: int) -> None:
    model = ROBOT.model("rotary_delta")
    points = model.forward(frame_joints(ROBOT, count), model.parameters.nominal)
    assert len(points) == count
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / np.sqrt(count)
    assert spread[1] > 0.2
    assert np.ptp(points[:, 2]) > 0.05


def test_the_frames_uncertainty_is_that_of_many_frames() -> None:
    rng = np.random.default_rng(0)
    frame = Frame.from_vector(np.array([0.1, -0.2, 2.0, 1.0, -2.0, 0.5]))
    points = 0.4 * rng.standard_normal((10, 3))
    off, said = [], []
    for _ in range(200):
        found = TrackerFrame.on(points + 1e-4 * rng.standard_normal((10, 3)), frame.apply(points))
        off.append(np.mean((found.frame.apply(points) - frame.apply(points)) ** 2) * 3)
        said.append(found.std**2)
    assert np.mean(said) == pytest.approx(np.mean(off), rel=0.1)
    assert "10 stops of the robot itself" in str(found)


def test_outcomes_are_written_whole(tmp_path: Path) -> None:
    outcome = Outcome(
        target=np.array([0.1, -0.2, -0.7]),
        command=np.array([0.1, 0.2, 0.3]),
        dq=np.array([1e-3, -2e-3, 0.0]),
        std=np.full(3, 1e-4),
        before=8e-4,
        after=3e-5,
        moves=17,
        stop=Stop.BOUND,
    )
    write_outcomes(tmp_path / "out.csv", NAMES, [outcome])
    (row,) = csv.DictReader((tmp_path / "out.csv").read_text().splitlines())
    assert [float(row[name]) for name in NAMES] == [0.101, 0.198, 0.3]
    assert (row["x_mm"], row["moves"], row["before_mm"]) == ("100.000000", "17", "0.8000")
    assert row["ended"] == Stop.BOUND.value
    with pytest.raises(InputError, match="cannot be written"):
        write_outcomes(tmp_path / "none" / "out.csv", NAMES, [outcome])
    write_outcomes(tmp_path / "out.csv", NAMES, [outcome, outcome])
    assert len((tmp_path / "out.csv").read_text().splitlines()) == 3


@pytest.mark.parametrize("there", ["", "PermitRootLogin no\n", "x_mm,y_mm,z_mm\n1,2,3\n"])
def test_a_file_of_another_is_not_written_over(tmp_path: Path, there: str) -> None:
    file = tmp_path / "out.csv"
    file.write_text(there)
    with pytest.raises(InputError, match="not overwritten"):
        write_outcomes(file, NAMES, [])
    assert file.read_text() == there


# --- standing


def standing(count: int = 3, last: np.ndarray | None = None) -> StopDetector:
    return StopDetector(NAMES, TOLD, 1e-4, count, ROBOT.tracker, last)


def test_the_mean_is_of_the_readings_after_it_came_to_rest() -> None:
    stop = standing()
    stop.reading(PLACE)
    assert stop.trouble == "no joint_states"
    stop.joints(TOLD + 2e-4 * np.array([0.0, 1.0, 0.0]))
    stop.reading(PLACE)  # moving: does not count
    assert stop.mean is None
    assert "joint_2 is at 0.200200 rad but was commanded to 0.200000" in stop.trouble
    stop.joints(TOLD + 5e-5)
    assert stop.trouble == "no tracker readings"
    stop.reading(PLACE + 2e-4 * ALONG)  # still oscillating
    stop.reading(PLACE + 1e-6 * ALONG)
    assert stop.trouble == "2 tracker readings; 3 are needed"
    stop.reading(PLACE)
    assert stop.mean is None
    assert "tracker readings spread over 0.199" in stop.trouble
    stop.reading(PLACE - 1e-6 * ALONG)
    np.testing.assert_allclose(stop.mean, PLACE, atol=1e-12)


def test_joints_that_leave_begin_it_anew() -> None:
    stop = standing()
    stop.joints(TOLD)
    for _ in range(3):
        stop.reading(PLACE)
    assert stop.mean is not None
    stop.joints(TOLD + 1e-3)
    stop.joints(TOLD)
    assert stop.mean is None


def test_a_tracker_that_says_the_same_as_elsewhere_has_lost_sight() -> None:
    stop = standing(last=PLACE)
    stop.joints(TOLD)
    for _ in range(3):
        stop.reading(PLACE)
    with pytest.raises(DataError, match="lost the reflector"):
        _ = stop.mean


def test_a_noisier_tracker_may_spread_more() -> None:
    noisy = replace(ROBOT.tracker, transverse=1e-4)
    stop = StopDetector(NAMES, TOLD, 1e-4, 3, noisy)
    stop.joints(TOLD)
    for shift in (2e-4, -2e-4, 0.0):
        stop.reading(PLACE + shift * ALONG)
    np.testing.assert_allclose(stop.mean, PLACE)


def test_where_a_sliding_joint_stands_is_said_in_its_unit():
    stop = StopDetector(NAMES, TOLD, 1e-4, 3, ROBOT.tracker, unit="m")
    stop.joints(TOLD + 0.01)
    assert re.search(r"is at \S+ m but was commanded to", stop.trouble)
