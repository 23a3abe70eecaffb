"""A number that is shown in several places is the same in all of them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from click.testing import CliRunner

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cell.calibration_session import CalibrationSession, Settings
from delta_calibration.cell.capture import Capture
from delta_calibration.cell.fitting import FittedCalibration, diagnosed, fit
from delta_calibration.cli.diagnose import describe
from delta_calibration.cli.fit import _digits
from delta_calibration.cli.fit import describe as describe_fit
from delta_calibration.cli.live_cell import at_targets
from delta_calibration.cli.main import group, run
from delta_calibration.data import SIMULATED_NS, Session, collect
from delta_calibration.diagnosis import Diagnosis
from delta_calibration.estimation import DIAGNOSIS, doubt, identify
from delta_calibration.geometry import align
from delta_calibration.plans import PLACES, make_plan
from delta_calibration.recording import read_session
from delta_calibration.report import Provenance, report_of
from delta_calibration.report.drift import drift_of_calibrations, read_calibration
from delta_calibration.report.glossary import TERMS
from delta_calibration.robot import load_robot
from delta_calibration.wording import mm, moment, sure

ROOT = Path(__file__).parents[1]
ROBOT = load_robot("srbd")
PROVENANCE = Provenance(
    "session", "0" * 64, 0, ROBOT.name, "srbd.yaml", ROBOT.hash, 0, recorded={"seed": "1"}
)
SESSIONS = ("srbd_plain", "srbd_backlash")
OLD = re.compile(r"noise floor|held[- ]out RMS|frame only|\b100(\.0)? ?% sure", re.IGNORECASE)


@lru_cache
def session(name: str) -> Session:
    return read_session(ROOT / "bags" / name)


@lru_cache
def by_node(name: str) -> FittedCalibration:
    """Result of the node's `~/diagnose` for a session."""
    return diagnosed(session(name), ROBOT, None, 0)


@lru_cache
def fitted(name: str) -> FittedCalibration:
    """Result of its `~/fit`."""
    return fit(session(name), ROBOT, None, 0)


def diagnosis(name: str) -> Diagnosis:
    found = by_node(name).diagnosis
    assert found is not None
    return found


def report(name: str):
    return report_of(diagnosis(name), ROBOT, PROVENANCE)


@pytest.mark.parametrize("way", [fitted, by_node])
def test_the_node_tells_the_errors_of_the_last_poses(
    way: Callable[[str], FittedCalibration],
) -> None:
    """The root mean square of these errors over all poses is the error left."""
    made = way("srbd_plain")
    told = [float(each) for each in made.last_errors().split(", ")]
    every = 1e3 * np.linalg.norm(made.found.missed, axis=1)
    np.testing.assert_allclose(told, every[-5:], atol=1e-4)
    assert np.isclose(np.sqrt(np.mean(every**2)), 1e3 * made.found.full.held_out)


def numbers(text: str) -> set[str]:
    return set(re.findall(r"\d+\.\d{4}\b", text))


# --- the held-out error of a diagnosis


@pytest.mark.parametrize("name", SESSIONS)
def test_one_sentence_on_console_node_and_page(name, tmp_path, capsys):
    file = tmp_path / "verdict.json"
    path = str(ROOT / "bags" / name)
    assert run(["diagnose", path, "--robot", "srbd", "--json", str(file)]) == 0
    printed, verdict = capsys.readouterr().out, diagnosis(name).verdict
    sentence = ROBOT.named(verdict.sentence())
    assert f"verdict: {sentence}\n" in printed
    assert sentence.removesuffix(".") in ROBOT.named(by_node(name).sentence())
    assert report(name).sentence == sentence
    assert json.loads(file.read_text()) == verdict.as_dict()


def test_a_name_and_what_it_leaves_are_in_one_sentence():
    verdict = diagnosis("srbd_backlash").verdict
    left = replace(verdict.unknown_structure, found=True, moves_with="joint_angle")
    named, both = verdict.sentence(), replace(verdict, unknown_structure=left).sentence()
    label = verdict.findings[0].label()
    assert named.startswith(label.capitalize()[:1] + label[1:])
    assert both.startswith(f"Beside {label} an error remains that no known cause explains; ")
    assert "it varies with joint angle:" in both
    assert both.partition(":")[2] == named.partition(":")[2]


