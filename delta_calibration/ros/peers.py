"""What peers on the network may do to a node: all of it, or, with `services:=false`, look on."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from delta_calibration.ros.parameters import Spec
from delta_calibration.texts import bounded

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


@dataclass(frozen=True)
class Guarded:
    """Answers a request of a peer; one that the callback fails on is refused, and ends no node.

    In rclpy 7.1 a parameter of a type that there is not raises out of `spin()`.

    Attributes:
        answer: what is called with the request and the empty response.
        warn: logs a line.
    """

    answer: Callable[[Any, Any], Any]
    warn: Callable[[str], Any]

    def __call__(self, request: Any, response: Any) -> Any:
        """The response: the callback's, or a refusal."""
        try:
            return self.answer(request, response)
        except Exception as error:
            reason = bounded(f"request refused: {error}")
        self.warn(reason)
        refused = SetParametersResult(successful=False, reason=reason)
        if isinstance(response, SetParameters.Response):
            response.results = [refused] * len(request.parameters)
        elif isinstance(response, SetParametersAtomically.Response):
            response.result = refused
        return response


class ShutToPeers:
    """Mixin of a node that no request of a peer ends, and that `services` may shut to them."""

    serves = True  # what the parameter says

    def shut_to_peers(self: Any) -> None:
        """Guard the services that rclpy gives; where services are off, end all others.

        No parameter is taken any more then. Called once the node stands, or again.
        """
        own = self.get_fully_qualified_name() + "/"
        for service in list(self.services):
            if service.service_name.removeprefix(own) in ROS_OWN:
                if not isinstance(service.callback, Guarded):
                    service.callback = Guarded(service.callback, self.get_logger().warn)
            elif not self.serves:
                self.destroy_service(service)
        if not self.serves:
            self.add_on_set_parameters_callback(_refuse_change)


def _refuse_change(_changed: list[Any]) -> SetParametersResult:
    return SetParametersResult(successful=False, reason="services are off (services:=false)")
