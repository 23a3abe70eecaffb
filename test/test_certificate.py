"""Tests of the certificate: content of its files, decisions, refusals."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")
pytest.importorskip("matplotlib", reason="needs the extra [report]")
pytest.importorskip("fpdf", reason="needs the extra [report]")
pytest.importorskip("pypdf", reason="needs the extra [test]")

import pypdf

from delta_calibration.calibration_file import load_calibration, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.documents import (
    check_document,
    content_hash,
    load_schema,
    parse_yaml,
    write_document,
)
from delta_calibration.errors import ConfigError, InputError
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.recording import Topics, read_session, write_session
from delta_calibration.report import pdf, read_about
from delta_calibration.report.certificate_figures import planes_of
from delta_calibration.report.decision import Decision, decided, of_all
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.uncertainty import Identified
from delta_calibration.wording import places_for, rounded
from headless import browser, chromium
from mistakes import KINDS, clean_case

ABOUT = """\
number: K-14
tolerance_mm: 0.06
operator: "<b>A & B</b>"
machine: {model: SRBD, serial: "0017", expansion_um_per_m_k: 11.5}
instrument: {model: tracker, serial: LT-1, u_along_um: 1, u_across_um: 3, u_reflector_um: 1.5}
ambient: {temperature_c: 21.4, u_temperature_k: 0.5}
"""


@pytest.fixture(scope="module")
def cell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session, the statements on it, and its certificate in all formats."""
    folder = tmp_path_factory.mktemp("certificate")
    made = ["--robot", "srbd", "--plan", "identify", "--seed", "3"]
    for count, name in ((30, "session"), (30, "renamed"), (32, "again")):
        out = ["--count", str(count), "--out", str(folder / name)]
        assert run(["simulate", *made, *out]) == 0
    (folder / "about.yaml").write_text(ABOUT)
    assert run(certify(folder, "about.yaml", "c.html", "c.pdf")) == 0
    fitted = ["fit", str(folder / "session"), "--robot", "srbd"]
    assert run([*fitted, "--out", str(folder / "calibration.yaml")]) == 0
    return folder


def certify(
    folder: Path,
    about: str | None,
    *outs: str,
    session: str = "session",
    more: tuple[str, ...] = (),
) -> list[str]:
    told = [] if about is None else ["--about", str(folder / about)]
    files = [word for out in outs for word in ("--out", str(folder / out))]
    return ["certificate", str(folder / session), "--robot", "srbd", *told, *files, *more]


def content(path: Path) -> dict:
    data = json.loads(path.read_text())
    check_document(data, load_schema("certificate"), str(path))
    return data


def text_of(path: Path) -> str:
    return "\n".join(page.extract_text() for page in pypdf.PdfReader(path).pages)


def test_json_lies_beside_and_follows_its_schema(cell: Path) -> None:
    told = content(cell / "c.json")
    assert told["decision"] == "pass"
    assert told["errors_held_out"] is True
    assert len(told["points"]) == told["session"]["poses"] == 60
    after = np.linalg.norm([point["after_mm"] for point in told["points"]], axis=1)
    before = np.linalg.norm([point["before_mm"] for point in told["points"]], axis=1)
    assert np.sqrt(np.mean(after**2)) < 0.03 < 0.3 < np.sqrt(np.mean(before**2))
    expanded = np.array([point["U_mm"] for point in told["points"]])
    assert (after + expanded <= 0.06).all()
    assert told["certified"]["u95_median_mm"] < told["certified"]["u95_largest_mm"]
    assert after.max() < 2 * told["certified"]["u95_largest_mm"]


