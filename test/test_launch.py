"""Checks of the launch file that need no launch package.

launch and launch_ros are not on PyPI, so the file is executed with stand-ins for them. The nodes
that it would start are compared with the executables of the package. test_ros_launch.py checks the
parameters and starts a cell. Where launch is installed, it loads the file as well.
"""

from __future__ import annotations

import importlib.util
import shlex
from configparser import ConfigParser
from pathlib import Path
from typing import Any

import pytest
from catkin_pkg.package import parse_package

from delta_calibration.cell.command_path import ON_FAILURE
from delta_calibration.cli.main import run
from delta_calibration.compensation import METHODS
from delta_calibration.ros.watchdog import LIMIT_S
from launch_stand_in import INSTALLED, LaunchDescription, Node, load
from urdf_reader import Urdf

ROOT = Path(__file__).parents[1]
FILE = ROOT / "launch" / "cell.launch.py"
PACKAGE = "delta_calibration"
OURS = {"calibration_node", "robot_description"}
FOREIGN = {"robot_state_publisher", "rviz2", "foxglove_bridge"}


@pytest.fixture(name="cell", scope="module")
def cell_fixture() -> LaunchDescription:
    return load(FILE)


@pytest.fixture(autouse=True)
def _screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


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


EVERYTHING = {"record": "true", "plan": "identify", "rviz": "true", "foxglove": "true"}


@pytest.fixture(name="nodes", scope="module")
def nodes_fixture(cell: LaunchDescription) -> list[Node]:
    """All nodes that the file can start."""
    every = cell.started(**EVERYTHING) | cell.started(play="session")
    return [node for node, _ in every.values()]


def test_executables_are_those_of_setup_cfg_or_of_packages_in_the_manifest(
    nodes: list[Node],
) -> None:
    parser = ConfigParser()
    parser.read(ROOT / "setup.cfg", encoding="utf-8")
    lines = parser["options.entry_points"]["console_scripts"].split("\n")
    ours = {line.split(" = ")[0] for line in lines if line}
    needed = {depend.name for depend in parse_package(str(ROOT)).exec_depends}
    for node in nodes:
        if node.package == PACKAGE:
            assert node.executable in ours
        else:
            assert node.executable == node.package
            assert node.package in FOREIGN
    assert {"ament_index_python", "launch", "launch_ros"} <= needed
    assert {"robot_state_publisher", "rviz2"} <= needed


@pytest.mark.parametrize(
    ("package", "chosen", "apt"),
    [
        ("robot_state_publisher", {}, "ros-jazzy-robot-state-publisher"),
        ("rviz2", {"rviz": "true"}, "ros-jazzy-rviz2"),
        ("foxglove_bridge", {"foxglove": "true"}, "ros-jazzy-foxglove-bridge"),
    ],
)
def test_where_a_package_is_missing_nothing_is_started(
    cell: LaunchDescription, package: str, chosen: dict[str, str], apt: str
) -> None:
    said = f"nothing was started: package {package} is not installed: sudo apt install {apt}"
    with pytest.raises(RuntimeError, match=said):
        cell.started(INSTALLED - {package}, **chosen)


