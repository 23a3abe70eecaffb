"""Tests of mistakes in sessions: named, repaired, never claimed wrongly, originals kept."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration_file import load_calibration
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.health import Level
from delta_calibration.cli.main import run
from delta_calibration.data import JointStream, Session, TrackerStream, collect
from delta_calibration.doctor import check, whole
from delta_calibration.doctor.clocks import Motion, _late, clocks
from delta_calibration.doctor.steps import Fitted, Offset
from delta_calibration.documents import check_document, load_schema, write_document
from delta_calibration.errors import MistakeError
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.robot import load_robot, robot_document
from delta_calibration.simulation import draw_machine, simulate_session
from mistakes import BOTH, KINDS, clean_case, examined, has_turns, joints, judged, stamped

# Kinds by robot: all on the one with the fastest sessions, on the others what is special.
SHOWN = {
    "linear_delta": tuple(KINDS),
    "srbd": ("joints_unit", "joint_offset", "joint_turns", "mirrored", "tracker_shifted"),
    "five_axis": ("turns_axes", "turns_angles", "tracker_turned", "reflector", "file_unit"),
    "scara": ("joint_turns", "joint_reversed", "turns_quaternion"),
    "ur10": ("joints_swapped", "axes", "reflector"),
    "cdpr8": ("command_offset",),
}


@cache
def case_of(name: str, turns: bool = False):
    return clean_case(name, 7, turns)


@pytest.mark.parametrize(("robot", "kind"), [(r, k) for r, kinds in SHOWN.items() for k in kinds])
def test_a_mistake_is_named(robot: str, kind: str) -> None:
    """At one of its two sizes; benchmarks/doctor.py runs all."""
    case, size = case_of(robot, has_turns(kind)), len(kind) % 2
    made = KINDS[kind](case, size) or KINDS[kind](case, 1 - size)
    if made is None:
        pytest.skip("cannot be seen on this robot")
    found = examined(case, made).found
    assert judged(found, made)[0], "; ".join(m.sentence() for m in found)


@pytest.mark.parametrize("robot", SHOWN)
def test_no_mistake_is_claimed_where_there_is_none(robot: str) -> None:
    for turns in (False, True):
        case = case_of(robot, turns)
        assert check(case.session, case.robot, case.document).found == ()


@pytest.mark.parametrize(
    ("robot", "cause", "strength"),
    [
        ("linear_delta", "joint_zero_offset", 2),
        ("linear_delta", "timestamp_latency", 1),
        ("linear_delta", "backlash", 3),
        ("scara", "link_length", 2),
        ("srbd", "joint_zero_offset", 2),
        ("srbd", "tracker_drift", 2),
    ],
)
def test_errors_of_a_machine_are_no_mistakes(robot: str, cause: str, strength: int) -> None:
    case = clean_case(robot, 8, effects={cause: {"strength": str(strength)}})
    assert check(case.session, case.robot).found == ()


def test_two_mistakes_are_both_named() -> None:
    case = case_of("linear_delta")
    session = replace(
        case.session,
        states=replace(case.session.states, position=1e3 * case.session.states.position),
        command=replace(case.session.command, position=1e3 * case.session.command.position),
        tracker=replace(case.session.tracker, position=case.session.tracker.position / 0.0254),
    )
    late = stamped(session, "tracker", lambda t: t + 2.0)
    found = check(late, case.robot).found
    assert [(m.mistake, m.stream) for m in found] == [
        ("clock_offset", "tracker"),
        ("unit_inch", "tracker"),
        ("unit_mm", "joint_command"),
        ("unit_mm", "joint_states"),
    ]


@pytest.mark.parametrize("robot", ["linear_delta", "ur10"])
def test_coordinates_in_two_units_and_a_left_handed_frame_are_both_named(robot: str) -> None:
    """The heights in mm, and x with the other sign."""
    case = case_of(robot)
    given = case.session.tracker.position * (-1.0, 1.0, 1e3)
    session = replace(case.session, tracker=replace(case.session.tracker, position=given))
    found = check(session, case.robot).found
    assert [(m.mistake, m.part) for m in found if m.mistake == "unit_mm"] == [("unit_mm", "z")]
    assert len(found) == 2
    assert "wrong_robot" not in {m.mistake for m in found}


@pytest.mark.parametrize("robot", ["srbd", "ur10"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_joints_from_one_other_zero_are_named_with_their_direction(
    robot: str, sign: float
) -> None:
    """Motors that read 90 degrees with the arm level, and may count in the other direction."""
    case = case_of(robot)
    made = joints(case.session, BOTH, lambda q: np.pi / 2 + sign * q)
    checked = check(made, case.robot)
    every = ", ".join(case.robot.joints.names)
    shifted = [("joint_offset", stream, every) for stream in BOTH]
    turned = [("joint_reversed", stream, every) for stream in BOTH if sign < 0]
    assert [(m.mistake, m.stream, m.part) for m in checked.found] == shifted + turned
    assert checked.found[0].value == pytest.approx(np.pi / 2, abs=np.radians(0.3))
    assert checked.found[0].mend.startswith(
        "`scale: -1` and `offset: 1.5" if sign < 0 else "`offset: -1.5"
    )
    was, now = case.session.states.position, checked.session.states.position
    np.testing.assert_allclose(now, was, atol=np.radians(0.3))


def test_a_latency_is_left_to_the_diagnosis() -> None:
    case = case_of("linear_delta")
    late = stamped(case.session, "tracker", lambda t: t + 0.02)
    assert check(late, case.robot).found == ()
    (found,) = check(stamped(case.session, "tracker", lambda t: t + 0.1), case.robot).found
    assert (found.mistake, found.stream) == ("clock_offset", "tracker")
    assert found.value == pytest.approx(0.1, abs=0.03)


def test_a_clock_of_another_epoch_is_found() -> None:
    case = case_of("linear_delta")
    begun = stamped(case.session, "tracker", lambda t: t - 1e8)
    (found,) = check(begun, case.robot).found
    assert found.mistake == "clock_offset"
    assert found.value == pytest.approx(-1e8, abs=0.1)


def test_a_session_of_nothing_claims_nothing() -> None:
    case = case_of("linear_delta")
    first = case.session.tracker.stamp_ns[0]
    short = case.session.between(first, first + 1_000_000_000)
    checked = check(short, case.robot)
    assert checked.found == ()
    assert "fewer than 6 stops" in checked.notes[0]


def test_a_session_without_joints_or_tracker_claims_nothing() -> None:
    case = case_of("linear_delta")
    for missing in ({"tracker": None}, {"command": None, "states": None}):
        checked = check(replace(case.session, **missing), case.robot)
        assert checked.found == ()
        assert checked.notes


# The command


def late_session(folder: Path) -> Path:
    case = case_of("linear_delta")
    late = stamped(case.session, "tracker", lambda t: t + 3.0)
    write_session(folder / "late", late)
    return folder / "late"


def test_the_command_names_and_mends(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, found, mended = late_session(tmp_path), tmp_path / "check.json", tmp_path / "mended"
    robot = ["--robot", "linear_delta"]
    assert run(["check", str(session), *robot, "--json", str(found), "--fix", str(mended)]) == 1
    assert "clock offset in tracker" in capsys.readouterr().out
    data = json.loads(found.read_text())
    check_document(data, load_schema("check"), "check.json")
    assert [one["mistake"] for one in data["found"]] == ["clock_offset"]
    assert data["found"][0]["value"] == pytest.approx(3.0, abs=0.05)
    assert run(["check", str(mended), *robot, "--json", str(found)]) == 0
    assert json.loads(found.read_text()) == {"schema": 1, "found": []}
    late = stamps(session)
    assert np.abs(late - stamps(mended) - 3.0).max() < 0.05
    assert "clock offset in tracker" in read_session(mended).metadata["mended"]


def stamps(session: Path) -> np.ndarray:
    tracker = read_session(session).tracker
    return tracker.stamp_ns * 1e-9


def test_nothing_is_written_where_nothing_is_mended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "clean", case_of("linear_delta").session)
    out = tmp_path / "out"
    words = ["check", str(tmp_path / "clean"), "--robot", "linear_delta", "--fix", str(out)]
    assert run(words) == 0  # 1 would say that a mistake was found
    assert "out: there is nothing to correct" in capsys.readouterr().out
    assert not out.exists()


@pytest.mark.parametrize("verb", ["fit", "diagnose"])
def test_no_calibration_is_written_over_a_mistake(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session, out = late_session(tmp_path), tmp_path / "calibration.yaml"
    words = [verb, str(session), "--robot", "linear_delta", "--out", str(out)]
    assert run(words) == 1
    said = capsys.readouterr()
    assert "warning: clock offset in tracker" in said.out
    assert "--force" in said.err
    assert not out.exists()


def test_a_verdict_of_a_session_with_a_mistake_is_written_before_the_refusal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`--json` beside `--out` gives what it gives alone; only the calibration is refused."""
    made = KINDS["tracker_shifted"](case_of("linear_delta"), 0)
    write_session(tmp_path / "moved", made.session)
    out, told = tmp_path / "calibration.yaml", tmp_path / "verdict.json"
    words = ["diagnose", str(tmp_path / "moved"), "--robot", "linear_delta", "--out", str(out)]
    assert run([*words, "--json", str(told)]) == 1
    said = capsys.readouterr()
    assert f"written: {told}" in said.out
    assert "no calibration is written" in said.err
    assert json.loads(told.read_text(encoding="utf-8"))["findings"]
    assert not out.exists()


