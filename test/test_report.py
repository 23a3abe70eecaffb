"""The report: its numbers compared with the hidden causes, its page, files and words."""

from __future__ import annotations

import csv
import json
import re
from dataclasses import replace
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")

from delta_calibration.accuracy import IsoReport, IsoValue
from delta_calibration.cli.main import run
from delta_calibration.data import at_rest, survey
from delta_calibration.diagnosis import diagnose
from delta_calibration.diagnosis.verdict import Estimate
from delta_calibration.effects.regressor import ANGLE
from delta_calibration.errors import InputError
from delta_calibration.iso9283 import STANDARD
from delta_calibration.mechanisms import MECHANISMS
from delta_calibration.plans import make_plan
from delta_calibration.recording import read_session, write_session
from delta_calibration.region import Region
from delta_calibration.report import (
    build_page,
    missing,
    page_of,
    report_of,
    write_figures,
    write_numbers,
    write_page,
)
from delta_calibration.report.browser import plot_of, ticks_of
from delta_calibration.report.candidates import evidence_figure, evidence_table
from delta_calibration.report.document import Report
from delta_calibration.report.drawing import Axis, Field, Figure, Line, Panel, Points, Rule, Scale
from delta_calibration.report.judged import Judged
from delta_calibration.report.line import along_line, line_figure, line_table
from delta_calibration.report.numbers import cell
from delta_calibration.report.picture import draw
from delta_calibration.report.session_report import _tests
from delta_calibration.report.words import estimate
from delta_calibration.report.workspace import around, maps, scale_of
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from delta_calibration.wording import chance, figures, sure
from report_bench import HOSTILE, JOINTS, NAME, PROVENANCE, ROBOT, found, hidden

ISO = IsoReport(STANDARD, "calibration <x>", (IsoValue("AP", "P1", 0.862e-3, 30),))
HEADINGS = (
    "Verdict in detail",
    "Error over the workspace",
    "Along the paper&#39;s line",
    "What points to the cause",
    "Evidence for each candidate",
    "Geometry, correlations and what the data do not determine",
    "Noise against the tracker&#39;s specification",
    "Accuracy by ISO 9283",
    "Provenance",
)


@cache
def elsewhere(name: str) -> Judged:
    """Diagnosis of a simulated session of another robot."""
    robot = load_robot(name)
    machine, plan = draw_machine(robot, 4), make_plan("identify", robot, count=24, seed=4)
    seen = survey(
        simulate_session(machine, plan, 4), robot.joints.names, robot.commanded.joint_size
    )
    return Judged.of(diagnose(seen, robot))


@pytest.mark.parametrize(
    ("name", "along"), [("five_axis", "y"), ("linear_delta", "z"), ("scara", "x")]
)
def test_another_robot_s_line_is_its_own(name: str, along: str) -> None:
    """The line follows the robot's own axes, and the numbers of the Delta paper are not shown."""
    robot = load_robot(name)
    line = along_line(elsewhere(name), robot)
    assert line is not None
    assert "xyz"[line.way] == along
    assert np.ptp(line.along) > 0.05
    assert line.inside.mean() > 0.5  # wherever the tool is on the platform
    shown, table = line_figure(line), line_table(line)
    told = " ".join((shown.title, shown.caption, str(shown.panels), str(table)))
    assert not any(word in told for word in ("paper", "Pan,", "711 mm"))


def test_a_model_less_itself_is_no_error() -> None:
    """Without an extension the calibrated model is the last: no row of zeros, no curve."""
    judged = elsewhere("five_axis")
    assert not judged.diagnosis.verdict.findings
    line = along_line(judged, load_robot("five_axis"))
    assert line is not None
    shown, rows = line_figure(line), line_table(line).rows
    assert {row[0].partition(", in")[0] for row in rows} == {"before", "calibrated, 95 % bound"}
    assert "0.0000" not in {row[1] for row in rows}
    assert "xtended" not in shown.caption
    assert [m.name for m in shown.panels[0].marks if isinstance(m, Line)] == [
        "before",
        "calibrated, 95 % bound",
    ]


