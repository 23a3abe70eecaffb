"""Service responses that are sent after the callback has returned.

The events executor of rclpy 7.1 does not support coroutines, so a callback that waits would block
all others. Here it returns a `Deferred` instead of a response.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


class Deferred:
    """Placeholder for a response, which has to be sent on the executor's thread."""

    def __init__(self) -> None:
        self._send: Callable[[Any], None] | None = None

    def bind(self, send: Callable[[Any], None]) -> None:
        """Set the function that sends the response to the caller; called by the service."""
        self._send = send

    def answer(self, response: Any) -> None:
        """Send the response; further calls are ignored."""
        send, self._send = self._send, None
        if send is not None:
            send(response)


def allow_deferred(service: Any) -> None:
    """Let this service's callback return a `Deferred`."""
    send = service.send_response

    def send_or_wait(response: Any, header: Any) -> None:
        if isinstance(response, Deferred):
            response.bind(lambda answer: send(answer, header))
        else:
            send(response, header)

    service.send_response = send_or_wait