def test_rviz_is_started_where_it_is_and_has_a_screen(
    cell: LaunchDescription, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "rviz2" in cell.started()
    assert "rviz2" not in cell.started(INSTALLED - {"rviz2"})
    monkeypatch.delenv("DISPLAY")
    assert "rviz2" not in cell.started()
    assert "rviz2" in cell.started(rviz="true")
    assert "rviz2" not in cell.started(rviz="false")


def test_where_one_ends_that_the_commands_need_all_end(nodes: list[Node]) -> None:
    required = {"calibration_node", "simulated_tracker", "session_recorder"}
    assert {node.executable for node in nodes if node.on_exit is not None} == required
    for node in nodes:
        if node.on_exit is not None:
            assert node.on_exit.reason == f"{node.executable} has ended"
        closing = float(node.sigterm_timeout)
        assert closing > (20.0 if node.executable == "session_recorder" else LIMIT_S)


@pytest.mark.parametrize(
    ("chosen", "said"),
    [
        (
            {"namespace": "left arm"},
            "namespace: 'left arm' is not a valid name; use letters, digits and _",
        ),
        ({"params_file": "/no/such/file.yaml"}, "params_file: /no/such/file.yaml is not a file"),
        ({"command_timeout_s": "soon"}, "command_timeout_s: 'soon' is not a time in seconds"),
    ],
)
def test_an_argument_that_is_wrong_starts_nothing(
    cell: LaunchDescription, chosen: dict[str, str], said: str
) -> None:
    with pytest.raises(RuntimeError, match=f"nothing was started: {said}"):
        cell.started(**chosen)


def test_what_is_chosen_reaches_the_calibration_node(
    cell: LaunchDescription, tmp_path: Path
) -> None:
    file = tmp_path / "cell.yaml"
    file.touch()
    chosen = {"method": "apso", "on_failure": "hold", "command_timeout_s": "0.5"}
    node, values = cell.started(**chosen, params_file=str(file))["calibration_node"]
    assert {name: values[name] for name in chosen} == {**chosen, "command_timeout_s": 0.5}
    assert node.files == [str(file)]
    node, values = cell.started()["calibration_node"]
    assert not set(chosen) & set(values)  # left to the file or to the default of the node
    assert node.files == []
    allowed = {argument.name: argument.choices for argument in cell.arguments}
    assert allowed["method"] == ["", *METHODS]
    assert allowed["on_failure"] == ["", *ON_FAILURE]


def test_a_file_of_parameters_is_for_own_nodes_alone(
    cell: LaunchDescription, tmp_path: Path
) -> None:
    (tmp_path / "cell.yaml").touch()
    started = cell.started(params_file=str(tmp_path / "cell.yaml"), **EVERYTHING)
    for executable, (node, _) in started.items():
        assert bool(node.files) == (node.package == PACKAGE), executable


def test_two_robots_share_no_topic_no_frame_and_no_file(cell: LaunchDescription) -> None:
    """All nodes are in the namespace, frames have the prefix, and output files differ."""
    for space in ("left", "/right/arm/"):
        name = space.strip("/")
        started = cell.started(namespace=space, **EVERYTHING)
        assert {node.namespace for node, _ in started.values()} == {name}
        for executable in ("calibration_node", "simulated_tracker", "robot_description"):
            assert started[executable][1]["frame_prefix"] == f"{name}/"
        joined = name.replace("/", "_")
        assert started["calibration_node"][1]["output"] == f"{joined}_calibration.yaml"
        assert started["session_recorder"][1]["output"] == f"{joined}_session"
        _, links = started["robot_state_publisher"]
        assert shlex.split(links["robot_description"])[-2:] == ["--frame-prefix", f"{name}/"]
        assert "frame_prefix" not in links  # otherwise links would get the prefix twice
        rviz, _ = started["rviz2"]
        assert rviz.arguments[-2:] == ["-f", f"{name}/base_link"]
        assert ("/tracker/pose", f"/{name}/tracker/pose") in rviz.remappings


def test_rviz_is_led_to_every_topic_that_it_shows(cell: LaunchDescription) -> None:
    shown = {
        line.split()[-1]
        for line in (ROOT / "config" / "cell.rviz").read_text().splitlines()
        if line.strip().startswith("Value: /")
    }
    rviz, _ = cell.started(namespace="left")["rviz2"]
    assert {before for before, _ in rviz.remappings} == shown
    assert cell.started()["rviz2"][0].remappings == []


def test_a_robot_alone_has_plain_names(cell: LaunchDescription) -> None:
    started = cell.started(**EVERYTHING)
    assert {node.namespace for node, _ in started.values()} == {None}
    assert started["simulated_tracker"][1]["frame_prefix"] == ""
    assert started["calibration_node"][1]["output"] == "calibration.yaml"
    assert started["session_recorder"][1]["output"] == "session"
    prefixed = cell.started(namespace="left", frame_prefix="l_")
    assert prefixed["simulated_tracker"][1]["frame_prefix"] == "l_"


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
    path = Path(node.arguments[1].perform(cell.context({})))
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
    assert len(found.entities) == len(load(FILE).arguments) + 1


def test_every_argument_is_used(cell: LaunchDescription) -> None:
    text = FILE.read_text(encoding="utf-8")
    for argument in cell.arguments:
        assert text.count(f'"{argument.name}"') >= 2, argument.name
