"""The robot's file in SI, its limits, and how a robot is found by name."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from delta_calibration.errors import ConfigError
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