def test_the_page_says_of_the_tests_what_the_verdict_says() -> None:
    verdict = found().verdict
    unknown = replace(verdict.unknown_structure, found=False)
    quiet = _tests(replace(verdict, unknown_structure=unknown)).caption
    assert quiet.startswith("The remaining errors are explained by chance")
    there = replace(unknown, found=True, moves_with="direction", rms_mm=0.01)
    loud = _tests(replace(verdict, unknown_structure=there)).caption
    assert loud.startswith("Error without a known cause, 0.0100 mm RMS; it varies with direction")
    tests = {"set_aside": 1e-9, "map": 1e-12}
    rows = _tests(replace(verdict, unknown_structure=replace(there, tests=tests))).rows
    assert [row[0] for row in rows] == [
        "similarity of the errors of poses set aside",
        "decrease of the errors by a smooth map",
    ]


def test_the_evidence_for_a_named_dimension_is_that_of_its_finding() -> None:
    """What the calibrated geometry already contains, its residuals cannot show."""
    verdict = found().verdict
    own = {"cause": "arm_length", "location": "joint_3", "signal": 3620.0, "p_value": 1e-17}
    named = replace(verdict.findings[0], **own)
    told = replace(found(), verdict=replace(verdict, findings=(named,)))
    row = next(row for row in evidence_table(told).rows if row[0] == "arm length at joint 3")
    assert (row[1], row[4], row[6]) == (figures(3620.0, 4), chance(1e-17), sure(named.confidence))
    (panel,) = evidence_figure(told).panels
    (bar,) = (mark for mark in panel.marks if mark.name == "named")
    assert bar.length.tolist() == [3620.0]


def test_the_table_tells_how_sure_each_finding_of_a_name_is() -> None:
    verdict = found().verdict
    first = next(f for f in verdict.findings if f.cause == "backlash")
    both = first, replace(first, confidence=0.61)
    told = replace(found(), verdict=replace(verdict, findings=both))
    sures = {row[6] for row in evidence_table(told).rows if row[0].startswith("backlash")}
    assert sures == {f"{sure(first.confidence)} and {sure(0.61)}"}


def test_repeats_that_scatter_more_than_the_file_states_are_told() -> None:
    """What changes from visit to visit counts as noise, so that nothing else would show it."""
    plain = found()
    assert not any("scatter" in text for text in plain.doubts)
    cell, filed = plain.model.cell, ROBOT.joints.repeatability
    loud = replace(cell.noise, measured=True, repeatability=4.2 * filed)
    told = replace(plain, model=replace(plain.model, cell=replace(cell, noise=loud)))
    assert any("scatter 4 times as much as the robot file" in text for text in told.doubts)
    for repeatability, freedom in ((3.0, 10.0), (1e-2, 1e-3)):  # by chance, or hardly determined
        unsure = replace(loud, repeatability=repeatability * filed, freedom=freedom)
        told = replace(plain, model=replace(plain.model, cell=replace(cell, noise=unsure)))
        assert not any("scatter" in text for text in told.doubts)
    robot = replace(ROBOT, joints=replace(ROBOT.joints, repeatability=0.0))  # allowed
    silent = replace(plain.model, cell=replace(cell, noise=loud, robot=robot))
    assert not any("scatter" in text for text in replace(plain, model=silent).doubts)


def test_a_value_that_the_session_does_not_determine_is_not_told_among_the_clearest() -> None:
    values = {
        "gap_1": Estimate(2e-4, 1e-5, "rad"),
        "gap_2": Estimate(1e-5, 2e-5, "rad"),  # small, and known to be
        "gap_3": Estimate(1.9e-4, 1.6e-3, "rad"),
        "level": Estimate(0.5, 0.4, "N m"),
    }
    finding = replace(found().verdict.findings[0], parameters=values)
    assert list(finding.clearest(6)) == ["gap_1", "gap_2", "level"]
    vague = {name: replace(e, std=3 * abs(e.value)) for name, e in finding.parameters.items()}
    assert len(replace(finding, parameters=vague).clearest(6)) == 1


@pytest.fixture(scope="module")
def report() -> Report:
    return report_of(found(), HOSTILE, PROVENANCE, ISO)


@pytest.fixture(scope="module")
def page(report: Report) -> str:
    return page_of(report)


