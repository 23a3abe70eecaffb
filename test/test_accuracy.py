"""Tests of ISO 9283 values of a session: deviations that are put in by hand are found again."""

from __future__ import annotations

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from delta_calibration import accuracy
from delta_calibration.accuracy import evaluate
from delta_calibration.calibration import Calibration
from delta_calibration.cli import report as command
from delta_calibration.cli.main import run
from delta_calibration.data import JointStream, Session, TrackerStream, at_rest, collect, match
from delta_calibration.errors import DataError
from delta_calibration.estimation import chain_of
from delta_calibration.geometry import Frame
from delta_calibration.iso9283 import DELTA_PAPER, STANDARD, Conditions
from delta_calibration.plans import CUBE, legs, make_plan
from delta_calibration.recording import write_session
from delta_calibration.region import Region
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from six_rods import SixRods, drawing_joints

ROBOT = load_robot("srbd")
RATE = 20.0
UM = 1e-6

# For each pose P1..P5: constant deviation, and alternating deviation from cycle to cycle, [um].
BIAS = np.array([[30, 40, 0], [100, 0, 0], [0, -60, 80], [0, 0, 250], [0, 0, 0]]) * UM
SWING = np.array([[5, 0, 0], [0, 9, 0], [0, 0, 7], [0, 9, 0], [2, 3, 6]]) * UM
LIFT, SWAY = 120 * UM, 11 * UM  # the paths: all too high, and alternately to either side