@pytest.mark.parametrize("name", SESSIONS)
def test_the_models_have_the_same_errors_everywhere(name):
    verdict, page = diagnosis(name).verdict, report(name)
    told = {label: mm(model.held_out_rms_mm) for label, model in verdict.models()}
    assert numbers(verdict.sentence()) == set(told.values())
    console = describe(verdict)
    for label, value in told.items():
        assert re.search(rf"^{label}: .* {value}$", console, re.MULTILINE)
    shown = {key.name: key.value for key in page.key_figures}
    assert shown == {**told, "noise of a pose": mm(verdict.noise_mm)}
    table = next(t for t in page.tables() if t.name == "error_workspace")
    in_table = {row[0].partition(":")[0]: row[1] for row in table.rows}
    assert told.items() <= in_table.items()


def test_one_cause_alone_is_what_the_extended_model_has_more():
    """It is the extended model without and with it, so there is no third pair of numbers."""
    verdict = diagnosis("srbd_backlash").verdict
    (finding,) = verdict.findings
    assert finding.rms_before_mm == verdict.calibrated.held_out_rms_mm
    assert finding.rms_after_mm == verdict.extended.held_out_rms_mm
    models = {mm(model.held_out_rms_mm) for _, model in verdict.models()}
    assert numbers(describe(verdict)) <= {*models, mm(verdict.noise_mm)}


def test_a_cause_that_shows_in_motion_says_so():
    """Otherwise its errors would have the same name as those of the poses."""
    verdict = diagnosis("srbd_backlash").verdict
    moving = replace(verdict.findings[0], in_motion=True)
    assert "held-out error in motion" in describe(replace(verdict, findings=(moving,)))
    assert "in motion" not in verdict.findings[0].errors()
    assert "in_motion" not in verdict.as_dict()["findings"][0]


@pytest.mark.parametrize("name", SESSIONS)
def test_before_is_the_drawing_and_no_reflector_that_flew_away(name):
    """Compared with a rigid alignment of other sectors, without reflector, priors or weights."""
    held, poses = diagnosis(name).held, by_node(name).poses
    mechanism = ROBOT.model()
    drawn = mechanism.position(mechanism.forward(poses.joint, mechanism.parameters.nominal))
    missed, sector = np.zeros(len(poses)), held.sectors[: len(poses)]
    for number in np.unique(sector):
        own = sector == number
        frame = align(drawn[~own], poses.point[~own])
        missed[own] = np.linalg.norm(frame.apply(drawn[own]) - poses.point[own], axis=1)
    expected = 1e3 * np.sqrt(np.mean(missed**2))
    assert diagnosis(name).verdict.baseline.held_out_rms_mm == pytest.approx(expected, rel=0.12)


# --- the error left of a fit


def test_a_fit_leaves_the_same_on_console_node_file_and_comparison(tmp_path, capsys):
    name = "srbd_plain"
    file = tmp_path / "calibration.yaml"
    path = str(ROOT / "bags" / name)
    assert run(["fit", path, "--robot", "srbd", "--out", str(file)]) == 0
    printed, found = capsys.readouterr().out, fitted(name).found
    before, left = mm(1e3 * found.frame_only.held_out), mm(1e3 * found.full.held_out)
    assert re.search(rf"^calibrated: geometry \+ frame +\S+ +{left} ", printed, re.MULTILINE)
    assert re.search(rf"^before: nominal \+ frame +\S+ +{before} ", printed, re.MULTILINE)
    sentence = fitted(name).sentence()
    assert f"error left {before} mm before, {left} mm calibrated" in sentence
    noise = f"noise of a pose: {mm(1e3 * found.noise.floor)} mm"
    assert noise in printed
    assert noise in sentence
    data = yaml.safe_load(file.read_text())
    assert mm(data["residuals"]["full"]["error_left_rms_mm"]) == left
    records = [read_calibration(file, ROBOT), read_calibration(file, ROBOT)]
    table = next(t for t in drift_of_calibrations(records).tables() if t.name == "calibrations")
    assert table.rows[0][table.head.index("error left, RMS [mm]")] == left


def test_an_extended_calibration_tells_the_error_left_as_a_fit_does():
    """The poses and parts are the same; one is linear about the fit, the other solves again."""
    ours, other = by_node("srbd_plain").found, fitted("srbd_plain").found
    for of in ("frame_only", "full"):
        a, b = getattr(ours, of), getattr(other, of)
        for figure in ("in_sample", "held_out", "held_out_max", "held_out_whitened"):
            assert getattr(a, figure) == pytest.approx(getattr(b, figure), rel=0.05), (of, figure)


