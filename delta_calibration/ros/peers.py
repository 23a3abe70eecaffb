"""Access of network peers to a node: full, or read-only with `services:=false`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from delta_calibration.ros.parameters import Spec
from delta_calibration.texts import bounded

# Services that rclpy gives every node: peers may read, but changes of the node are refused.
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
    """Service callback that refuses a request on any exception, so that it cannot end the node.

    In rclpy 7.1 a parameter of an invalid type raises out of `spin()`.

    Attributes:
        answer: original callback, called with the request and the empty response.
        warn: function that logs a warning.
    """

    answer: Callable[[Any, Any], Any]
    warn: Callable[[str], Any]

    def __call__(self, request: Any, response: Any) -> Any:
        """Return the response of the original callback, or a refusal."""
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
    """Mixin that protects a node from requests of peers, and can close its services to them."""

    serves = True  # value of the parameter `services`

    def shut_to_peers(self: Any) -> None:
        """Guard the services of rclpy; if `services` is false, destroy all others.

        Parameter changes are then refused, too. To be called when the node is built, or again.
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