def cycles(count: int) -> Session:
    """A session of the plan with these deviations; a noise-free tracker in the base frame."""
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
            path = plan.paths[(number - len(plan)) // 2]  # a move to the path, then the path
            sign = 1 if runs % 2 else -1
            runs += (number - len(plan)) % 2
            normal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
            tangent = CUBE.line()[-1] - CUBE.line()[0]
            if path.name == "line":  # sideways, perpendicular to the line and to the lift
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
    # Repeated readings count as frozen, so noise of a nanometre is added.
    rng = np.random.default_rng(0)
    point = np.concatenate(points)
    point = point + 1e-9 * rng.standard_normal(point.shape)
    return Session("cycles", joint, joint, TrackerStream(stamp, point))


def drawing_as_calibration() -> Calibration:
    """The nominal robot as a calibration, with the tracker frame equal to the base frame."""
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


@pytest.mark.parametrize("moved", [1.2, 0.008])
def test_a_tracker_that_was_moved_is_named(thirty, moved):
    """Its frame is told to be off, even if it would only shift the ends of a path."""
    calibration = drawing_as_calibration()
    theta, place = calibration.theta.copy(), calibration.chain.layout.place
    theta[place] += moved * CUBE.line()[-1] / np.linalg.norm(CUBE.line()[-1])
    with pytest.raises(DataError) as refused:
        report(thirty, STANDARD, replace(calibration, theta=theta))
    said = str(refused.value)
    assert f"does not fit this session: it is off by {1e3 * moved:.0f} mm" in said
    assert "the tracker was probably moved; leave out --calibration" in said
    assert "attempts" not in said
    assert "\n" not in said


def test_cycles_of_another_robot_are_refused_before_the_diagnosis(
    thirty, tmp_path, monkeypatch, capsys
):
    """A session of the UR10 with the cycles of a Delta."""

    def refuse(*_):
        raise AssertionError

    robot = load_robot("ur10")
    plan = make_plan("identify", robot, count=8, seed=1)
    write_session(tmp_path / "arm", simulate_session(draw_machine(robot, 1), plan, 1))
    write_session(tmp_path / "cycles", thirty)
    monkeypatch.setattr(command, "diagnosed", refuse)
    given = ["--robot", "ur10", "--iso9283", str(tmp_path / "cycles")]
    out = ["--out", str(tmp_path / "page.html")]
    assert run(["report", str(tmp_path / "arm"), *given, *out]) != 0
    said = capsys.readouterr().err
    assert "cycles" in said
    assert said.count("\n") == 1


def test_a_part_of_a_path_that_is_missing_is_not_put_down_to_the_tracker(thirty, monkeypatch):
    def refuse(*_):
        raise DataError("does not go from end to end")

    monkeypatch.setattr(accuracy, "_paths", refuse)
    with pytest.raises(DataError, match=r"^does not go from end to end$"):
        report(thirty, STANDARD, drawing_as_calibration())


@pytest.fixture(scope="module")
def thirty():
    return cycles(30)


@pytest.mark.parametrize("conditions", [STANDARD, DELTA_PAPER], ids=["standard", "delta_paper"])
def test_deviations_laid_in_by_hand_come_out(thirty, conditions):
    found, value = report(thirty, conditions, drawing_as_calibration())
    n = conditions.position_cycles
    # With an odd number of cycles 1/n of the alternating deviation remains in the mean: first -,
    # last -.
    left = -(n % 2) / n
    for k in range(5):
        mean = BIAS[k] + left * SWING[k]
        assert value["AP", f"P{k + 1}"] == pytest.approx(np.linalg.norm(mean), abs=0.02 * UM)
        radii = np.array([abs(s - left) for s in [-1, 1] * (n // 2) + [-1] * (n % 2)])
        radii = radii * np.linalg.norm(SWING[k])
        rp = radii.mean() + 3 * radii.std(ddof=1)
        assert value["RP", f"P{k + 1}"] == pytest.approx(rp, abs=0.02 * UM)
    # P2 and P4 deviate together, so their distance does not: AD is that of the constants, RD is
    # zero.
    p = CUBE.poses()
    distance = np.linalg.norm(p[1] + BIAS[1] - p[3] - BIAS[3]) - np.linalg.norm(p[1] - p[3])
    assert value["AD", "P2-P4"] == pytest.approx(distance, abs=0.02 * UM)
    assert abs(value["RD", "P2-P4"]) < 0.02 * UM
    assert {v.cycles for v in found.values if v.symbol in ("AT", "RT")} == {conditions.path_cycles}


def test_paths_too_high_and_swaying(thirty):
    """AT is the lift, RT the sway, of a line with sideways and a circle with axial sway."""
    _, value = report(thirty, STANDARD, drawing_as_calibration())
    assert value["AT", "line"] == pytest.approx(LIFT, abs=0.1 * UM)
    assert value["RT", "line"] == pytest.approx(SWAY, abs=0.1 * UM)
    # The commanded circle is a polygon that stays within a micrometre of the true circle.
    assert value["AT", "circle"] == pytest.approx(LIFT, abs=0.3 * UM)
    assert value["RT", "circle"] == pytest.approx(SWAY, abs=0.3 * UM)


def test_a_frame_from_the_same_stops_flatters_ap_but_not_the_distances(thirty):
    found, own = report(thirty, STANDARD, None)
    _, given = report(thirty, STANDARD, drawing_as_calibration())
    assert "makes AP look better" in found.frame
    ap = [np.mean([v for (s, _), v in values.items() if s == "AP"]) for values in (own, given)]
    assert ap[0] < ap[1]
    for key in (("AD", "P2-P4"), ("RD", "P2-P4"), ("RP", "P3")):
        assert own[key] == pytest.approx(given[key], abs=0.02 * UM)


def test_too_few_cycles_are_refused_by_pose_and_number():
    said = r"P1 of the cube of robot srbd \(0, 0, -800 mm\) was reached 6 times"
    with pytest.raises(DataError, match=said):
        report(cycles(6), STANDARD, None)


def test_a_session_without_paths_has_no_path_criteria(thirty):
    names = ROBOT.joints.names
    readings = match(thirty, names)
    stops = readings.take(readings.time < collect(thirty, names).time[149] + 0.1)
    found = evaluate(collect(thirty, names), stops, ROBOT, STANDARD, None)
    assert {v.symbol for v in found.values} == {"AP", "RP", "AD", "RD"}
    said = "AT and RT of the {}: 0 complete runs found, ISO 9283:1998 asks for 10"
    assert found.left_out == (said.format("line"), said.format("circle"))


def test_of_two_paths_the_one_that_was_run_too_seldom_is_named(thirty):
    """The ten circles come last; without the last second and a half one of them is incomplete."""
    names = ROBOT.joints.names
    readings = match(thirty, names)
    cut = readings.take(readings.time < readings.time[-1] - 1.5)
    found = evaluate(collect(thirty, names), cut, ROBOT, STANDARD, None)
    paths = [(v.symbol, v.where) for v in found.values if v.symbol in ("AT", "RT")]
    assert paths == [("AT", "line"), ("RT", "line")]
    (said,) = found.left_out
    assert said == "AT and RT of the circle: 9 complete runs found, ISO 9283:1998 asks for 10"
    assert report(thirty, STANDARD, None)[0].left_out == ()


# A session evaluated by an independent short program.


@pytest.fixture(scope="module")
def simulated():
    return simulate_session(draw_machine(ROBOT, 4), make_plan("iso9283", ROBOT, count=30), 4)


def own_frame(source, target):
    """R, t of the least-squares rigid motion, by the quaternion of Horn (1987)."""
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    m = a.T @ b
    skew = np.array([m[1, 2] - m[2, 1], m[2, 0] - m[0, 2], m[0, 1] - m[1, 0]])
    k = np.block([[np.trace(m), skew[None]], [skew[:, None], m + m.T - np.trace(m) * np.eye(3)]])
    w, *v = np.linalg.eigh(k)[1][:, -1]
    turn = Rotation.from_quat([*v, w]).as_matrix()
    return turn, target.mean(axis=0) - turn @ source.mean(axis=0)


def test_a_simulated_session_by_a_few_lines_of_ones_own(simulated):
    """Stops by the command's standstill, means of readings, numpy; no code of the package."""
    found, value = report(simulated, STANDARD, None)
    command, point = simulated.command.position, simulated.tracker.position
    rest = np.r_[False, (np.diff(command, axis=0) == 0).all(axis=1)]
    starts = np.flatnonzero(rest & ~np.r_[False, rest[:-1]])
    ends = [start + int(np.argmin(np.r_[rest[start:], False])) for start in starts]
    stops = [(s, e) for s, e in zip(starts, ends, strict=True) if e - s >= 15]
    at = command[[start for start, _ in stops]]
    mean = np.array([point[start:end].mean(axis=0) for start, end in stops])
    turn, place = own_frame(mean, SixRods().point(at))
    drawing = drawing_joints(CUBE.poses())
    here = [np.flatnonzero(np.abs(at - joints).max(axis=1) < 1e-6)[:30] for joints in drawing]
    reached = mean[np.array(here)]  # (5, 30, 3)
    based = reached @ turn.T + place
    middle = based.mean(axis=1)
    radius = np.linalg.norm(based - middle[:, None], axis=2)
    for k in range(5):
        ap = np.linalg.norm(middle[k] - CUBE.poses()[k])
        rp = radius[k].mean() + 3 * radius[k].std(ddof=1)
        # The two select slightly different readings at the edges of a stop: below a micrometre.
        assert value["AP", f"P{k + 1}"] == pytest.approx(ap, abs=1.5 * UM)
        assert value["RP", f"P{k + 1}"] == pytest.approx(rp, abs=3 * UM)
    between = np.linalg.norm(reached[1] - reached[3], axis=1)
    meant = np.linalg.norm(CUBE.poses()[1] - CUBE.poses()[3])
    assert value["AD", "P2-P4"] == pytest.approx(between.mean() - meant, abs=1.5 * UM)
    assert value["RD", "P2-P4"] == pytest.approx(3 * between.std(ddof=1), abs=3 * UM)
    # Rest errors of 12 urad at about 0.4 m/rad: a few micrometres.
    assert all(2 * UM < v.value < 60 * UM for v in found.values if v.symbol in ("RP", "RT"))


def test_the_standards_ten_runs_and_the_papers_three_come_from_one_session(simulated):
    for conditions, runs in ((STANDARD, 10), (DELTA_PAPER, 3)):
        found, value = report(simulated, conditions, None)
        paths = {(v.symbol, v.where): v.cycles for v in found.values if v.symbol in ("AT", "RT")}
        assert paths == dict.fromkeys(product(("AT", "RT"), ("line", "circle")), runs)
        # The machine's error in the middle of the line equals that at P1 within 20 um.
        assert value["AT", "line"] > value["AP", "P1"] - 20 * UM


def test_at_of_a_simulated_session_is_the_machines_own_deviation(simulated):
    """Largest perpendicular distance of the true machine from the line, in the fitted frame.

    In the mean of ten runs a third of the rest error, a few micrometres, remains.
    """
    machine = draw_machine(ROBOT, 4)
    _, value = report(simulated, STANDARD, None)
    poses = collect(simulated, ROBOT.joints.names)
    nominal = ROBOT.model("rotary_delta")
    meant = nominal.forward(poses.command, nominal.parameters.nominal)
    turn, place = own_frame(poses.point, meant)
    for name, way, tangent in (
        ("line", CUBE.line(), np.gradient(CUBE.line(), axis=0)),
        ("circle", CUBE.circle(), np.roll(CUBE.circle()[:-1] - CUBE.centre, -25, axis=0)),
    ):
        q = drawing_joints(way[: len(tangent)])
        there = machine.chain.predict(at_rest(q), machine.theta)
        off = there @ turn.T + place - way[: len(tangent)]
        unit = tangent / np.linalg.norm(tangent, axis=1, keepdims=True)
        square = off - np.sum(off * unit, axis=1, keepdims=True) * unit
        largest = np.linalg.norm(square, axis=1).max()
        assert value["AT", name] == pytest.approx(largest, abs=8 * UM)


FEW = Conditions("a few cycles", position_cycles=3, distance_cycles=3, path_cycles=2)


@pytest.mark.parametrize("name", ["linear_delta", "cdpr8", "ur10"])
def test_every_robot_is_judged_by_the_cube_that_its_plan_drives(name):
    """By the machine's true positions. Earlier, all robots were tested in the Delta's cube."""
    robot = load_robot(name)
    machine, plan = draw_machine(robot, 5), make_plan("iso9283", robot, count=6, dwell=0.4)
    session = simulate_session(machine, plan, 5)
    names = robot.joints.names
    report = evaluate(collect(session, names), match(session, names), robot, FEW, None)
    found = {(value.symbol, value.where): value.value for value in report.values}
    assert report.left_out == ()
    # True positions at P1 to P5; the plan visits them in the order P5 to P1.
    chain, theta = machine.chain, machine.theta
    at = at_rest(plan.joint[:5])
    there = chain.predict(at, theta)
    true = np.linalg.norm(there[3] - there[1]) - np.linalg.norm(plan.target[3] - plan.target[1])
    assert found["AD", "P2-P4"] == pytest.approx(true, abs=found["RD", "P2-P4"])
    assert 0.0 < found["RD", "P2-P4"] < 2e-4


def test_cycles_of_another_robot_are_refused():
    robot, other = load_robot("linear_delta"), load_robot("ur10")
    cycle = make_plan("iso9283", other, count=3, dwell=0.4)
    session = simulate_session(draw_machine(other, 5), replace(cycle, paths=()), 5)
    renamed = replace(robot, joints=replace(robot.joints, names=other.joints.names[:3]))
    poses, readings = (f(session, renamed.joints.names) for f in (collect, match))
    said = r"pose 1 \(.* m\) is out of reach of robot 'linear_delta': is it the session of another"
    with pytest.raises(DataError, match=said):
        evaluate(poses, readings, renamed, FEW, None)