def test_fix_is_not_promised_where_nothing_explains_the_session(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = case_of("linear_delta").session
    tracker = session.tracker
    flat = replace(tracker, position=tracker.position * [1.0, 1.0, 1e-3])
    write_session(tmp_path / "flat", replace(session, tracker=flat))
    out = tmp_path / "calibration.yaml"
    assert run(["fit", str(tmp_path / "flat"), "--robot", "linear_delta", "--out", str(out)]) == 1
    said = capsys.readouterr().err
    assert "with a mistake (wrong robot): `delta-cal check` explains it; --force" in said
    assert not out.exists()


def test_history_advises_no_force_that_it_does_not_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("sqlalchemy", reason="needs the extra [history]")
    made = KINDS["tracker_shifted"](case_of("linear_delta"), 0)
    write_session(tmp_path / "moved", made.session)
    store = ["--machine", "m", "--store", str(tmp_path / "h.sqlite")]
    words = ["history", "add", str(tmp_path / "moved"), "--robot", "linear_delta", *store]
    assert run(words) == 1
    said = capsys.readouterr().err
    assert "no calibration is written from a session with a mistake" in said
    assert "--force" not in said


def test_by_force_it_is(tmp_path: Path) -> None:
    """A session with a moved tracker can be fitted, but badly."""
    case, out = case_of("linear_delta"), tmp_path / "calibration.yaml"
    made = KINDS["tracker_shifted"](case, 0)
    write_session(tmp_path / "moved", made.session)
    words = ["fit", str(tmp_path / "moved"), "--robot", "linear_delta", "--out", str(out)]
    assert run(words) == 1
    assert run([*words, "--force"]) == 0
    load_calibration(out, case.robot)


def test_a_robot_file_that_does_not_load_is_mended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    document = robot_document("linear_delta")[1]
    document["geometry"] = {**document["geometry"], "arm_mm": 0.345}
    robot, session, out = tmp_path / "mine.yaml", tmp_path / "clean", tmp_path / "out"
    write_document(robot, document)
    write_session(session, case_of("linear_delta").session)
    assert run(["check", str(session), "--robot", str(robot), "--fix", str(out)]) == 1
    assert "write `geometry.arm_mm: 345`" in capsys.readouterr().out
    assert run(["check", str(session), "--robot", str(tmp_path / "out_robot.yaml")]) == 0


def test_a_robot_of_other_joints_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "clean", case_of("linear_delta").session)
    assert run(["check", str(tmp_path / "clean"), "--robot", "srbd"]) == 1
    assert "`--robot linear_delta`" in capsys.readouterr().out


