"""Lifecycle node that is robust against invalid requests and failing callbacks.

In rclpy 7.1 a `change_state` request that does not fit the state raises out of `spin()`, and an
exception in a transition callback is swallowed. Here such a request is answered with false, and
such an exception is logged.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from delta_calibration.errors import CalibrationError
from delta_calibration.ros.parameters import ParameterTable, Spec
from delta_calibration.ros.peers import SERVICES, ShutToPeers
from delta_calibration.ros.runtime import Finishing

AUTOSTART = Spec(
    "autostart",
    False,
    "configure and activate at start, without a lifecycle manager",
    read_only=True,
)


class SafeLifecycleNode(Finishing, ShutToPeers, LifecycleNode):
    """Lifecycle node with the hooks `configure`, `activate`, `deactivate` and `cleanup`.

    A hook that raises CalibrationError refuses the transition: one line is logged, and the state
    does not change. Any other exception is logged with its traceback; everything is released and
    the node is unconfigured again. `cleanup` may be called in any state and has to release
    everything that exists.
    """

    def __init__(self, name: str, **kwargs: Any) -> None:
        super().__init__(name, **kwargs)
        table = ParameterTable(self, (AUTOSTART, SERVICES))
        self._autostart, self.serves = table.flag("autostart"), table.flag("services")
        self._change_state: Callable[..., Any] = self._service_change_state.callback
        self._service_change_state.callback = self._answer_change_state

    def configure(self) -> None:
        """Load and check everything the node needs."""

    def activate(self) -> None:
        """Start operation; managed publishers are activated after this."""

    def deactivate(self) -> None:
        """Stop operation; managed publishers are still active in here."""

    def cleanup(self) -> None:
        """Release everything that `configure` took, in any state."""

    @property
    def state(self) -> str:
        """Label of the lifecycle state: `unconfigured`, `inactive`, `active`, `finalized`."""
        return str(self._state_machine.current_state[1])

    def start(self) -> None:
        """Configure and activate if `autostart` says so; a refusal leaves the node up."""
        if not self._autostart:
            self.get_logger().info(
                "unconfigured: waiting for a lifecycle manager; with -p autostart:=true the node "
                "needs none"
            )
        elif self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def close(self) -> None:
        """Leave through the lifecycle's own shutdown: `deactivate` and `cleanup` are called."""
        if self.state in ("unconfigured", "inactive", "active"):
            self.trigger_shutdown()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition from `unconfigured` to `inactive`."""
        return self._attempt(self.configure, super().on_configure, state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition from `inactive` to `active`."""
        return self._attempt(self.activate, super().on_activate, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition from `active` to `inactive`."""
        return self._attempt(self.deactivate, super().on_deactivate, state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition from `inactive` to `unconfigured`."""
        return self._attempt(self.cleanup, super().on_cleanup, state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Transition to `finalized`; it cannot be refused, and failures are only logged."""
        if state.label == "active":
            self._attempt(self.deactivate, super().on_deactivate, state)
        self._attempt(self.cleanup, super().on_shutdown, state)
        return TransitionCallbackReturn.SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Release everything and deactivate publishers; then `unconfigured`, else `finalized`."""
        super().on_deactivate(state)
        return self._attempt(self.cleanup, super().on_error, state)

    def _attempt(
        self,
        hook: Callable[[], None],
        entities: Callable[[LifecycleState], TransitionCallbackReturn],
        state: LifecycleState,
    ) -> TransitionCallbackReturn:
        """Call a hook, then the managed entities; convert an exception to the return value."""
        try:
            hook()
            return entities(state)
        except CalibrationError as error:
            self.get_logger().error(f"{hook.__name__}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception:
            self.get_logger().error(f"{hook.__name__}: {traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR

    def _answer_change_state(
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        """Answer false to a request that does not fit the state; rclpy would end the process."""
        state = self.state
        if not self.serves:
            self.get_logger().warn("transition refused: services are off", once=True)
            response.success = False
            return response
        try:
            return self._change_state(request, response)
        except RuntimeError as error:  # RCLError
            asked = request.transition.label or request.transition.id
            self.get_logger().warn(f"transition {asked} refused in state '{state}': {error}")
            response.success = False
            return response
