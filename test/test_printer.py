"""A Delta printer from the data of its firmware, compared with an independent simulation."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import fsolve

import real_v400
from delta_calibration.cli.main import run
from delta_calibration.recording.klipper import read_printer
from real_machines import DATA

REAL = DATA / "v400_linear_delta"
STEP = 0.0125  # [mm]
TRUE = {
    "radius": 160.8,
    "angle": np.radians([210.05, 329.9, 90.0]),
    "arm": np.array([344.6, 345.3, 345.0]),
    "endstop": np.array([418.3, 417.6, 419.1]),
}


def joints(place):
    """Steps of the true carriages for a place [mm], by a root of the closures."""
    towers = TRUE["radius"] * np.stack([np.cos(TRUE["angle"]), np.sin(TRUE["angle"])], axis=1)
    top = TRUE["endstop"] + np.sqrt(TRUE["arm"] ** 2 - TRUE["radius"] ** 2)

    def off(height):
        ball = np.column_stack([towers, height])
        return np.linalg.norm(ball - place, axis=1) - TRUE["arm"]

    return (top - fsolve(off, place[2] + np.full(3, 300.0), xtol=1e-12)) / STEP


def written(folder, saved: list[str], **changed: str) -> str:
    """A printer.cfg as SAVE_CONFIG leaves it: the typed part, then the saved block."""
    entries = {
        "arm_length": "345.0",
        "position_endstop": "415.0",
        "delta_radius": "160.0",
    } | changed
    typed = ["[printer]", "kinematics: delta   # three towers", "delta_radius: 161.5"]
    for tower in "abc":
        typed += [f"[stepper_{tower}]"]
        typed += (
            ["step_pin: P2.2"] if tower != "a" else ["rotation_distance = 40", "microsteps: 16"]
        )
    block = ["[printer]", f"delta_radius = {entries['delta_radius']}", "[stepper_a]"]
    block += [f"{name} = {entries[name]}" for name in ("arm_length", "position_endstop")]
    head = "#*# <---------------------- SAVE_CONFIG ---------------------->"
    text = "\n".join([*typed, "", head, *(f"#*# {line}" for line in [*block, *saved])])
    path = folder / "printer.cfg"
    path.write_text(text, encoding="utf-8")
    return str(path)


def measured(rng, noise: float) -> list[str]:
    """Entries of heights above the bed and of distances on it."""
    lines = ["[delta_calibrate]"]
    bed = [
        (0, 0),
        *((r * np.cos(a), r * np.sin(a)) for r in (70, 130) for a in np.arange(6) / 6 * 6.28),
    ]
    for i, (x, y) in enumerate(bed):
        steps = joints(np.array([x, y, 18.2]))
        lines += [f"height{i} = {18.2 + noise * rng.standard_normal():.6f}"]
        lines += [f"height{i}_pos = {','.join(f'{s:.3f}' for s in steps)}"]
    for i in range(12):
        one, other = (np.array([*rng.uniform(-90, 90, 2), 0.0]) for _ in range(2))
        apart = np.linalg.norm(one - other) + noise * rng.standard_normal()
        lines += [f"distance{i} = {apart:.6f}"]
        for end, place in ((1, one), (2, other)):
            lines += [f"distance{i}_pos{end} = {','.join(f'{s:.3f}' for s in joints(place))}"]
    return lines


def test_the_machine_is_found_and_its_entries_written(tmp_path, capsys) -> None:
    config = written(tmp_path, measured(np.random.default_rng(1), 0.0))
    out = tmp_path / "identified.cfg"
    assert run(["printer", config, "--data-alone", "--noise-um", "10", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "13 heights, 12 distances" in said
    text = out.read_text(encoding="utf-8")
    values = [float(line.split(":")[1]) for line in text.splitlines() if ":" in line]
    true = [TRUE["radius"]]
    for i in range(3):
        true += [np.degrees(TRUE["angle"][i]), TRUE["arm"][i], TRUE["endstop"][i]]
    np.testing.assert_allclose(values, true, atol=0.02)  # steps are rounded to a thousandth


def test_errors_are_those_of_the_configuration_and_of_what_is_foretold(tmp_path, capsys) -> None:
    config = written(tmp_path, measured(np.random.default_rng(2), 0.02))
    assert run(["printer", config, "--noise-um", "20"]) == 0
    lines = capsys.readouterr().out.splitlines()
    rows = [
        [float(n) for n in line.split()[1:]]
        for line in lines
        if line.startswith(("heights", "distances"))
    ]
    for configured, identified, left_out in rows:
        assert configured > 0.2
        assert identified < 0.03
        assert identified < left_out < 0.08


@pytest.mark.parametrize(
    ("saved", "changed", "said"),
    [
        (["[delta_calibrate]"], {}, "no measurements: run DELTA_CALIBRATE"),
        (["[delta_calibrate]", "height0 = 18"], {}, "[delta_calibrate] height0_pos is missing"),
        (
            ["[delta_calibrate]", "height0 = 18", "height0_pos = 1,2"],
            {},
            "height0_pos: '1,2' is not allowed; three numbers",
        ),
        (
            ["[delta_calibrate]", "height0 = nan", "height0_pos = 1,2,3"],
            {},
            "height0: 'nan' is not allowed; a number",
        ),
        ([], {"arm_length": "-3"}, "arm_length: '-3' is not allowed; a number above 0"),
        ([], {"delta_radius": "400"}, "arm"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_line(saved, changed, said, tmp_path, capsys) -> None:
    lines = saved or measured(np.random.default_rng(3), 0.0)
    assert run(["printer", written(tmp_path, lines, **changed)]) != 0
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1


def test_a_printer_that_is_no_delta_is_refused(tmp_path, capsys) -> None:
    path = tmp_path / "printer.cfg"
    path.write_text("[printer]\nkinematics: corexy\n", encoding="utf-8")
    assert run(["printer", str(path)]) != 0
    assert "[printer] kinematics: 'corexy' is not allowed; delta" in capsys.readouterr().err
    path.write_text("[include base.cfg]\n", encoding="utf-8")
    assert run(["printer", str(path)]) != 0
    assert "[printer] kinematics is missing; it may be in base.cfg" in capsys.readouterr().err
    path.write_text("no section\n", encoding="utf-8")
    assert run(["printer", str(path)]) != 0
    assert "no printer.cfg" in capsys.readouterr().err


@pytest.mark.real
@pytest.mark.skipif(not REAL.is_dir(), reason="measurements of real machines are not there")
def test_a_real_printer_as_its_firmware_would_have_kept_it(tmp_path) -> None:
    """The 19 data of the documentation, written as entries of the firmware."""
    folder = REAL / real_v400.MEASURED
    heights = np.loadtxt(folder / "heights.csv", delimiter=",", skiprows=1)
    distances = np.loadtxt(folder / "distances.csv", delimiter=",", skiprows=1)
    lines = ["[delta_calibrate]"]
    for i, (height, *steps) in enumerate(heights.tolist()):
        lines += [f"height{i} = {height}", f"height{i}_pos = {','.join(map(str, steps))}"]
    for i, (distance, *steps) in enumerate(distances.tolist()):
        lines += [f"distance{i} = {distance}"]
        lines += [f"distance{i}_pos1 = {','.join(map(str, steps[:3]))}"]
        lines += [f"distance{i}_pos2 = {','.join(map(str, steps[3:]))}"]
    read = read_printer(Path(written(tmp_path, lines)))
    known = real_v400.observations(folder)
    np.testing.assert_allclose(read.at_height, known[0].joint, atol=1e-12)
    np.testing.assert_allclose(read.one, known[1].joint, atol=1e-12)
    np.testing.assert_allclose(read.distance, known[1].distance, atol=1e-12)
    assert json.loads((folder / "saved_geometry.json").read_text())["microstep_mm"][0] == STEP
