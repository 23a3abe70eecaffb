"""ISO 9283 on a session: deviations that are laid in by hand come out as they were laid in."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

from delta_calibration.accuracy import evaluate
from delta_calibration.calibration import Calibration
from delta_calibration.errors import DataError
from delta_calibration.geometry import Frame
from delta_calibration.identification import chain_of
from delta_calibration.iso9283 import DELTA_PAPER, STANDARD
from delta_calibration.plans import CUBE, legs, make_plan
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from delta_calibration.samples import JointStream, Session, TrackerStream, collect, match

ROBOT = load_robot("srbd")
RATE = 20.0
UM = 1e-6

# Of each pose P1..P5: what every cycle is off by, and what it swings by from cycle to cycle, [um].
BIAS = np.array([[30, 40, 0], [100, 0, 0], [0, -60, 80], [0, 0, 250], [0, 0, 0]]) * UM
SWING = np.array([[5, 0, 0], [0, 9, 0], [0, 0, 7], [0, 9, 0], [2, 3, 6]]) * UM
LIFT, SWAY = 120 * UM, 11 * UM  # the paths: all too high, and to either side in turn


def cycles(count: int) -> Session:
    """A session of the plan with these deviations, the tracker without noise in the base."""
    model = ROBOT.model("rotary_delta")
    plan = make_plan("iso9283", ROBOT, count=count, dwell=0.5)
    clock, visits = 0.0, np.zeros(5, dtype=int)
    stamps, joints, points = [], [], []
    runs = 0
    for number, leg in enumerate(legs(plan, ROBOT, RATE)):
        nominal = model.forward(leg.joint, model.parameters.nominal)
        if number < len(plan):
            pose = int(np.argmin(np.linalg.norm(CUBE.poses() - plan.target[number], axis=1)))
            sign = 1 if visits[pose] % 2 else -1
            visits[pose] += 1
            off = BIAS[pose] + sign * SWING[pose]
        else:
            path = plan.paths[(number - len(plan)) // 2]  # a way to the path, then the path
            sign = 1 if runs % 2 else -1
            runs += (number - len(plan)) % 2
            normal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
            tangent = CUBE.line()[-1] - CUBE.line()[0]
            if path.name == "line":  # a side way that is square to the line and to the lift
                normal = np.cross(tangent, [0.0, 0.0, 1.0])
                normal /= np.linalg.norm(normal)
                up = np.cross(normal, tangent / np.linalg.norm(tangent))
                off = LIFT * up + sign * SWAY * normal
            else:
                across = np.cross(CUBE.circle()[1] - CUBE.centre, CUBE.circle()[0] - CUBE.centre)
                off = (LIFT + sign * SWAY) * across / np.linalg.norm(across)
        stamps.append(clock + leg.time)
        joints.append(leg.joint)
        points.append(nominal + off)
        clock += float(leg.time[-1]) + 1 / RATE
    stamp = np.round(np.concatenate(stamps) * 1e9).astype(np.int64)
    joint = JointStream(stamp, ROBOT.joints.names, np.concatenate(joints))
    # A still tracker repeats its value, which counts as frozen: a nanometre of life.
    rng = np.random.default_rng(0)
    point = np.concatenate(points)
    point = point + 1e-9 * rng.standard_normal(point.shape)
    return Session("cycles", joint, joint, TrackerStream(stamp, point))


def drawing_as_calibration() -> Calibration:
    """The nominal robot, the tracker's frame the base's own."""
    chain = chain_of(ROBOT)
    theta = chain.join(chain.mechanism.parameters.nominal, chain.offset, Frame.identity())
    corners = Region(np.array(list(product((-1.0, 1.0), (-1.0, 1.0), (-1.0, 0.0)))))
    limits = ROBOT.joints.lower, ROBOT.joints.upper
    return Calibration(ROBOT, chain, theta, corners, *limits, 0.0, "made", "0" * 64)


def report(session, conditions, calibration):
    names = ROBOT.joints.names
    poses, readings = collect(session, names), match(session, names)
    found = evaluate(poses, readings, ROBOT, conditions, calibration)
    return found, {(v.symbol, v.where): v.value for v in found.values}


@pytest.fixture(scope="module")
def thirty():
    return cycles(30)


@pytest.mark.parametrize("conditions", [STANDARD, DELTA_PAPER], ids=["standard", "delta_paper"])
def test_deviations_laid_in_by_hand_come_out(thirty, conditions):
    found, value = report(thirty, conditions, drawing_as_calibration())
    n = conditions.position_cycles
    # The swing of an odd number of cycles leaves 1/n of itself in the mean: first -, last -.
    left = -(n % 2) / n
    for k in range(5):
        mean = BIAS[k] + left * SWING[k]
        assert value["AP", f"P{k + 1}"] == pytest.approx(np.linalg.norm(mean), abs=0.02 * UM)
        radii = np.array([abs(s - left) for s in [-1, 1] * (n // 2) + [-1] * (n % 2)])
        radii = radii * np.linalg.norm(SWING[k])
        rp = radii.mean() + 3 * radii.std(ddof=1)
        assert value["RP", f"P{k + 1}"] == pytest.approx(rp, abs=0.02 * UM)
    # P2 and P4 swing together, so their distance does not: AD is that of the biases, RD nothing.
    p = CUBE.poses()
    distance = np.linalg.norm(p[1] + BIAS[1] - p[3] - BIAS[3]) - np.linalg.norm(p[1] - p[3])
    assert value["AD", "P2-P4"] == pytest.approx(distance, abs=0.02 * UM)
    assert abs(value["RD", "P2-P4"]) < 0.02 * UM
    assert {v.cycles for v in found.values if v.symbol in ("AT", "RT")} == {conditions.path_cycles}


def test_paths_too_high_and_swaying(thirty):
    """AT is the lift, RT the sway, for a line that sways sideways and a circle along its axis."""
    _, value = report(thirty, STANDARD, drawing_as_calibration())
    assert value["AT", "line"] == pytest.approx(LIFT, abs=0.1 * UM)
    assert value["RT", "line"] == pytest.approx(SWAY, abs=0.1 * UM)
    # The commanded circle is a polygon that stays within a micrometre of the round one.
    assert value["AT", "circle"] == pytest.approx(LIFT, abs=0.3 * UM)
    assert value["RT", "circle"] == pytest.approx(SWAY, abs=0.3 * UM)


def test_a_frame_from_the_same_stops_flatters_ap_but_not_the_distances(thirty):
    found, own = report(thirty, STANDARD, None)
    _, given = report(thirty, STANDARD, drawing_as_calibration())
    assert "flatters AP" in found.frame
    ap = [np.mean([v for (s, _), v in values.items() if s == "AP"]) for values in (own, given)]
    assert ap[0] < ap[1]
    for key in (("AD", "P2-P4"), ("RD", "P2-P4"), ("RP", "P3")):
        assert own[key] == pytest.approx(given[key], abs=0.02 * UM)


def test_too_few_cycles_are_refused_by_pose_and_number():
    with pytest.raises(DataError, match=r"P1 of the cube \(0, 0, -800 mm\) was reached 6 times"):
        report(cycles(6), STANDARD, None)


def test_a_session_without_paths_has_no_path_criteria(thirty):
    names = ROBOT.joints.names
    readings = match(thirty, names)
    stops = readings.take(readings.time < collect(thirty, names).time[149] + 0.1)
    found = evaluate(collect(thirty, names), stops, ROBOT, STANDARD, None)
    assert {v.symbol for v in found.values} == {"AP", "RP", "AD", "RD"}