@pytest.mark.parametrize("name", SESSIONS)
def test_before_is_the_same_in_the_files_of_a_fit_and_of_a_diagnosis(name):
    """From the poses alone. With readings on paths it would be 1.0663 mm instead of 1.0135 mm."""
    ours, other = by_node(name).found.frame_only, fitted(name).found.frame_only
    for figure in ("in_sample", "held_out", "held_out_max", "held_out_whitened"):
        assert getattr(ours, figure) == pytest.approx(getattr(other, figure), rel=1e-3), figure


@pytest.mark.parametrize("name", SESSIONS)
def test_fit_and_diagnosis_have_one_noise(name):
    floor = fitted(name).found.noise.floor
    assert diagnosis(name).verdict.noise_mm == pytest.approx(1e3 * floor, rel=1e-12)
    assert by_node(name).found.noise.floor == floor


# --- the same data


def test_a_node_sees_the_poses_that_a_reader_of_its_recording_sees():
    """A capture of all messages and the recording read as a file give exactly equal poses."""
    read, capture = session("srbd_plain"), Capture(ROBOT.joints.names, 100_000)
    assert read.tracker is not None
    capture.start()
    for stream, add in ((read.command, capture.add_command), (read.states, capture.add_states)):
        assert stream is not None
        order = [stream.names.index(joint) for joint in ROBOT.joints.names]
        for stamp, position in zip(stream.stamp_ns, stream.position, strict=True):
            add(int(stamp), position[order])
    for stamp, position in zip(read.tracker.stamp_ns, read.tracker.position, strict=True):
        capture.add_tracker(int(stamp), position)
    names = ROBOT.joints.names
    ours, theirs = collect(capture.session("captured"), names), collect(read, names)
    assert len(ours) == len(theirs) == 48
    for of in ("time", "joint", "command", "point", "direction", "place"):
        np.testing.assert_array_equal(getattr(ours, of), getattr(theirs, of))


def test_a_stretch_of_a_session_is_what_was_captured_in_it():
    """Part of a longer recording, as it is cut out for the report of the demonstration."""
    read = session("srbd_plain")
    whole = collect(read, ROBOT.joints.names)
    assert read.tracker is not None
    middle = [whole.start_ns + int(1e9 * whole.time[k]) for k in (9, 29)]
    part = collect(read.between(*middle), ROBOT.joints.names)
    assert len(part) in (20, 21)
    np.testing.assert_allclose(part.point[1:-1], whole.point[10:29][: len(part) - 2], atol=1e-12)
    assert (part.payload == whole.payload[0]).all()


def test_a_way_into_a_stop_that_was_lost_is_no_stop():
    """The joints also stand still where they reverse, 10 mrad away: millimetres at the tool."""
    poses = collect(session("srbd_plain"), ROBOT.joints.names).take(np.arange(0, 20, 2))
    plan = replace(make_plan("line", ROBOT, count=10, both_sides=False), joint=poses.joint + 3e-3)
    joint = poses.joint.copy()
    assert len(at_targets(replace(poses, joint=joint), plan)) == 10
    joint[4] -= 6e-3
    assert len(at_targets(replace(poses, joint=joint), plan)) == 9


# --- warnings of a fit that leaves too much


def test_a_fit_to_enough_places_has_no_doubt():
    assert doubt(fitted("srbd_plain").found) == ""
    assert "warning" not in describe_fit(fitted("srbd_plain").found, False)


def test_a_model_that_lacks_something_is_to_be_diagnosed(tmp_path):
    found = fitted("srbd_backlash").found
    said = f"{found.full.held_out / found.noise.floor:.1f} times the noise of a pose"
    for where in (doubt(found), describe_fit(found, False), fitted("srbd_backlash").sentence()):
        assert said in where
        assert "run a diagnosis" in where
    assert by_node("srbd_backlash").found.effort.method == DIAGNOSIS
    assert doubt(by_node("srbd_backlash").found) == ""


def test_a_swarm_that_has_not_come_to_rest_is_not_the_model_s_fault():
    found = fitted("srbd_backlash").found
    by_swarm = replace(found, effort=replace(found.effort, method="pso"))
    assert "search by pso has not converged" in doubt(by_swarm)
    assert "least_squares leaves as much error" in doubt(by_swarm)
    assert "nominal robot" not in doubt(by_swarm)
    worse = replace(found.full, held_out=2.0 * found.frame_only.held_out)
    assert "larger than that of the nominal robot" in doubt(replace(by_swarm, full=worse))


def test_a_standard_error_has_a_digit():
    """For gains, a micrometre per radian is not negligible."""
    assert [_digits(std) for std in (12.0, 0.4, 0.004, 0.0002, 0.0)] == [3, 3, 3, 4, 3]


