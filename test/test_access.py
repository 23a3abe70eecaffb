"""Tests of the SROS 2 policy: the rules of its schema, and what the running nodes really open."""

from __future__ import annotations

from configparser import ConfigParser
from pathlib import Path
from xml.etree import ElementTree

import pytest

from delta_calibration.access import NODES, OPERATOR, Rights, policy, rights
from delta_calibration.cli.main import run
from delta_calibration.errors import InputError

# Format 0.2.0: element: (required attributes, optional ones, children, whether one is required).
RULES = {
    "policy": ({"version"}, set(), {"enclaves"}, True),
    "enclaves": (set(), set(), {"enclave"}, True),
    "enclave": ({"path"}, set(), {"profiles"}, True),
    "profiles": (set(), {"type"}, {"profile", "metadata"}, True),
    "profile": ({"ns", "node"}, set(), {"topics", "services", "actions"}, False),
    "topics": (set(), {"publish", "subscribe"}, {"topic"}, True),
    "services": (set(), {"reply", "request"}, {"service"}, True),
    "topic": (set(), set(), set(), False),
    "service": (set(), set(), set(), False),
}
QUALIFIERS = {"publish", "subscribe", "reply", "request"}
# Opened with another robot or session than those of the inventory, or with use_sim_time.
BY_CHOICE = {
    "/clock": {n.node for n in NODES},
    "/tracker/pose": {"session_player"},
}
Names = dict[str, set[str]]


def faults(element: ElementTree.Element) -> list[str]:
    """Violations of the schema in an element and below it."""
    tag = element.tag
    if tag not in RULES:
        return [f"<{tag}> is no element of a policy"]
    must, may, children, needed = RULES[tag]
    found = set(element.attrib)
    wrong = [f"<{tag}> lacks {name}" for name in must - found]
    wrong += [f"<{tag}> has {name}" for name in found - must - may]
    wrong += [
        f"<{tag}> {name}={value}"
        for name, value in element.attrib.items()
        if name in QUALIFIERS and value not in ("ALLOW", "DENY")
    ]
    wrong += [f"<{tag}> holds <{child.tag}>" for child in element if child.tag not in children]
    if needed and not len(element):
        wrong.append(f"<{tag}> is empty")
    if tag == "policy" and (element.get("version"), len(element)) != ("0.2.0", 1):
        wrong.append("<policy> has to be of version 0.2.0 and hold one <enclaves>")
    return wrong + [fault for child in element for fault in faults(child)]


def allowed(text: str) -> dict[str, Names]:
    """Allowed full names by node and verb, as SROS 2 expands them."""
    every: dict[str, Names] = {}
    for profile in ElementTree.fromstring(text.encode()).iter("profile"):
        space = profile.attrib["ns"].rstrip("/") + "/"
        node = profile.attrib["node"]
        names = every.setdefault(node, {})
        for group in profile:
            (verb,) = group.attrib
            for entry in group:
                name = entry.text or ""
                full = name if name.startswith("/") else space + name
                full = f"{space}{node}{name[1:]}" if name.startswith("~") else full
                names.setdefault(verb, set()).add(full)
    return every


@pytest.mark.parametrize("namespace", ["/", "/cell_a", "hall/cell_b"])
def test_a_policy_keeps_the_rules_of_its_schema(namespace: str) -> None:
    text = policy(rights(("forward",), "plan"), namespace)
    assert faults(ElementTree.fromstring(text.encode())) == []


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ('version="0.2.0"', 'version="0.1.0"'),
        ("ALLOW", "MAYBE"),
        ("profile", "knot"),
        (' ns="/"', ""),
        ("<enclave path", "<enclave name"),
    ],
)
def test_the_rules_find_what_breaks_them(right: str, wrong: str) -> None:
    text = policy(NODES[:1]).replace(right, wrong)
    assert faults(ElementTree.fromstring(text.encode()))


def test_only_the_operator_may_ask() -> None:
    every = allowed(policy(rights()))
    assert {node for node, names in every.items() if "request" in names} == {OPERATOR}
    assert every[OPERATOR]["request"] == every["calibration_node"]["reply"]
    assert OPERATOR not in allowed(policy(rights(operator=False)))


def test_a_controller_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["sros2", "--policy", "--namespace", "cell_a", "--controller", "fwd"]) == 0
    published = allowed(capsys.readouterr().out)["calibration_node"]["publish"]
    assert {"/cell_a/fwd/commands", "/cell_a/fwd/joint_trajectory"} <= published


def test_the_policy_is_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "policy.xml"
    assert run(["sros2", "--policy", "--out", str(out)]) == 0
    assert out.read_text() == policy(rights())
    capsys.readouterr()
    assert run(["sros2"]) == 0
    assert capsys.readouterr().out == policy(rights())


@pytest.mark.parametrize("name", ["a b", "<x>", "1st", "a//b"])
def test_a_name_that_ros_does_not_know_is_refused(name: str) -> None:
    with pytest.raises(InputError, match="not a valid ROS name"):
        rights((name,))
    with pytest.raises(InputError, match="not a valid ROS name"):
        policy(NODES, name)


def missing_and_beyond(node: Rights, opened: Names) -> tuple[set[str], set[str]]:
    """Names that a node opens without permission, and names that it may open but does not."""
    told = allowed(policy([node]))[node.node]
    lacks = {
        f"{verb} {n}" for verb, names in opened.items() for n in names - told.get(verb, set())
    }
    free = {name for name, nodes in BY_CHOICE.items() if node.node in nodes}
    more = {
        f"{verb} {n}"
        for verb, names in told.items()
        for n in names - opened.get(verb, set()) - free
    }
    return lacks, more


@pytest.mark.ros
def test_the_policy_is_what_the_running_nodes_open(tmp_path: Path) -> None:
    """For each node of the graph everything that it opens is allowed, and nothing else is."""
    pytest.importorskip("rclpy")
    from node_inventory import every_node
    from ros_helpers import Bench

    bench = Bench()
    try:
        nodes = every_node(bench, tmp_path)
        told = {r.node: r for r in rights(("controller",), "trajectory_input", operator=False)}
        assert set(nodes) == set(told)
        for name, node in nodes.items():
            lacks, more = missing_and_beyond(told[name], opened_by(node))
            assert (name, lacks, more) == (name, set(), set())
        nodes["session_recorder"].close()
    finally:
        bench.take_down()


def opened_by(node: object) -> Names:
    """Names that the graph lists for a node."""
    ways = dict(publish="publisher", subscribe="subscriber", reply="service", request="client")
    own = node.get_name(), node.get_namespace()  # type: ignore[attr-defined]
    return {
        verb: {name for name, _ in getattr(node, f"get_{what}_names_and_types_by_node")(*own)}
        for verb, what in ways.items()
    }


def test_every_node_that_is_installed_has_rights() -> None:
    setup = ConfigParser()
    setup.read(Path(__file__).parents[1] / "setup.cfg")
    scripts = setup["options.entry_points"]["console_scripts"].splitlines()
    nodes = {line.split("=")[0].strip() for line in scripts if "ros.entry:" in line}
    assert nodes == {one.node for one in NODES}
