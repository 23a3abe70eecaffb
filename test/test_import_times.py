"""Tables without times: only the order of their rows is known, and every result says so."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.recording import read_session
from import_bench import SRBD, imported, mapping_of, measured, refused, stops

MODEL = "rotary_delta"  # the fastest model
ASSUMED = "10 s from row to row are assumed"


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder, and header and rows of a table of stops without times."""
    return tmp_path_factory.mktemp("cell"), *stops(measured()[1])


def poses_of(folder):
    return collect(read_session(folder), SRBD.joints.names)


def assumed(folder):
    return read_session(folder).assumed_interval


def test_assumed_times_are_said_by_every_verb(cell, capsys, tmp_path):
    folder, head, rows = cell
    out = imported(folder, head, rows, mapping_of())
    assert ASSUMED in capsys.readouterr().out
    chosen = [str(out), "--robot", "srbd"]
    for verb in (["check"], ["fit", "--model", MODEL, "--out", str(tmp_path / "c.yaml")]):
        assert run([verb[0], *chosen, *verb[1:]]) == 0
        assert ASSUMED in capsys.readouterr().out
    assert ASSUMED in (tmp_path / "c.yaml").read_text().replace("\n", " ")
    assert run(["info", str(out)]) == 0
    assert "assumed row interval s: 10" in capsys.readouterr().out
    assert assumed(out) == 10.0


def test_a_stated_interval_is_no_assumption(cell, capsys):
    folder, head, rows = cell
    out = imported(folder, head, rows, mapping_of(row_interval_s=38))
    assert ASSUMED not in capsys.readouterr().out
    assert assumed(out) is None
    np.testing.assert_allclose(np.diff(poses_of(out).time), 38.0, atol=1e-6)


def test_measured_times_are_no_assumption(cell, capsys):
    folder, head, rows = cell
    timed = [[str(5 * k), *row] for k, row in enumerate(rows, 1)]
    mapping = mapping_of(time={"column": "t", "unit": "s"})
    out = imported(folder, ["t", *head], timed, mapping)
    assert ASSUMED not in capsys.readouterr().out
    assert assumed(out) is None


def test_rows_that_are_left_out_take_their_time(cell):
    folder, head, rows = cell
    gap = [row if k != 4 else ["", *row[1:]] for k, row in enumerate(rows)]
    poses = poses_of(imported(folder, head, gap, mapping_of(missing="skip", row_interval_s=38)))
    steps = np.diff(poses.time)
    np.testing.assert_allclose(steps[3], 76.0, atol=1e-6)
    np.testing.assert_allclose(np.delete(steps, 3), 38.0, atol=1e-6)


def test_a_guess_takes_the_interval(cell, capsys, tmp_path):
    _, head, rows = cell
    table = tmp_path / "table.csv"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([[*head[:3], "x_mm", "y_mm", "z_mm"], *rows])
    asked = ["import", str(table), "--guess", "--robot", "srbd", "--out"]
    assert run([*asked, str(tmp_path / "a")]) == 0
    assert ASSUMED in capsys.readouterr().out
    assert run([*asked, str(tmp_path / "b"), "--row-interval", "38"]) == 0
    assert ASSUMED not in capsys.readouterr().out
    np.testing.assert_allclose(np.diff(poses_of(tmp_path / "b").time), 38.0, atol=1e-6)
    asked[2:3] = ["--mapping", str(tmp_path / "m.yaml")]
    assert run([*asked, str(tmp_path / "c"), "--row-interval", "38"]) == 2
    assert "row_interval_s" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"row_interval_s": 30, "time": {"column": "x", "unit": "s"}}, "together with time"),
        ({"row_interval_s": 0.5}, "1.1 s apart or more"),
        ({"row_interval_s": -3}, "row_interval_s"),
        ({"rows": "stream"}, "or row_interval_s"),
    ],
)
def test_wrong_intervals_are_refused(cell, capsys, changes, said):
    folder, head, rows = cell
    assert said in refused(capsys, folder, head, rows, mapping_of(**changes))
