"""`delta-cal compensate --method table`: a table is made, saved, loaded and refused."""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.calibration_file import save_calibration
from delta_calibration.cli.main import run
from delta_calibration.data import collect
from delta_calibration.estimation import identify
from delta_calibration.plans import make_plan
from delta_calibration.robot import load_robot
from delta_calibration.simulation import draw_machine, simulate_session
from extended_bench import with_effects

ROBOT = load_robot("srbd")


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """A fit, the same fit with effects, another fit, and targets."""
    folder = tmp_path_factory.mktemp("cell")
    plan = make_plan("identify", ROBOT, count=15, dwell=0.4, both_sides=False)
    found = {}
    for seed in (5, 6):
        poses = collect(simulate_session(draw_machine(ROBOT, seed), plan, 5), ROBOT.joints.names)
        found[seed] = identify(poses, ROBOT, "rotary_delta"), poses
    play, grown = {"backlash": ({}, 4e-4)}, {"thermal_growth_arm": ({"sensor": "arm"}, 23e-6)}
    for name, seed, effects in (
        ("plain", 5, {}),
        ("play", 5, play),
        ("grown", 5, grown),
        ("other", 6, {}),
    ):
        fit, poses = found[seed]
        save_calibration(folder / f"{name}.yaml", with_effects(fit, ROBOT, effects), ROBOT, poses)
    turn = np.linspace(0, 5, 30)
    rows = [f"{200 * np.cos(a)},{150 * np.sin(a)},{-711 - 10 * a}" for a in turn]
    (folder / "targets.csv").write_text("x_mm,y_mm,z_mm\n" + "\n".join(rows) + "\n")
    return folder


def compensate(cell: Path, name: str, method: str, *more: str) -> int:
    return run(
        [
            "compensate",
            "--robot",
            "srbd",
            "--calibration",
            str(cell / f"{name}.yaml"),
            "--method",
            method,
            str(cell / "targets.csv"),
            "--out",
            str(cell / f"{method}.csv"),
            *more,
        ]
    )


def commands(cell: Path, method: str) -> np.ndarray:
    with (cell / f"{method}.csv").open() as file:
        rows = list(csv.DictReader(file))
    names = (*ROBOT.joints.names, "error_mm")
    return np.array([[float(row[name]) for name in names] for row in rows])


@pytest.mark.parametrize("name", ["plain", "play"])
def test_a_table_gives_newtons_commands_and_says_how_well(cell, capsys, name):
    assert compensate(cell, name, "table") == 0
    said = capsys.readouterr().out
    words = r"corrections by table \(\d+ nodes an axis by newton, at most 0.\d+ um off at \d+ pl"
    assert re.search(words, said)
    assert "bound 1 um)" in said
    assert compensate(cell, name, "newton") == 0
    table, newton = commands(cell, "table"), commands(cell, "newton")
    np.testing.assert_allclose(table[:, :3], newton[:, :3], atol=2e-6)
    assert table[:, 3].max() <= 1e-3
    if name == "plain":  # with backlash, Newton's method continues from the table's value
        assert table[:, 3].max() > newton[:, 3].max()


def test_a_table_is_written_then_loaded_and_refused_when_stale(cell, capsys):
    file = cell / "kept.npz"
    asked = ("--table", str(file))
    assert compensate(cell, "plain", "table", *asked, "--table-bound-um", "0.3") == 0
    assert f"bound 0.3 um), written: {file}" in capsys.readouterr().out
    made, first = file.read_bytes(), commands(cell, "table")
    assert compensate(cell, "plain", "table", *asked) == 0
    assert f"bound 0.3 um), loaded from {file}" in capsys.readouterr().out
    assert file.read_bytes() == made
    np.testing.assert_array_equal(commands(cell, "table"), first)

    for name in ("other", "play"):
        assert compensate(cell, name, "table", *asked) == 2
        said = capsys.readouterr().err.strip().splitlines()[-1]
        assert f"{file}: the table is outdated: it was made for calibration " in said
    for more, reason in (
        (("--table-bound-um", "0.2"), "its bound is 0.3 um, not 0.2"),
        (("--table-by", "apso"), "made by newton, not by apso"),
    ):
        assert compensate(cell, "plain", "table", *asked, *more) == 2
        assert f"{file}: {reason}" in capsys.readouterr().err
    file.write_bytes(made[:-30])
    assert compensate(cell, "plain", "table", *asked) == 2
    assert f"{file}: not a whole table of corrections" in capsys.readouterr().err
    assert file.read_bytes() == made[:-30]  # only the user may delete it


def test_where_dimensions_change_the_exact_way_is_taken_and_said(cell, capsys):
    file = cell / "never.npz"
    warm = ("--temperature", "arm=31")
    assert compensate(cell, "grown", "table", "--table", str(file), *warm) == 0
    said = capsys.readouterr().out
    assert "by newton (no table, because the dimensions change with thermal_growth_arm)" in said
    assert not file.exists()
    assert "(30 of 30 commands corrected by newton, " in said
    assert compensate(cell, "grown", "newton", *warm) == 0
    table, newton = commands(cell, "table"), commands(cell, "newton")
    np.testing.assert_allclose(table, newton, rtol=0, atol=1e-9)  # compiled code and numpy


def test_options_of_a_table_beside_another_method_are_refused(cell, capsys):
    for option, value in (("--table", "a.npz"), ("--table-by", "apso"), ("--table-bound-um", "1")):
        assert compensate(cell, "plain", "newton", option, value) == 2
        assert f"{option} is for --method table, not newton" in capsys.readouterr().err
    (cell / "table.csv").touch()
    assert compensate(cell, "plain", "table", "--table", str(cell / "table.csv" / "a.npz")) == 2
    assert "table.csv is not a folder" in capsys.readouterr().err
    assert compensate(cell, "plain", "table", "--table-bound-um", "2") == 2