# The cell


def captured(desk: CalibrationSession, session: Session) -> None:
    """Capture the messages of a session in a cell."""
    desk.start_capture(0.0)
    for stream, add in (
        (session.command, desk.capture.add_command),
        (session.states, desk.capture.add_states),
        (session.tracker, desk.capture.add_tracker),
    ):
        for stamp, row in zip(stream.stamp_ns.tolist(), stream.position, strict=True):
            add(stamp, row)
    desk.stop_capture()


def test_a_cell_fits_nothing_over_a_mistake_and_says_so(tmp_path: Path) -> None:
    case, desk = case_of("linear_delta"), CalibrationSession(Settings("linear_delta"))
    captured(desk, stamped(case.session, "tracker", lambda t: t + 3.0))
    with pytest.raises(MistakeError, match="clock offset in tracker"):
        desk.prepare_fit()()
    health = desk.health(0.0, 1.0)
    assert health.level is Level.WARN
    assert "not fitted: clock offset in tracker" in health.message
    with pytest.raises(MistakeError, match="nothing to save"):
        desk.save(str(tmp_path / "calibration.yaml"))
    captured(desk, case.session)
    desk.take(*desk.prepare_fit()())
    assert desk.health(0.0, 1.0).level is Level.OK
    desk.save(str(tmp_path / "calibration.yaml"))


