"""Tests of the circle test: circles found and measured, shares of causes, predicted repairs."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")

from delta_calibration.circle_test import (
    DIMENSIONS,
    FOLLOWING,
    CircleTest,
    circle_test,
    find_circles,
    measured_circles,
    pairs,
)
from delta_calibration.circle_test.circles import circular_deviation, circular_hysteresis
from delta_calibration.cli.main import run
from delta_calibration.data import Session, survey
from delta_calibration.diagnosis import Model, calibrated, diagnose
from delta_calibration.diagnosis.constants import LEAST_SURE
from delta_calibration.diagnosis.findings import HeldOutModels, of_term
from delta_calibration.diagnosis.geometry import scatter_of
from delta_calibration.diagnosis.residual_tests import audit
from delta_calibration.diagnosis.rivals import standing
from delta_calibration.diagnosis.scan import scanned
from delta_calibration.diagnosis.search import SearchResult
from delta_calibration.effects import Effect, catalogue
from delta_calibration.errors import DataError
from delta_calibration.plans import make_plan
from delta_calibration.recording import write_session
from delta_calibration.report.circles import on_a_part
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session

ROBOT = load_robot("scara")
SEED = 5
PLAY = {"backlash": {"location": "joint_2", "value": "0.0012"}}
TURN = np.radians(np.arange(-20.0, 380.0, 2.0))
CENTRE = np.array([0.1, -0.2, 0.5])


def session_of(causes: dict, scatter: float = 1.0, seed: int = SEED) -> Session:
    machine = draw_machine(ROBOT, SEED, scatter, causes)
    return simulate_session(machine, make_plan("circles", ROBOT), seed)


def diagnosed(session: Session) -> CircleTest:
    return circle_test(session, ROBOT, diagnose(survey(session, ROBOT.joints.names), ROBOT))


def session_row(session: Session, row: int) -> int:
    """The tracker reading nearest in time to a row of the paths."""
    seen = survey(session, ROBOT.joints.names)
    assert session.tracker is not None
    time = (session.tracker.stamp_ns - seen.poses.start_ns) * 1e-9
    return int(np.argmin(np.abs(time - seen.paths.conditions.time[row])))


def tracked(model: Model) -> np.ndarray:
    return model.extended.chain.predict(model.survey.paths.conditions, model.theta)


def mean_deviation(session: Session) -> float:
    """Measured mean deviation, with only the geometry fitted."""
    model = calibrated(survey(session, ROBOT.joints.names), ROBOT)
    return float(np.mean([m.deviation for m in measured_circles(session, ROBOT, model)]))


@pytest.fixture(scope="module")
def session() -> Session:
    return session_of(PLAY)


@pytest.fixture(scope="module")
def found(session: Session) -> CircleTest:
    return diagnosed(session)


def turned(turn: np.ndarray, radius: float = 0.2, axes: tuple[int, int] = (1, 2)) -> np.ndarray:
    way = np.tile(CENTRE, (len(turn), 1))
    way[:, axes[0]] += radius * np.cos(turn)
    way[:, axes[1]] += radius * np.sin(turn)
    return way


def circles_in(*ways: np.ndarray):
    number = np.repeat(np.arange(len(ways)), [len(way) for way in ways])
    return find_circles(0.05 * np.arange(len(number)), np.concatenate(ways), number)


# Circles


def test_a_circle_is_found_with_plane_sense_radius_and_feed() -> None:
    there, back = circles_in(turned(TURN), turned(TURN[::-1]))
    assert (there.plane, there.sense, back.sense) == ("yz", "anticlockwise", "clockwise")
    assert there.radius == pytest.approx(0.2)
    assert there.feed == pytest.approx(0.2 * np.radians(2.0) / 0.05, rel=1e-3)
    np.testing.assert_allclose(there.centre, CENTRE, atol=1e-9)
    assert np.degrees(np.ptp(there.angle)) == pytest.approx(360.0, abs=2.5)
    assert list(pairs([there, back])) == [(0, 1)]
    (third,) = circles_in(turned(TURN, axes=(2, 0)))
    assert third.plane == "zx"


def test_what_is_no_whole_circle_is_none() -> None:
    arc = turned(TURN[:160])  # 318 degrees
    oval = turned(TURN) + 0.003 * np.outer(np.cos(TURN), [0.0, 1.0, 0.0])
    line = np.linspace([0.0, 0.0, 0.0], [0.3, 0.2, 0.1], 200)
    spot = np.tile(CENTRE, (200, 1))
    helix = turned(TURN) + 0.002 * np.outer(TURN, [1.0, 0.0, 0.0])
    holed = np.delete(turned(TURN), np.arange(80, 95), axis=0)
    for way in (arc, oval, line, spot, helix, holed):
        assert circles_in(way) == ()


def test_the_ways_up_to_the_feed_and_down_are_left_out() -> None:
    slow = np.concatenate([np.linspace(-0.6, -0.35, 40), TURN, np.linspace(6.65, 6.9, 40)])
    (circle,) = circles_in(turned(slow))
    assert circle.rows.min() > 40
    assert circle.rows.max() < len(slow) - 40


def test_deviation_and_hysteresis_are_those_of_the_standard() -> None:
    """G of an oval is twice its amplitude; a shifted centre and a wrong radius do not count."""
    there, back = circles_in(turned(TURN), turned(TURN[::-1]))
    out = np.stack([0 * there.angle, np.cos(there.angle), np.sin(there.angle)], axis=1)
    oval = 30e-6 * np.cos(2 * there.angle)[:, None] * out
    off = oval + 50e-6 * out + np.array([2e-3, 1e-4, -2e-4])
    radial = there.radial(off)
    assert circular_deviation(radial) == pytest.approx(60e-6, rel=2e-3)
    assert radial.mean() == pytest.approx(50e-6, rel=2e-3)
    out = np.stack([0 * back.angle, np.cos(back.angle), np.sin(back.angle)], axis=1)
    other = (
        30e-6 * np.cos(2 * back.angle)[:, None] * out
        + 20e-6 * np.sin(3 * back.angle)[:, None] * out
    )
    assert circular_hysteresis(there, oval, back, other) == pytest.approx(20e-6, rel=0.02)


# Shares and repairs


def test_the_cause_is_named_and_shares_add_up(found: CircleTest) -> None:
    (finding,) = found.verdict.findings
    assert (finding.cause, finding.location) == ("backlash", "joint_2")
    assert {(m.circle.plane, m.circle.sense) for m in found.circles} == {
        ("xy", "clockwise"),
        ("xy", "anticlockwise"),
    }
    assert len(found.circles) == 12
    for m in found.circles:
        assert m.hysteresis is not None
        assert sum(s.size for s in m.shares) == pytest.approx(m.deviation, rel=1e-6)
        assert circular_deviation(m.radial) == m.deviation
    assert sum(s.size for s in found.shares) == pytest.approx(found.deviation, rel=1e-6)
    by = {s.cause: s.size for s in found.shares}
    assert by["measurement_noise"] > 0
    assert by["not_explained"] < 0.02 * found.deviation
    assert FOLLOWING not in by


def test_dimensions_are_told_with_how_far_they_are_off(found: CircleTest) -> None:
    """Except for the tool: the reflector is farther off than its prior, and moves it."""
    machine = draw_machine(ROBOT, SEED, 1.0, PLAY)
    true = dict(zip(machine.chain.parameters.names, machine.theta, strict=True))
    nominal = {p.name: p.nominal for p in machine.chain.parameters.items}
    own = {name: e for name, e in found.dimensions.items() if not name.startswith("tool")}
    assert own
    for name, told in own.items():
        assert abs(told.value - (true[name] - nominal[name])) < 4 * told.std
        assert abs(told.value) > 3 * told.std


def test_a_repair_is_foretold(found: CircleTest) -> None:
    """Compared with the same simulated machine without the cause, and with nominal parts."""
    play, parts = ("backlash", "joint_2"), (DIMENSIONS, None)
    repaired = mean_deviation(session_of({}, seed=77))
    assert found.without(*play) == pytest.approx(repaired, rel=0.1)
    as_drawn = mean_deviation(session_of(PLAY, scatter=0.0, seed=78))
    assert found.without(*parts) == pytest.approx(as_drawn, rel=0.1)
    assert found.deviation > 1.15 * max(repaired, as_drawn)
    least = min((play, parts), key=lambda key: found.without(*key))
    assert found.first == least


def test_what_a_cause_does_to_a_part(found: CircleTest) -> None:
    """Backlash separates the two directions; dimensions do not."""
    play, parts = found.part_error("backlash", "joint_2"), found.part_error(DIMENSIONS, None)
    assert play.senses > 100e-6
    assert parts.senses < 0.2 * play.senses
    assert parts.lobes == 2
    assert "oval by ±" in on_a_part(parts)
    assert "between the two senses" in on_a_part(play)


def test_every_reading_counts_but_outliers(session: Session, found: CircleTest) -> None:
    """Readings just after a reversal belong to the circle; a disturbed beam does not."""
    for m in found.circles:
        assert len(m.radial) >= (355 if m.circle.feed < 0.1 else 118)
    assert session.tracker is not None
    position = session.tracker.position.copy()
    row = int(found.circles[0].circle.rows[100])
    at = session_row(session, row)
    position[at] += 0.005
    spoiled = replace(session, tracker=replace(session.tracker, position=position))
    seen = survey(spoiled, ROBOT.joints.names)
    model = calibrated(seen, ROBOT)
    off = np.linalg.norm(seen.paths.conditions.reading - tracked(model), axis=1)
    assert off.max() > 0.003  # it is in the survey
    again = diagnosed(spoiled)
    assert again.circles[0].deviation == pytest.approx(found.circles[0].deviation, rel=0.02)


def test_drives_that_do_not_follow_have_a_share(session: Session) -> None:
    """The machine is where the encoders indicate; the command was elsewhere."""
    assert session.command is not None
    stamp = session.command.stamp_ns
    late = np.stack(
        [np.interp(stamp + 2e6, stamp, column) for column in session.command.position.T], axis=1
    )
    sharp = 5e-4 * np.sin(4 * late)
    found = diagnosed(replace(session, command=replace(session.command, position=late + sharp)))
    by = {s.cause: s.size for s in found.shares}
    assert by[FOLLOWING] > 20e-6
    assert found.without(FOLLOWING, None) < found.deviation
    assert sum(by.values()) == pytest.approx(found.deviation, rel=1e-6)


def test_dimensions_that_circles_do_not_show_have_no_share_in_the_geometry() -> None:
    """For a nominal machine; none is reported as outlier, and nothing is divided by zero."""
    machine = draw_machine(ROBOT, SEED, 0.0)
    session = simulate_session(machine, make_plan("circles", ROBOT), SEED)
    outlier = scatter_of(calibrated(survey(session, ROBOT.joints.names), ROBOT).beside).outlier
    assert outlier is not None
    assert 0.0 <= outlier.share <= 1.0


def clean_delta(seed: int) -> tuple[Model, tuple[Effect, ...]]:
    """A machine without a cause, measured by circles, and the effects that can be tried."""
    delta = load_robot("srbd")
    session = simulate_session(draw_machine(delta, seed), make_plan("circles", delta), seed)
    start = calibrated(survey(session, delta.joints.names), delta)
    return start, catalogue(delta, start.problem.chain.mechanism)


def test_the_reflector_is_on_the_floor_that_circles_show() -> None:
    """36 stops prefer a minimum 6 cm off; circles prefer the true one by a chi square of 230."""
    start, _ = clean_delta(1300018)
    assert np.abs(start.theta[start.layout.offset]).max() < 0.01


def test_a_small_p_is_not_that_of_few_draws() -> None:
    """Four of 20 000 draws have neighbours as similar; some 200 would say one in a million."""
    session = simulate_session(draw_machine(ROBOT, 1400158), make_plan("circles", ROBOT), 1400158)
    start = calibrated(survey(session, ROBOT.joints.names), ROBOT)
    p = audit(start.beside, start.noise_degrees, np.random.default_rng(5)).p["moran_joints"]
    assert 5e-5 < p < 1e-3


def test_what_chance_explains_as_well_is_not_named() -> None:
    """A joint compliance that replaced another cause predicts too little."""
    (start, every), rng = clean_delta(1200155), np.random.default_rng(0)
    effects = tuple(effect for effect in every if effect.cause == "joint_compliance")
    scan = scanned(start, effects, rng)
    score = next(s for s in scan.scores if s.candidate.label == "joint_compliance at joint_2")
    term = score.candidate
    model = start.fitted((term,)).rested()
    found = SearchResult(model, replace(scan, tests=130), scan, (score,))
    assert standing(model, term, found.tried).confidence > LEAST_SURE
    assert of_term(found, term, HeldOutModels(model), rng) is None


def test_a_session_without_circles_is_refused() -> None:
    machine = draw_machine(ROBOT, SEED)
    session = simulate_session(machine, make_plan("identify", ROBOT, count=15), SEED)
    with pytest.raises(DataError, match="no circle among 0 paths in motion"):
        diagnosed(session)


# Command and page


def test_the_command_writes_figures_and_page(
    session: Session, found: CircleTest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "session", session)
    out, page = tmp_path / "circles.json", tmp_path / "circles.html"
    arguments = ["--robot", "scara", "--json", str(out), "--report", str(page)]
    assert run(["circle", str(tmp_path / "session"), *arguments]) == 0
    said = capsys.readouterr().out
    assert "xy, anticlockwise" in said
    assert "to do first:" in said
    told = json.loads(out.read_text())
    assert told["findings"][0]["cause"] == "backlash"
    assert told["findings"][0]["action"]["do"] == "adjust"
    assert len(told["circles"]) == 12
    for each in told["circles"]:
        assert each["plane"] == "xy"
        assert each["sense"] in ("clockwise", "anticlockwise")
        assert sum(s["um"] for s in each["shares"]) == pytest.approx(each["deviation_um"])
        assert sum(s["share"] for s in each["shares"]) == pytest.approx(1.0)
    assert told["deviation_um"] == pytest.approx(1e6 * found.deviation, rel=1e-3)
    assert told["first"]["deviation_after_um"] < told["deviation_um"]
    html = page.read_text()
    assert "circular deviation G" in html
    assert "off the drawing: " in html
    assert "dial gauge" in html
    assert f"{told['first']['deviation_after_um']:.1f} µm" in html


def test_a_folder_in_which_nothing_was_written_is_removed(tmp_path: Path) -> None:
    arguments = ["--robot", "scara", "--json", str(tmp_path / "no" / "x.json")]
    assert run(["circle", str(tmp_path), *arguments]) == 2
    assert not (tmp_path / "no").exists()


def test_figures_are_printed_alone_where_no_file_is_named(
    session: Session, found: CircleTest, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_session(tmp_path / "session", session)
    assert run(["circle", str(tmp_path / "session"), "--robot", "scara", "-v", "--json"]) == 0
    printed = capsys.readouterr()
    assert "tried on the calibrated model" in printed.err
    assert json.loads(printed.out)["deviation_um"] == pytest.approx(
        1e6 * found.deviation, rel=1e-3
    )
    assert "to do first:" in printed.err
