"""`--help` of every node, and the inventory behind it compared with the real nodes."""

from __future__ import annotations

import shlex
import subprocess
import sys

import pytest

pytest.importorskip("rclpy")
from rclpy.node import Node
from ruamel.yaml import YAML

from delta_calibration.ros.driven import STATE_TYPE, Driven
from delta_calibration.ros.entry import run_node
from delta_calibration.ros.inventory import DRIVEN, INPUTS, NODES, Inventory
from delta_calibration.ros.node_help import asks_for_help, specs_of
from node_inventory import ROS_OWN, every_node, type_name
from ros_helpers import Bench, bench_fixture  # noqa: F401

pytestmark = pytest.mark.ros

# Values that node_inventory gives the calibration node.
GIVEN = {"command_controller": "controller", "trajectory_controller": "controller"}
GIVEN["trajectory_input"] = "trajectory_input"


@pytest.fixture(name="real", scope="module")
def real_fixture(tmp_path_factory: pytest.TempPathFactory):
    bench = Bench()
    try:
        nodes = every_node(bench, tmp_path_factory.mktemp("nodes"))
        yield nodes
        nodes["session_recorder"].close()
    finally:
        bench.take_down()


def names_of(inventory: Inventory, does: str) -> dict[str, str]:
    """Types by name, with names that follow from parameters."""
    found = {}
    for name, kind in getattr(inventory, does).items():
        for part, parameter in inventory.named.items():
            name = name.replace(part, GIVEN[parameter])
        found[name] = kind
    return found


def real_names(node: Node, entities: list[tuple[str, type]]) -> dict[str, str]:
    """The same from a real node, without what ROS adds."""
    home, found = f"{node.get_fully_qualified_name()}/", {}
    for name, kind in entities:
        if name.removeprefix(home).removeprefix("/") not in ROS_OWN:
            short = f"~/{name.removeprefix(home)}" if name.startswith(home) else name
            absolute = short in ("/diagnostics", "/clock")
            found[short if absolute else short.removeprefix("/")] = type_name(kind)
    return found


def test_every_node_is_in_the_inventory(real: dict[str, Node]) -> None:
    assert set(NODES) == set(real)


@pytest.mark.parametrize("name", NODES)
def test_the_inventory_is_what_the_node_has(name: str, real: dict[str, Node]) -> None:
    node, inventory = real[name], NODES[name]
    published = real_names(node, [(p.topic_name, p.msg_type) for p in node.publishers])
    expected = names_of(inventory, "publishes")
    if name == "session_player":  # it publishes the topics of the session
        assert published.items() <= expected.items()
        assert expected == INPUTS | {"/clock": published["/clock"]}
    else:
        assert published == expected
    heard = real_names(node, [(s.topic_name, s.msg_type) for s in node.subscriptions])
    assert heard == names_of(inventory, "subscribes")
    served = real_names(node, [(s.service_name, s.srv_type) for s in node.services])
    assert served == names_of(inventory, "serves")
    drives = any(isinstance(part, Driven) for part in vars(node).values())
    assert inventory.calls == (DRIVEN if drives else {})
    assert set(DRIVEN.values()) == {STATE_TYPE}


@pytest.mark.parametrize("option", ["--help", "-h"])
@pytest.mark.parametrize("name", NODES)
def test_help_tells_all_that_can_be_given(
    name: str,
    option: str,
    real: dict[str, Node],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(sys, "argv", [name, option])
    assert run_node(name) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{name}: ")
    lines = said.splitlines()
    assert f"    ros2 run delta_calibration {name} {NODES[name].example}" in lines
    ros_own = ("use_sim_time", "start_type_description_service", "qos_overrides.")
    declared = {p for p in real[name].list_parameters([], 0).names if not p.startswith(ros_own)}
    told = {line.split(" = ")[0].strip(): line for line in lines if " = " in line}
    assert set(told) == declared
    for spec in specs_of(name):
        assert all(choice in told[spec.name] for choice in spec.choices)
        assert ("at the start only" in told[spec.name]) == spec.read_only
        if spec.range is not None:
            low, high = (f"{bound:.10g}" for bound in spec.range)
            assert f"from {low} to {high}" in told[spec.name]
        assert " ".join(spec.description.split()) in " ".join(said.split())


@pytest.mark.parametrize("name", NODES)
def test_an_example_would_be_taken(name: str) -> None:
    words = shlex.split(NODES[name].example)
    assert words.pop(0) == "--ros-args"
    specs = {spec.name: spec for spec in specs_of(name)}
    for flag, given in zip(words[::2], words[1::2], strict=True):
        parameter, value = given.split(":=")
        assert flag == "-p"
        found = YAML(typ="safe").load(value)
        assert type(found) is type(specs[parameter].default)
        assert specs[parameter].reason_against(found) is None


def test_help_that_is_a_parameters_value_is_none() -> None:
    assert not asks_for_help(["node", "--ros-args", "-p", "output:=x", "--help"])
    assert not asks_for_help(["--help"])


@pytest.mark.parametrize("name", NODES)
def test_a_module_that_is_run_by_python_tells_the_same(name: str) -> None:
    command = [sys.executable, "-m", f"delta_calibration.ros.{name}", "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.startswith(f"{name}: ")
    assert f"ros2 run delta_calibration {name}" in done.stdout


@pytest.mark.parametrize("name", [[], ["no_such_node"]])
def test_a_node_that_there_is_not_is_a_line(name: list[str]) -> None:
    command = [sys.executable, "-m", "delta_calibration.ros.entry", *name]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "is not a node; choose from: calibration_node, " in done.stderr
    assert "Traceback" not in done.stderr
