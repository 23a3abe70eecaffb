"""Tests of the drift of calibrations and verdicts, and of the verbs `report` and `compare`."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("jinja2", reason="needs the extra [report]")
pytest.importorskip("plotly", reason="needs the extra [report]")

from delta_calibration.calibration import Calibration
from delta_calibration.calibration_file import from_identification, save_calibration
from delta_calibration.cli.main import run
from delta_calibration.errors import DataError, InputError
from delta_calibration.estimation import chain_of
from delta_calibration.report import drift_of_verdicts, read_verdict
from delta_calibration.report.drift import read_calibration, shift, standardised
from delta_calibration.report.glossary import TERMS
from delta_calibration.report.verdict_file import verdict_of
from report_bench import ROBOT, found


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return from_identification(found().identification, ROBOT, found().model.survey.poses)


def changed(calibration: Calibration, **by: float) -> Calibration:
    """The calibration with all parameters changed whose names begin with these stems."""
    theta = calibration.theta.copy()
    for row, name in enumerate(calibration.chain.parameters.names):
        theta[row] += sum(value for stem, value in by.items() if name.startswith(stem))
    return replace(calibration, theta=theta)


@pytest.fixture
def verdicts(tmp_path: Path) -> list[Path]:
    """Two verdicts; the backlash grows by half from the first to the second."""
    data = found().verdict.as_dict()
    paths = [tmp_path / "may.json", tmp_path / "june.json"]
    paths[0].write_text(json.dumps(data))
    for value in data["findings"][0]["parameters"].values():
        value["value"] *= 1.5
    paths[1].write_text(json.dumps(data))
    return paths


def test_a_machine_has_not_moved_from_itself(calibration: Calibration) -> None:
    assert shift(calibration, calibration) == pytest.approx((0.0, 0.0), abs=1e-12)


def test_a_base_mounted_higher_is_no_drift(calibration: Calibration) -> None:
    """A rigid motion of all base joints equals another position of the tracker."""
    assert shift(calibration, changed(calibration, base_height=1e-3))[1] < 1e-9


def test_a_longer_arm_is_drift(calibration: Calibration) -> None:
    """Shift of the three-sphere Delta's platform by 0.1 mm of one arm, after fitting a frame."""
    rms, most = shift(calibration, changed(calibration, arm_1=0.1e-3))
    assert 0.01e-3 < rms < most < 0.3e-3
    twice = shift(calibration, changed(calibration, arm_1=0.2e-3))[0]
    assert twice == pytest.approx(2 * rms, rel=0.01)


def test_machines_of_two_models_are_not_compared(calibration: Calibration) -> None:
    other = replace(calibration, chain=chain_of(ROBOT, "rotary_delta"))
    with pytest.raises(DataError, match=r"'six_rod_delta'.*'rotary_delta'"):
        shift(calibration, other)


