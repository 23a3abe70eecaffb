"""What peers on the network may do to a node: all of it, or, with `services:=false`, look on."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import SetParametersResult

from delta_calibration.ros.parameters import Spec

# What rclpy gives nodes: to be read by peers, refused where it would change the node.
ROS_OWN = frozenset(
    (
        "describe_parameters",
        "get_parameter_types",
        "get_parameters",
        "list_parameters",
        "set_parameters",
        "set_parameters_atomically",
        "get_type_description",
        "change_state",
        "get_state",
        "get_available_states",
        "get_available_transitions",
        "get_transition_graph",
    )
)
SERVICES = Spec(
    "services",
    True,
    "whether other nodes may call services, change the state and set parameters; if false, only "
    "the process that starts the node controls it: by parameters at the start, autostart, "
    "enabled and signals",
    read_only=True,
)


class ShutToPeers:
    """Mixin of a node whose parameter `services` may shut it to its peers."""

    serves = True  # what the parameter says

    def shut_to_peers(self: Any) -> None:
        """Where services are off, end those of the node itself, and take no parameter any more.

        Called once the node stands.
        """
        if self.serves:
            return
        own = self.get_fully_qualified_name() + "/"
        for service in list(self.services):
            if service.service_name.removeprefix(own) not in ROS_OWN:
                self.destroy_service(service)
        self.add_on_set_parameters_callback(_refuse_change)


def _refuse_change(_changed: list[Any]) -> SetParametersResult:
    return SetParametersResult(successful=False, reason="services are off (services:=false)")
