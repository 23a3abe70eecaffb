"""Rows of a table that are copies of other rows: refused, left out or kept, with line numbers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from delta_calibration.recording import read_session
from delta_calibration.recording.table_repeats import _alike, _at_least
from import_bench import imported, mapping_of, measured, refused, stops


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A folder, and the header and rows of a table."""
    _, poses = measured()
    return tmp_path_factory.mktemp("repeats"), *stops(poses)


def rounded(rows, digits):
    return [[*row[:3], *(f"{float(v):.{digits}f}" for v in row[3:])] for row in rows]


@pytest.mark.parametrize("digits", [12, 4, 3, 2])
def test_a_block_that_was_pasted_twice(cell, capsys, digits):
    folder, head, rows = cell
    rows = rounded(rows, digits)
    n = len(rows)
    said = refused(capsys, folder, head, [*rows, *rows], mapping_of())
    assert f"lines {n + 2} to {2 * n + 1} repeat lines 2 to {n + 1} to the last digit" in said
    assert ".csv: lines" in said
    assert "`repeated: skip` in the mapping leaves them out, `keep` uses them" in said


def test_numbers_written_otherwise_are_the_same_numbers(cell, capsys):
    folder, head, rows = cell
    again = [f"{float(v):+.17e}" for v in rows[5]]
    said = refused(capsys, folder, head, [*rows, again], mapping_of())
    assert f"line {len(rows) + 2} repeats line 7 to the last digit" in said


def test_copies_in_another_order_under_other_times_and_loads(cell, capsys):
    folder, head, rows = cell
    more = [*rows, *(rows[k] for k in (9, 3, 4, 5))]
    more = [[10 * k, *row, k % 3] for k, row in enumerate(more)]
    timed = mapping_of(time={"column": "t", "unit": "s"}, payload={"column": "kg", "unit": "kg"})
    said = refused(capsys, folder, ["t", *head, "kg"], more, timed)
    n = len(rows) + 2
    assert f"lines {n} to {n + 3} repeat lines 5 to 7, 11 to the last digit" in said


def test_copies_are_left_out_or_kept(cell, capsys):
    folder, head, rows = cell
    table = [*rows, *rows[:10]]
    out = imported(folder, head, table, mapping_of(repeated="skip"))
    assert "repeat lines 2 to 11 to the last digit" in capsys.readouterr().out
    assert len(read_session(out).tracker.stamp_ns) == len(rows)
    out = imported(folder, head, table, mapping_of(repeated="keep", row_interval_s=10))
    assert "note" not in capsys.readouterr().out
    assert len(read_session(out).tracker.stamp_ns) == len(rows) + 10


def test_repeated_poses_that_coarse_digits_make_alike(cell, capsys):
    """New readings of the same poses with tracker noise, rounded to 0.1 mm, are not copies."""
    folder, head, rows = cell
    rng = np.random.default_rng(4)
    table = [
        [*row[:3], *(repr(float(v) + 3e-3 * rng.normal()) for v in row[3:])]
        for row in [*rows, *rows, *rows]
    ]
    imported(folder, head, rounded(table, 1), mapping_of())
    assert "can be equal by chance, so they were kept" in capsys.readouterr().out
    imported(folder, head, rounded(table, 4), mapping_of(row_interval_s=10))
    assert "note" not in capsys.readouterr().out


@pytest.mark.parametrize(("equal", "tries"), [(1, 1), (3, 40), (40, 40), (4, 2**32 + 5)])
def test_as_many_equal_rows_by_chance(equal: int, tries: int) -> None:
    for alike in (0.0, 1e-9, 0.2, 1.0):
        theirs = binom.sf(equal - 1, tries, alike)
        assert _at_least(equal, tries, alike) == pytest.approx(theirs, rel=1e-9, abs=1e-300)


def test_a_robot_that_stands_still_twice_is_no_copy_in_a_stream(cell, capsys):
    """Encoders and commands repeat, but the time does not."""
    folder, head, rows = cell
    twice = [[k, *row] for k, row in enumerate([*rows, *rows])]
    mapping = mapping_of(rows="stream", time={"column": "t", "unit": "s"})
    imported(folder, ["t", *head], twice, mapping)
    twice = [[k % len(rows), *row] for k, row in enumerate([*rows, *rows])]
    said = refused(capsys, folder, ["t", *head], twice, mapping)
    assert f"repeat lines 2 to {len(rows) + 1} to the last digit" in said


def test_rows_in_motion_may_have_the_same_commands(cell):
    folder, head, rows = cell
    going = [[*row[:3], "", "", ""] for row in rows[:3]]
    table = [[*row, "stop"] for row in rows]
    table[5:5] = [[*row, "go"] for row in going]
    table[9:9] = [[*row, "go"] for row in going]
    moving = {"column": "state", "at_rest": ["stop"]}
    imported(folder, [*head, "state"], table, mapping_of(moving=moving))


@pytest.mark.parametrize("step", [0.1, 1.0, 5.0, 40.0])
def test_the_chance_of_two_readings_that_round_alike(step):
    """Compared with random draws; the true value is uniform between two multiples of the step."""
    rng = np.random.default_rng(7)
    value = rng.uniform(0, step, 200_000)
    one, other = (np.round((value + rng.normal(size=len(value))) / step) for _ in range(2))
    share = np.mean(one == other)
    assert abs(share - _alike(step, 1.0)) < 4 * np.sqrt(share / len(value))
