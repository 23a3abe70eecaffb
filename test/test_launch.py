"""The launch file, as far as it can be checked without the launch package.

launch and launch_ros are not on PyPI. So the file is executed against a stand-in for them, and
what it would start is held against the package's own executables; test_ros_launch.py does the same
with parameters, and starts a cell so. Where launch is installed, the real one loads it as well.
"""

from __future__ import annotations

import importlib.util
import inspect
import shlex
from configparser import ConfigParser
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import parse_package

from delta_calibration.cli.main import run
from launch_stand_in import LaunchDescription, load
from urdf_reader import Urdf

ROOT = Path(__file__).parents[1]
FILE = ROOT / "launch" / "cell.launch.py"
PACKAGE = "delta_calibration"
OURS = {"calibration_node", "robot_description"}
FOREIGN = {"robot_state_publisher", "rviz2", "foxglove_bridge"}


@pytest.fixture(name="cell", scope="module")
def cell_fixture() -> LaunchDescription:
    return load(FILE)


def test_by_default_a_simulated_cell_is_watched(cell: LaunchDescription) -> None:
    started = set(cell.started())
    assert started == OURS | {"simulated_tracker", "robot_state_publisher", "rviz2"}
    assert {argument.name for argument in cell.arguments if not argument.description} == set()


@pytest.mark.parametrize(
    ("chosen", "more", "fewer"),
    [
        ({"simulated": "false"}, set(), {"simulated_tracker"}),
        ({"record": "true"}, {"session_recorder"}, set()),
        ({"plan": "identify"}, {"measurement_plan"}, set()),
        ({"rviz": "false"}, set(), {"rviz2"}),
        ({"foxglove": "true"}, {"foxglove_bridge"}, set()),
        ({"play": "session"}, {"session_player"}, {"calibration_node", "simulated_tracker"}),
    ],
)
def test_arguments_start_and_leave_out(
    cell: LaunchDescription, chosen: dict[str, str], more: set[str], fewer: set[str]
) -> None:
    before, after = set(cell.started()), set(cell.started(**chosen))
    assert after - before == more
    assert before - after == fewer


def test_a_session_is_shown_by_its_own_clock_and_nothing_drives(cell: LaunchDescription) -> None:
    played = cell.started(play="session", record="true", plan="line")
    assert set(played) == {"session_player", "robot_description", "robot_state_publisher", "rviz2"}
    for started, sim_time in ((played, True), (cell.started(), False)):
        for viewer in ("robot_state_publisher", "rviz2"):
            assert started[viewer][1]["use_sim_time"] is sim_time


def test_executables_are_those_of_setup_cfg_or_of_packages_in_the_manifest(
    cell: LaunchDescription,
) -> None:
    parser = ConfigParser()
    parser.read(ROOT / "setup.cfg", encoding="utf-8")
    lines = parser["options.entry_points"]["console_scripts"].split("\n")
    ours = {line.split(" = ")[0] for line in lines if line}
    needed = {depend.name for depend in parse_package(str(ROOT)).exec_depends}
    for node in cell.nodes:
        if node.package == PACKAGE:
            assert node.executable in ours
        else:
            assert node.executable == node.package
            assert node.package in FOREIGN
    assert {"launch", "launch_ros", "robot_state_publisher", "rviz2"} <= needed


def test_who_drives_waits_for_who_writes(cell: LaunchDescription) -> None:
    def listeners(**chosen: str) -> int:
        return cell.started(plan="line", **chosen)["measurement_plan"][1]["subscribers"]

    assert listeners() == 1
    assert listeners(record="true") == 2


@pytest.mark.parametrize("calibration", ["", "/a b/cell.yaml"])
def test_the_urdf_is_what_the_verb_prints(
    cell: LaunchDescription, calibration: str, capsys: pytest.CaptureFixture[str]
) -> None:
    values = cell.started(calibration=calibration)["robot_state_publisher"][1]
    program, *words = shlex.split(values["robot_description"])
    assert program == f"/opt/lib/{PACKAGE}/delta-cal"
    if calibration:
        assert words[-2:] == ["--calibration", calibration]
        words = words[:-2]
    assert run(words) == 0
    assert Urdf(capsys.readouterr().out).root == "base_link"


def test_links_are_placed_by_the_states_with_passive_joints(cell: LaunchDescription) -> None:
    node, _ = cell.started()["robot_state_publisher"]
    assert ("joint_states", "joint_states_all") in node.remappings


def test_the_view_is_installed_where_it_is_looked_for(cell: LaunchDescription) -> None:
    node, _ = cell.started()["rviz2"]
    given = cell.given()
    path = Path(node.arguments[1].perform(given))
    assert path.parts[-3:] == (PACKAGE, "config", "cell.rviz")
    assert (ROOT / "config" / path.name).is_file()
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    assert '"config/*.*"' in setup
    assert '"launch/*.launch.py"' in setup


@pytest.mark.skipif(
    importlib.util.find_spec("launch_ros") is None, reason="launch_ros is not installed"
)
def test_the_real_launch_loads_it() -> None:
    from launch.launch_description_sources import get_launch_description_from_python_launch_file

    found: Any = get_launch_description_from_python_launch_file(str(FILE))
    assert len(found.entities) == len(load(FILE).arguments) + len(load(FILE).nodes)


def test_every_argument_is_documented_and_used(cell: LaunchDescription) -> None:
    text = inspect.cleandoc(FILE.read_text(encoding="utf-8"))
    for argument in cell.arguments:
        assert argument.description
        assert text.count(f'"{argument.name}"') >= 2, argument.name