def test_a_file_that_was_not_named_is_kept(cell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The JSON beside a page replaces an earlier certificate only."""
    (cell / "june.json").write_text('{"findings": []}')
    assert run(certify(cell, None, "june.html")) == 2
    assert "june.json: the certificate's JSON would replace this file" in capsys.readouterr().err
    assert (cell / "june.json").read_text() == '{"findings": []}'
    assert not (cell / "june.html").exists()
    assert [run(certify(cell, None, "july.pdf")) for _ in range(2)] == [0, 0]


def test_the_budget_holds_what_was_stated(cell: Path) -> None:
    parts = {part["name"]: part for part in content(cell / "c.json")["budget"]}
    np.testing.assert_allclose(parts["reflector"]["corrected_um"], 1.5)
    along = np.square(parts["tracker along the beam, its certificate"]["measured_um"])
    across = np.square(parts["tracker across the beam, its certificate"]["measured_um"])
    np.testing.assert_allclose((along.sum(), across.sum()), (1.0, 2 * 9.0))
    assert parts["error of the model"]["measured_um"] is None
    assert parts["tracker's noise along the beam"]["corrected_um"] is None


def test_pdf_can_be_searched(cell: Path) -> None:
    said = text_of(cell / "c.pdf")
    for words in ("K-14", "LT-1", "<b>A & B</b>", "Passes a tolerance of 0.06 mm", "Approved by"):
        assert words in said
    assert said.index("Approved by") < said.index("Uncertainty budget")


def test_html_escapes_what_was_given(cell: Path) -> None:
    page = (cell / "c.html").read_text()
    assert "&lt;b&gt;A &amp; B&lt;/b&gt;" in page
    assert "<b>A" not in page
    assert "Approved by" in page


@pytest.mark.skipif(chromium() is None, reason="no Chromium on this machine")
@pytest.mark.parametrize("width", [1280, 400])
def test_nothing_sticks_out_of_the_window(cell: Path, width: int) -> None:
    with browser() as chrome:
        chrome.open(cell / "c.html", width, 20_000)
        for _ in range(60):
            if not chrome.run("document.querySelectorAll('.plot:not(.js-plotly-plot)').length"):
                break
            chrome.settle(0.2)
        assert chrome.errors == []
        assert chrome.run("document.documentElement.scrollWidth") <= width
        assert (
            chrome.run(
                "[...document.querySelectorAll('.plot svg, h1, h2, p, dd')]"
                f".filter(e => e.getBoundingClientRect().right > {width} + 1).length"
            )
            == 0
        )


def test_what_is_not_stated_is_said_so(cell: Path) -> None:
    assert run(certify(cell, None, "bare.pdf", more=("--serial", "X-9"))) == 0
    said = " ".join(text_of(cell / "bare.pdf").split())
    assert "no tolerance was given" in said
    assert "serial X-9" in said
    assert re.search(r"measured in simulated time; issued 20\d\d-", said)
    gaps = (
        "tracker along the beam, its certificate; tracker across the beam, its certificate; "
        "reflector; temperature"
    )
    assert f"Not in the budget, because it was not stated: {gaps}." in said
    head, rest = said.split("Approved by", 1)
    assert "U is incomplete: 4 of 4 contributions are not stated." in head
    assert f"lack these contributions, because they were not stated: {gaps}." in head
    assert re.search(r"Number\W+not stated", head)
    assert f"It does not include, because not stated: {gaps}." in rest
    assert "It includes as stated" not in rest
    assert content(cell / "bare.json")["decision"] is None


def test_nothing_is_said_to_be_missing_if_all_is_stated(cell: Path) -> None:
    said = " ".join(text_of(cell / "c.pdf").split())
    assert "incomplete" not in said
    assert (
        "It includes as stated: tracker along the beam, its certificate; tracker across the beam, "
        "its certificate; reflector; temperature." in said
    )


def test_the_seed_is_named_by_its_use(cell: Path) -> None:
    assert "seed of the fit" in text_of(cell / "c.pdf")
    given = ("--calibration", str(cell / "calibration.yaml"))
    assert run(certify(cell, None, "seedless.pdf", session="again", more=given)) == 0
    said = text_of(cell / "seedless.pdf")
    assert "seed of" not in said
    assert "seed of the diagnosis" not in text_of(cell / "c.pdf")


def test_page_and_json_count_the_same_readings_set_aside(cell: Path) -> None:
    """One reading far from the others of its still moment."""
    session = read_session(cell / "session", Topics())
    assert session.tracker is not None
    place = session.tracker.position.copy()
    place[400] += 0.05
    knocked = replace(session, tracker=replace(session.tracker, position=place))
    write_session(cell / "knocked", knocked)
    assert run(certify(cell, "about.yaml", "knocked.pdf", session="knocked")) in (0, 1)
    count = content(cell / "knocked.json")["session"]["set_aside"]
    assert count > 0
    said = re.search(r"readings set aside ((\d+ \w+(, )?)+)", text_of(cell / "knocked.pdf"))
    assert said is not None
    assert sum(map(int, re.findall(r"\d+", said[1]))) == count


def test_what_is_stated_in_part_is_not_said_to_be_missing_altogether() -> None:
    """The uncertainty of a thermometer is useless without the machine's expansion."""
    about = read_about(None, {"ambient.u_temperature_k": 0.5, "instrument.u_along_um": 1.0})
    assert about.gaps == (
        "tracker across the beam, its certificate",
        "reflector",
        "temperature (machine.expansion_um_per_m_k missing)",
    )


@pytest.mark.parametrize(("tolerance", "decision"), [("0.03", "not decided"), ("1e-4", "fail")])
def test_a_tolerance_that_is_not_met(
    cell: Path, tolerance: str, decision: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """The option overrides the file; the certificate is written and the exit code is 1."""
    assert run(certify(cell, "about.yaml", "no.json", more=("--tolerance", tolerance))) == 1
    told = content(cell / "no.json")
    assert told["decision"] == decision
    assert tolerance.rstrip("0") in capsys.readouterr().err.replace("0.0001", "1e-4")


@pytest.mark.parametrize("session", ["session", "renamed"])
def test_nothing_passes_by_the_session_a_calibration_was_made_from(
    cell: Path, session: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = ("--calibration", str(cell / "calibration.yaml"))
    assert run(certify(cell, "about.yaml", "same.json", session=session, more=given)) == 1
    assert "made from this very session" in capsys.readouterr().err
    told = content(cell / "same.json")
    assert told["errors_held_out"] is False
    assert told["decision"] == "not decided"
    assert {each["decision"] for each in told["points"]} == {"not decided"}
    assert len(told["calibration_sha256"]) == 64


def test_another_session_may_pass_by_a_calibration(cell: Path) -> None:
    given = ("--calibration", str(cell / "calibration.yaml"))
    assert run(certify(cell, "about.yaml", "other.json", session="again", more=given)) == 0
    assert content(cell / "other.json")["errors_held_out"] is True


def test_a_machine_that_changed_is_certified_by_its_own_points(cell: Path) -> None:
    """Backlash of 0.5 mrad since the calibration, which states a radius a tenth of its effect."""
    hidden = ["--visit", "60", "--effect", "backlash:location=joint_2,value=0.0005"]
    made = ["--robot", "srbd", "--plan", "identify", "--seed", "3", "--count", "30", *hidden]
    assert run(["simulate", *made, "--out", str(cell / "worn")]) == 0
    given = ("--calibration", str(cell / "calibration.yaml"))
    found = {}
    for session, outs in (("again", ["holds.json"]), ("worn", ["worn.json", "worn.html"])):
        run(certify(cell, "about.yaml", *outs, session=session, more=given))
        found[session] = content(cell / outs[0])
    own, holds, worn = (
        told["certified"]["u95_median_mm"] for told in (content(cell / "c.json"), *found.values())
    )
    assert holds < 1.05 * own
    assert worn > 3 * own
    after = np.linalg.norm([point["after_mm"] for point in found["worn"]["points"]], axis=1)
    assert np.mean(after <= found["worn"]["certified"]["u95_largest_mm"]) >= 0.95
    parts = {part["name"]: part for part in found["worn"]["budget"]}
    assert parts["play, side unknown"]["origin"] == "residuals"
    assert max(parts["play, side unknown"]["corrected_um"]) > 20
    parts = {part["name"]: part for part in found["again"]["budget"]}
    assert parts["play, side unknown"]["origin"] == "calibration"
    assert parts["error of the model"]["kind"] == "B"
    page = (cell / "worn.html").read_text()
    assert "This session refutes the uncertainty of the calibration" in page


def test_a_calibration_keeps_its_uncertainty(cell: Path) -> None:
    told = content(cell / "c.json")
    found = load_calibration(cell / "calibration.yaml", load_robot("srbd")).uncertainty
    std = np.sqrt(np.diag(found.covariance))[: len(told["dimensions"])]
    expanded = [d["U"] for d in told["dimensions"]]
    pairs = [(u, 2 * s) for u, s in zip(expanded, std, strict=True) if u is not None]
    assert len(pairs) > 5
    np.testing.assert_allclose(*zip(*pairs, strict=True), rtol=1e-6)


def test_a_calibration_of_before_is_refused(
    cell: Path, capsys: pytest.CaptureFixture[str]
) -> None:

    data = parse_yaml((cell / "calibration.yaml").read_text(), "calibration")
    bare = {key: value for key, value in data.items() if key not in ("uncertainty", "sha256")}
    write_document(cell / "old.yaml", {**bare, "sha256": content_hash(bare)})
    given = ("--calibration", str(cell / "old.yaml"))
    assert run(certify(cell, "about.yaml", "old.json", more=given)) == 1
    assert "does not contain the uncertainty" in capsys.readouterr().err
    assert not (cell / "old.json").exists()


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ("machine: {serials: 17}", "machine: unknown key serials; allowed: maker, model, serial"),
        ("tolerance_mm: -1", "tolerance_mm: -1 is not allowed; more than 0 is expected"),
        ("ambient: {temperature_c: warm}", "ambient.temperature_c: 'warm' is not allowed"),
        ("tolerance_mm: .nan", "tolerance_mm"),
        ("measured_on: 24.11.2026", "measured_on: '24.11.2026' is not allowed; a date such as"),
        ("measured_on: 2026-02-30", "measured_on: '2026-02-30' is not a date of the calendar"),
        ("instrument: {valid_until: soon}", "'soon' is not allowed; a date such as 2027-03-31"),
        (
            "instrument: {valid_until: 2027-02-29}",
            "instrument.valid_until: '2027-02-29' is not a date",
        ),
        ("machine: {serial: 17}", "machine.serial: 17 is not allowed; a text is expected; put it"),
    ],
)
def test_a_wrong_entry_is_named(tmp_path: Path, wrong: str, said: str) -> None:
    (tmp_path / "about.yaml").write_text(wrong + "\n")
    with pytest.raises(ConfigError) as refused:
        read_about(tmp_path / "about.yaml", {})
    assert said in str(refused.value)
    assert "about.yaml" in str(refused.value)


@pytest.mark.parametrize(
    ("until", "measured", "warned"),
    [
        ("2026-10", "2026-11-24", True),
        ("2026-11", "2026-11-24", False),
        ("2026-11-23", "2026-11-24", True),
        ("2026-11-24", "2026-11-24", False),
    ],
)
def test_an_instrument_whose_certificate_had_run_out_is_warned_of(
    tmp_path: Path, until: str, measured: str, warned: bool
) -> None:
    file = tmp_path / "about.yaml"
    file.write_text(f"measured_on: {measured}\ninstrument: {{valid_until: {until}}}\n")
    said = read_about(file, {}).expired(None)
    assert bool(said) == warned
    assert not warned or (until in said and measured in said)
    file.write_text(f"instrument: {{valid_until: {until}}}\n")
    day = date.fromisoformat(measured)
    assert bool(read_about(file, {}).expired(day)) == warned
    assert not read_about(file, {}).expired(None)


def test_the_page_warns_of_it(cell: Path) -> None:
    ended = ABOUT.replace("serial: LT-1", "valid_until: 2020-01")
    (cell / "ended.yaml").write_text(ended + "measured_on: 2026-11-24\n")
    assert run(certify(cell, "ended.yaml", "ended.html")) == 0
    warned = "The certificate of the instrument was valid until 2020-01; measured on 2026-11-24."
    assert warned in (cell / "ended.html").read_text()
    assert "was valid until" not in (cell / "c.html").read_text()


def test_another_ending_is_refused_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = ["--out", str(tmp_path / "c.docx")]
    assert run(["certificate", str(tmp_path / "none"), "--robot", "srbd", *out]) == 2
    assert ".html, .pdf, .json" in capsys.readouterr().err


def test_a_letter_that_the_font_lacks_is_refused(
    cell: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The files of its fonts are closed in this case as well."""
    made, new = [], pdf._new
    monkeypatch.setattr(pdf, "_new", lambda report: made.append(new(report)) or made[-1])
    assert run(certify(cell, None, "letters.pdf", more=("--operator", "\u5f20"))) == 2
    assert "no letters \u5f20" in capsys.readouterr().err
    assert not (cell / "letters.pdf").exists()
    assert [font.ttfont.reader for font in made[0].fonts.values()] == [None, None]


def test_decisions_by_the_standard() -> None:
    """Uncertainty counts against either claim; a value at the limit passes."""
    error, u = np.array([0.5, 0.75, 0.8, 1.2, 1.3, np.nan]), 0.25
    found = decided(error, np.full(6, u), 1.0)
    pass_, fail, open_ = Decision.PASS, Decision.FAIL, Decision.NOT_DECIDED
    assert found == (pass_, pass_, open_, open_, fail, open_)
    assert of_all((pass_, pass_)) is pass_
    assert of_all((pass_, open_, fail)) is fail
    assert of_all((pass_, open_)) is open_


@pytest.mark.parametrize(
    ("value", "uncertainty", "shown"),
    [
        (320.04153, 0.0060, "320.0415"),
        (-0.04531, 0.022, "\u22120.045"),
        (-0.0001, 0.022, "0.000"),
        (12.3456, 0.0996, "12.35"),
        (1234.5, 31.0, "1\u202f234"),
        (0.1234567, 0.0, "0.123"),
    ],
)
def test_values_carry_two_figures_of_their_uncertainty(
    value: float, uncertainty: float, shown: str
) -> None:
    assert rounded(value, uncertainty) == shown
    assert places_for(0.0996) == 2


def test_planes_are_those_that_the_machine_works_in() -> None:
    flat = np.random.default_rng(1).uniform(size=(30, 3)) * [0.0, 0.4, 0.2]
    assert planes_of(flat) == ((1, 2),)


def test_an_option_alone_is_checked() -> None:
    with pytest.raises((ConfigError, InputError), match="options of the certificate: operator"):
        read_about(None, {"operator": ""})


def test_positions_are_as_uncertain_from_the_file(cell: Path) -> None:
    """Eight digits of the factor are sufficient for a covariance that spans ten powers of ten."""
    robot = load_robot("linear_delta")
    plan = make_plan("identify", robot, count=20, seed=1)
    session = simulate_session(draw_machine(robot, 1), plan, 1)
    poses = collect(session, robot.joints.names, robot.commanded.joint_size)
    found = identify(poses, robot)
    save_calibration(cell / "linear.yaml", found, robot, poses)
    read = load_calibration(cell / "linear.yaml", robot).identified
    made = Identified(found.chain, found.theta, found.uncertainty)
    at = poses.conditions
    assert read is not None
    np.testing.assert_allclose(read.radius(at), made.radius(at), rtol=1e-4)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda rows: rows[:-1], "the lower triangle of"),
        (lambda rows: [*rows[:-1], rows[-1] + " 1"], "the lower triangle of"),
        (lambda rows: ["nan", *rows[1:]], "finite numbers"),
        (lambda rows: ["much", *rows[1:]], "could not convert string to float: 'much'"),
    ],
)
def test_an_uncertainty_that_is_not_whole_is_refused(
    cell: Path, change: Callable[[list[str]], list[str]], said: str
) -> None:
    data = parse_yaml((cell / "calibration.yaml").read_text(), "calibration")
    told = data["uncertainty"]
    told["factor_lower"] = change(told["factor_lower"])
    bare = {key: value for key, value in data.items() if key != "sha256"}
    write_document(cell / "cut.yaml", {**bare, "sha256": content_hash(bare)})
    with pytest.raises(ConfigError, match=said) as refused:
        load_calibration(cell / "cut.yaml", load_robot("srbd"))
    assert "uncertainty: factor_lower" in str(refused.value)


def test_play_of_other_joints_is_refused(cell: Path) -> None:
    data = parse_yaml((cell / "calibration.yaml").read_text(), "calibration")
    data["uncertainty"]["model"]["play"] = [1e-5]
    bare = {key: value for key, value in data.items() if key != "sha256"}
    write_document(cell / "play.yaml", {**bare, "sha256": content_hash(bare)})
    with pytest.raises(ConfigError, match=r"model\.play: 1 values found, 3 are expected"):
        load_calibration(cell / "play.yaml", load_robot("srbd"))


def test_nothing_is_certified_by_a_session_with_a_mistake(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    made = KINDS["tracker_unit"](clean_case("linear_delta", 1), 0)
    assert made is not None
    write_session(tmp_path / "wrong", made.session)
    order = ["certificate", str(tmp_path / "wrong"), "--robot", "linear_delta"]
    assert run([*order, "--out", str(tmp_path / "c.json")]) == 1
    said = capsys.readouterr()
    assert "a session with a mistake cannot be certified" in said.err
    assert "warning:" in said.out
    assert not (tmp_path / "c.json").exists()