class Elements(HTMLParser):
    """Tags with attributes, and the text outside scripts and styles."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text, self.styles, self._in = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._in = tag

    def handle_endtag(self, tag):
        self._in = ""

    def handle_data(self, data):
        if self._in == "style":
            self.styles.append(data)
        elif self._in != "script":
            self.text.append(data)

    def whole(self) -> str:
        return " ".join(" ".join(self.text).split())


def figure(report: Report, name: str):
    return next(f for f in report.figures() if f.name.startswith(name))


# --- numbers compared with the hidden causes


def test_the_residual_shows_the_hidden_play_by_direction(report: Report) -> None:
    """The measured points alone show the gap as the difference between up and down."""
    shown = figure(report, "giveaway_1")
    gaps = list(hidden().hidden.values["backlash"].values())
    steps = []
    for panel in shown.panels:
        by_name = {m.name: m for m in panel.marks if isinstance(m, Points)}
        up, down = (by_name[f"joint last went {way}"] for way in ("up", "down"))
        steps.append(1e-6 * (down.y.mean() - up.y.mean()))
    np.testing.assert_allclose(steps, gaps, rtol=0.1)


def test_the_error_that_calibration_leaves_on_the_line_is_half_the_play() -> None:
    """|J gap / 2|, with J from differences of the independent three-sphere model."""
    line = along_line(Judged.of(found()), ROBOT)
    assert line is not None
    plan = make_plan("line", ROBOT, count=len(line.target), both_sides=False)
    delta = MECHANISMS["rotary_delta"](ROBOT.dimensions, ROBOT.tolerances)
    nominal, step = delta.parameters.nominal, 1e-6
    half = np.array(list(hidden().hidden.values["backlash"].values())) / 2
    ends = [delta.forward(plan.joint + way * step * half, nominal) for way in (1, -1)]
    expected = np.linalg.norm(ends[0] - ends[1], axis=1) / (2 * step)
    good = line.inside
    assert good.sum() > 20
    np.testing.assert_allclose(line.calibrated[good], expected[good], rtol=0.15)


def test_the_maps_hold_the_errors_that_the_verdict_tells() -> None:
    judged, verdict = Judged.of(found()), found().verdict
    for held, error in (
        (verdict.baseline, judged.before),
        (verdict.calibrated, judged.calibrated),
        (verdict.extended, judged.extended),
    ):
        assert 1e3 * np.sqrt(np.mean(error**2)) == pytest.approx(held.held_out_rms_mm, rel=1e-9)


def test_a_map_is_local() -> None:
    place = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.01, 0.0, 0.0]])
    error = np.array([1e-3, 3e-3, 4e-3])
    value = around(place[:2], place, error, 0.05)
    np.testing.assert_allclose(value, [1e-3, np.sqrt((9 + 16) / 2) * 1e-3], rtol=0.01)


def test_one_round_scale_for_all_panels(report: Report) -> None:
    scale = scale_of([np.full(50, 0.9e-3), np.full(50, 0.012e-3)], 0.008e-3)
    assert (scale.low, scale.high) == pytest.approx((0.005, 1.0))
    assert ticks_of(scale) == pytest.approx([0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0])
    scales = {
        mark.scale
        for name in ("error_map", "error_section")
        for panel in figure(report, name).panels
        for mark in panel.marks
        if hasattr(mark, "scale")
    }
    assert len(scales) == 1


# --- the page


def test_the_page_says_what_was_found(page: str, report: Report) -> None:
    text = Elements(page).whole()
    verdict = found().verdict
    assert text.index(report.sentence) < text.index("What is wrong") < text.index("What it gains")
    assert "What cannot be distinguished" in text
    for value in (verdict.noise_mm, verdict.calibrated.held_out_rms_mm):
        assert f"{value:.4f}" in text
    places = [page.index(f"</span>{heading}</h2>") for heading in HEADINGS]
    assert places == sorted(places)
    for said in ("0.8030", "3.3050", "0.8620", "30 cycles", PROVENANCE.session_sha256, ROBOT.hash):
        assert said in text
    for finding in verdict.findings:
        assert finding.cause.replace("_", " ") in text


def test_what_strings_hold_is_shown_and_not_obeyed(page: str) -> None:
    elements = Elements(page)
    assert [tag for tag, _ in elements.tags].count("script") == 3  # plotly, the plots, own code
    assert not [tag for tag, _ in elements.tags if tag in ("img", "iframe", "object", "b")]
    assert not [a for _, attrs in elements.tags for a in attrs if a.startswith("on")]
    text = elements.whole()
    for name in (*JOINTS, NAME, "{{ 7 * 7 }}"):
        assert name in text
    plots = json.loads(page.split('id="plots">')[1].split("</script>")[0])
    titles = {plot["layout"]["xaxis"]["title"]["text"] for plot in plots.values()}
    assert "angle of &lt;script&gt;ask(1)&lt;/script&gt; [°]" in titles


def test_the_page_asks_no_host(page: str) -> None:
    elements = Elements(page)
    links = [
        value
        for _, attrs in elements.tags
        for name, value in attrs.items()
        if name in ("src", "href", "srcset", "action", "data", "poster") and value is not None
    ]
    assert links
    assert all(link.startswith("#") or link == "data:," for link in links)
    assert not any("url(" in style or "@import" in style for style in elements.styles)
    policy = next(a["content"] for t, a in elements.tags if a.get("http-equiv"))
    assert policy.startswith("default-src 'none';")
    assert "http" not in policy


def test_the_page_is_small_enough(page: str) -> None:
    assert len(page.encode()) < 8e6


def test_axes_have_units(report: Report) -> None:
    for shown in report.figures():
        for panel in shown.panels:
            for axis in (panel.x, panel.y):
                assert axis.names or (axis.title.endswith("]") and "[" in axis.title), shown.name


def test_key_figures_have_the_robot_s_own_names() -> None:
    verdict = found().verdict
    model = replace(verdict.extended, model="geometry + frame + backlash at joint_2")
    made = report_of(
        replace(found(), verdict=replace(verdict, extended=model)), HOSTILE, PROVENANCE
    )
    notes = {key.name: key.note for key in made.key_figures}
    assert notes["extended"].endswith(f"backlash at {JOINTS[1]}")


def test_plotly_takes_every_panel(report: Report) -> None:
    objects = pytest.importorskip("plotly.graph_objects")
    for shown in report.figures():
        for panel in shown.panels:
            objects.Figure(plot_of(panel))  # refuses unknown properties


def test_a_rule_on_a_logarithmic_axis_has_its_name_at_its_value() -> None:
    """Plotly takes the value for the line, and its logarithm for the name."""
    panel = Panel("", Axis("x [1]", log=True), Axis("y [1]"), (Rule("r", 100.0, upright=True),))
    layout = plot_of(panel)["layout"]
    assert layout["shapes"][0]["x0"] == 100.0
    assert layout["annotations"][0]["x"] == 2.0


def test_names_of_rules_beside_each_other_stand_apart() -> None:
    rules = (
        Rule("40", 40.0, upright=True, side="left"),
        Rule("80", 80.0, upright=True, side="right"),
    )
    shown = plot_of(Panel("", Axis("x [1]", log=True), Axis("y [1]"), rules))["layout"]
    assert [each["xanchor"] for each in shown["annotations"]] == ["right", "left"]


def test_a_square_panel_of_a_narrow_page_has_few_names() -> None:
    """A square panel is as high as it is wide; at 400 px thirty names would overlap."""
    for equal, most in ((True, 16), (False, 30)):
        names = tuple(f"p {k}" for k in range(30))
        panel = Panel("", Axis("x [1]"), Axis("", names=names), (), equal=equal)
        shown = plot_of(panel)["layout"]["yaxis"]
        assert most / 2 < len(shown["ticktext"]) <= most
        assert [names[k] for k in shown["tickvals"]] == shown["ticktext"]


def test_without_the_standards_cycles_it_says_why() -> None:
    page = build_page(found(), ROBOT, PROVENANCE, "P1 was reached 0 times")
    assert "does not contain the cycles of the standard: P1 was reached 0 times" in page


def test_a_page_that_cannot_be_written_is_refused(report: Report, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cannot be written"):
        write_page(tmp_path / "nowhere" / "page.html", report)


def test_what_to_install_is_said(monkeypatch: pytest.MonkeyPatch, report: Report) -> None:
    def absent(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(missing.importlib, "import_module", absent)
    with pytest.raises(InputError, match=r"needs jinja2.*delta_calibration\[report\]"):
        page_of(report)


# --- files


def test_numbers_are_in_the_files(report: Report, tmp_path: Path) -> None:
    paths = write_numbers(report, tmp_path / "numbers")
    assert {p.name for p in paths} >= {"report.json", "findings.csv", "error_map.csv", "noise.csv"}
    data = json.loads(paths[0].read_text())
    assert data["verdict"] == json.loads(json.dumps(found().verdict.as_dict()))
    shown = figure(report, "error_line")
    with (tmp_path / "numbers" / "error_line.csv").open() as file:
        rows = [row for row in csv.DictReader(file) if row["series"] == "before"]
    np.testing.assert_allclose([float(r["y"]) for r in rows], shown.panels[0].marks[0].y)


@pytest.mark.parametrize(
    ("shown", "written"),
    [
        ("−1.000", "-1.000"),
        ("+0.5", "0.5"),
        ("23\u202f280", "23280"),
        ("2.4 × 10⁻¹⁴⁸", "2.4e-148"),
        ("< 10⁻³⁰⁰", "1e-300"),
        ("95 %", "0.95"),
        ("> 99.9 %", "0.999"),
        ("–", ""),
        ("gap 2 = −3 ± 1 µrad", "gap 2 = -3 +- 1 urad"),
        ("0.0642 → 0.0105", "0.0642 → 0.0105"),
    ],
)
def test_a_cell_is_a_plain_number_in_a_file(shown: str, written: str) -> None:
    assert cell(shown) == written


def test_tables_of_numbers_are_read_without_options(report: Report, tmp_path: Path) -> None:
    pandas = pytest.importorskip("pandas", reason="needs the extra [notebook]")
    write_numbers(report, tmp_path)
    evidence = pandas.read_csv(tmp_path / "evidence_table.csv")
    for name in ("chi square", "ln B", "p", "confidence"):
        assert pandas.api.types.is_numeric_dtype(evidence[name]), name
    for file in tmp_path.glob("*.csv"):
        text = file.read_text(encoding="utf-8")
        assert not set("−×⁻\u202f") & set(text), file
        assert "Unnamed" not in " ".join(pandas.read_csv(file).columns)


def test_figures_carry_the_robots_own_names() -> None:
    axis = Axis("angle of joint_2 [°]", names=("backlash at joint 2", "joint zero 1"))
    line = Line("joint 2", np.zeros(2), np.zeros(2))
    shown = Figure("f", "t", "c", (Panel("extended: backlash at joint 2", axis, axis, (line,)),))
    panel = shown.renamed(lambda text: re.sub(r"joint[_ ]2", "axis_2", text)).panels[0]
    assert panel.title == "extended: backlash at axis_2"
    assert panel.y.names == ("backlash at axis_2", "joint zero 1")
    assert (panel.x.title, panel.marks[0].name) == ("angle of axis_2 [°]", "axis_2")


def test_figures_as_pictures(report: Report, tmp_path: Path) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="needs the extra [report]")
    few = replace(report, sections=report.sections[2:4])  # some names contain a dollar sign
    paths = write_figures(few, tmp_path)
    assert [p.stem for p in paths] == [f.name for f in few.figures()]
    for path in paths:
        picture = pyplot.imread(path)
        inked = (picture[..., :3].min(axis=-1) < 0.8).mean()
        assert 0.005 < inked < 0.8, path


def test_a_pictures_logarithmic_axis_has_plain_numbers(report: Report) -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot", reason="needs the extra [report]")
    canvas = draw(figure(report, "error_line"))
    canvas.canvas.draw()
    labels = [label.get_text() for label in canvas.axes[0].get_yticklabels()]
    pyplot.close(canvas)
    assert {"0.01", "0.1", "1"} <= set(labels)


# --- words


@pytest.mark.parametrize(
    ("value", "said"),
    [(0.0, "0"), (933122.0, "933\u202f000"), (4.16e-7, "4.16 × 10⁻⁷"), (-0.0123, "−0.0123")],
)
def test_numbers_as_read(value: float, said: str) -> None:
    assert figures(value) == said


def test_no_chance_is_nothing_and_nothing_is_certain() -> None:
    assert chance(0.0) == "< 10⁻³⁰⁰"
    assert sure(1.0) == "> 99.9 %"
    assert sure(0.994) == "99.4 %"
    assert sure(0.62) == "62 %"


@pytest.mark.parametrize(
    ("e", "said"),
    [
        (Estimate(2.929e-4, 5.2e-7, "rad"), "gap 2 = 292.90 ± 0.52 µrad"),
        (Estimate(-2.0e-3, None, "m"), "gap 2 = −2.000 mm"),
        (Estimate(1.5e-5, 2e-7, "1/K"), "gap 2 = 1.500 × 10⁻⁵ ± 2.0 × 10⁻⁷ 1/K"),
    ],
)
def test_estimates_in_a_readers_unit(e: Estimate, said: str) -> None:
    assert estimate("gap_2", e).replace("\u00a0", " ") == said


def test_a_scale_that_is_not_logarithmic_has_even_ticks() -> None:
    assert ticks_of(Scale("r [1]", -1.0, 1.0)) == [-1.0, -0.5, 0.0, 0.5, 1.0]


def test_maps_show_the_planes_that_a_machine_works_in_and_are_not_empty() -> None:
    """The poses of a five-axis machine vary across x, those of a SCARA in a horizontal plane."""
    rng = np.random.default_rng(0)
    spread = 0.2 * rng.uniform(-1, 1, (60, 3))
    for flat, title in ((0, "Section, x = "), (2, "Seen from above, z = ")):
        place = spread.copy()
        place[:, flat] = 0.0
        region = Region.of(place)
        place[:, flat] = 2e-3 + 1e-5 * rng.standard_normal(60)
        (figure,) = maps(place, {"before": np.full(60, 1e-4)}, region, 1e-5)
        assert figure.title.startswith(title)
        field = next(mark for mark in figure.panels[0].marks if isinstance(mark, Field))
        assert np.isfinite(field.value).mean() > 0.5


def test_joints_that_slide_are_drawn_in_mm() -> None:
    at = at_rest(np.array([[0.25], [0.5]]))
    slid = ANGLE.of_joints("m")
    assert slid.title == "position of the joint [mm]"
    np.testing.assert_allclose(slid.of(at, 0), [250.0, 500.0])
    assert ANGLE.of_joints("rad") is ANGLE


def test_a_narrow_map_has_few_level_ticks() -> None:
    """Plotly turns seven tick labels under a narrow map upright."""
    wide, high = np.array([-1.0, np.nan, 1.0]), np.array([-5.0, 0.0, 5.0])

    def ticks(x: np.ndarray, y: np.ndarray) -> dict[str, object]:
        marks = (Points("", x, y),)
        shown = plot_of(Panel("", Axis("x"), Axis("y"), marks, equal=True))["layout"]["xaxis"]
        return {key: shown[key] for key in ("nticks", "tickangle")}

    assert ticks(wide, high) == {"nticks": 3, "tickangle": 0}
    assert ticks(high, wide) == {"nticks": 7, "tickangle": 0}


def test_a_mistake_in_the_session_is_told_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The tracker is moved by 10 mm; without the warning it would look like a drift."""
    recorded = read_session(Path(__file__).parents[1] / "bags" / "srbd_plain")
    tracker = recorded.tracker
    place = tracker.position.copy()
    place[len(place) // 2 :] += [0.006, -0.008, 0.0]
    moved = replace(recorded, tracker=replace(tracker, position=place))
    write_session(tmp_path / "moved", moved, {})
    page = tmp_path / "page.html"
    assert (
        run(["report", str(tmp_path / "moved"), "--robot", "srbd", "--out", str(page), "-v"]) == 0
    )
    said = capsys.readouterr().out
    assert "warning: tracker moved in tracker (10.0" in said
    assert "tried on the calibrated model" in said
    text = page.read_text(encoding="utf-8")
    first = text.index("Mistake in the session")
    assert text.index("tracker moved in tracker (10.0", first) < text.index("What is wrong", first)