def test_the_mistake_that_somebody_knows_is_the_one_that_is_mended(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two swapped joints of a Delta look like a left-handed frame; points do not separate them."""
    case = case_of("srbd")
    made = joints(case.session, BOTH, lambda q: q[:, [1, 0, 2]])
    write_session(tmp_path / "swapped", made)
    arguments = ["check", str(tmp_path / "swapped"), "--robot", "srbd"]
    mended = ["--fix", str(tmp_path / "mended"), "--prefer", "joints_swapped"]
    assert run([*arguments, *mended]) == 1
    said = capsys.readouterr().out
    assert said.startswith("joints swapped in joint command (joint_1, joint_2)")
    assert "corrected there: joints swapped in joint command; joints swapped in joint st" in said
    now = read_session(tmp_path / "mended")
    np.testing.assert_array_equal(now.command.position, case.session.command.position)
    np.testing.assert_array_equal(now.tracker.position, case.session.tracker.position)
    assert run([*arguments, "--prefer", "joint offset"]) == 2
    assert "'joint offset': not found in the session; found: frame mir" in capsys.readouterr().err


@pytest.mark.parametrize(("own", "given"), [("srbd", "scara"), ("ur10", "srbd")])
def test_the_right_robot_may_have_more_joints(own: str, given: str) -> None:
    """A robot whose joints are among those recorded; its further joints are taken into account."""
    case = clean_case(own, 12)
    (found,) = check(case.session, load_robot(given)).found
    assert (found.mistake, found.mend) == ("wrong_robot", f"`--robot {own}`")


@pytest.mark.parametrize("verb", ["fit", "diagnose"])
def test_a_session_without_the_robots_joints_is_refused_by_one_message(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "session", clean_case("srbd", 12).session)
    assert run([verb, str(tmp_path / "session"), "--robot", "ur10", "--force"]) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith(f"delta-cal: {tmp_path / 'session'}: wrong robot in robot file (ur")
    assert told.err.count("\n") == 1


def test_stops_at_equal_intervals_do_not_shift_a_clock():
    """Speeds of the states that resemble the tracker's at the same and at the next move alike."""
    interval, moves = 3.0, 13
    time = np.arange(0.0, (moves - 1) * interval, 0.05)
    move = np.clip(1.5 - np.abs(time % interval - 0.75) / 0.3, 0.0, 1.0)
    rng = np.random.default_rng(0)
    matched = 0
    for _ in range(100):
        speed = rng.uniform(0.6, 1.2, moves)
        tracker, states = (
            Motion(begin, np.repeat(of, len(time) // (moves - 1)) * move)
            for begin, of in ((0.0, speed[:-1]), (0.02, 0.5 * (speed[:-1] + speed[1:])))
        )
        clock = _late(tracker, states)
        if clock is not None:
            matched += 1
            assert abs(clock.offset) < 0.1
            assert abs(clock.drifted) < 0.1
    assert matched


@pytest.mark.parametrize("seed", range(4))
def test_a_tracker_that_reads_at_stops_only_has_no_clock_error(seed: int) -> None:
    """Joints are recorded on their way to a stop as well; the tracker shows only noise."""
    rng, pitch, way = np.random.default_rng(seed), 0.04, 8
    ends = rng.uniform(-0.5, 0.5, (21, 3))
    share = np.minimum(np.arange(way + 5) / way, 1.0)
    smooth = (share**2 * (3 - 2 * share))[:, None]
    begins = 10**18 + 270 * 10**9 * np.arange(20)
    stamps = begins[:, None] + (1e9 * pitch * np.arange(way + 5)).astype(np.int64)
    joint = np.array([a + smooth * (b - a) for a, b in pairwise(ends)])
    resting = joint[:, way:].reshape(-1, 3) + np.array([3.0, 0.0, 0.0])
    noise = 8e-6 * rng.standard_normal(resting.shape)
    moved = JointStream(stamps.ravel(), ("a", "b", "c"), joint.reshape(-1, 3))
    tracker = TrackerStream(stamps[:, way:].ravel(), resting + noise, None)
    session = Session("stops", moved, moved, tracker)
    assert clocks(session)[1] == ()


def test_a_tracker_that_freezes_is_told_and_no_other_robot():
    """What it repeats for two thirds of the session says nothing about the robot."""
    robot = load_robot("srbd")
    session = simulate_session(draw_machine(robot, 3), make_plan("identify", robot, count=30), 3)
    seen = session.tracker.position.copy()
    begin = len(seen) // 3
    seen[begin:] = seen[begin]
    checked = check(replace(session, tracker=replace(session.tracker, position=seen)), robot)
    assert checked.found == ()
    assert checked.notes == (
        f"{len(seen) - begin - 1} of {len(seen)} tracker readings repeat a frozen value and are "
        "left out",
    )


# A few exchanged rows


@cache
def table_of(name: str) -> Session:
    """A session as a table has it: one row for each stop, 5 s apart."""
    case = case_of(name)
    joints_of = case.robot.joints
    poses = collect(case.session, joints_of.names, case.robot.commanded.joint_size)
    stamp = np.arange(len(poses), dtype=np.int64) * 5_000_000_000
    return replace(
        case.session,
        command=JointStream(stamp, joints_of.names, poses.joint),
        states=None,
        tracker=TrackerStream(stamp, poses.point),
    )


def exchanged(session: Session, pairs: int, seed: int = 0) -> tuple[Session, list[int]]:
    """The points of some pairs of neighbouring rows exchanged, and the first row of each pair."""
    point = session.tracker.position.copy()
    apart = np.linalg.norm(np.diff(point, axis=0), axis=1) > 0.02
    begins = [k for k in range(1, len(apart), 3) if apart[k]]
    chosen = np.random.default_rng(seed).choice(begins, pairs, replace=False)
    for k in chosen:
        point[[k, k + 1]] = point[[k + 1, k]]
    tracker = replace(session.tracker, position=point)
    return replace(session, tracker=tracker), sorted(chosen.tolist())


@pytest.mark.parametrize("pairs", [1, 2, 4])
@pytest.mark.parametrize("robot", ["ur10", "linear_delta", "scara", "five_axis"])
def test_a_few_exchanged_rows_are_told_and_no_mistake(robot: str, pairs: int) -> None:
    made, begins = exchanged(table_of(robot), pairs)
    checked = check(made, case_of(robot).robot)
    assert checked.found == ()
    (note,) = checked.notes
    assert "of neighbouring stops seem exchanged" in note
    for k in begins:
        assert f"{5.0 * k:.1f} and {5.0 * (k + 1):.1f} s" in note


@pytest.mark.parametrize(
    ("robot", "value", "within"),
    [
        ("ur10", 0.03, 1e-3),
        ("ur10", 0.5, 2e-3),
        ("scara", -0.05, 3e-3),
        ("srbd", 0.1, 3e-3),
        ("linear_delta", 0.02, 2e-3),
    ],
)
def test_an_offset_is_found_beside_exchanged_rows(robot: str, value: float, within: float) -> None:
    """With its value, in rad or m."""
    case = case_of(robot)
    other = joints(table_of(robot), BOTH, lambda q: q + value * np.eye(case.joints)[1])
    (found,) = check(exchanged(other, 2)[0], case.robot).found
    assert (found.mistake, found.part) == ("joint_offset", case.robot.joints.names[1])
    assert found.value == pytest.approx(value, abs=within)


@pytest.mark.parametrize("robot", ["ur10", "cdpr8"])
def test_a_moved_tracker_is_found_beside_exchanged_rows(robot: str) -> None:
    point = table_of(robot).tracker.position.copy()
    point[70:] += [0.003, 0.004, 0.0]
    moved = replace(table_of(robot), tracker=replace(table_of(robot).tracker, position=point))
    found = check(exchanged(moved, 3)[0], case_of(robot).robot).found
    assert found[0].mistake == "tracker_moved"
    assert found[0].part.startswith("5.0")
    assert found[0].value == pytest.approx(347.5)


def test_an_offset_beyond_half_a_turn_or_the_range_is_not_possible() -> None:
    for robot, most in (("ur10", np.pi), ("linear_delta", 0.45), ("cdpr8", 698.0)):
        for share, possible in ((0.99, True), (1.01, False)):
            offset = Offset(1, -share * most, 1e6, 0.0)
            assert whole._possible(load_robot(robot), offset) is possible


def test_an_offset_that_a_second_fit_does_not_confirm_is_none() -> None:
    case = case_of("scara")
    names, size = case.robot.joints.names, case.robot.commanded.joint_size
    fitted = Fitted(collect(case.session, names, size), case.robot)
    assert not whole._holds(fitted, Offset(1, 0.05, 1e4, 0.0))
    other = joints(case.session, BOTH, lambda q: q + np.array([0.0, 0.05]))
    fitted = Fitted(collect(other, names, size), case.robot)
    assert whole._holds(fitted, fitted.offset())
