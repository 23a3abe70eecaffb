"""Access rights of every node (topics and services), and the SROS 2 policy that grants them.

SROS 2 gives each process an identity (an enclave) and lets it publish, subscribe, reply and
request only what a policy allows. The policy is generated here from the list of topics and
services that each node opens. The list is kept apart from the nodes, as the command line works
without ROS; test/test_access.py compares it with the graph of the running nodes.

Source: ROS 2 design, "ROS 2 access control policies", policy format 0.2.0.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from xml.etree import ElementTree

from delta_calibration.errors import InputError

VERSION = "0.2.0"
FOLDER = "delta_calibration"
OPERATOR = "operator"
CALIBRATION_NODE = "calibration_node"

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_INPUTS = (
    "joint_command",
    "joint_states",
    "tracker/pose",
    "tracker/point",
    "cell/temperature",
    "cell/payload",
)
_LOOK = tuple(
    f"~/{name}"
    for name in (
        "describe_parameters",
        "get_parameter_types",
        "get_parameters",
        "list_parameters",
        "get_type_description",
    )
)
_SET = ("~/set_parameters", "~/set_parameters_atomically")
_LIFECYCLE = tuple(
    f"~/{name}"
    for name in (
        "change_state",
        "get_state",
        "get_available_states",
        "get_available_transitions",
        "get_transition_graph",
    )
)
_ORDERS = tuple(
    f"~/{name}"
    for name in ("enable", "fit", "diagnose", "save", "reload", "start_capture", "stop_capture")
)


@dataclass(frozen=True)
class Rights:
    """Access rights of one node; names as in its code, `~/` private, `/` outside any namespace.

    Attributes:
        node: name of the node.
        publish: topics that it publishes.
        subscribe: topics that it subscribes to.
        reply: services that it offers.
        request: services of other nodes that it calls.
    """

    node: str
    publish: tuple[str, ...]
    subscribe: tuple[str, ...]
    reply: tuple[str, ...] = ()
    request: tuple[str, ...] = ()


def _node(name: str, publish: Iterable[str], subscribe: Iterable[str]) -> Rights:
    """Rights of a node, with those that every ROS node needs: parameters, log, simulated time."""
    return Rights(
        name,
        (*publish, "/parameter_events", "/rosout"),
        (*subscribe, "/clock"),
        (*_LOOK, *_SET),
    )


_CALIBRATION = replace(
    _node(
        CALIBRATION_NODE,
        (
            "joint_command_compensated",
            "joint_states_nominal",
            "~/status",
            "~/markers",
            "~/progress",
            "~/transition_event",
            "/diagnostics",
        ),
        _INPUTS,
    ),
    reply=(*_LOOK, *_SET, *_LIFECYCLE, *_ORDERS),
)
NODES = (
    _CALIBRATION,
    _node(
        "simulated_tracker",
        ("joint_states", "tracker/pose", "cell/temperature", "cell/payload", "/diagnostics"),
        ("joint_command_compensated", "cell/payload"),
    ),
    _node(
        "measurement_plan",
        ("joint_command", "~/progress", "/diagnostics"),
        ("joint_states", "joint_states_nominal"),
    ),
    _node(
        "grid_positioner",
        ("joint_command", "/diagnostics"),
        ("joint_states", "tracker/pose", "tracker/point"),
    ),
    _node(
        "robot_description",
        ("joint_states_all", "robot_description", "/diagnostics"),
        ("joint_states",),
    ),
    _node("session_recorder", ("/diagnostics",), _INPUTS),
    replace(_node("session_player", (*_INPUTS, "/clock"), ()), subscribe=()),
)


def rights(
    controllers: Iterable[str] = (), trajectory_input: str = "", operator: bool = True
) -> tuple[Rights, ...]:
    """Rights of every node of the package, for the configuration of one cell.

    Args:
        controllers: names of the ros2_control controllers that `calibration_node` publishes to:
            the values of its parameters `command_controller` and `trajectory_controller`.
        trajectory_input: value of its parameter `trajectory_input`; empty for none.
        operator: whether to add an operator identity, which may call the services and transitions
            and set the parameters of `calibration_node`.

    Raises:
        InputError: a name that no topic can have.
    """
    sent = [
        f"{_checked('controller', name)}/{topic}"
        for name in controllers
        for topic in ("commands", "joint_trajectory")
    ]
    heard = [_checked("trajectory input", trajectory_input)] if trajectory_input else []
    node = replace(
        _CALIBRATION,
        publish=(*_CALIBRATION.publish, *sent),
        subscribe=(*_CALIBRATION.subscribe, *heard),
    )
    others = (_operator(),) if operator else ()
    return (node, *NODES[1:], *others)


def _operator() -> Rights:
    """Rights of the operator identity, whatever its node is called."""
    asked = tuple(f"{CALIBRATION_NODE}/{name[2:]}" for name in _CALIBRATION.reply)
    own = _node(OPERATOR, (), ("/diagnostics", "/rosout", f"{CALIBRATION_NODE}/status"))
    return replace(own, request=asked)


def policy(every: Iterable[Rights], namespace: str = "/") -> str:
    """Write the policy (XML) with one enclave for each node, `/delta_calibration/NODE`.

    Args:
        every: rights to allow; everything else is denied.
        namespace: of the nodes; the enclaves lie under it as well.

    Raises:
        InputError: a namespace that no node can have.
    """
    inner = namespace.strip("/")
    path = f"/{_checked('namespace', inner)}" if inner else ""
    root = ElementTree.Element("policy", version=VERSION)
    enclaves = ElementTree.SubElement(root, "enclaves")
    for one in every:
        _enclave(enclaves, one, path)
    ElementTree.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ElementTree.tostring(root, "unicode")}\n'


def _enclave(enclaves: ElementTree.Element, one: Rights, path: str) -> None:
    name = f"{path}/{FOLDER}/{one.node}"
    profiles = ElementTree.SubElement(
        ElementTree.SubElement(enclaves, "enclave", path=name), "profiles"
    )
    profile = ElementTree.SubElement(profiles, "profile", ns=path or "/", node=one.node)
    for kind, verb, names in (
        ("topic", "publish", one.publish),
        ("topic", "subscribe", one.subscribe),
        ("service", "reply", one.reply),
        ("service", "request", one.request),
    ):
        if names:
            group = ElementTree.SubElement(profile, f"{kind}s", {verb: "ALLOW"})
            for each in sorted(set(names)):
                ElementTree.SubElement(group, kind).text = each


def _checked(what: str, name: str) -> str:
    if not _NAME.fullmatch(name.removeprefix("/")):
        raise InputError(
            f"{what}: {name!r} is not a valid ROS name: letters, digits and _, separated by /; "
            "no part begins with a digit"
        )
    return name
