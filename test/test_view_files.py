"""RViz and Foxglove files name only topics that a cell publishes or a session contains."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

pytest.importorskip("rclpy")
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from delta_calibration.cell.guard_trail import SEEN
from delta_calibration.robot import load_robot
from delta_calibration.ros.calibration_node import CalibrationNode
from delta_calibration.ros.qos import INPUTS
from delta_calibration.ros.robot_description import RobotDescription
from delta_calibration.ros.simulated_tracker import SimulatedTracker
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

CONFIG = Path(__file__).parents[1] / "config"
RVIZ = YAML(typ="safe").load(CONFIG / "cell.rviz")["Visualization Manager"]
LAYOUT = json.loads((CONFIG / "cell.foxglove.json").read_text(encoding="utf-8"))
SHOWS = {  # types that RViz's displays take
    "RobotModel": "std_msgs/msg/String",
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "Pose": "geometry_msgs/msg/PoseStamped",
    "PointStamped": "geometry_msgs/msg/PointStamped",
}
SCENE = {"geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PointStamped", SHOWS["MarkerArray"]}
PANELS = {  # types that Foxglove's panels take, by the setting with the topic
    "DiagnosticSummary": ("topicToRender", "diagnostic_msgs/msg/DiagnosticArray"),
    "RawMessages": ("topicPath", None),
}


@pytest.fixture(name="published")
def published_fixture(bench: Bench) -> dict[str, str]:
    """Topics and types of a running cell, from its nodes, and of a session."""
    start = [Parameter("autostart", value=True)]
    node = bench.add(CalibrationNode(context=bench.context, parameter_overrides=start))
    node.start()
    for kind in (SimulatedTracker, RobotDescription):
        bench.add(kind(context=bench.context))

    def told() -> dict[str, str]:
        named = node.get_topic_names_and_types()
        return {topic: types[0] for topic, types in named if node.count_publishers(topic)}

    last = {"/joint_command_compensated", "/cell/payload", "/robot_description"}
    assert bench.until(lambda: last <= set(told()))
    return {f"/{topic.name}": topic.type_name for topic in INPUTS} | told()


def displays() -> Iterator[tuple[str, dict[str, Any]]]:
    """Kind and topic settings of each RViz display with a topic."""
    for display in RVIZ["Displays"]:
        topic = display.get("Topic") or display.get("Description Topic")
        if topic is not None:
            yield display["Class"].removeprefix("rviz_default_plugins/"), topic


def panels(kind: str) -> list[dict[str, Any]]:
    found = [v for name, v in LAYOUT["configById"].items() if name.split("!")[0] == kind]
    assert found
    return found


def test_rviz_shows_what_is_published(published: dict[str, str], bench: Bench) -> None:
    shown = {topic["Value"]: SHOWS[kind] for kind, topic in displays()}
    assert {"/robot_description", "/calibration_node/markers", "/tracker/pose"} <= set(shown)
    assert shown.items() <= published.items()
    assert RVIZ["Global Options"]["Fixed Frame"] == "base_link"


def test_rviz_asks_for_no_better_service_than_there_is(
    published: dict[str, str], bench: Bench
) -> None:
    """Latched topics are requested as latched, streams of drivers as best effort."""
    for _, topic in displays():
        found = bench.nodes[0].get_publishers_info_by_topic(topic["Value"])
        assert found or topic["Value"] == "/tracker/point"  # for a tracker without poses
        for info in found:
            latched = info.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
            assert (topic["Durability Policy"] == "Transient Local") == latched
            assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
        if topic["Value"].startswith("/tracker"):
            assert topic["Reliability Policy"] == "Best Effort"


def test_rviz_names_the_drawings(bench: Bench) -> None:
    (cell,) = (d for d in RVIZ["Displays"] if d["Class"].endswith("MarkerArray"))
    still = ["workspace", "region", "region edges", "nominal"]
    errors = ["error measured", "error calibrated"]
    assert [*cell["Namespaces"]] == [*still, *errors, *(f"guard: {what}" for what in SEEN)]


def test_foxglove_s_panels_show_what_is_published(published: dict[str, str]) -> None:
    for kind, (setting, wanted) in PANELS.items():
        for panel in panels(kind):
            assert panel[setting] in published
            assert wanted in (None, published[panel[setting]])


def test_foxglove_s_scenes_show_what_is_published(published: dict[str, str]) -> None:
    for panel in panels("3D"):
        assert panel["followTf"] in ("base_link", "tracker")
        assert panel["topics"]
        for topic in panel["topics"]:
            assert published[topic] in SCENE
        for layer in panel["layers"].values():
            if layer["layerId"] == "foxglove.Urdf":
                assert published[layer["topic"]] == SHOWS["RobotModel"]


def test_foxglove_s_plots_draw_fields_that_messages_have(published: dict[str, str]) -> None:
    for panel in panels("Plot"):
        assert panel["yAxisLabel"] in ("rad", "m", "deg C")
        for path in panel["paths"]:
            topic, *fields = path["value"].split(".")
            assert is_number(published[topic], fields), path["value"]


def is_number(kind: str, fields: list[str]) -> bool:
    """Whether a path through a message of this type ends in a number."""
    for field in fields:
        name, index = re.fullmatch(r"(\w+)(\[\d+\])?", field).groups()
        package, *_, message = kind.split("/")
        kind = getattr(import_module(f"{package}.msg"), message).get_fields_and_field_types()[name]
        listed = re.fullmatch(r"sequence<(.+)>", kind)
        assert (listed is not None) == (index is not None)
        kind = kind if listed is None else listed.group(1)
    return kind in ("double", "float")


def test_the_session_s_tab_needs_a_session_alone() -> None:
    held = {f"/{topic.name}" for topic in INPUTS}
    (tabs,) = panels("Tab")
    session = next(tab for tab in tabs["tabs"] if tab["title"] == "Session")
    for name in leaves(session["layout"]):
        panel = LAYOUT["configById"][name]
        topics = {path["value"].split(".")[0] for path in panel.get("paths", ())}
        assert topics | set(panel.get("topics", ())) <= held, name


def test_every_panel_has_a_place_and_every_place_a_panel() -> None:
    (tabs,) = panels("Tab")
    placed = [*leaves(LAYOUT["layout"])]
    for tab in tabs["tabs"]:
        placed += leaves(tab["layout"])
    assert sorted(placed) == sorted(LAYOUT["configById"])
    assert {"configById", "globalVariables", "playbackConfig", "layout"} <= set(LAYOUT)


def leaves(layout: Any) -> Iterator[str]:
    """Panels of a layout, which is divided in two repeatedly."""
    if isinstance(layout, str):
        yield layout
    else:
        assert layout["direction"] in ("row", "column")
        assert 0 < layout["splitPercentage"] < 100
        yield from leaves(layout["first"])
        yield from leaves(layout["second"])


def test_the_plots_name_joints_that_the_robot_has() -> None:
    joints = len(load_robot("srbd").joints.names)
    for panel in panels("Plot"):
        for path in panel["paths"]:
            index = re.search(r"position\[(\d+)\]", path["value"])
            assert index is None or int(index.group(1)) < joints