def test_changes_are_weighed_by_their_errors(calibration: Calibration, tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    save_calibration(path, found().identification, ROBOT, found().model.survey.poses)
    record = read_calibration(path, ROBOT)
    later = replace(record, calibration=changed(record.calibration, arm_2=5e-6))
    change = standardised(record, later)
    row = calibration.chain.parameters.row("arm_2")
    expected = 5e-6 / (np.sqrt(2) * found().identification.std[row])
    assert change[row] == pytest.approx(expected, rel=1e-6)
    assert np.count_nonzero(change) == 1


def test_a_verdict_is_read_back_as_it_was(verdicts: list[Path]) -> None:
    assert read_verdict(verdicts[0]).verdict == found().verdict


def test_a_verdict_without_what_the_contract_leaves_open() -> None:
    data = found().verdict.as_dict()
    for name in ("gain_low", "gain_high", "signal"):
        del data["findings"][0][name]
    assert verdict_of(data).findings[0].gain_low == data["findings"][0]["gain"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{", "not JSON"),
        ("[]", "a mapping"),
        ('{"schema": 1}', "missing key"),
    ],
)
def test_what_is_no_verdict_is_refused(text: str, said: str, tmp_path: Path) -> None:
    path = tmp_path / "odd.json"
    path.write_text(text)
    with pytest.raises(InputError, match=rf"odd\.json.*{said}"):
        read_verdict(path)


def test_a_value_that_is_a_text_is_named(verdicts: list[Path], tmp_path: Path) -> None:
    """Some values may be a number or null; an error names both."""
    data = json.loads(verdicts[0].read_text())
    data["baseline"]["held_out_rms_mm"] = "0.1"
    path = tmp_path / "odd.json"
    path.write_text(json.dumps(data))
    said = r"odd\.json: baseline\.held_out_rms_mm: '0\.1' is not allowed; a number or null"
    with pytest.raises(InputError, match=said):
        read_verdict(path)


def test_drift_of_verdicts_shows_the_grown_play(verdicts: list[Path]) -> None:
    made = drift_of_verdicts([read_verdict(path) for path in verdicts])
    values = next(f for f in made.figures() if f.name.startswith("values_"))
    for points in values.panels[0].marks:
        assert points.y[1] == pytest.approx(1.5 * points.y[0])


def test_values_of_unlike_units_have_panels_of_their_own(verdicts: list[Path]) -> None:
    """A drift may be a ramp in one session and settle in another."""
    files = [read_verdict(path) for path in verdicts]
    rates = [each for file in files for each in (file, file)]
    for number, file in enumerate(rates):
        unit = "rad/h" if number % 2 else "rad"
        (finding,) = file.verdict.findings
        values = {name: replace(e, unit=unit) for name, e in finding.parameters.items()}
        verdict = replace(file.verdict, findings=(replace(finding, parameters=values),))
        rates[number] = replace(file, name=f"{number}", verdict=verdict)
    values = next(f for f in drift_of_verdicts(rates).figures() if f.name.startswith("values_"))
    axes = [panel.y.title for panel in values.panels]
    assert [title.rpartition("[")[2] for title in axes] == ["mrad]", "mrad/h]"]


def test_compare_writes_pages_tables_and_numbers(
    verdicts: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page, folder = tmp_path / "drift.html", tmp_path / "numbers"
    names = [str(path) for path in verdicts]
    assert run(["compare", *names, "--out", str(page), "--numbers", str(folder)]) == 0
    said = capsys.readouterr().out
    assert "may" in said
    assert "june" in said
    assert max(map(len, said.splitlines())) < 300  # the glossary's sentences are on the page only
    assert "Comparison of 2 verdicts" in page.read_text()
    assert set(json.loads((folder / "report.json").read_text())["verdicts"]) == {"may", "june"}


def test_files_of_one_name_are_told_apart(
    verdicts: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """None replaces another in the numbers; giving a file twice is a mistake."""
    other = tmp_path / "later" / verdicts[0].name
    other.parent.mkdir()
    other.write_bytes(verdicts[1].read_bytes())
    numbers = tmp_path / "numbers"
    assert run(["compare", str(verdicts[0]), str(other), "--numbers", str(numbers)]) == 0
    written = json.loads((numbers / "report.json").read_text())["verdicts"]
    assert set(written) == {str(verdicts[0]), str(other)}
    assert run(["compare", str(other), str(other)]) == 2
    assert "given twice" in capsys.readouterr().err


def test_one_verdict_makes_a_page(verdicts: list[Path], tmp_path: Path) -> None:
    page = tmp_path / "one.html"
    assert run(["compare", str(verdicts[0]), "--out", str(page)]) == 0
    assert len(page.read_bytes()) < 100_000  # no plots, no script
    assert "<script" not in page.read_text()


def test_compare_of_calibrations(
    calibration: Calibration, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [tmp_path / "a.yaml", tmp_path / "b.yaml"]
    for path in paths:
        save_calibration(path, found().identification, ROBOT, found().model.survey.poses)
    names = [str(path) for path in paths]
    page = tmp_path / "drift.html"
    assert run(["compare", *names, "--robot", "srbd", "--out", str(page)]) == 0
    assert "0.0000 mm RMS" in capsys.readouterr().out
    assert "Dimensions that changed most" in page.read_text()


def test_compare_refuses_what_cannot_be_compared(
    verdicts: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, said in (
        ([str(verdicts[0]), "x.yaml"], "files of one kind"),
        (["x.yaml"], "at least two"),
        (["x.yaml", "y.yaml"], "--robot"),
        (["x.yaml", "y.yaml", "--robot", "srbd"], "x.yaml: cannot be read"),
    ):
        assert run(["compare", *arguments]) == 2
        assert said in capsys.readouterr().err


def test_report_refuses_before_any_work(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("")
    out = str(tmp_path / "file" / "page.html")
    assert run(["report", str(tmp_path), "--robot", "srbd", "--out", out]) == 2
    assert "file is not a folder" in capsys.readouterr().err


def test_the_terminal_is_spared_the_glossary(
    verdicts: list[Path], capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["compare", *map(str, verdicts)]) == 0
    said = capsys.readouterr().out
    assert "noise of a pose [mm]" in said
    assert TERMS[0][1] not in said
    assert max(map(len, said.splitlines())) < 250


def test_a_file_of_neither_kind_is_named(
    verdicts: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "report.html"
    page.write_text("<html>")
    assert run(["compare", str(verdicts[0]), str(page)]) == 2
    assert f"{page}: a calibration" in capsys.readouterr().err
