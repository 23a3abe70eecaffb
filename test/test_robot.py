"""Robot files: conversion to SI, limits, and robots by name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.errors import ConfigError, ReachError
from delta_calibration.robot import known_robots, load_robot

TEXT = Path(load_robot("srbd").source).read_text(encoding="utf-8")


def robot_with(tmp_path, old, new):
    assert TEXT.count(old) == 1
    path = tmp_path / "cell.yaml"
    path.write_text(TEXT.replace(old, new), encoding="utf-8")
    return load_robot(path)


def test_units_of_the_file_become_si():
    robot = load_robot("srbd")
    assert robot.name == "srbd"
    assert robot.dimensions.base_radius == pytest.approx(0.2)
    assert robot.dimensions.half_width == pytest.approx(0.04)
    assert robot.tolerances.arm == pytest.approx(0.15e-3)
    assert robot.tolerances.joint_zero == pytest.approx(0.8e-3)
    np.testing.assert_allclose(robot.joints.lower, -35 * np.pi / 180)
    assert robot.joints.repeatability == pytest.approx(12e-6)
    assert robot.joints.encoder == pytest.approx(3e-6)
    speed = float(re.search(r"speed_deg_per_s: ([\d.]+)", TEXT)[1])
    assert robot.joints.speed == pytest.approx(speed * np.pi / 180)
    assert robot.joints.gear_ratio == 33
    assert (robot.masses.platform, robot.masses.arm_centre) == (1.2, 0.45)
    assert robot.tracker.radial == pytest.approx(3e-6)
    assert robot.tracker.transverse_per_metre == pytest.approx(2e-6)
    assert robot.tracker.reflector_offset_prior == pytest.approx(0.05)
    assert robot.limits.correction == pytest.approx(np.pi / 180)
    assert robot.limits.region_margin == pytest.approx(0.01)


def test_vectors_keep_their_order_and_unit(tmp_path):
    offset = "reflector_offset_mm: [0.0, 0.0, 0.0]"
    robot = robot_with(tmp_path, offset, "reflector_offset_mm: [1, -2.0, 30]")
    np.testing.assert_allclose(robot.tracker.reflector_offset, [1e-3, -2e-3, 30e-3])


def test_noise_across_the_beam_grows_with_distance():
    along, across = load_robot("srbd").tracker.sigmas(np.array([1.0, 3.0]))
    np.testing.assert_allclose(along, 3e-6)
    np.testing.assert_allclose(across, [4e-6, 8e-6])


@pytest.mark.parametrize("low", ["100.0", "100.5"])
def test_lower_not_below_upper_is_refused(tmp_path, low):
    message = rf"cell\.yaml: joints: joint_2 has lower_deg {low} not below upper_deg 100"
    with pytest.raises(ConfigError, match=message):
        robot_with(
            tmp_path, "lower_deg: [-35.0, -35.0, -35.0]", f"lower_deg: [-35.0, {low}, -35.0]"
        )


@pytest.mark.parametrize("values", ["[-35.0]", "[-35.0, -35.0, -35.0, -35.0]"])
def test_limits_are_one_a_joint(tmp_path, values):
    count = values.count("-")
    message = rf"cell\.yaml: joints\.lower_deg: {count} values found, 3 are expected"
    with pytest.raises(ConfigError, match=message):
        robot_with(tmp_path, "lower_deg: [-35.0, -35.0, -35.0]", f"lower_deg: {values}")


def robot_like(tmp_path, name, old, new):
    """A robot of the package with a change in its file."""
    text = Path(load_robot(name).source).read_text(encoding="utf-8")
    assert old in text
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    return load_robot(path)


TOWERS = "angles_deg: [210.0, 330.0, 90.0]"
DRAWINGS = {  # robot, text, its replacement, message
    "towers in one place": (
        "linear_delta",
        TOWERS,
        "angles_deg: [90, 330, 90]",
        r"geometry.angles_deg: \[90, 330, 90\] is not allowed; 3 towers at least 1 deg apart",
    ),
    "towers in one place, a turn apart": (
        "linear_delta",
        TOWERS,
        "angles_deg: [-270, 330, 90]",
        r"\[-270, 330, 90\] is not allowed",
    ),
    "arms too short": (
        "linear_delta",
        "arm_mm: 345.0",
        "arm_mm: 150.0",
        "geometry.arm_mm: 150 is not allowed; more than radius_mm, 160, to reach the middle",
    ),
    "rods too short": (
        "srbd",
        "rod_mm: 850.0",
        "rod_mm: 465",
        r"geometry.rod_mm: 465 is not allowed; more than 465 \(base_radius_mm \+ arm_mm - ",
    ),
    "rods stretched": (
        "srbd",
        "rod_mm: 850.0",
        "rod_mm: 465.0001",
        "geometry: base_radius_mm 200.0, .* rod_mm 465.0001, .* a six_rod_delta of these "
        "dimensions is singular at home",
    ),
    "struts too short": (
        "five_axis",
        "strut_mm: 628.0",
        "strut_mm: 28.0",
        "geometry.turning.strut_mm: 28 is not allowed; more than 354.379",
    ),
    "a stretched arm": (
        "scara",
        "home_deg: [60.0, 30.0]",
        "home_deg: [60.0, 0.0]",
        r"home_deg \[60.0, 0.0\], .*: a serial_arm of these dimensions is singular at home",
    ),
    "a coordinate that no joint changes": (
        "scara",
        "home_deg: [60.0, 30.0]",
        "home_deg: [0.0, 0.0]",
        r"joints at 0, 0 degrees, where no joint changes x, which it is commanded by",
    ),
    "home beyond the limits": (
        "scara",
        "home_deg: [60.0, 30.0]",
        "home_deg: [60.0, -160.0]",
        r"joints: joint_2 is at -160 degrees at home \(geometry.home_deg\), beyond lower_deg -150",
    ),
    "sliding home beyond the limits": (
        "linear_delta",
        "height_mm: 415.0",
        "height_mm: 1000.0",
        r"carriage_1 is at 500 mm at home \(half of geometry.height_mm\), beyond upper_mm 450",
    ),
    "one home too few": (
        "scara",
        "home_deg: [60.0, 30.0]",
        "home_deg: [60.0]",
        r"geometry.home_deg: \[60\] is not allowed; 2 finite numbers",
    ),
    "cables without a turn": (
        "cdpr8",
        "home_turn_deg: [0.0, 0.0, 0.0]",
        "",
        r"geometry.joints_mm: \[\[-200, 200, 400\], .* as a point \(no home_turn_deg\)",
    ),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", DRAWINGS)
def test_drawings_of_no_machine_are_refused_by_their_keys_in_their_units(tmp_path, name):
    robot, old, new, said = DRAWINGS[name]
    with pytest.raises(ConfigError, match=rf"cell\.yaml: .*{said}"):
        robot_like(tmp_path, robot, old, new)


def test_what_joints_cannot_take_is_said_in_their_unit():
    """Joint values have the unit of the joints, m or rad; places are in metres."""
    none = np.full((1, 3), np.nan)
    for name, unit in (("linear_delta", "m"), ("srbd", "rad")):
        model = load_robot(name).commanded
        with pytest.raises(ReachError, match=rf"joint command 1 \(0.1, 0.2, 0.3 {unit}\)"):
            model.require_reach(none, np.array([[0.1, 0.2, 0.3]]), "joint command")
        with pytest.raises(ReachError, match=r"target 1 \(0.1, 0.2, 0.3 m\)"):
            model.require_reach(none, np.array([[0.1, 0.2, 0.3]]), "target", "m")


def test_robots_of_the_package_by_name():
    assert "srbd" in known_robots()
    with pytest.raises(ConfigError, match=r"no robot 'sbrd': neither a YAML file .*srbd"):
        load_robot("sbrd")


def test_a_folder_of_the_robots_name_is_not_taken_for_its_file(tmp_path, monkeypatch):
    (tmp_path / "srbd").mkdir()
    monkeypatch.chdir(tmp_path)
    assert load_robot("srbd").name == "srbd"


def test_a_missing_file_is_named():
    with pytest.raises(ConfigError, match=r"^cells/none\.yaml: cannot be read: No such file"):
        load_robot("cells/none.yaml")


def test_models_of_the_robot():
    robot = load_robot("srbd")
    assert robot.model().name == "six_rod_delta"
    assert robot.model("rotary_delta").name == "rotary_delta"
    with pytest.raises(ConfigError, match=r"no mechanism 'scara'; there are: .*rotary_delta"):
        robot.model("scara")