def test_few_places_are_told_from_a_wrong_model():
    poses = collect(session("srbd_plain"), ROBOT.joints.names)
    few = identify(poses.take(np.flatnonzero(np.isin(poses.place, range(12)))), ROBOT)
    assert few.full.held_out > 2 * few.noise.floor
    assert "measure more places" in doubt(few)
    assert "diagnose" not in doubt(few)


def test_the_node_warns_while_such_a_fit_is_in_force(tmp_path):
    desk = CalibrationSession(Settings(robot="srbd"))
    desk.take(fitted("srbd_backlash"), desk._compensator(fitted("srbd_backlash").calibration))
    health = desk.health(0.0, 1.0)
    assert health.level.name == "WARN"
    assert "times the noise of a pose" in health.message
    file = tmp_path / "other.yaml"
    save_calibration(file, fitted("srbd_plain").found, ROBOT, fitted("srbd_plain").poses)
    desk.reload(str(file))
    assert "times the noise" not in desk.health(0.0, 1.0).message


# --- dates and counts


@pytest.mark.parametrize(
    ("start_ns", "shown"),
    [
        (0, "without a date"),
        (10**9, "without a date"),
        (SIMULATED_NS, "in simulated time"),
        (1_770_000_000 * 10**9, "2026-02-02 02:40 UTC"),
    ],
)
def test_a_date_that_nobody_recorded_is_none(start_ns, shown):
    assert moment(start_ns) == shown


def test_a_simulated_session_has_no_date_anywhere(capsys):
    poses = by_node("srbd_plain").poses
    assert moment(poses.start_ns) == "in simulated time"
    assert run(["info", str(ROOT / "bags" / "srbd_plain")]) == 0
    assert "recorded in simulated time; " in capsys.readouterr().out
    said = replace(PROVENANCE, start_ns=poses.start_ns)
    made = report_of(diagnosis("srbd_plain"), ROBOT, said)
    assert "recorded in simulated time; " in made.subtitle
    rows = dict(said.table().rows)
    assert rows["recorded"] == "in simulated time"
    assert {"seed of the diagnosis", "session: seed"} <= rows.keys()


def test_a_simulation_counts_the_poses_that_a_fit_finds(tmp_path, capsys):
    """The ends of paths are poses at rest too, so these are more than the stops of the plan."""
    session = str(tmp_path / "session")
    plan = ["--plan", "rich", "--count", "2", "--seed", "1"]
    assert run(["simulate", "--robot", "srbd", *plan, "--out", session]) == 0
    told = re.search(r"(\d+) stops and 9 paths: (\d+) poses at rest", capsys.readouterr().out)
    assert told is not None
    assert int(told[2]) == len(collect(read_session(Path(session)), ROBOT.joints.names))
    assert int(told[2]) > int(told[1])


def test_both_plans_to_identify_have_as_many_places():
    plan = make_plan("identify", ROBOT)
    assert len(np.unique(plan.target, axis=0)) == PLACES
    assert f"{PLACES} to identify" in CliRunner().invoke(group, ["plan", "--help"]).output


# --- words


@pytest.mark.parametrize(
    ("confidence", "shown"),
    [(1.0, "> 99.9 %"), (0.99951, "> 99.9 %"), (0.998, "99.8 %"), (0.97, "97 %"), (0.5, "50 %")],
)
def test_nothing_is_certain(confidence, shown):
    assert sure(confidence) == shown


@pytest.mark.parametrize("name", SESSIONS)
def test_no_output_has_a_word_of_its_own(name):
    outputs = (
        describe(diagnosis(name).verdict),
        describe_fit(fitted(name).found, True),
        fitted(name).sentence(),
        by_node(name).sentence(),
        report(name).sentence,
        *(statement.answer for statement in report(name).statements),
        *(" ".join((t.title, *t.head, t.caption)) for t in report(name).tables()),
    )
    for text in outputs:
        assert not OLD.search(text), text


def test_the_glossary_of_the_page_is_that_of_the_documents():
    text = " ".join((ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").split())
    for word, meaning in TERMS:
        assert f"## {word[0].upper()}{word[1:]} {meaning}" in text, word
    assert "glossary.md" in (ROOT / "docs" / "README.md").read_text(encoding="utf-8")
    assert "docs/glossary.md" in (ROOT / "README.md").read_text(encoding="utf-8")
    table = next(t for t in report("srbd_plain").tables() if t.name == "glossary")
    assert table.rows == TERMS


def test_there_is_one_folder_of_robot_files():
    link = ROOT / "delta_calibration" / "config"
    assert link.resolve() == (ROOT / "config").resolve()
