"""Check that the commands of a node are received, and still forwarded to the drives."""

from __future__ import annotations

import time
from dataclasses import dataclass

from lifecycle_msgs.srv import GetState
from rclpy.client import Client
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.task import Future

SETTLE_S = 2.0  # [s] a publisher may know of a subscriber long before that knows of it
FAREWELL_S = 1.0  # [s] for the last command to arrive
PERIOD_S = 0.2
AGAIN_S = 1.0  # [s] until a request is repeated: discovery may be incomplete, the answer lost
LASTS_S = 0.5  # [s] that a problem must last, as Ctrl-C ends all nodes one after another
SILENT_S = 3.0  # [s] without an answer, after which a node is assumed to hang
ACTIVE = "active"
STATE_TYPE = "lifecycle_msgs/srv/GetState"
UNKNOWN = "_NODE_NAME_UNKNOWN_"


@dataclass
class _Managed:
    """A lifecycle node among the subscribers."""

    client: Client
    heard_s: float  # time of its last answer, or when it was found
    state: str = ""  # according to that answer
    asked_s: float = 0.0
    answer: Future | None = None


class Driven:
    """Monitors the subscribers of a publisher: their number, and the states of lifecycle nodes.

    An inactive calibration node subscribes but forwards nothing; one that is gone or finalized no
    longer subscribes. In both cases the machine stands still, and further commands are useless.

    Args:
        node: node that sends commands.
        commands: its publisher.
        wanted: required number of subscribers.
    """

    def __init__(self, node: Node, commands: Publisher, wanted: int) -> None:
        self._node, self._commands, self._wanted = node, commands, wanted
        self._listeners: set[str] = set()  # full names of the nodes at the last check
        self._managed: dict[str, _Managed] = {}
        self._met: tuple[str, float] | None = None  # first problem, and its time
        node.create_timer(PERIOD_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def trouble(self) -> str:
        """Reason why the commands do not reach the drives; empty if they do."""
        topic, now_s = self._commands.topic_name, time.monotonic()
        for name, managed in self._managed.items():
            if name not in self._listeners:
                was = f", and was {managed.state}" if managed.state else ""
                return f"{name} no longer listens to {topic}{was}"
            if managed.state and managed.state != ACTIVE:
                return f"{name} is {managed.state} and forwards nothing; activate it"
            if now_s - managed.heard_s > SILENT_S:
                return f"{name} has not reported for {SILENT_S:g} s whether it is active"
        found = self._commands.get_subscription_count()
        if found < self._wanted:
            who = f"only {found} of {self._wanted}" if found else "nobody"
            return f"{who} listens to {topic}"
        return ""

    def lasting_trouble(self) -> str:
        """First problem, once problems have lasted for `LASTS_S`; called at every command."""
        trouble, now_s = self.trouble(), time.monotonic()
        if not trouble:
            self._met = None
            return ""
        if self._met is None:
            self._met = trouble, now_s
        begun, since_s = self._met
        return begun if now_s - since_s >= LASTS_S else ""

    def known(self) -> bool:
        """Whether the state of every lifecycle node that subscribed is known."""
        return all(managed.state for managed in self._managed.values())

    def forget(self) -> None:
        """Forget nodes that have gone; allowed before the motion begins."""
        for name in set(self._managed) - self._listeners:
            self._node.destroy_client(self._managed.pop(name).client)

    def _look(self) -> None:
        now_s = time.monotonic()
        found = self._node.get_subscriptions_info_by_topic(self._commands.topic_name)
        self._listeners = {_full_name(info.node_namespace, info.node_name) for info in found}
        services = dict(self._node.get_service_names_and_types())
        for name in self._listeners - set(self._managed):
            service = f"{name}/get_state"
            if UNKNOWN not in name and STATE_TYPE in services.get(service, ()):
                client = self._node.create_client(GetState, service)
                self._managed[name] = _Managed(client, now_s)
        for managed in self._managed.values():
            _ask(managed, now_s)


def _ask(managed: _Managed, now_s: float) -> None:
    """Process an answer that has arrived, and request the state again."""
    answer = managed.answer
    if answer is not None and answer.done():
        managed.state, managed.heard_s = str(answer.result().current_state.label), now_s
        managed.answer = None
    if managed.answer is None or now_s - managed.asked_s > AGAIN_S:
        if managed.answer is not None:
            managed.client.remove_pending_request(managed.answer)
        managed.answer, managed.asked_s = managed.client.call_async(GetState.Request()), now_s


def _full_name(namespace: str, name: str) -> str:
    return f"{namespace.rstrip('/')}/{name}"
